"""The window: the driven head at the display's rate, in a process of its own."""
