"""What makes a face alive between words: head, brows, gaze and breath, after the denoiser."""
