"""`livedrive bench fuzz`: damaged bytes at every border, to see that no exception escapes."""
