"""Live sensors as one source, and their recorder."""
