"""Losses of distillation: the teacher's distribution, the truth's mouth (paper section 4.2)."""

import torch
from torch import Tensor

from encoder.denoiser.diffusion import Schedule
from encoder.denoiser.model import Denoiser
from encoder.training.geometry import TrainingFace


def dmd_loss(
    student: Denoiser, teacher: Denoiser, z: Tensor, audio: Tensor, gaze: Tensor, schedule: Schedule
) -> Tensor:
    """A loss whose gradient in z is the normalised difference of the two scores (Yin et al. 2024).

    With x0-predicting networks a score difference at tau is a difference of x0 predictions.
    """
    with torch.no_grad():
        tau = torch.randint(schedule.num_steps // 50, int(0.98 * schedule.num_steps) + 1, (len(z),))
        tau = tau.to(z.device)
        noisy = schedule.q_sample(z, tau, torch.randn_like(z))
        real, fake = teacher(noisy, tau, audio, gaze), student(noisy, tau, audio, gaze)
        scale = (z - real).abs().mean((1, 2), keepdim=True) + 1e-3
        target = z - (fake - real) / scale.clamp(min=0.05)
    return 0.5 * (z - target).square().mean()


def mouth_error(
    student: Denoiser, z: Tensor, codes: Tensor, weight: Tensor, face: TrainingFace
) -> Tensor:
    """Weighted squared error of the part of the codes that moves the mouth, in units of `z`.

    Sound does not tell when a blink comes, and the mean of blinks is no blink: lids are left out.
    """
    error = face.mouth(student.unstandardise(z) - codes) / student.expression_std
    return (error.square().mean(-1) * weight).mean()
