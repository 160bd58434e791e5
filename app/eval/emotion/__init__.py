"""`livedrive eval emotion`."""
