"""A face without the decoder, a pack of tones and clips of voices: what stages learn from here."""

from pathlib import Path

import numpy as np
import torch

from encoder.capture import dataset
from encoder.capture.motion.channels import JAW_OPEN, RIG_NAMES
from encoder.denoiser.config import MOUTH
from encoder.training.geometry import TrainingFace
from encoder.training.streams.spoken import SpokenFrames

BASIS = np.linalg.qr(np.random.default_rng(0).standard_normal((256, 55)))[0].T.astype(np.float32)


def vertices(codes: torch.Tensor) -> torch.Tensor:
    return (codes @ torch.tensor(BASIS.T))[..., :30].unflatten(-1, (10, 3))


def mouth(codes: torch.Tensor) -> torch.Tensor:
    return torch.cat([codes[..., :MOUTH], torch.zeros_like(codes[..., MOUTH:])], -1)


FACE = TrainingFace(
    lambda rig: rig @ BASIS[: rig.shape[-1]] * 10, vertices, torch.ones(10), vertices,
    lambda codes: codes[..., :2], mouth, lambda codes: codes[..., MOUTH - 2 : MOUTH],
)  # fmt: skip


def pack_of_tones(folder: Path) -> Path:
    """Eight clips of tones: loud is open."""
    rng, clips = np.random.default_rng(0), []
    for truth in ("rules", "tracked", "envelope", "rest") * 2:
        level = np.clip(np.sin(np.arange(40) * 0.5 + rng.uniform(0, 6)), 0, 1)
        level = level * (truth != "rest")
        sound = np.repeat(level, 1600) * np.sin(np.arange(40 * 1600) * 0.05) * 0.3
        rig = np.zeros((40, len(RIG_NAMES)))
        rig[:, JAW_OPEN] = 0.4 * level
        gaze = np.tile([0.0, 0.0, 1.0], (40, 2, 1))
        phones = (level > 0.5).astype(int)
        clips.append(dataset.make_clip(sound, rig, gaze, phones, truth=truth, voice="tone"))
    shard = dataset.write_shard(folder / "shard_000.npz", clips)
    dataset.write_manifest(folder, [shard], {"tones": "made by rules"})
    return folder


def spoken(voices: dict[str, int], dim: int = 7) -> SpokenFrames:
    """Clips of these voices, of so many frames."""
    rng, count = np.random.default_rng(0), sum(voices.values())
    heard = rng.standard_normal((count, dim)).astype(np.float16)
    own, rig = rng.standard_normal((count, 256)), rng.random((count, 53))
    phones = rng.integers(-1, 40, count).astype(np.int8)
    whose = np.repeat(list(voices), list(voices.values()))
    lengths = np.array(list(voices.values()))
    return SpokenFrames(
        heard, own.astype(np.float16), rig.astype(np.float16), phones, whose, lengths,
        np.isin(whose, ["anna", "ben"]),
    )  # fmt: skip
