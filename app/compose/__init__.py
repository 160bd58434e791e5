"""The composition root: frozen settings in, a source, driver, sinks and view put together out."""
