"""What is seen of the colours of a head's Gaussians, on its face and on its eyes: the same for
everyone, once for every number of Gaussians. What it is for: detail.py."""

# pyright: reportUntypedFunctionDecorator=false
import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_array, eye_array, vstack

from render.decoder import mesh_parts, prior_file
from render.decoder.cover import nearest
from render.decoder.surface import FLATNESS, Surface
from render.splats.reference import LOW_PASS_PX2, MAX_ALPHA, MIN_ALPHA
from render.types import Density, Floats, Ints

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
FAINT = 9.0  # squared deviations at which no alpha reaches MIN_ALPHA
THINNER: tuple[Density, ...] = ("16k", "32k")  # densities whose Gaussians are fewer and wider
SEAM = 1e-3  # of texture coordinates
_known: dict[str, "dict[Density, Blends]"] = {}  # of the last prior


class Blend(NamedTuple):
    """What is seen of everyone's Gaussians at places on the face."""

    shares: csr_array  # [S, N] float32, of each colour
    uv: Floats  # [S, 2] the places in the texture


class Drawn(NamedTuple):
    """Gaussians as they are drawn, on the mean face."""

    points: Floats  # [n, 3] mm
    normals: Floats  # [n, 3] unit
    widths: Floats  # [n] mm
    opacities: Floats  # [n]
    below: NDArray[np.bool_]  # [n] in the layer below the skin


class Blends(NamedTuple):
    """Of one density: of the colours that a file holds for the densest, of those that are drawn
    for thinner ones."""

    shares: csr_array  # see Decoder.shares
    skin: Blend  # of the face
    eyes: Blend


def of_densities(
    t: prior_file.Tensors,
    card: dict[str, Any],
    surface: Surface,  # of all Gaussians, in the order of the file
    face: NDArray[np.bool_],  # [N] those on the skin of the face
) -> dict[Density, Blends]:
    """It takes seconds: a process computes it once."""
    if card["sha256"] not in _known:
        _known.clear()
        _known[card["sha256"]] = _of_densities(t, card, surface, face)
    return _known[card["sha256"]]


def _of_densities(
    t: prior_file.Tensors, card: dict[str, Any], surface: Surface, face: NDArray[np.bool_]
) -> dict[Density, Blends]:
    mesh, faces = prior_file.template(t), t["faces"].astype(np.int32)
    uv = np.zeros((len(mesh), 2), np.float32)
    uv[surface.used] = t["vertex_uv"]
    off = np.abs(surface.interpolate @ t["vertex_uv"] - t["anchor_uv"]).max(1)
    eye, places = t["anchor_kinds"] == mesh_parts.EYE, []
    for which in (face, eye):
        corners = faces[np.unique(t["anchor_triangles"][which & (off < SEAM)])]
        places.append(sampled(corners, mesh, uv, int(DENSITY * which.sum())))
    densities: tuple[Density, ...] = ("65k", *THINNER)
    parts = {density: prior_file.parts(t, card, density) for density in densities}

    def one(density: Density) -> Blends:
        fields = parts[density]
        head = drawn(fields["surface"], fields["opacities"], mesh)
        shares = fields["shares"]
        of = shares if density == "65k" else csr_array(eye_array(len(head.points)))
        on_eye = shares @ eye.astype(np.float32) > 0.99
        skin = blend(head, of, *places[0])
        eyes = blend(head, of, *places[1], among=on_eye, views_deg=EYE_VIEWS_DEG)
        return Blends(shares, skin, eyes)

    with ThreadPoolExecutor() as pool:
        return dict(zip(densities, pool.map(one, densities), strict=True))


def drawn(head: Surface, opacities: Floats, mesh: Floats) -> Drawn:  # [n], [V, 3] mm
    normals = head.interpolate @ head.whole.normals(mesh)[0]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-9
    points = head.interpolate @ mesh[head.used] - head.depths[:, None] * normals
    return Drawn(points, normals, head.scales, opacities, head.depths > 0)


def sampled(
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
    rows, shares = mesh_parts.scattered(area, count, rng)
    # Neighbours stand together, or every product with a blend waits for memory.
    chosen = np.sort(rows)
    points, at = ((v[corners[chosen]] * shares[:, :, None]).sum(1) for v in (mesh, uv))
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
    near = np.concatenate(found, 1).astype(np.int32)
    parts, seen_at = list[csr_array](), list[Floats]()
    for yaw, pitch in np.radians(views_deg):
        flat = np.cos(pitch)
        towards = np.array([np.sin(yaw) * flat, np.sin(pitch), np.cos(yaw) * flat], np.float32)
        facing = np.flatnonzero(normals @ towards > LEAST_COSINE)
        seen, whole = composited(gaussians, near, facing, points, towards)
        parts.append(seen @ shares)
        seen_at.append(uv[facing][whole])
    return Blend(csr_array(vstack(parts), dtype=np.float32), np.concatenate(seen_at))


def composited(
    gaussians: Drawn,
    near: Ints,  # [S, K] Gaussians around each place -> nearer to the viewer first
    facing: NDArray[np.intp],  # [F] places that the viewer sees
    points: Floats,  # [S, 3] mm
    towards: Floats,  # [3] unit: the viewer
) -> tuple[csr_array, NDArray[np.bool_]]:
    """Shares of the Gaussians in what is seen at the places that they cover [f, n], and which
    places these are [F].

    As the renderers have it (render/splats/reference.py), but from far away."""
    right = np.cross((0, 1, 0), towards)
    right /= np.linalg.norm(right)
    screen = np.stack([right, np.cross(towards, right), towards], 1).astype(np.float32)
    width, lean = gaussians.widths**2, gaussians.normals @ screen
    thin, blur = (1 - FLATNESS**2) * width, LOW_PASS_PX2 * PIXEL_MM**2
    across, up = (width - thin * lean[:, k] ** 2 + blur for k in range(2))
    both = -thin * lean[:, 0] * lean[:, 1]
    inverse = np.stack([up, -2 * both, across], 1) / (across * up - both * both)[:, None]
    alphas = np.minimum(gaussians.opacities, MAX_ALPHA)
    splats = np.concatenate([gaussians.points @ screen, inverse, alphas[:, None]], 1)
    most = len(facing) * near.shape[1]
    columns, shares = np.empty(most, np.int32), np.empty(most, np.float32)
    starts = np.zeros(len(facing) + 1, np.int32)
    at = points @ screen[:, :2]
    _front_to_back(splats.astype(np.float32), at, near, facing, columns, shares, starts)
    whole = np.diff(starts) > 0
    ends = np.concatenate([starts[:1], starts[1:][whole]])
    seen = csr_array(
        (shares[: ends[-1]], columns[: ends[-1]], ends), shape=(len(ends) - 1, len(splats))
    )
    return seen, whole


@njit(cache=True, nogil=True, error_model="numpy")
def _front_to_back(
    splats: Floats,  # [n, 7] mm right, up and towards the viewer, inverse covariance, alpha
    places: Floats,  # [S, 2] mm right and up
    near: Ints,  # [S, K] -> sorted
    facing: NDArray[np.intp],  # [F]
    columns: Ints,  # -> [F * K]
    shares: Floats,  # -> [F * K]
    starts: Ints,  # -> [F + 1] of what each place has of these; nothing where little covers it
) -> None:
    for i, place in enumerate(facing):
        row, end = near[place], starts[i]
        for j in range(1, len(row)):  # all but in order, from one view to the next
            which, k = row[j], j
            while k > 0 and splats[row[k - 1], 2] < splats[which, 2]:
                row[k] = row[k - 1]
                k -= 1
            row[k] = which
        left = np.float32(1)
        for which in row:
            one = splats[which]
            x, y = places[place, 0] - one[0], places[place, 1] - one[1]
            away = one[3] * x * x + one[4] * x * y + one[5] * y * y
            if away > FAINT:
                continue
            alpha = one[6] * math.exp(np.float32(-0.5) * away)
            if alpha >= MIN_ALPHA:
                columns[end], shares[end] = which, left * alpha
                left *= 1 - alpha
                end += 1
        if 1 - left > LEAST_SEEN:
            shares[starts[i] : end] /= 1 - left
            starts[i + 1] = end
        else:
            starts[i + 1] = starts[i]
