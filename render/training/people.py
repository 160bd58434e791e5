"""Virtual people: shapes drawn from the face data's 100 modes, mixed and recoloured skins."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.training.face_data import FaceData, geometry

Floats = NDArray[np.float32]
EYES = ("blue", "green", "grey", "brownlight", "brown")
STRENGTH = (0.60, 0.70)  # standard deviations of the shape modes
GAIN_SPREAD = 0.15  # how differently strong people make the same expression
HELD_OUT = 10_000  # seeds from here on are never trained on


@dataclass(frozen=True)
class Person:
    """A virtual person; the seed decides the rest."""

    modes: Floats  # [100] standard deviations
    skins: tuple[str, str]  # file names
    mix: float  # share of the second skin
    tone: Floats  # [3] gain of the stored colours
    eye: str
    gains: Floats  # [53] strength of each expression


def skins(face: FaceData) -> list[str]:
    """The MakeHuman skins; the LPS scan is kept for judging."""
    return sorted(p.name for p in (face.folder / "albedo").glob("mh_*.jpg"))


def draw(face: FaceData, seed: int) -> Person:
    rng = np.random.default_rng((seed, 77))
    names = skins(face)
    first, second = rng.choice(len(names), 2, replace=False)
    mix = 0.0 if rng.random() < 0.4 else float(rng.uniform(0.15, 0.85))
    warmth = rng.normal(0, 0.03)
    tone = rng.uniform(0.86, 1.04) * np.array([1 + warmth, 1.0, 1 - warmth])
    return Person(
        modes=(rng.standard_normal(100) * rng.uniform(*STRENGTH)).astype(np.float32),
        skins=(names[first], names[second]),
        mix=mix,
        tone=tone.astype(np.float32),
        eye=EYES[rng.integers(len(EYES))],
        gains=np.clip(rng.normal(1, GAIN_SPREAD, len(face.rig_names)), 0.6, 1.4).astype(np.float32),
    )


def texture(face: FaceData, person: Person) -> Floats:  # [1024, 2048, 3] 0..1
    out = face.image(f"albedo/{person.skins[0]}")[..., :3]
    if person.mix > 0:
        out = out + person.mix * (face.image(f"albedo/{person.skins[1]}")[..., :3] - out)
    return np.clip(out * person.tone, 0, 1)


def eye_texture(face: FaceData, name: str) -> Floats:
    return face.image(f"eye_{name}.png")[..., :3]


def neutral(face: FaceData, person: Person) -> Floats:  # [V, 3] mm
    return geometry(face, person.modes)
