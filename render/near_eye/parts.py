"""The near-eye pictures' geometry: the skin around one eye, its lid margins, lashes and brows.

Everything is in eye space: millimetres from the centre of the eyeball; the right eye is mirrored
in x, so that all code sees left eyes. Vertex ranges are those of the face data's topology.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from render.decoder.mesh_parts import SKIN_VERTICES
from render.types import Floats

LACRIMAL = ((24_591, 24_795), (24_795, 24_999))  # the pink corner, left and right
REACH_MM = 52.0
MARGIN_X = np.arange(-9.0, 11.1, 1.25)  # columns in which the lid margins are found
POLY = 3  # degree of the margins' curves
LASH_STEPS = 6


@dataclass(frozen=True)
class EyeSkin:
    """Fixed for one identity and eye."""

    center: Floats  # [3] mm in the head
    side: float  # 1 left, -1 right
    members: NDArray[np.int32]  # [M] mesh vertices drawn
    faces: NDArray[np.int32]  # [F, 3] into members
    rest: Floats  # [M, 3]
    upper: NDArray[np.int32]  # [k] members on the upper lid's margin
    lower: NDArray[np.int32]
    opening_mm: float  # at rest
    brow_roots: Floats  # [B, 3] barycentric
    brow_faces: NDArray[np.int32]  # [B, 3] members

    def posed(self, vertices: Floats) -> Floats:
        """[V, 3] mesh in mm -> [M, 3] eye space."""
        return to_eye(vertices[self.members], self.center, self.side)

    def margins(self, posed: Floats) -> tuple[Floats, Floats]:
        """Polynomials y(x) and z(x) of both margins: [2, 4] upper, [2, 4] lower."""
        result = []
        for members in (self.upper, self.lower):
            x, y, z = posed[members].T.astype(np.float64)
            result.append(np.stack([np.polyfit(x, v, POLY) for v in (y, z)]).astype(np.float32))
        return result[0], result[1]

    def opening(self, margins: tuple[Floats, Floats]) -> float:
        """Lid opening, 0 shut, 1 as at rest, a little more when wide."""
        return float(np.clip(_gap(*margins) / self.opening_mm, 0, 1.3))


def to_eye(points: Floats, center: Floats, side: float) -> Floats:
    moved = (points - center).astype(np.float32)
    moved[:, 0] *= side
    return moved


def _gap(upper: Floats, lower: Floats) -> float:
    x = np.linspace(-3, 3, 7)
    return float(np.mean(np.polyval(upper[0], x) - np.polyval(lower[0], x)))


def eye_skin(
    neutral: Floats,  # [V, 3] mm
    mesh_faces: NDArray[np.int32],  # [F, 3]
    center: Floats,  # [3] mm
    eye: int,
    eyelids: NDArray[np.int32],
    brows: NDArray[np.int32],
    rng: np.random.Generator,
) -> EyeSkin:
    """Cut out what one camera can see. eye: 0 left, 1 right."""
    side = 1.0 if eye == 0 else -1.0
    local = to_eye(neutral, center, side)
    first, last = LACRIMAL[eye]
    index = np.arange(len(neutral))
    wanted = (index < SKIN_VERTICES) | ((index >= first) & (index < last))
    wanted &= (np.linalg.norm(local, axis=1) < REACH_MM) & (local[:, 2] > -12)
    faces = mesh_faces[wanted[mesh_faces].all(1)]
    members = np.unique(faces)
    where = np.full(len(neutral), -1, np.int32)
    where[members] = np.arange(len(members))
    rest = local[members]
    near = where[eyelids]
    near = near[near >= 0]
    near = near[rest[near, 2] > 7]
    upper, lower = _margin(rest, near, 1), _margin(rest, near, -1)
    brow_faces, roots = _brow_roots(rest, where[faces], where[brows], rng)
    skin = EyeSkin(
        center, side, members.astype(np.int32), where[faces], rest, upper, lower, 1.0,
        roots, brow_faces,
    )  # fmt: skip
    gap = _gap(*skin.margins(rest))
    return replace(skin, opening_mm=max(gap, 4.0))


def _margin(rest: Floats, near: NDArray[np.int32], sign: int) -> NDArray[np.int32]:
    """The vertex nearest to the opening in each column, among those on the outside of the lid."""
    found = []
    for x in MARGIN_X:
        column = near[np.abs(rest[near, 0] - x) < 0.8]
        # the line from corner to corner falls a little inwards and outwards
        middle = -0.8
        column = column[sign * (rest[column, 1] - middle) > 0]
        if not len(column):
            continue
        height = sign * rest[column, 1] - 0.35 * rest[column, 2]  # near the opening, but outside
        found.append(column[np.argmin(height)])
    return np.unique(np.array(found, np.int32))


def _brow_roots(
    rest: Floats, faces: NDArray[np.int32], brows: NDArray[np.int32], rng: np.random.Generator
) -> tuple[NDArray[np.int32], Floats]:
    """700 random places on the brow: faces [B, 3] and barycentric weights [B, 3]."""
    inside = np.zeros(len(rest), bool)
    inside[brows[brows >= 0]] = True
    # The region reaches far around the hairs: keep its ridge, 15-25 mm above the eye.
    ridge = 15.5 + 0.18 * rest[:, 0] - 0.012 * rest[:, 0] ** 2 + 3.0
    inside &= np.abs(rest[:, 1] - ridge) < 4.5
    chosen = faces[inside[faces].all(1)]
    if not len(chosen):
        return np.zeros((0, 3), np.int32), np.zeros((0, 3), np.float32)
    picked = chosen[rng.integers(len(chosen), size=700)]
    return picked, rng.dirichlet((1, 1, 1), 700).astype(np.float32)


def normals(points: Floats, faces: NDArray[np.int32]) -> Floats:
    """[M, 3] unit normals of a posed mesh, area weighted."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    face = np.cross(b - a, c - a)
    total = np.zeros_like(points)
    for axis in range(3):
        column = np.zeros(len(points))
        for corner in range(3):
            column += np.bincount(faces[:, corner], face[:, axis], len(points))
        total[:, axis] = column
    return total / (np.linalg.norm(total, axis=1, keepdims=True) + 1e-9)


@dataclass(frozen=True)
class Lashes:
    """One person's lashes: constants drawn once, so that they stay over a clip."""

    at: Floats  # [n] place along the margin, mm
    length: Floats  # [n] mm
    lean: Floats  # [n] sideways
    curl: Floats  # [n]
    upper: NDArray[np.bool_]  # [n]

    @staticmethod
    def draw(
        skin: EyeSkin, count: int, length: float, curl: float, rng: np.random.Generator
    ) -> "Lashes":
        lower = count // 2
        ends = [np.sort(skin.rest[lid, 0])[[0, -1]] for lid in (skin.upper, skin.lower)]
        at = np.concatenate([
            rng.uniform(ends[0][0] + 1, ends[0][1], count),
            rng.uniform(ends[1][0] + 3, ends[1][1] - 1.5, lower),
        ])  # fmt: skip
        upper = np.arange(count + lower) < count
        reach = np.where(upper, length, 0.5 * length) * rng.uniform(0.55, 1.1, len(at))
        reach *= 0.65 + 0.35 * np.clip((at + 9) / 14, 0, 1)  # longer outwards
        lean = 0.06 * at + rng.normal(0, 0.22, len(at))
        own = curl * rng.uniform(0.6, 1.3, len(at))
        at, reach, lean, own = (v.astype(np.float32) for v in (at, reach, lean, own))
        return Lashes(at, reach, lean, own, upper)

    def curves(self, margins: tuple[Floats, Floats]) -> Floats:
        """[n, LASH_STEPS, 3]: out of the lid, then curling away from the opening."""
        roots = np.empty((len(self.at), 3), np.float32)
        roots[:, 0] = self.at
        for members, curve in ((self.upper, margins[0]), (~self.upper, margins[1])):
            for axis in (1, 2):
                roots[members, axis] = np.polyval(curve[axis - 1], self.at[members])
        outward = roots / np.linalg.norm(roots, axis=1, keepdims=True)
        away = np.where(self.upper, 1.0, -1.0)[:, None] * np.array([0, 1, 0], np.float32)
        away = away - (away * outward).sum(1, keepdims=True) * outward
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        sideways = np.cross(away, outward) * np.where(self.upper, -1, 1)[:, None]
        s = np.linspace(0, 1, LASH_STEPS, dtype=np.float32)[None, :, None]
        down = np.where(self.upper, -0.18, 0.05)[:, None, None]
        path = outward[:, None] * (s - 0.15 * self.curl[:, None, None] * s**2)
        path = path + away[:, None] * (down * s + (self.curl[:, None, None] + 0.12) * s**2)
        path = path + sideways[:, None] * self.lean[:, None, None] * s
        return (roots[:, None] + self.length[:, None, None] * path).astype(np.float32)


def brow_curves(skin: EyeSkin, posed: Floats, surface: Floats, count: int) -> Floats:
    """[n, LASH_STEPS, 3]: short hairs that lie along the brow."""
    faces, weights = skin.brow_faces[:count], skin.brow_roots[:count, :, None]
    if not len(faces):
        return np.zeros((0, LASH_STEPS, 3), np.float32)
    roots = (posed[faces] * weights).sum(1)
    normal = (surface[faces] * weights).sum(1)
    phase = np.sin(np.arange(len(faces)) * 12.9898).astype(np.float32)
    rise = 0.75 - 0.05 * (roots[:, 0] + 8) + 0.25 * phase
    way = np.stack([np.ones(len(roots)), rise, np.zeros(len(roots))], 1)
    way -= (way * normal).sum(1, keepdims=True) * normal
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    s = np.linspace(0, 1, LASH_STEPS, dtype=np.float32)[None, :, None]
    length = (5.5 + 2 * phase)[:, None, None]
    path = way[:, None] * s + normal[:, None] * (0.05 + 0.12 * s * (1 - s))
    return (roots[:, None] + length * path).astype(np.float32)


def ribbons(curves: Floats, camera: Floats, width: float, shade: float, pixel_mm: float) -> Floats:
    """[n, S, 3] -> triangles [n * (S - 1) * 6, 9]: place, no normal, (shade, opacity, 0).

    A ribbon is never thinner than a pixel; thin hairs are faint instead.
    """
    tangent = np.gradient(curves, axis=1)
    side = np.cross(tangent, curves - camera)
    side /= np.sqrt(np.einsum("nsk,nsk->ns", side, side))[..., None] + 1e-9
    true = width * np.linspace(1, 0.3, curves.shape[1], dtype=np.float32)
    drawn = np.maximum(true, 1.3 * pixel_mm).astype(np.float32)
    half = (0.5 * drawn)[None, :, None] * side
    rows = np.zeros((len(curves), curves.shape[1], 2, 9), np.float32)
    rows[..., 0, :3], rows[..., 1, :3] = curves - half, curves + half
    rows[..., 6] = shade
    rows[..., 7] = (0.9 * np.minimum(true / drawn, 1))[None, :, None]
    here, next_ = rows[:, :-1], rows[:, 1:]
    corners = (here[:, :, 0], here[:, :, 1], next_[:, :, 0], next_[:, :, 0], here[:, :, 1],
               next_[:, :, 1])  # fmt: skip
    return np.stack(corners, 2).reshape(-1, 9)
