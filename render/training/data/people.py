"""Virtual people: shapes drawn from the face data's 100 modes, mixed and recoloured skins."""

from dataclasses import dataclass

import numpy as np

from render.decoder.mesh_parts import SKIN_VERTICES
from render.training.data import expressions
from render.training.data.face_data import FaceData, geometry
from render.types import Floats, Ints

EYES = ("blue", "green", "grey", "brownlight", "brown")
STRENGTH = (0.60, 0.70)  # standard deviations of the shape modes
FEMININE, FEMININE_SPREAD = 1.5, 0.7  # mean of women along the axis of `sex.py`; men: below zero
GAIN_SPREAD = 0.15  # how differently strong people make the same expression
HELD_OUT = 10_000  # seeds from here on are never trained on


# A face at rest: the data's neutral lids stare and its brows and mouth are grim.
RELAXED = {
    **{"eyeBlink": 0.05, "eyeSquint": 0.08, "cheekSquint": 0.06},
    **{"mouthSmile": 0.10, "mouthDimple": 0.04},
    **{"browInnerUp": 0.10, "browOuterUp": 0.08},
}


CORNERS, MIDDLE = [48, 54, 60, 64], [61, 62, 63, 65, 66, 67]  # of the mouth, of the 68 landmarks
LEVEL_MM = -0.1  # least height of the corners over the middle
CORNER_HALF_MM = np.array([12.0, 9.0, 12.0])  # what goes with a corner


@dataclass(frozen=True)
class Skin:
    """What lies on a person's tone; strengths, 0 is none."""

    blood: float = 1.0  # red of cheeks, nose and ears
    freckles: float = 0.0
    lips: float = 0.5  # how much redder than the skin's texture has them; below 0: less red
    melanin: float = 0.0  # how uneven it lies, of deep skin 1
    age: float = 0.0  # 0 young .. 1 old


@dataclass(frozen=True)
class VirtualPerson:
    """A virtual person; the seed decides the rest."""

    modes: Floats  # [100] standard deviations
    skins: tuple[str, str]  # file names
    mix: float  # share of the second skin
    tone: Floats  # [3] gain of the stored colours
    eye: str
    gains: Floats  # [53] strength of each expression
    skin: Skin  # what lies on top of the tone


def skins(face: FaceData) -> list[str]:
    """The MakeHuman skins; the LPS scan is kept for judging."""
    return sorted(p.name for p in (face.folder / "albedo").glob("mh_*.jpg"))


def draw(face: FaceData, seed: int) -> VirtualPerson:
    rng = np.random.default_rng((seed, 77))
    woman = rng.random() < 0.5
    names = [name for name in skins(face) if ("female" in name) == woman]
    first, second = rng.choice(len(names), 2, replace=False)
    mix = 0.0 if rng.random() < 0.3 else float(rng.uniform(0.15, 0.85))
    warmth = rng.normal(0, 0.03)
    tone = rng.uniform(0.86, 1.04) * np.array([1 + warmth, 1.0, 1 - warmth])
    modes = (rng.standard_normal(100) * rng.uniform(*STRENGTH)).astype(np.float32)
    leaning = rng.normal(FEMININE if woman else -FEMININE, FEMININE_SPREAD)
    return VirtualPerson(
        modes=leaning_to(face, modes, float(leaning)),
        skins=(names[first], names[second]),
        mix=mix,
        tone=tone.astype(np.float32),
        eye=EYES[rng.integers(len(EYES))],
        gains=np.clip(rng.normal(1, GAIN_SPREAD, len(face.rig_names)), 0.6, 1.4).astype(np.float32),
        skin=Skin(
            blood=float(rng.uniform(0.5, 1.3)),
            freckles=float(max(rng.normal(-0.4, 0.6), 0)),
            lips=float(rng.uniform(0.6, 1.1) if woman else rng.uniform(0.2, 0.6)),
        ),
    )


def neutral(face: FaceData, person: VirtualPerson) -> Floats:  # [V, 3] mm
    return relaxed(face, person.modes)


def leaning_to(face: FaceData, modes: Floats, feminine: float) -> Floats:  # [100] -> [100]
    """The same person so many deviations along the axis of sex; below zero: masculine."""
    return (modes + (feminine - modes @ face.feminine) * face.feminine).astype(np.float32)


def relaxed(face: FaceData, modes: Floats, wide: float = 0.0) -> Floats:  # [100] -> [V, 3] mm
    """Somebody's face at rest; `wide`: how far the lids are apart, of eyeWide."""
    rig = np.zeros(len(face.rig_names), np.float32)
    expressions.set_named(rig, face.rig_names, {**RELAXED, "eyeWide": wide})
    return geometry(face, modes) + np.tensordot(rig, face.rig, 1)


def levelled(landmarks: Ints, vertices: Floats) -> Floats:  # [68], [V, 3] mm -> [V, 3] mm
    """A face at rest whose mouth's corners do not hang, which looks sullen."""
    height = vertices[:, 1]
    hang = LEVEL_MM - float(height[landmarks[CORNERS]].mean() - height[landmarks[MIDDLE]].mean())
    middle = vertices[landmarks[CORNERS]].mean(0) * (0, 1, 1)
    middle[0] = np.abs(vertices[landmarks[CORNERS], 0]).mean()
    skin = vertices[:SKIN_VERTICES]
    away = (np.abs(skin) * (1, 0, 0) + skin * (0, 1, 1) - middle) / CORNER_HALF_MM
    out = vertices.copy()
    out[:SKIN_VERTICES, 1] += max(hang, 0) * np.exp(-(away**2).sum(1))
    return out
