"""Identity: what the decoder needs to know about one person (the paper's Theta_id).

A neutral geometry, the colour of every shared Gaussian, the light that reaches the face at rest,
and a bias map for each level of the light decoder: all computed from a mean texture and a mean
geometry (`render/avatar.py`). Hair is the person's own: Gaussians that do not move with the face,
and a beard that does.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from render import beard as beards
from render import weights_file
from render.beard import Beard
from render.errors import InputError
from render.posing import GEOMETRY_STEPS, Rest
from render.types import Gaussians

KIND = "identity"
PREFIX = "avatar_"
Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Identity:
    """One person at rest."""

    name: str
    rest: Rest
    albedo: Floats  # [N, 3] 0..1 stored colours of the anchored Gaussians
    shown: Floats  # [N] 0..1 factor of their opacities: 0 where hair covers them
    seen: Floats  # [2, U] shares of the sky and of the key light at rest
    biases: tuple[Floats, ...]  # per level [texels, C]
    hair: Gaussians  # [H]
    beard: Beard  # [B]

    @property
    def geometry(self) -> Floats:
        """[V, 3] mm: the face at rest."""
        return self.rest.geometry

    @property
    def eye_centers(self) -> Floats:
        """[2, 3] mm, left eye first."""
        return self.rest.eye_centers


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
    t, _ = weights_file.load(folder / f"{PREFIX}{name}", KIND)
    geometry = t["geometry"].astype(np.float32) / GEOMETRY_STEPS
    rest = Rest(geometry, t["eye_centers"], (t["reach_l"], t["reach_r"]), t["shut"])
    hair = Gaussians(
        means=t["hair_means"].astype(np.float32),
        quats=t["hair_quats"].astype(np.float32) / np.float32(127),
        scales=t["hair_scales"].astype(np.float32),
        opacities=t["hair_opacities"].astype(np.float32) / np.float32(255),
        colors=t["hair_colors"].astype(np.float32) / np.float32(255),
    )
    count = sum(key.startswith("bias") for key in t)
    return Identity(
        name=name,
        rest=rest,
        albedo=t["albedo"].astype(np.float32) / np.float32(255),
        shown=t["shown"].astype(np.float32) / np.float32(255),
        seen=t["seen"].astype(np.float32) / np.float32(255),
        biases=tuple(t[f"bias{i}"].astype(np.float32) for i in range(count)),
        hair=hair,
        beard=beards.of(t),
    )


def save(who: Identity, folder: Path, card: dict) -> None:  # type: ignore[type-arg]
    """Write an avatar file and its card; what is kept is rounded, see `GEOMETRY_STEPS`."""
    hair = who.hair

    def byte(values: Floats) -> NDArray[np.uint8]:
        return np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)

    steps = np.rint(who.geometry * GEOMETRY_STEPS).astype(np.int16)
    tensors = {
        "geometry": steps,
        "eye_centers": who.eye_centers.astype(np.float32),
        "reach_l": who.rest.reach[0],
        "reach_r": who.rest.reach[1],
        "shut": who.rest.shut,
        "albedo": byte(who.albedo),
        "shown": byte(who.shown),
        "seen": byte(who.seen),
        **{f"bias{i}": bias.astype(np.float16) for i, bias in enumerate(who.biases)},
        "hair_means": hair.means.astype(np.float16),
        "hair_quats": np.rint(hair.quats * 127).astype(np.int8),
        "hair_scales": hair.scales.astype(np.float16),
        "hair_opacities": byte(hair.opacities),
        "hair_colors": byte(hair.colors),
        **beards.tensors(who.beard),
    }
    weights_file.save(folder / f"{PREFIX}{who.name}", tensors, {"kind": KIND, **card})
