"""Identity: what the decoder needs to know about one person (the paper's Theta_id).

A neutral geometry, the colour of every shared Gaussian, the light that reaches the face at rest,
and a bias map for each level of the light decoder: all computed from a mean texture and a mean
geometry (`avatars/maker.py`). Hair is the person's own: Gaussians that do not move with the face,
and a beard that does.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.decoder import avatar_check, density
from render.decoder import beard as beards
from render.decoder.beard import Beard
from render.decoder.learned import avatar_files, weights_file
from render.decoder.posing import GEOMETRY_STEPS, Rest
from render.strands import Hair
from render.types import Density, Floats

KIND = "identity"
GLOSS_STEPS, DETAIL_STEPS = 160, 128  # in a file, a whole


@dataclass(frozen=True, eq=False)
class Identity:
    """One person at rest."""

    name: str
    rest: Rest
    albedo: Floats  # [N, 3] 0..1 stored colours of the anchored Gaussians
    gloss: Floats  # [N] weight of the light that they mirror, about 0..1.3
    opacity_factors: Floats  # [N] 0..1 factor of their opacities: 0 where hair covers them
    visibility: Floats  # [4, U] shares of the sky, of the key light and the rims at rest
    biases: tuple[Floats, ...]  # per level [texels, C]
    hair: Hair  # [H]
    beard: Beard  # [B] brows, lashes and beard
    wrinkles: float = 1.0  # how deep those of an expression are: 1 at middle age
    # [n] by density: factors of the brightness of the Gaussians drawn, of thinner heads
    detail: dict[Density, Floats] = field(default_factory=dict[Density, Floats])

    @property
    def geometry(self) -> Floats:
        """[V, 3] mm: the face at rest."""
        return self.rest.geometry

    @property
    def eye_centers(self) -> Floats:
        """[2, 3] mm, left eye first."""
        return self.rest.eye_centers


def load(name: str, folder: Path | None = None) -> Identity:
    """Load one identity by its name, or from FILE.safetensors; its tensors are checked, against
    the decoder in `folder` if one is there.

    Raises InputError naming the ones that exist.
    """
    path = avatar_files.path_of(name, folder)
    t, _ = weights_file.load(path, KIND)
    whole = folder is not None and (folder / "prior.safetensors").is_file()
    avatar_check.check(t, path, folder if folder and whole else weights_file.FOLDER)
    name = path.stem.removeprefix(avatar_files.PREFIX)
    geometry = t["geometry"].astype(np.float32) / GEOMETRY_STEPS
    rest = Rest(geometry, t["eye_centers"], (t["reach_l"], t["reach_r"]), t["shut"])
    hair = Hair(
        means=t["hair_means"].astype(np.float32),
        quats=t["hair_quats"].astype(np.float32) / np.float32(127),
        scales=t["hair_scales"].astype(np.float32),
        opacities=t["hair_opacities"].astype(np.float32) / np.float32(255),
        albedo=t["hair_albedo"].astype(np.float32) / np.float32(255),
        seen=t["hair_seen"].astype(np.float32) / np.float32(255),
    )
    count = sum(key.startswith("bias") for key in t)
    return Identity(
        name=name,
        rest=rest,
        albedo=t["albedo"].astype(np.float32) / np.float32(255),
        gloss=t["gloss"].astype(np.float32) / np.float32(GLOSS_STEPS),
        opacity_factors=t["shown"].astype(np.float32) / np.float32(255),
        visibility=t["seen"].astype(np.float32) / np.float32(255),
        biases=tuple(t[f"bias{i}"].astype(np.float32) for i in range(count)),
        hair=hair,
        beard=beards.of(t),
        wrinkles=float(t["wrinkles"][0]) if "wrinkles" in t else 1.0,
        detail={
            preset: t[f"detail_{preset}"].astype(np.float32) / np.float32(DETAIL_STEPS)
            for preset in density.COUNTS
            if f"detail_{preset}" in t
        },
    )


def save(who: Identity, folder: Path, card: dict[str, Any], *, private: bool = False) -> None:
    """Write an avatar file and its card; what is kept is rounded, see `GEOMETRY_STEPS`.

    `private`: for their owner alone (0600), as somebody's face is."""
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
        "gloss": np.rint(np.clip(who.gloss * GLOSS_STEPS, 0, 255)).astype(np.uint8),
        "shown": byte(who.opacity_factors),
        "seen": byte(who.visibility),
        **{f"bias{i}": bias.astype(np.float16) for i, bias in enumerate(who.biases)},
        "hair_means": hair.means.astype(np.float16),
        "hair_quats": np.rint(hair.quats * 127).astype(np.int8),
        "hair_scales": hair.scales.astype(np.float16),
        "hair_opacities": byte(hair.opacities),
        "hair_albedo": byte(hair.albedo),
        "hair_seen": byte(hair.seen),
        **beards.tensors(who.beard),
        **({} if who.wrinkles == 1 else {"wrinkles": np.array([who.wrinkles], np.float32)}),
        **{
            f"detail_{preset}": np.rint(np.clip(gain * DETAIL_STEPS, 0, 255)).astype(np.uint8)
            for preset, gain in who.detail.items()
        },
    }
    path = folder / f"{avatar_files.PREFIX}{who.name}"
    weights_file.save(path, tensors, {"kind": KIND, **card}, private=private)
