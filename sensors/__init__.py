"""Sensors: microphone and eye cameras to 30 FPS frames, live, recorded or replayed."""
