"""What the prior is trained on: the face data on disk, people drawn from it, expressions."""
