"""Where Gaussians sit on the head."""
