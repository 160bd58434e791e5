"""Twins of the paper's baselines (table 1) in our code space; none of them can run live."""
