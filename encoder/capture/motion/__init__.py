"""Rule-made face motion."""
