"""Where a person's Gaussians sit on the mesh, and the colours they carry.

Placement is shared by everyone (anchors: triangle + barycentric coordinates); colours, hair and
eye highlights belong to one identity. Light is baked: key, fill, ambient and occlusion.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from render.training.face_data import SKIN_VERTICES, FaceData, vertex_normals

Floats = NDArray[np.floating]

# Gaussians a square millimetre, relative to the cheeks: detail goes where people look.
DENSITY = {
    "M_Face": 1.0,
    "M_BackHead": 0.16,
    "M_GumsTongue": 0.35,
    "M_Teeth": 0.7,
    "M_ScleraLeft": 2.0,
    "M_ScleraRight": 2.0,
    "M_EyeLashes": 1.5,
}
REGION_DENSITY = {"lips": 2.6, "eyelids": 3.0, "brows": 1.8, "head_neck": 0.5}
SCLERA_MATERIALS = ("M_ScleraLeft", "M_ScleraRight")
CANDIDATES = 8  # darts thrown a Gaussian kept
SPACING = 0.80  # smallest distance of two neighbours, in units of 1 / sqrt(density)
NEIGHBOURS = 5
WIDTH = 0.54  # standard deviation, in units of the distance to the NEIGHBOURS-th neighbour
KEY_LIGHT, FILL_LIGHT = np.array([0.35, 0.45, 0.82]), np.array([-0.7, 0.1, 0.7])


@dataclass(frozen=True)
class Anchors:
    """Gaussians glued to the mesh."""

    triangles: NDArray[np.int32]  # [N] rows of FaceData.faces
    barycentric: Floats  # [N, 3]
    scales: Floats  # [N] mm, standard deviation in the plane at rest
    opacities: Floats  # [N]


def place(face: FaceData, count: int, seed: int) -> Anchors:
    """Spread about `count` Gaussians over the mesh, denser in the regions that matter."""
    rng = np.random.default_rng(seed)
    corners = face.neutral[face.faces]
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    density = np.array([DENSITY.get(str(m), 0.0) for m in face.materials])
    for region, factor in REGION_DENSITY.items():
        inside = np.isin(face.faces, face.regions[region]).all(1)
        density[inside] *= factor
    socket = np.isin(face.faces, face.regions["mouth_socket"]).all(1)
    density[socket] = 0.25
    iris_front = np.isin(face.materials, SCLERA_MATERIALS) & (
        corners[:, :, 2].mean(1) < _eye_depth(face, corners)
    )
    density[iris_front] = 0.1  # the back of an eyeball is never seen
    density *= count / (area * density).sum()
    triangles, barycentric = scatter(corners, area, density, rng)
    even = 1 / np.sqrt(density[triangles])
    scales = WIDTH * np.clip(gaps(corners, triangles, barycentric), 0.8 * even, 1.35 * even)
    opacities = np.full(len(triangles), 0.99, np.float32)
    lashes = face.materials[triangles] == "M_EyeLashes"
    alpha = face.image("eyelash_alpha.png")
    alpha = alpha[..., :1] if alpha.ndim == 3 else alpha[..., None]
    seen = sample(alpha, _uv(face, triangles, barycentric))[:, 0]
    opacities[lashes] = 0.85 * seen[lashes]
    scales[lashes] *= 0.5
    keep = opacities > 0.2
    return Anchors(
        triangles[keep],
        barycentric[keep],
        scales[keep].astype(np.float32),
        opacities[keep],
    )


def scatter(
    corners: Floats,  # [F, 3, 3] mm
    area: Floats,  # [F] mm^2
    density: NDArray[np.float64],  # [F] Gaussians a mm^2
    rng: np.random.Generator,
) -> tuple[NDArray[np.int32], Floats]:  # triangles [N], barycentric [N, 3]
    """Poisson-disk points: even cover without holes (plain random points left 10 % uncovered)."""
    from scipy.spatial import KDTree

    expected = np.cumsum(area * density) * CANDIDATES
    darts = np.searchsorted(expected, rng.uniform(0, expected[-1], int(expected[-1])))
    u, v = rng.uniform(0, 1, (2, len(darts)))
    fold = u + v > 1
    u[fold], v[fold] = 1 - u[fold], 1 - v[fold]
    barycentric = np.stack([1 - u - v, u, v], 1)
    points = (corners[darts] * barycentric[..., None]).sum(1)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = (normals / (np.linalg.norm(normals, axis=1, keepdims=True) + 1e-9))[darts]
    radius = SPACING / np.sqrt(density[darts])
    tree = KDTree(points)
    free, kept = np.ones(len(darts), bool), []
    for dart in range(len(darts)):
        if not free[dart]:
            continue
        kept.append(dart)
        near = np.array(tree.query_ball_point(points[dart], radius[dart]))
        free[near[normals[near] @ normals[dart] > 0.3]] = False
    return darts[kept].astype(np.int32), barycentric[kept].astype(np.float32)


def gaps(
    corners: Floats,  # [F, 3, 3] mm
    triangles: NDArray[np.int32],  # [N]
    barycentric: Floats,  # [N, 3]
) -> Floats:  # [N] mm
    """How far apart neighbours on the same surface are: wide Gaussians only where it is sparse."""
    from scipy.spatial import KDTree

    points = (corners[triangles] * barycentric[..., None]).sum(1)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[triangles]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-9
    distance, near = KDTree(points).query(points, k=4 * NEIGHBOURS)
    other_side = (normals[near] * normals[:, None]).sum(-1) < 0.3
    distance[other_side] = np.inf
    widest = np.sort(distance, axis=1)[:, NEIGHBOURS]
    return widest


def _eye_depth(face: FaceData, corners: Floats) -> Floats:
    """Depth behind which an eyeball's triangles are hidden, for the eye of each triangle."""
    depth = np.zeros(len(corners), np.float32)
    for material, side in zip(SCLERA_MATERIALS, "lr", strict=True):
        depth[face.materials == material] = face.neutral[face.regions[f"eyeball_{side}"], 2].mean()
    return depth


def _uv(face: FaceData, triangles: NDArray[np.int32], barycentric: Floats) -> Floats:
    return (face.uv[face.uv_faces[triangles]] * barycentric[..., None]).sum(1, dtype=np.float32)


def sample(image: Floats, uv: Floats) -> Floats:
    """Bilinear look-up of `image` [H, W, C] at `uv` [n, 2] (v up) -> [n, C]."""
    height, width = image.shape[:2]
    rows = (1 - uv[:, 1] % 1.0) * height - 0.5
    columns = (uv[:, 0] % 1.0) * width - 0.5
    return np.stack(
        [
            map_coordinates(image[..., c], [rows, columns], order=1, mode="nearest")
            for c in range(image.shape[-1])
        ],
        1,
    )


def light(normals: Floats) -> Floats:  # [n, 3] -> [n]
    """Key, fill and sky light on a matte surface, in linear intensity."""
    return (
        0.30
        + 0.10 * normals[:, 1]
        + 0.62 * np.clip(normals @ KEY_LIGHT, 0, 1)
        + 0.18 * np.clip(normals @ FILL_LIGHT, 0, 1)
    )


def colors(
    face: FaceData,
    anchors: Anchors,
    vertices: Floats,  # [V, 3] mm, the person at rest
    skin: str,
    eye: str,
) -> Floats:  # [N, 3] 0..1 sRGB values
    """Baked colours of one person's anchored Gaussians."""
    corners = face.faces[anchors.triangles]
    weights = anchors.barycentric[..., None]
    uv = _uv(face, anchors.triangles, anchors.barycentric)
    material = face.materials[anchors.triangles]
    rgb = (face.vertex_color[corners] * weights).sum(1)
    albedo = face.image(skin)[..., :3]
    albedo = np.stack([gaussian_filter(albedo[..., c], 1.2) for c in range(3)], -1)
    on_skin = np.isin(material, ("M_Face", "M_BackHead")) & (corners.max(1) < SKIN_VERTICES)
    rgb[on_skin] = sample(albedo, uv[on_skin] * [0.5, 1.0])
    on_eye = np.isin(material, SCLERA_MATERIALS)
    rgb[on_eye] = sample(face.image(eye)[..., :3], uv[on_eye])
    rgb[material == "M_EyeLashes"] = 0.06
    normals = (vertex_normals(vertices, face.faces)[corners] * weights).sum(1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-9
    occlusion = (face.vertex_ao[corners] * anchors.barycentric).sum(1)
    shade = light(normals) * (0.25 + 0.75 * np.clip(occlusion * 1.35, 0, 1))
    half = KEY_LIGHT + [0, 0, 1]
    half = half / np.linalg.norm(half)
    shine = np.where(on_skin, 0.035, 0.0) * np.clip(normals @ half, 0, 1) ** 18
    linear = rgb**2.2 * shade[:, None] * 1.15 + shine[:, None]
    return np.clip(linear, 0, 1).astype(np.float32) ** (1 / 2.2)
