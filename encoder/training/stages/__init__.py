"""The training stages, one script each."""
