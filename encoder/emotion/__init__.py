"""Emotions at run time (paper section 5.1)."""
