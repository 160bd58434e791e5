"""The subjects of a data set: how each is made, and the importers of real motion."""
