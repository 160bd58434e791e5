"""The decoder as callables for training and evaluation in `encoder`."""
