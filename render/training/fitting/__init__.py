"""Fitting Gaussians and networks to pictures."""
