"""The application: command line, driving loop, sinks. It composes sensors, encoder and render."""
