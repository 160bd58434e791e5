"""The decoder D(x, g; identity): code and gaze to mesh and Gaussians (paper section 3)."""
