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

from render.avatars import textures
from render.decoder.cover import nearest
from render.decoder.surface import FLATNESS, Surface
from render.lighting import LUMINANCE
from render.splats.reference import LOW_PASS_PX2, MAX_ALPHA, MIN_ALPHA
from render.types import Density, Floats

DENSITY = 3.0  # places a Gaussian
# Yaw and pitch of whoever looks: which Gaussian lies before which depends on it.
VIEWS_DEG = (
    *((0, 0), (-25, -8), (25, 8), (-12, 12), (12, -12), (-30, 6), (30, -6)),
    *((-18, 0), (18, 2), (-6, -6), (7, 7), (0, 14), (0, -14)),
)
# The same of eyes, which turn; straight ahead counts thrice.
EYE_VIEWS_DEG = ((0, 0), (0, 0), (0, 0), (-28, -14), (28, 14), (-28, 14), (28, -14))
NEAR, NEAR_BELOW = 24, 8  # Gaussians around a place, of the skin and of the layer below it
PIXEL_MM = 0.336  # of a portrait of 1024
LEAST_COSINE, LEAST_SEEN = 0.25, 0.8
STAY, STEPS = 0.11, 40  # how much a colour that stays is worth; of least squares
THINNER: tuple[Density, ...] = ("16k", "32k")  # densities whose Gaussians are fewer and wider
# Least and largest gain: a single Gaussian beyond is a grain of salt or soot on the skin.
SKIN, EYES = (0.8, 1.1), (0.3, 1.9)
# Texels of the skin and of an eye's picture: what a picture averages of them (what is darker than a
# pupil would draw the look aside); detail finer than FINE is wanted so much stronger.
SKIN_BLUR, SKIN_FINE, SKIN_GAIN = 0.65, 6.0, 1.3
EYE_BLUR, EYE_FINE, EYE_GAIN = 2.5, 6.25, 1.6
ROUNDS = 3  # of least squares: what gains at a limit may not do, others make up for
# A colour of an eye is found within so many texels, or is lighter by at most this, and by no more
# than the darkest found there: a pupil stays dark.
EYE_REACH, EYE_LIGHTER = 5, 0.15
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
        rows, share = rows[whole], (share[whole] / seen[whole, None]).astype(np.float32)
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
) -> tuple[NDArray[np.intp], Floats]:
    """The same Gaussians front to back [S, K], and the share of each in what is seen [S, K].

    As the renderers have it (render/splats/reference.py), but from far away."""
    right = np.cross((0, 1, 0), towards)
    right /= np.linalg.norm(right)
    screen = np.stack([right, np.cross(towards, right)], 1).astype(np.float32)
    depth = (gaussians.points @ towards)[near]
    near = np.take_along_axis(near, np.argsort(-depth, axis=1), 1)
    width, lean = gaussians.widths**2, gaussians.normals @ screen
    thin, blur = (1 - FLATNESS**2) * width, LOW_PASS_PX2 * PIXEL_MM**2
    across, up = (width - thin * lean[:, k] ** 2 + blur for k in range(2))
    both = -thin * lean[:, 0] * lean[:, 1]
    flat = gaussians.points @ screen
    x, y = ((points @ screen[:, k])[:, None] - flat[:, k][near] for k in range(2))
    away = up[near] * x * x - 2 * both[near] * x * y + across[near] * y * y
    away /= (across * up - both * both)[near]
    alpha = np.minimum(gaussians.opacities, MAX_ALPHA)[near] * np.exp(-0.5 * away)
    alpha[alpha < MIN_ALPHA] = 0
    left = np.cumprod(1 - alpha, axis=1)
    passed = np.concatenate([np.ones_like(left[:, :1]), left[:, :-1]], 1)
    return near, np.asarray(alpha * passed, np.float32)


def wanted_skin(skin: Floats) -> Floats:  # [H, 2 H, 3] 0..1
    """The texture as a picture of Gaussians is to show it."""
    return textures.sharper(skin, SKIN_BLUR, SKIN_FINE, SKIN_GAIN)


def wanted_eye(eye: Floats) -> Floats:  # [H, H, 3] 0..1
    """The same of an eye's picture."""
    return textures.sharper(eye, EYE_BLUR, EYE_FINE, EYE_GAIN)


def card() -> dict[str, float]:
    """What to tell beside an avatar about how its colours were made."""
    how = {"places": DENSITY, "stay": STAY, "steps": STEPS, "rounds": ROUNDS}
    return how | {"gain": SKIN_GAIN, "gain_eyes": EYE_GAIN}


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
