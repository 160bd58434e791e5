"""Training streams: features beside motion."""
