"""Textured hair cards (MakeHuman, CC0), bound to a head."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from render.avatars.textures import sample
from render.decoder.mesh_parts import SKIN_VERTICES
from render.training.data.face_data import MM_PER_UNIT
from render.training.geometry.assembly import Assembly
from render.types import Floats

SPAN, LONG_SPAN, LONG = 3, 4, ("long01", "ponytail01")  # steps a Gaussian is long; of long hair
CURLS = ("afro01",)
LIFT_MM = 0.8  # hair stays this far outside the skin
PRESSED, PRESSED_BY = ("short03_swept",), 24  # styles; neighbours on the skin
STANDS_MM, STANDS = 7.0, 0.15  # off the skin: how far, and what stays of more than that
BEFORE_MM = (-10.0, 25.0)  # forward: from where on


@dataclass(frozen=True)
class Cards:
    """One style on one head."""

    corners: Floats  # [T, 3, 3] mm
    uv: Floats  # [T, 3, 2]
    texture: Floats | None  # [H, W, 4]; none for curls
    cap: Floats  # [SKIN_VERTICES] 0..1 hair cover of the skin
    span: int  # steps of a strand that one Gaussian shows


def bound(assembly: Assembly, vertices: Floats, normals: Floats, style: str) -> Cards:
    """Bind a style to a person at rest."""
    face = assembly.face
    z = np.load(face.folder / "hair" / f"hair_{style}.npz", allow_pickle=False)
    held = vertices[z["bind_idx"]] / MM_PER_UNIT
    points = ((held * z["bind_w"][..., None]).sum(1) + z["offsets"]) * MM_PER_UNIT
    points = push_out(points.astype(np.float32), vertices, normals)
    if style in PRESSED:
        points = pressed(points, vertices[:SKIN_VERTICES])
    texture, span = None, LONG_SPAN if style in LONG else SPAN
    if style not in CURLS:
        texture = face.image(f"hair/{style.removesuffix('_swept')}.png")
    return Cards(
        points[z["tris"]], z["uv"][z["tris"]], texture, z["scalp_cap"].astype(np.float32), span
    )


def push_out(points: Floats, vertices: Floats, normals: Floats) -> Floats:
    """Move hair that fell inside the skin outside it."""
    skin, out = vertices[:SKIN_VERTICES], points.copy()
    for _ in range(2):
        _, near = KDTree(skin).query(out, k=4)
        normal = normals[near].mean(1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-9
        height = ((out[:, None] - skin[near]) * normals[near]).sum(2).mean(1)
        inside = (height < LIFT_MM) & (height > -25)
        out[inside] += (LIFT_MM - height[inside])[:, None] * normal[inside]
    return out


def pressed(points: Floats, skin: Floats) -> Floats:
    """Hair that stands off a temple, nearer to it: a hollow is seen from in front."""
    away, near = KDTree(skin).query(points, k=PRESSED_BY)
    out = points - skin[near].mean(1)
    out /= np.linalg.norm(out, axis=1, keepdims=True) + 1e-9
    before = np.interp(points[:, 2], BEFORE_MM, (0, 1))
    more = before * (1 - STANDS) * np.maximum(away[:, 0] - STANDS_MM, 0)
    return (points - more[:, None] * out).astype(np.float32)


def opaque(worn: Cards) -> Floats:
    """Triangles that are more hair than air: they cast shadow."""
    assert worn.texture is not None
    middle = worn.uv.mean(1).astype(np.float32)
    return worn.corners[sample(worn.texture, middle)[:, 3] > 0.5]


def directions(corners: Floats, uv: Floats) -> Floats:  # [T, 3, 3], [T, 3, 2] -> [T, 3]
    """Direction in which v grows: the textures' strands run along it."""
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    d1, d2 = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    determinant = d1[:, :1] * d2[:, 1:] - d2[:, :1] * d1[:, 1:]
    along = (e2 * d1[:, :1] - e1 * d2[:, :1]) * np.sign(determinant)
    return along / (np.linalg.norm(along, axis=1, keepdims=True) + 1e-9)
