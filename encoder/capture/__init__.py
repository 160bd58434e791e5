"""The synthetic capture stage: speech, motion curves and the data pack. Numbers only."""
