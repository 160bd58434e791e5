"""Rule-made speech and aligned recordings."""
