"""Evaluation of rule-made data: comparison with real data, and alternative emotions."""
