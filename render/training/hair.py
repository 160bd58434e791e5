"""Hair as Gaussians that lie along the strands of textured hair cards (MakeHuman, CC0)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.training.appearance import light, sample
from render.training.face_data import MM_PER_UNIT, SKIN_VERTICES, FaceData, vertex_normals
from render.training.visibility import seen, views
from render.types import Gaussians

LAYERS = 2  # candidates a Gaussian kept, about


@dataclass(frozen=True)
class Hair:
    """Gaussians that do not move with the face."""

    means: NDArray[np.float32]  # [N, 3] mm
    quats: NDArray[np.float32]  # [N, 4] wxyz; local x runs along the strand
    scales: NDArray[np.float32]  # [N, 3] mm
    opacities: NDArray[np.float32]  # [N]
    colors: NDArray[np.float32]  # [N, 3] 0..1 sRGB values


def grow(
    face: FaceData,
    vertices: NDArray[np.float32],  # [V, 3] mm, the person at rest
    style: str,
    tint: tuple[float, float, float] | None,
    count: int,
    seed: int,
) -> Hair:
    """About `count` Gaussians of one hair style, fitted to one person's head."""
    rng = np.random.default_rng(seed)
    darts = LAYERS * count
    z = np.load(face.folder / "hair" / f"hair_{style}.npz", allow_pickle=False)
    bound = vertices[z["bind_idx"]] / MM_PER_UNIT
    points = ((bound * z["bind_w"][..., None]).sum(1) + z["offsets"]) * MM_PER_UNIT
    points = push_out(points.astype(np.float32), vertices, face.faces)
    texture = face.image(f"hair/{style.removesuffix('_swept')}.png")
    corners = points[z["tris"]]
    edges = corners[:, 1:] - corners[:, :1]
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    triangles = rng.choice(len(area), darts, p=area / area.sum())
    u, v = rng.uniform(0, 1, (2, darts))
    fold = u + v > 1
    u[fold], v[fold] = 1 - u[fold], 1 - v[fold]
    weights = np.stack([1 - u - v, u, v], 1)[..., None]
    means = (corners[triangles] * weights).sum(1)
    rgba = sample(texture, (z["uv"][z["tris"][triangles]] * weights).sum(1))
    normals = (vertex_normals(points, z["tris"])[z["tris"][triangles]] * weights).sum(1)
    outward = means - np.array([0, 30.0, 0])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    normals *= np.sign((normals * outward).sum(1, keepdims=True) + 1e-9)
    normals = 0.45 * normals + 0.55 * outward
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-9
    rgb = rgba[:, :3]
    if tint is not None:
        luminance = rgb @ [0.3, 0.59, 0.11]
        median = np.median(luminance[rgba[:, 3] > 0.5])
        rgb = np.clip((luminance / median)[:, None] ** 0.9 * np.array(tint), 0, 1)
    linear = rgb**2.2 * (light(normals) * 1.1 + 0.05)[:, None]
    size = np.sqrt(area.sum() / darts)
    scales = np.tile(np.array([1.2, 0.45, 0.3], np.float32) * size, (darts, 1))
    keep = rgba[:, 3] > 0.3
    still = np.zeros((darts, 4), np.float32)
    outer = Gaussians(means, still, scales, keep * rgba[:, 3], rgba[:, :3])
    keep &= seen(outer, list(views()))  # hair cards lie in many layers; the outer ones show
    quats = strand_quats(strands(corners, z["uv"][z["tris"]])[triangles], normals)
    return Hair(
        means[keep].astype(np.float32),
        quats[keep].astype(np.float32),
        scales[keep].astype(np.float32),
        (0.9 * rgba[keep, 3]).astype(np.float32),
        (np.clip(linear[keep], 0, 1) ** (1 / 2.2)).astype(np.float32),
    )


def push_out(
    points: NDArray[np.float32], vertices: NDArray[np.float32], faces: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Move hair that fell inside the skin to 0.8 mm outside it."""
    from scipy.spatial import KDTree

    skin = vertices[:SKIN_VERTICES]
    normals = vertex_normals(vertices, faces)[:SKIN_VERTICES]
    moved = points.copy()
    for _ in range(2):
        _, near = KDTree(skin).query(moved, k=4)
        normal = normals[near].mean(1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-9
        height = ((moved[:, None] - skin[near]) * normals[near]).sum(2).mean(1)
        inside = (height < 0.8) & (height > -25)
        moved[inside] += (0.8 - height[inside])[:, None] * normal[inside]
    return moved


def strands(
    corners: NDArray[np.float32],  # [F, 3, 3] mm
    uv: NDArray[np.float32],  # [F, 3, 2]
) -> NDArray[np.float32]:  # [F, 3] unit direction in which v grows: strands run along it
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    d1, d2 = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    along = e2 * d1[:, :1] - e1 * d2[:, :1]
    return along / (np.linalg.norm(along, axis=1, keepdims=True) + 1e-9)


def strand_quats(
    along: NDArray[np.float32],  # [n, 3] unit
    normals: NDArray[np.float32],  # [n, 3] unit
) -> NDArray[np.float32]:  # [n, 4] wxyz
    """Rotations whose x axis is the strand and whose z axis is nearest to the normal."""
    from scipy.spatial.transform import Rotation

    across = np.cross(normals, along)
    across /= np.linalg.norm(across, axis=1, keepdims=True) + 1e-9
    along = along / (np.linalg.norm(along, axis=1, keepdims=True) + 1e-9)
    matrix = np.stack([along, across, np.cross(along, across)], -1)
    degenerate = np.abs(np.linalg.det(matrix) - 1) > 0.01
    matrix[degenerate] = np.eye(3)
    return Rotation.from_matrix(matrix).as_quat(scalar_first=True)
