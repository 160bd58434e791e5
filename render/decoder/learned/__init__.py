"""The learned part of the prior and its files."""
