"""The face data on disk, as the prior's training reads it (units turned into millimetres).

Needs the folder with `ict_face.npz`, `albedo/`, `hair/`: the ICT Face Model Light (MIT) and
MakeHuman skins, eyes and hair (CC0). Nothing of it is needed, or read, once weights exist.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from render.decoder import posing
from render.decoder.mesh_parts import SKIN_VERTICES
from render.decoder.posing import straightened
from render.training.data import crowns, rounding, sex
from sensors import files
from sensors.types import InputError

FILE, AGAIN = "ict_face.npz", "get the face data again"
MM_PER_UNIT = 10.0
# How far a lower lip rolls in, of what the face data has: all of it hides thin lips, as in f and v.
ROLLED = 0.65
EYE_PICTURE_DEG = 80.0  # from the pupil to the middle of an edge of an eye's picture


@dataclass(frozen=True)
class FaceData:
    """The face model: everything linear, in millimetres."""

    folder: Path
    neutral: NDArray[np.float32]  # [V, 3] mm
    rig: NDArray[np.float32]  # [53, V, 3] mm at full activation
    rig_names: list[str]
    identities: NDArray[np.float16]  # [100, V, 3] units a standard deviation
    faces: NDArray[np.int32]  # [F, 3]
    uv_faces: NDArray[np.int32]  # [F, 3]
    uv: NDArray[np.float32]  # [U, 2], v up; u of the back of the head lies in 1..2
    materials: NDArray[np.str_]  # [F] name of each triangle's material
    vertex_color: NDArray[np.float32]  # [V, 3] 0..1 sRGB values
    vertex_ao: NDArray[np.float32]  # [V] 0..1 light that reaches the vertex
    regions: dict[str, NDArray[np.int32]]  # vertex sets by name
    landmarks: NDArray[np.int32]  # [68] vertices, in the order of iBUG 300-W

    @cached_property
    def feminine(self) -> NDArray[np.float32]:
        """[100] unit: see `render/training/data/sex.py`."""
        moves = self.identities.astype(np.float32) * np.float32(MM_PER_UNIT)
        return sex.axis(self.neutral, moves, self.landmarks)

    def image(self, name: str) -> NDArray[np.float32]:  # [H, W, 3 or 4] 0..1
        from PIL import Image

        return np.asarray(Image.open(self.folder / name), np.float32) / np.float32(255)

    def scan(self) -> NDArray[np.float32]:  # [V, 3] mm
        """A man's scan (LPS) in the identity shapes; raises InputError where the data lack it."""
        with files.arrays(self.folder / FILE, AGAIN) as z:
            return geometry(self, z["ident_lps"])


def load(folder: Path) -> FaceData:
    """Read the face data; raise InputError when the folder does not hold it."""
    path = folder / FILE
    if not path.is_file():
        raise InputError(
            f"face data: expected {path}, got no such file; give the folder with --face DIR"
        )
    with files.arrays(path, AGAIN) as z:
        materials = z["materials"].astype(str)[z["tri_material"]]
        neutral = z["neutral"] * MM_PER_UNIT
        uv = z["uv"].copy()
        for side, name in (("l", "M_ScleraLeft"), ("r", "M_ScleraRight")):
            rows = materials == name
            places = eye_places(neutral, z[f"region_eyeball_{side}"], mirrored=side == "r")
            uv[z["uv_tris"][rows]] = places[z["tris"][rows]]
        names = [str(name) for name in z["expr_names"]]
        rig = z["expr"].astype(np.float32) * MM_PER_UNIT
        rig[names.index("mouthRollLower")] *= ROLLED
        regions = {k.removeprefix("region_"): z[k] for k in z.files if k.startswith("region_")}
        landmarks = z["landmarks68"].astype(np.int32)
        rig = rounding.rounded(rig, names, neutral, SKIN_VERTICES, regions, landmarks)
        return FaceData(
            folder=folder,
            neutral=crowns.reshaped(neutral, z["tris"], regions),
            rig=rig,
            rig_names=names,
            identities=z["ident"],
            faces=z["tris"],
            uv_faces=z["uv_tris"],
            uv=uv,
            materials=materials,
            vertex_color=z["vertex_color"],
            vertex_ao=z["vertex_ao"],
            regions=regions,
            landmarks=landmarks,
        )


def eye_places(
    neutral: NDArray[np.float32],  # [V, 3] mm
    eyeball: NDArray[np.int32],
    mirrored: bool,
) -> NDArray[np.float32]:  # [V, 2]
    """Texture coordinates of an eyeball: the pupil in the middle, the distance from it the angle;
    the left edge towards the nose for both eyes."""
    straight = straightened(neutral[eyeball])
    arm = straight - posing.sphere_centre(straight)
    around = np.arctan2(arm[:, 1], -arm[:, 0] if mirrored else arm[:, 0])
    away = np.degrees(np.arccos(arm[:, 2] / np.linalg.norm(arm, axis=1)))
    radius = 0.499 * np.minimum(away / EYE_PICTURE_DEG, 1)
    out = np.zeros((len(neutral), 2), np.float32)
    out[eyeball] = 0.5 + radius[:, None] * np.stack([np.cos(around), np.sin(around)], 1)
    return out


def geometry(face: FaceData, modes: NDArray[np.float32]) -> NDArray[np.float32]:  # [V, 3] mm
    """The neutral head of one person; `modes` [100] are in standard deviations."""
    shape = np.tensordot(modes, face.identities.astype(np.float32), 1)
    return (face.neutral + shape * MM_PER_UNIT).astype(np.float32)
