"""One flat script a training stage: audio, diffusion, distill."""
