"""`livedrive eval`: trained models, evaluated on held-out data."""
