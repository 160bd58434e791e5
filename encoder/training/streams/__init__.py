"""Training streams: features of the frozen encoders with the motion that belongs to them."""
