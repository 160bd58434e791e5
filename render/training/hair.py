"""Hair as long thin Gaussians along the strands of textured hair cards (MakeHuman, CC0).

Strands are traced along the cards: every Gaussian lies in the card's plane but is lit as part of
the whole head of hair, with the light that reaches it, so a card seen edge-on does not show.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.lighting import HALF, KEY, STUDIO
from render.mesh_occlusion import Occlusion
from render.textures import sample
from render.training.assembly import Assembly
from render.training.face_data import MM_PER_UNIT, SKIN_VERTICES
from render.types import Gaussians

Floats = NDArray[np.float32]
Tint = tuple[float, float, float]
CANDIDATES = 10  # darts a Gaussian kept
# Standard deviations; length and width in units of the strands' spacing, and their limits.
LENGTH, WIDTH, THICKNESS_MM = 1.45, 0.40, 0.35
LENGTH_MM, WIDTH_MM = (3.2, 6.5), (0.8, 1.7)
LIFT_MM = 0.8  # hair stays this far outside the skin
STRAND_SPREAD = 0.14  # how differently bright strands are
CURL_MM = (2.6, 1.5, 1.1)
ROOT_DARK = 0.7  # colour of a covered scalp, as a share of the hair's
CURLS = ("afro01",)


@dataclass(frozen=True)
class Cards:
    """One style on one head."""

    corners: Floats  # [T, 3, 3] mm
    uv: Floats  # [T, 3, 2]
    texture: Floats | None  # [H, W, 4]; none for curls
    cap: Floats  # [SKIN_VERTICES] 0..1 hair cover of the skin


def cards(assembly: Assembly, vertices: Floats, normals: Floats, style: str) -> Cards:
    """Bind a style to a person at rest."""
    face = assembly.face
    z = np.load(face.folder / "hair" / f"hair_{style}.npz", allow_pickle=False)
    bound = vertices[z["bind_idx"]] / MM_PER_UNIT
    points = ((bound * z["bind_w"][..., None]).sum(1) + z["offsets"]) * MM_PER_UNIT
    points = push_out(points.astype(np.float32), vertices, normals)
    texture = None
    if style not in CURLS:
        texture = face.image(f"hair/{style.removesuffix('_swept')}.png")
    return Cards(points[z["tris"]], z["uv"][z["tris"]], texture, z["scalp_cap"].astype(np.float32))


def push_out(points: Floats, vertices: Floats, normals: Floats) -> Floats:
    """Move hair that fell inside the skin outside it."""
    from scipy.spatial import KDTree

    skin, out = vertices[:SKIN_VERTICES], points.copy()
    for _ in range(2):
        _, near = KDTree(skin).query(out, k=4)
        normal = normals[near].mean(1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-9
        height = ((out[:, None] - skin[near]) * normals[near]).sum(2).mean(1)
        inside = (height < LIFT_MM) & (height > -25)
        out[inside] += (LIFT_MM - height[inside])[:, None] * normal[inside]
    return out


def grow(
    worn: Cards, tint: Tint, count: int, occlusion: Occlusion, vertices: Floats, seed: int
) -> Gaussians:
    """About `count` Gaussians: those that are seen from somewhere, evenly spread."""
    rng = np.random.default_rng(seed)
    edges = worn.corners[:, 1:] - worn.corners[:, :1]
    flat = np.cross(edges[:, 0], edges[:, 1])
    area = 0.5 * np.linalg.norm(flat, axis=1)
    darts = rng.choice(len(area), CANDIDATES * count, p=area / area.sum())
    u, v = rng.uniform(0, 1, (2, len(darts)))
    fold = u + v > 1
    u[fold], v[fold] = 1 - u[fold], 1 - v[fold]
    weights = np.stack([1 - u - v, u, v], 1)[..., None]
    means = (worn.corners[darts] * weights).sum(1)
    outward = _outward(means)
    if worn.texture is None:
        rgb = np.tile(np.array(tint, np.float32), (len(means), 1))
        alpha = np.ones(len(means), np.float32)
        means = means - outward * rng.uniform(0, 7, (len(means), 1))
        along = rng.standard_normal((len(means), 3))
    else:
        rgba = sample(worn.texture, (worn.uv[darts] * weights).sum(1).astype(np.float32))
        rgb, alpha = tinted(rgba[:, :3], worn.texture, tint), rgba[:, 3]
        along = strands(worn.corners, worn.uv)[darts]
    cover = worn.corners if worn.texture is None else opaque(worn)
    light = occlusion(vertices, outward, cover, (means, outward), offset_mm=3.0)
    chosen, spacing = thin(means, light, alpha, count, rng)
    return _gaussians(
        means[chosen], along[chosen], outward[chosen], rgb[chosen], alpha[chosen], light[chosen],
        None if worn.texture is None else spacing, rng,
    )  # fmt: skip


def _outward(means: Floats) -> Floats:
    out = means - np.array([0, 30.0, -5.0])
    out[:, 1] *= 0.7
    return (out / np.linalg.norm(out, axis=1, keepdims=True)).astype(np.float32)


def opaque(worn: Cards) -> Floats:
    """Triangles that are more hair than air: they cast shadow."""
    assert worn.texture is not None
    middle = worn.uv.mean(1).astype(np.float32)
    return worn.corners[sample(worn.texture, middle)[:, 3] > 0.5]


def tinted(rgb: Floats, texture: Floats, tint: Tint) -> Floats:
    """The strands' relative brightness in another colour."""
    weights = np.array([0.3, 0.59, 0.11], np.float32)
    median = np.median(texture[..., :3][texture[..., 3] > 0.5] @ weights)
    relative = (rgb @ weights / max(float(median), 0.02)).clip(0.35, 2.2)
    return (relative[:, None] ** 0.8 * np.array(tint, np.float32)).clip(0, 1)


def thin(
    means: Floats, light: Floats, alpha: Floats, count: int, rng: np.random.Generator
) -> tuple[NDArray[np.intp], float]:
    """Darts that see the sky, at least a spacing apart: even cover from few Gaussians."""
    from scipy.spatial import KDTree

    candidates = np.flatnonzero((alpha > 0.35) & (light[:, 0] > 0.10))
    points = means[candidates]
    tree = KDTree(points)
    order = rng.permutation(len(candidates))
    low, high = 0.5, 12.0
    for _ in range(7):  # bisect the spacing that leaves about `count`
        spacing = 0.5 * (low + high)
        free, kept = np.ones(len(points), bool), []
        for dart in order:
            if free[dart]:
                kept.append(dart)
                free[tree.query_ball_point(points[dart], spacing)] = False
        low, high = (spacing, high) if len(kept) > count else (low, spacing)
    return candidates[np.array(kept)], spacing


def _gaussians(means, along, outward, rgb, alpha, light, spacing: float | None, rng):  # type: ignore[no-untyped-def]
    """`spacing` of the strands in mm; None: curls."""
    curly = spacing is None
    along = along / (np.linalg.norm(along, axis=1, keepdims=True) + 1e-9)
    # Hair scatters along cones about the strand: lit by what crosses it, shiny where it faces half.
    crossing = np.sqrt(1 - np.clip(along @ KEY, -1, 1) ** 2)
    shine = np.sqrt(1 - np.clip(along @ HALF, -1, 1) ** 2) ** 60 * np.maximum(outward @ HALF, 0)
    shade = STUDIO.shade(
        np.ascontiguousarray(outward, np.float32), light[:, 0] * 0.9 + 0.05, light[:, 1] * crossing
    )
    rgb = rgb * np.clip(1 + STRAND_SPREAD * rng.standard_normal((len(rgb), 1)), 0.6, 1.5)
    linear = rgb**2 * shade * 1.1
    if not curly:
        linear += (0.05 + 0.4 * rgb**2) * (shine * light[:, 1])[:, None] * 0.55
    size = CURL_MM
    if spacing is not None:
        width = np.clip(WIDTH * spacing, *WIDTH_MM)
        size = (np.clip(LENGTH * spacing, *LENGTH_MM), width, THICKNESS_MM)
    scales = np.tile(np.array(size, np.float32), (len(means), 1))
    scales *= np.clip(1 + 0.2 * rng.standard_normal((len(means), 1)), 0.6, 1.5)
    return Gaussians(
        means.astype(np.float32),
        strand_quats(along, outward).astype(np.float32),
        scales.astype(np.float32),
        np.clip(1.15 * alpha - 0.08, 0.1, 0.95).astype(np.float32),
        np.sqrt(np.clip(linear, 0, 1)).astype(np.float32),
    )


def strands(corners: Floats, uv: Floats) -> Floats:  # [T, 3, 3], [T, 3, 2] -> [T, 3]
    """Direction in which v grows: the textures' strands run along it."""
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    d1, d2 = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    determinant = d1[:, :1] * d2[:, 1:] - d2[:, :1] * d1[:, 1:]
    along = (e2 * d1[:, :1] - e1 * d2[:, :1]) * np.sign(determinant)
    return along / (np.linalg.norm(along, axis=1, keepdims=True) + 1e-9)


def strand_quats(along: Floats, normals: Floats) -> Floats:  # [n, 3], [n, 3] -> [n, 4] wxyz
    """Rotations whose x axis is the strand and whose z axis is nearest to the normal."""
    from scipy.spatial.transform import Rotation

    across = np.cross(normals, along)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(length > 1e-3, across / (length + 1e-9), np.cross(along, (0.3, 0.9, 0.2)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    matrix = np.stack([along, across, np.cross(along, across)], -1)
    return Rotation.from_matrix(matrix).as_quat(scalar_first=True)
