"""`livedrive eval eyes`."""
