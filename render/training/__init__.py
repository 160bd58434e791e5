"""Training of the prior: the face data in, `render/weights/` out."""
