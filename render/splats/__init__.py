"""Splat renderers: Gaussians to pictures."""
