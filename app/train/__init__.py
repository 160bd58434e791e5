"""`livedrive train`: the training stages with what they need of the decoder."""
