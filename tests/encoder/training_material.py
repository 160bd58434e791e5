"""A face without the decoder, a pack of tones and clips of voices: what stages learn from here."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from encoder.audio.config import PRESETS as AUDIO
from encoder.audio.encoder import AudioEncoder
from encoder.capture import dataset
from encoder.capture.motion.channels import JAW_OPEN, RIG_NAMES
from encoder.denoiser.config import MOUTH, PRESETS, ZeroConvConfig
from encoder.denoiser.model import Denoiser
from encoder.denoiser.zero_conv import ZeroConvs
from encoder.emotion.labels import LABELS
from encoder.nn import checkpoint
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


def save(path: Path, module: torch.nn.Module, kind: str, **facts: Any) -> str:
    config = asdict(module.config)  # type: ignore[arg-type]
    tensors = facts.pop("tensors", module.state_dict())
    checkpoint.save(path, tensors, {"kind": kind, "config": config, "steps": 1, "seed": 0, **facts})
    return str(checkpoint.load(path, kind)[1]["sha256"])


def chain_that_hears_no_phones(folder: Path) -> dict[str, Path]:
    """Untrained, with a phonetic encoder and a pack beside it; the paths of a ListenConfig."""
    torch.manual_seed(0)
    old, out = folder / "old", folder / "out"
    save(old / "audio", AudioEncoder(AUDIO["debug"]), "audio")
    sizes = replace(PRESETS["debug"], audio_dim=AUDIO["debug"].frame_width)
    sha256 = save(old / "student", Denoiser(sizes), "student")
    seer = Denoiser(replace(sizes, condition="eyes", condition_dim=160))
    own = {k: v for k, v in seer.state_dict().items() if k.startswith(("input", "null_cond"))}
    save(old / "student_eyes", seer, "student", tensors=own, audio_model={"sha256": sha256})
    zero = ZeroConvs(ZeroConvConfig(labels=LABELS, places=sizes.places))
    save(old / "emotion", zero, "emotion", student_sha256=sha256)
    phones = replace(AUDIO["phonetic-debug"], past_ticks=2)
    save(folder / "phones" / "audio", AudioEncoder(phones), "audio")
    return {
        "pack": pack_of_tones(folder / "pack"), "phones": folder / "phones" / "audio",
        "old": old, "output": out, "pair": out / "audio",
    }  # fmt: skip
