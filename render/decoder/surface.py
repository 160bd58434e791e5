"""The Gaussian half of the decoder: posed vertices -> Gaussians that ride on the skin.

Each Gaussian is anchored to a triangle (UV Gaussians: a fixed place in texture space, the same for
everyone). It lies flat on the surface, stretches with it, and its colour is the person's albedo
under the light that the posed face receives.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from render import lighting
from render.decoder.kernels import light as light_kernels
from render.decoder.kernels import surface as kernels
from render.decoder.lines import AT_REST
from render.decoder.mesh_parts import Triangles
from render.decoder.neck import RestSurface, TurnedHead
from render.lighting import STUDIO, Lighting
from render.types import Floats, Ints, Shorts
from sensors.threads import Share, in_turn

SKIN, EYE, WET, DRY = range(4)  # kinds of vertices
FLATNESS = np.float32(0.2)  # thickness of a Gaussian, as a share of its width
FLUSH = np.array([0.06, 0.20, 0.17], np.float32)  # of red, green, blue for a doubled area
# Shares of the area at rest; beyond them the colour stays.
FLUSHES = (np.float32(0.6), np.float32(1.35))
BEHIND = np.float32(1.0001)  # more than 1: straight backward is a rotation too
LIGHT = slice(kernels.LIGHT, kernels.LIGHT + 3)  # linear, of what a vertex carries
AT_ONCE, VERTICES_AT_ONCE = 96 * kernels.BLOCK, 36 * kernels.BLOCK  # that a thread makes
STRETCH = (np.float32(0.6), np.float32(1.5))  # how far the width follows the triangle


class SkinGaussians(NamedTuple):
    """Gaussians on the skin, but for their opacities."""

    means: Floats  # [N, 3] mm
    quats: Floats  # [N, 4] wxyz, see normals_of
    scales: Floats  # [N, 3] mm: flat, round in its plane
    colors: Floats  # [N, 3] stored, 0..1, without mirrored light
    shine: Floats  # [N, 4] weight of the mirrored light of each lamp


class Posed(NamedTuple):
    """What the Gaussians of a posed face have from its vertices."""

    normals: Floats  # [U, 3] unit
    flush: Floats  # [L, 3] gain of linear light, see Surface.flush
    stretches: Floats  # [F + 1] factors of widths, of the triangles of `face`
    widths: Floats  # [N] mm, not stretched by them


@dataclass(frozen=True)
class Surface:
    """Shared by everyone; holds no state."""

    used: Ints  # [U] vertices that carry Gaussians
    whole: Triangles  # all used vertices
    live: Ints  # [L] rows of `used` on face, eyes and tongue: lit anew in every frame
    face: Triangles  # the live ones
    interpolate: csr_array  # [N, U] vertices -> anchors
    triangle: Ints  # [N] triangle of `whole` an anchor lies on
    live_triangle: Ints  # [N] the triangle of `face` an anchor lies on, or -1
    rest_areas: Floats  # [N] mm^2, twice its triangle's area on the mean face
    scales: Floats  # [N] mm, standard deviation at rest on the mean face
    blood: Floats  # [L] 1 where the skin changes colour as it stretches, else 0
    depths: Floats  # [N] mm under the skin

    def at_rest(self, vertices: Floats) -> RestSurface:  # [V, 3] mm
        """Prepare a person from the face at rest."""
        normals, _, areas = self.whole.normals(vertices)
        widths = self.scales * stretch(areas.take(self.triangle), self.rest_areas)
        return RestSurface(
            normals,
            self.face.normals(vertices)[1],
            np.where(self.live_triangle < 0, widths, self.scales),
        )

    def posed(self, vertices: Floats, rest: RestSurface, turned: TurnedHead | None = None) -> Posed:
        """What follows from the vertices [V, 3] mm alone; `turned`: how the head is turned from
        where they are, and how the skin of the neck is bent and stretched."""
        if turned:
            rest = turned.surface(rest)
        totals, areas = self.face.around(vertices)
        normals = rest.normals.copy()
        kernels.normalise(totals, self.live, normals)
        kernels.stretches(areas, self.anchors[3], *STRETCH)
        return Posed(normals, self.flush(totals[:-1, 3], rest.sums), areas, rest.widths)

    def light(
        self,
        vertices: Floats,  # [V, 3] mm
        visibility: Floats,  # [4, U] shares of the sky, of the key light and the rims
        posed: Posed,
        lights: Lighting = STUDIO,
        move: Floats = AT_REST,  # [3, 4] how the head is turned from where the vertices are
        share: Share = in_turn,
    ) -> Floats:
        """What `kernels.skin_gaussians` interpolates from each used vertex [U, CARRIED]; the light
        on a white surface is at LIGHT."""
        towards, count = lighting.TOWARDS_AND_UP @ move[:, :3], len(self.used)
        out = np.empty((count, kernels.CARRIED), np.float32)

        def light(part: int) -> None:
            light_kernels.vertex_attributes(
                *(part * VERTICES_AT_ONCE, min((part + 1) * VERTICES_AT_ONCE, count)),
                *(vertices, self.used, posed.normals, visibility, towards, *lights.terms),
                *(lighting.BLEED, lighting.BOUNCE, BEHIND, move, out),
            )

        share(light, -(count // -VERTICES_AT_ONCE))
        light_kernels.gain_light(self.live, posed.flush, out)
        return out

    def gaussians(
        self,
        carried: Floats,  # [U, CARRIED] see `light`
        posed: Posed,
        reflected: Floats,  # [N, 3] linear albedo
        gloss: Floats,  # [N] weight of mirrored light
        out: SkinGaussians,  # filled, but for the shine of the rims
    ) -> list[Callable[[], None]]:
        """Calls that make them, some each, for threads to share."""
        rows, weights, triangles, _ = self.anchors
        look = reflected, gloss, self.depths, lighting.FILM, FLATNESS, BEHIND

        def make(first: int) -> None:
            span = first, min(first + AT_ONCE, len(rows)), carried, rows, weights
            kernels.skin_gaussians(*span, posed.stretches, triangles, posed.widths, *look, *out)

        return [partial(make, first) for first in range(0, len(rows), AT_ONCE)]

    def take(self, rows: NDArray[np.intp]) -> "Surface":
        """Some of the anchors, in this order."""
        return replace(
            self,
            interpolate=self.interpolate[rows],
            triangle=self.triangle[rows],
            live_triangle=self.live_triangle[rows],
            rest_areas=self.rest_areas[rows],
            scales=self.scales[rows],
            depths=self.depths[rows],
        )

    def share_on(self, vertices: NDArray[np.integer]) -> Floats:  # [N] 0..1
        """How much of each anchor lies on these vertices."""
        return self.interpolate @ np.isin(self.used, vertices).astype(np.float32)

    @cached_property
    def anchors(self) -> tuple[Shorts, Floats, Shorts, Floats]:
        """Rows of `used` around the anchors [N, 3] and their shares [N, 3]; the triangles of
        `face` that their widths follow [N], or the one after the last; the areas of these at rest
        on the mean face [F + 1] mm^2, 1 for the last."""
        rows = self.interpolate.indices.reshape(-1, 3).astype(np.uint16)
        weights = self.interpolate.data.reshape(-1, 3).astype(np.float32)
        follows = self.live_triangle >= 0
        triangles = np.where(follows, self.live_triangle, len(self.face.corners)).astype(np.uint16)
        areas = np.ones(len(self.face.corners) + 1, np.float32)
        areas[self.live_triangle[follows]] = self.rest_areas[follows]
        return rows, weights, triangles, areas

    def flush(self, sums: Floats, rest_sums: Floats) -> Floats:  # [L], [L] -> [L, 3]
        """Gain of linear light: stretched skin pales, pressed skin darkens and reddens."""
        gains = np.empty((len(sums), 3), np.float32)
        light_kernels.flush(sums, rest_sums, self.blood, FLUSH, *FLUSHES, gains)
        return gains


def build(
    mesh: Floats,  # [V, 3] mm, the mean face
    faces: Ints,  # [F, 3] every triangle of the mesh
    drawn: Ints,  # [D] rows of `faces` that are drawn
    kinds: Ints,  # [V] SKIN, EYE, WET or DRY
    blood: Ints,  # vertices whose skin flushes
    lids: Ints,  # vertices whose skin moves as much and does not: stretched it would be pale
    tongue: Ints,  # vertices
    triangles: Ints,  # [N] the anchors' rows of `faces`
    weights: Floats,  # [N, 3] barycentric coordinates
    widths: Floats,  # [N] mm
) -> Surface:
    """The linear algebra of a set of anchors."""
    corners = faces[triangles]
    used = np.unique(corners)
    flushing = np.isin(used, np.setdiff1d(blood, lids))
    moving = flushing | np.isin(used, np.concatenate([lids, tongue]))
    live = np.flatnonzero((kinds[used] == EYE) | moving)
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
        blood=(flushing & (kinds[used] != EYE))[live].astype(np.float32),
        depths=np.zeros(count, np.float32),
    )


def _around(faces: Ints, drawn: Ints, vertices: Ints, count: int) -> tuple[Triangles, Ints]:
    """The drawn triangles around vertices; and which of them each triangle [F] is, else -1."""
    chosen = drawn[np.isin(faces[drawn], vertices).any(1)]
    near = np.ascontiguousarray(faces[chosen], np.uint16)
    row_of = np.full(count, len(vertices), np.uint16)
    row_of[vertices] = np.arange(len(vertices))
    place = np.full(len(faces), -1, np.int32)
    place[chosen] = np.arange(len(chosen))
    return Triangles(near, row_of[near], len(vertices)), place


def normals_of(quats: Floats) -> Floats:  # [n, 4] -> [n, 3]
    """The normals that a splat's turn was made from.

    It is the shortest turn from z to the normal (a splat is round in its plane, so it suffices):
    linear in the normal, so what is mixed of such turns is the turn of the mixed normal.
    """
    return np.stack([quats[:, 2], -quats[:, 1], quats[:, 0] - BEHIND], 1)


def stretch(areas: Floats, rest_areas: Floats) -> Floats:
    """Factor of the widths of Gaussians on stretched triangles; `kernels.skin_gaussians` twin."""
    return np.clip(np.sqrt(areas / rest_areas), *STRETCH)
