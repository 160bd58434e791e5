"""One flat script a training stage."""
