"""`livedrive eval speech`."""
