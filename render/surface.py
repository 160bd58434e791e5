"""The Gaussian half of the decoder: posed vertices -> Gaussians that ride on the skin.

Each Gaussian is anchored to a triangle (UV Gaussians: a fixed place in texture space, the same for
everyone). It lies flat on the surface, stretches with it, and its colour is the person's albedo
under the light that the posed face receives.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from render import kernels, lighting
from render.lighting import STUDIO, Lighting

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]
SKIN, EYE, WET, DRY = range(4)  # kinds of vertices
SHINE = np.array([lighting.SKIN_SHINE, lighting.EYE_SHINE, lighting.WET_SHINE, (0, 0)], np.float32)
FLATNESS = np.float32(0.2)  # thickness of a Gaussian, as a share of its width
FLUSH = np.array([0.06, 0.20, 0.17], np.float32)  # of red, green, blue for a doubled area
FLUSHES = (
    np.float32(0.6),
    np.float32(1.35),
)  # share of the area at rest; beyond it the colour stays
BEHIND = np.float32(1.0001)  # more than 1: straight backward is a rotation too
STRETCH = (np.float32(0.6), np.float32(1.5))  # how far the width follows the triangle


@dataclass(frozen=True)
class Around:
    """Triangles around some vertices."""

    corners: Ints  # [F, 3] rows of the mesh's vertices
    rows: Ints  # [F, 3] which of the n vertices each corner is, or -1
    count: int  # n

    def normals(self, vertices: Floats) -> tuple[Floats, Floats, Floats]:
        """[V, 3] mm -> unit normals [n, 3], twice the areas around each vertex [n] and of each
        triangle [F], mm^2."""
        normals, sums = np.empty((self.count, 3), np.float32), np.empty(self.count, np.float32)
        areas = np.empty(len(self.corners), np.float32)
        kernels.around_vertices(vertices, self.corners, self.rows, normals, sums, areas)
        return normals, sums, areas


class Placed(NamedTuple):
    """Gaussians on the skin, but for what colours them."""

    means: Floats  # [N, 3] mm
    quats: Floats  # [N, 4] wxyz, see facing
    scales: Floats  # [N, 3] mm: flat, round in its plane
    light: Floats  # [N, 4] linear red, green, blue on a white surface; shine


@dataclass(frozen=True)
class Still:
    """What follows from a person at rest; the neck, teeth and scalp keep it when the face moves."""

    quats: Floats  # [U, 4] see facing
    parts: Floats  # [U, 8] see Lighting.parts
    sums: Floats  # [L] twice the area around each live vertex
    widths: Floats  # [N] mm


@dataclass(frozen=True)
class Surface:
    """Shared by everyone; holds no state."""

    used: Ints  # [U] vertices that carry Gaussians
    whole: Around  # all used vertices
    live: Ints  # [L] rows of `used` on the face and the eyes: lit anew in every frame
    face: Around  # the live ones
    interpolate: csr_array  # [N, U] vertices -> anchors
    triangle: Ints  # [N] triangle of `whole` an anchor lies on
    live_triangle: Ints  # [N] the triangle of `face` an anchor lies on, or -1
    rest_areas: Floats  # [N] mm^2, twice its triangle's area on the mean face
    scales: Floats  # [N] mm, standard deviation at rest on the mean face
    shine: Floats  # [2, U] weights of sheen and gloss
    blood: Floats  # [L] 1 where the skin changes colour as it stretches, else 0

    def still(self, vertices: Floats, lights: Lighting = STUDIO) -> Still:  # [V, 3] mm
        """Prepare a person; vertices are those of the face at rest."""
        normals, _, areas = self.whole.normals(vertices)
        return Still(
            facing(normals),
            lights.parts(normals),
            self.face.normals(vertices)[1],
            self.scales * stretched(areas.take(self.triangle), self.rest_areas),
        )

    def place(
        self,
        vertices: Floats,  # [V, 3] mm
        seen: Floats,  # [2, U] shares of the sky and of the key light
        still: Still,
        out: Placed,  # filled
        lights: Lighting = STUDIO,
    ) -> None:
        """The anchored Gaussians of a posed face."""
        normals, sums, areas = self.face.normals(vertices)
        quats, parts = still.quats.copy(), still.parts.copy()
        kernels.face(normals, self.live, BEHIND, quats)
        lights.renew(normals, self.live, self.flush(sums, still.sums), parts)
        light = lighting.shaded(parts, self.shine, seen)
        kernels.widen(
            *(areas, self.live_triangle, self.rest_areas, self.scales, still.widths),
            *(*STRETCH, FLATNESS, out.scales),
        )
        corners, rows, weights = self._anchors
        kernels.ride(
            *(vertices, quats, light, corners, rows, weights),
            *(out.means, out.quats, out.light),
        )

    @cached_property
    def _anchors(self) -> tuple[Ints, Ints, Floats]:  # [N, 3] each
        """Vertices around the anchors, their rows of `used`, and their shares."""
        rows = self.interpolate.indices.reshape(-1, 3).astype(np.int32)
        weights = self.interpolate.data.reshape(-1, 3).astype(np.float32)
        return self.used[rows], rows, weights

    def flush(self, sums: Floats, rest_sums: Floats) -> Floats:  # [L], [L] -> [L, 3]
        """Gain of linear light: stretched skin pales, pressed skin darkens and reddens."""
        gains = np.empty((len(sums), 3), np.float32)
        kernels.flush(sums, rest_sums, self.blood, FLUSH, *FLUSHES, gains)
        return gains


def build(
    mesh: Floats,  # [V, 3] mm, the mean face
    faces: Ints,  # [F, 3] every triangle of the mesh
    drawn: Ints,  # [D] rows of `faces` that are drawn
    kinds: Ints,  # [V] SKIN, EYE, WET or DRY
    blood: Ints,  # vertices whose skin flushes
    triangles: Ints,  # [N] the anchors' rows of `faces`
    weights: Floats,  # [N, 3] barycentric coordinates
    widths: Floats,  # [N] mm
) -> Surface:
    """The linear algebra of a set of anchors."""
    corners = faces[triangles]
    used = np.unique(corners)
    live = np.flatnonzero((kinds[used] == EYE) | np.isin(used, blood))
    whole, rows_whole = _around(faces, drawn, used, len(mesh))
    face, rows_face = _around(faces, drawn, used[live], len(mesh))
    row_of = np.full(len(mesh), -1, np.int32)
    row_of[used] = np.arange(len(used))
    count = len(corners)
    interpolate = csr_array(
        (
            weights.ravel().astype(np.float32),
            row_of[corners.ravel()],
            np.arange(0, 3 * count + 1, 3, dtype=np.int32),
        ),
        shape=(count, len(used)),
    )
    a, b, c = (mesh[faces[triangles, k]].astype(np.float32) for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1).astype(np.float32)
    return Surface(
        used=used.astype(np.int32),
        whole=whole,
        live=live.astype(np.int32),
        face=face,
        interpolate=interpolate,
        triangle=rows_whole[triangles],
        live_triangle=rows_face[triangles],
        rest_areas=areas + np.float32(1e-9),
        scales=widths.astype(np.float32),
        shine=np.ascontiguousarray(SHINE[kinds[used]].T),
        blood=(kinds[used[live]] != EYE).astype(np.float32),
    )


def _around(faces: Ints, drawn: Ints, vertices: Ints, count: int) -> tuple[Around, Ints]:
    """The drawn triangles around vertices; and which of them each triangle [F] is, else -1."""
    chosen = drawn[np.isin(faces[drawn], vertices).any(1)]
    near = np.ascontiguousarray(faces[chosen], np.int32)
    row_of = np.full(count, -1, np.int32)
    row_of[vertices] = np.arange(len(vertices))
    place = np.full(len(faces), -1, np.int32)
    place[chosen] = np.arange(len(chosen))
    return Around(near, row_of[near], len(vertices)), place


def facing(normals: Floats) -> Floats:  # [n, 3] unit -> [n, 4] wxyz
    """The shortest turn from z to the normal; a splat is round in its plane, so it suffices.

    Linear in the normal, so what is mixed of such turns is the turn of the mixed normal.
    """
    quats = np.empty((len(normals), 4), np.float32)
    kernels.face(normals, np.arange(len(normals), dtype=np.int32), BEHIND, quats)
    return quats


def faced(quats: Floats) -> Floats:  # [n, 4] -> [n, 3]
    """The normals that `facing` was given."""
    return np.stack([quats[:, 2], -quats[:, 1], quats[:, 0] - BEHIND], 1)


def stretched(areas: Floats, rest_areas: Floats) -> Floats:
    """How far widths follow their triangles; `kernels.widen` does it to those that move."""
    return np.clip(np.sqrt(areas / rest_areas), *STRETCH)
