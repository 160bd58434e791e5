"""The encoder: sound and eyes in, expression codes and gaze out, never a future input."""
