"""The face data on disk, as the prior's training reads it (units turned into millimetres).

Needs the folder with `ict_face.npz`, `albedo/`, `hair/`: the ICT Face Model Light (MIT) and
MakeHuman skins, eyes and hair (CC0). Nothing of it is needed, or read, once weights exist.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from render.errors import InputError

MM_PER_UNIT = 10.0
SKIN_VERTICES = 11248  # the first vertices of the mesh are skin, the rest are parts


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

    def image(self, name: str) -> NDArray[np.float32]:  # [H, W, 3 or 4] 0..1
        from PIL import Image

        return np.asarray(Image.open(self.folder / name), np.float32) / np.float32(255)


def load(folder: Path) -> FaceData:
    """Read the face data; raise InputError when the folder does not hold it."""
    path = folder / "ict_face.npz"
    if not path.is_file():
        raise InputError(
            f"face data: expected {path}, got no such file; give the folder with --face DIR"
        )
    z = np.load(path, allow_pickle=False)
    materials = z["materials"].astype(str)[z["tri_material"]]
    return FaceData(
        folder=folder,
        neutral=z["neutral"] * MM_PER_UNIT,
        rig=z["expr"].astype(np.float32) * MM_PER_UNIT,
        rig_names=[str(name) for name in z["expr_names"]],
        identities=z["ident"],
        faces=z["tris"],
        uv_faces=z["uv_tris"],
        uv=z["uv"],
        materials=materials,
        vertex_color=z["vertex_color"],
        vertex_ao=z["vertex_ao"],
        regions={k.removeprefix("region_"): z[k] for k in z.files if k.startswith("region_")},
    )


def geometry(face: FaceData, modes: NDArray[np.float32]) -> NDArray[np.float32]:  # [V, 3] mm
    """The neutral head of one person; `modes` [100] are in standard deviations."""
    shape = np.tensordot(modes, face.identities.astype(np.float32), 1)
    return (face.neutral + shape * MM_PER_UNIT).astype(np.float32)


def sphere_centre(points: NDArray[np.float32]) -> NDArray[np.float32]:  # [3]
    """Centre of the sphere through the back half of an eyeball's vertices [n, 3]."""
    back = points[points[:, 2] < points[:, 2].mean()].astype(np.float64)
    system = np.c_[2 * back, np.ones(len(back))]
    return np.linalg.lstsq(system, (back**2).sum(1), rcond=None)[0][:3].astype(np.float32)


def vertex_normals(
    vertices: NDArray[np.float32],  # [V, 3]
    faces: NDArray[np.int32],  # [F, 3]
) -> NDArray[np.float32]:  # [V, 3] unit
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    face_normals = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], face_normals)
    return normals / (np.linalg.norm(normals, axis=1, keepdims=True) + 1e-9)
