"""`livedrive bench`: what things cost, measured."""
