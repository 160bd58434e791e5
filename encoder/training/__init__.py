"""Training of the encoder's networks: loop, losses, data streams, and a script a stage."""
