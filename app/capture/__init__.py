"""`livedrive capture`: the synthetic capture stage, composed of encoder and render."""
