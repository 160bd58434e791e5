"""Identity: what the decoder needs to know about one person (the paper's Theta_id).

An identity is a neutral geometry plus the colours of the Gaussians that the prior glues to it,
and the Gaussians that do not move with the face (hair). The paper computes bias maps from a mean
texture and a mean geometry; ours are baked by `render/training/prior.py`.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from render import weights_file
from render.errors import InputError
from render.types import Gaussians

KIND = "identity"
PREFIX = "avatar_"


@dataclass(frozen=True)
class Identity:
    """One person at rest."""

    name: str
    geometry: NDArray[np.float32]  # [V, 3] mm
    eye_centers: NDArray[np.float32]  # [2, 3] mm, left eye first
    colors: NDArray[np.float32]  # [N + 2 + H, 3] 0..1 sRGB: anchored Gaussians, highlights, hair
    opacities: NDArray[np.float32]  # [N + 2 + H] 0..1, in the same order
    hair: Gaussians  # [H]


def names(folder: Path = weights_file.FOLDER) -> list[str]:
    """The identities that can be loaded, sorted."""
    return sorted(path.stem.removeprefix(PREFIX) for path in folder.glob(f"{PREFIX}*.safetensors"))


def load(name: str, folder: Path = weights_file.FOLDER) -> Identity:
    """Load one identity; raise InputError naming the ones that exist."""
    if name not in names(folder):
        raise InputError(
            f"avatar: expected one of {', '.join(names(folder)) or '(none)'}, got {name!r}; "
            "run: livedrive avatar list"
        )
    tensors, _ = weights_file.load(folder / f"{PREFIX}{name}", KIND)
    hair = Gaussians(
        means=tensors["hair_means"].astype(np.float32),
        quats=tensors["hair_quats"].astype(np.float32),
        scales=tensors["hair_scales"].astype(np.float32),
        opacities=tensors["hair_opacities"].astype(np.float32),
        colors=tensors["hair_colors"].astype(np.float32) / np.float32(255),
    )
    skin = tensors["colors"].astype(np.float32) / np.float32(255)
    highlights = np.ones((2, 3), np.float32)
    shown = tensors["opacities"].astype(np.float32)
    return Identity(
        name=name,
        geometry=tensors["geometry"].astype(np.float32),
        eye_centers=tensors["eye_centers"].astype(np.float32),
        colors=np.concatenate([skin, highlights, hair.colors]),
        opacities=np.concatenate([shown, np.full(2, 0.8, np.float32), hair.opacities]),
        hair=hair,
    )
