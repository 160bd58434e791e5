"""`livedrive bench xr`: what a headset costs: its frames, and what they leave for the tick."""
