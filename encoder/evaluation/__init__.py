"""Metrics and test rows of the paper's tables."""
