"""The encoder's training stages with what they need of the decoder (DESIGN 2).

`encoder` never imports `render`: the map from rig to code and the vertices that the geometry
losses look at are handed over from here.
"""

import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from torch import Tensor

    from app.train import Train

LOSS_VERTICES = {"lips": 2, "eyelids": 4, "brows": 8, "upper_face": 12}  # region: every n-th vertex


@dataclass(frozen=True)
class Geometry:
    """The decoder as a differentiable function of codes; one vertex set for all identities."""

    to_code: np.ndarray  # [53, 256]
    to_vertices: "Tensor"  # [256, V * 3] mm

    def rig_to_code(self, rig: np.ndarray) -> np.ndarray:  # [..., 53] -> [..., 256]
        return rig.astype(np.float32) @ self.to_code

    def vertices(self, codes: "Tensor") -> "Tensor":  # [B, T, 256] -> [B, T, V, 3] mm
        """Offsets from rest; the neutral face cancels in every loss that compares two faces."""
        flat = codes @ self.to_vertices
        return flat.reshape(*codes.shape[:-1], -1, 3)


def geometry() -> Geometry:
    import torch

    from render.decoder import Decoder

    decoder = Decoder.load()
    chosen = np.unique(np.concatenate([decoder.regions[r][::n] for r, n in LOSS_VERTICES.items()]))
    rows = (chosen[:, None].astype(np.int64) * 3 + np.arange(3)).ravel()
    dense = np.asarray(decoder.basis[rows].todense(), np.float32)  # [V * 3, 53]
    return Geometry(decoder.to_code, torch.from_numpy(decoder.to_rig @ dense.T))


def run_stage(command: "Train") -> None:
    """Run one of audio, diffusion, distill; states and the teacher live in `data`."""
    import torch

    from encoder.inference import WEIGHTS

    torch.set_num_threads(1)
    out = command.out or WEIGHTS
    common: dict[str, Any] = {
        "seed": command.seed,
        "resume": command.resume,
        "state": command.data / f"{command.stage}.state",
        "note": (("command", _words(command)), ("commit", _commit())),
    }
    if command.stage == "audio":
        from encoder.training import audio

        audio.run(audio.preset(command.preset, pack=command.data, output=out / "audio", **common))
        return
    streams = _streams(command.data, out, command.seed)
    face = geometry()
    if command.stage == "diffusion":
        from encoder.training import diffusion

        config = diffusion.preset(
            command.preset, streams=streams, output=command.data / "teacher", **common
        )
        diffusion.run(config, face.rig_to_code, face.vertices)
    else:
        from encoder.training import distill

        config = distill.preset(
            command.preset,
            streams=streams,
            teacher=command.data / "teacher",
            output=out / "student",
            **common,
        )
        distill.run(config, face.rig_to_code, face.vertices)


def _streams(data: Path, weights: Path, seed: int) -> Path:
    """Features of the frozen audio encoder; made once for each audio checkpoint."""
    from encoder.training import streams

    path = data / "streams.npz"
    audio = weights / "audio"
    newest = audio.with_suffix(".safetensors")
    if not path.exists() or path.stat().st_mtime < newest.stat().st_mtime:
        heads = (data / "audio.state").with_suffix(".heads")
        streams.run(
            streams.StreamConfig(pack=data, audio=audio, heads=heads, output=path, seed=seed)
        )
    return path


def _words(command: "Train") -> str:
    return f"livedrive train {command.stage} --preset {command.preset} --seed {command.seed}"


def _commit() -> str:
    """The commit of the code that trains, for the card; "unknown" outside a checkout."""
    try:
        done = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return done.stdout.strip()
