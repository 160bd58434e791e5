"""Motion beyond speech, added after the denoiser: head, brows, gaze and breath."""
