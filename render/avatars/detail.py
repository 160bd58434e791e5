"""Colours whose blend, not each of them, looks like a texture.

Narrow Gaussians lie over a wide layer that closes the gaps between them, and about half of what is
seen is that layer: a picture of Gaussians that each have the texture's colour is soft. What is seen
at places on the face is linear in the colours, and the same for everyone: this solves for colours
that together show the texture, and stays near those it was given. Fewer and wider Gaussians, whose
colours are means of these, get their own in the same way: each a factor of its brightness.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack

from render.decoder.cover import nearest
from render.decoder.surface import Surface
from render.lighting import LUMINANCE
from render.types import Density, Doubles, Floats

DENSITY = 3.0  # places a Gaussian
# Yaw and pitch of whoever looks: which Gaussian lies before which depends on it.
VIEWS_DEG = ((0, 0), (-25, -8), (25, 8), (-12, 12), (12, -12))
# The same of eyes, which turn; straight ahead counts thrice.
EYE_VIEWS_DEG = ((0, 0), (0, 0), (0, 0), (-28, -14), (28, 14), (-28, 14), (28, -14))
NEAR, NEAR_BELOW = 14, 5  # Gaussians around a place, of the skin and of the layer below it
PIXEL_MM = 0.13  # what a picture's filter adds to a width, at 1024 pixels
LEAST_COSINE, LEAST_ALPHA, LEAST_SEEN = 0.25, 1 / 255, 0.8
STAY, STEPS = 0.11, 40  # how much a colour that stays is worth; of least squares
THINNER: tuple[Density, ...] = ("16k", "32k")  # densities whose Gaussians are fewer and wider
# Least and largest gain: a single Gaussian beyond is a grain of salt or soot on the skin.
SKIN, WIDE, EYES = (0.85, 1.05), (0.8, 1.1), (0.3, 1.9)
ROUNDS = 3  # of least squares: what gains at a limit may not do, others make up for
# Texels of an eye's picture: how sharp it is to be seen, and how near a Gaussian its colour must be
# found: what is darker than a pupil or a rim would draw the look aside.
EYE_BLUR, EYE_REACH = 2.5, 5
SEAM = 1e-3  # of texture coordinates
ATLAS = np.array([0.5, 1.0], np.float32)  # the face lies in the left half


class Blend(NamedTuple):
    """What is seen of everyone's Gaussians at places on the face."""

    shares: csr_array  # [S, N] of each colour
    uv: Floats  # [S, 2] the places in the texture


class Drawn(NamedTuple):
    """Gaussians as they are drawn, on the mean face."""

    points: Floats  # [n, 3] mm
    normals: Floats  # [n, 3] unit
    widths: Floats  # [n] mm
    opacities: Floats  # [n]
    below: NDArray[np.bool_]  # [n] in the layer below the skin


def drawn(head: Surface, opacities: Floats, mesh: Floats) -> Drawn:  # [n], [V, 3] mm
    normals = head.interpolate @ head.whole.normals(mesh)[0]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-9
    points = head.interpolate @ mesh[head.used] - head.depths[:, None] * normals
    return Drawn(points, normals, head.scales, opacities, head.depths > 0)


def places(
    corners: NDArray[np.integer],  # [F, 3] triangles
    mesh: Floats,  # [V, 3] mm
    uv: Floats,  # [V, 2]
    count: int,
) -> tuple[Floats, Floats, Floats]:
    """Points [S, 3] mm, normals [S, 3] and texture coordinates [S, 2], even over the triangles."""
    rng = np.random.default_rng(0)
    a, b, c = (mesh[corners[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    area = np.linalg.norm(across, axis=1)
    chosen = rng.choice(len(corners), count, p=area / area.sum())
    inside = rng.dirichlet((1, 1, 1), count).astype(np.float32)[:, :, None]
    points, at = ((v[corners[chosen]] * inside).sum(1) for v in (mesh, uv))
    return points, (across / area[:, None])[chosen], at


def blend(
    gaussians: Drawn,
    shares: csr_array,  # [n, N] see Decoder.shares
    points: Floats,  # [S, 3] mm
    normals: Floats,  # [S, 3] unit
    uv: Floats,  # [S, 2]
    among: NDArray[np.bool_] | bool = True,  # [n] nothing else is seen
    views_deg: tuple[tuple[int, int], ...] = VIEWS_DEG,
) -> Blend:
    """Gaussians composited front to back at every place, once for each view that it faces."""
    found: list[NDArray[np.intp]] = []
    for layer, count in ((~gaussians.below, NEAR), (gaussians.below, NEAR_BELOW)):
        rows = np.flatnonzero(layer & among)
        if len(rows):
            found.append(rows[nearest(gaussians.points[rows], points, count)[1]])
    near = np.concatenate(found, 1)
    parts, seen_at = list[csr_array](), list[Floats]()
    for yaw, pitch in np.radians(views_deg):
        flat = np.cos(pitch)
        towards = np.array([np.sin(yaw) * flat, np.sin(pitch), np.cos(yaw) * flat], np.float32)
        facing = np.flatnonzero(normals @ towards > LEAST_COSINE)
        rows, share = composited(gaussians, near[facing], points[facing], towards)
        seen = share.sum(1)
        whole = seen > LEAST_SEEN
        rows, share = rows[whole], (share / seen[:, None])[whole].astype(np.float32)
        starts = np.arange(0, rows.size + 1, rows.shape[1])
        size = (len(rows), len(gaussians.points))
        parts.append(csr_array((share.ravel(), rows.ravel(), starts), shape=size) @ shares)
        seen_at.append(uv[facing][whole])
    return Blend(csr_array(vstack(parts), dtype=np.float64), np.concatenate(seen_at))


def composited(
    gaussians: Drawn,
    near: NDArray[np.intp],  # [S, K] Gaussians around each place
    points: Floats,  # [S, 3] mm
    towards: Floats,  # [3] unit: the viewer
) -> tuple[NDArray[np.intp], Doubles]:
    """The same Gaussians front to back [S, K], and the share of each in what is seen [S, K]."""
    depth = gaussians.points[near] @ towards
    near = np.take_along_axis(near, np.argsort(-depth, axis=1), 1)
    off = [points[:, c, None] - gaussians.points[:, c][near] for c in range(3)]
    flat = [gaussians.normals[:, c][near] for c in range(3)]
    cosine = np.maximum(gaussians.normals @ towards, LEAST_COSINE)[near]
    along = sum(o * n for o, n in zip(off, flat, strict=True)) / cosine
    away = sum((o - along * t) ** 2 for o, t in zip(off, towards, strict=True))  # in its plane
    width = gaussians.widths**2
    spread = width + np.where(gaussians.below, 0, PIXEL_MM**2)
    peak, spread = (gaussians.opacities * width / spread)[near], spread[near]
    alpha = peak * np.exp(-0.5 * away / spread)
    alpha[alpha < LEAST_ALPHA] = 0
    left = np.cumprod(1 - alpha, axis=1)
    return near, alpha * np.concatenate([np.ones_like(left[:, :1]), left[:, :-1]], 1)


def card() -> dict[str, float]:
    """What to tell beside an avatar about how its colours were made."""
    return {"places": DENSITY, "stay": STAY, "steps": STEPS, "rounds": ROUNDS}


def sharpened(
    albedo: Floats,  # [N, 3] 0..1 stored
    free: NDArray[np.bool_],  # [N] which may change
    of: Blend,
    wanted: Floats,  # [S, 3] what is to be seen at its places
) -> Floats:  # [N, 3]
    """Colours that show the detail: brighter or darker, in the hue that they have."""
    return np.clip(albedo * gains(albedo, free, of, wanted, SKIN)[:, None], 0, 1)


def gains(
    albedo: Floats,  # [N, 3] 0..1 stored
    free: NDArray[np.bool_],  # [N]
    of: Blend,
    wanted: Floats,  # [S, 3]
    limits: tuple[float, float],
) -> Floats:  # [N]
    """The same as factors of brightness: 1 where nothing changes."""
    shares, bright = of.shares[:, np.flatnonzero(free)], np.maximum(albedo[free] @ LUMINANCE, 0.05)
    low, high = ((limit - 1) * bright for limit in limits)
    missing, change = (wanted - of.shares @ albedo) @ LUMINANCE, np.zeros(len(bright))
    moving = np.ones(len(bright), bool)
    for _ in range(ROUNDS):
        change[moving] += _solved(shares[:, np.flatnonzero(moving)], missing - shares @ change)
        change = change.clip(low, high)
        moving = (change > low) & (change < high)
    out = np.ones(len(albedo), np.float32)
    out[free] += (change / bright).astype(np.float32)
    return out


def repainted(
    albedo: Floats,  # [N, 3] 0..1 stored
    free: NDArray[np.bool_],  # [N]
    of: Blend,
    wanted: Floats,  # [S, 3]
    bounds: tuple[Floats, Floats],  # [free, 3] each: darkest and lightest
) -> Floats:  # [N, 3]
    """Colours that show the detail in its own hues: an iris has a dark rim, and ends in white."""
    out, shares = albedo.copy(), of.shares[:, np.flatnonzero(free)]
    for channel in range(3):
        missing = wanted[:, channel] - of.shares @ albedo[:, channel]
        out[free, channel] += _solved(shares, missing).astype(np.float32)
    out[free] = np.clip(out[free], *bounds)
    return out


def _solved(shares: csr_array, missing: Floats) -> Floats:
    """[S, n], [S] -> the change [n] of colours that makes up for it, as far as they may change."""
    from scipy.sparse.linalg import lsmr

    return lsmr(shares, missing, damp=STAY, maxiter=STEPS)[0]
