"""The denoiser and its diffusion process (paper sections 4.1, 4.2, 5.1)."""
