"""The hem of a shirt: threads along its neckline, where cloth and skin would end unevenly."""

import numpy as np
from numpy.typing import NDArray

from render.decoder import beard as beards
from render.decoder import mesh_parts
from render.decoder.beard import Beard
from render.lighting import STUDIO
from render.strands import strand_light
from render.training.geometry.assembly import Assembly
from render.training.look.clothes import WEAVE, height
from render.types import Floats

# Threads: at which heights over the neckline, off the skin, how wide; a piece, how far
# apart they are, and what of the lamps they see: threads mirror as hair does, cloth does not.
HEM_MM, HEM_OUT_MM, HEM_WIDTH_MM = (-2.6, -1.2, 0.2), 1.0, 0.75
THREAD_MM, APART_MM, MATTE = 7.0, 2.2, 0.3


def threads(
    assembly: Assembly,
    vertices: Floats,  # [V, 3] mm at rest
    used: NDArray[np.integer],  # [U] vertices whose light is known
    seen: Floats,  # [4, U] shares of light
    color: tuple[float, float, float],
    rng: np.random.Generator,
) -> Beard:
    """For one person; they move with the skin as a beard does."""
    neutral, faces = assembly.face.neutral, assembly.face.faces[assembly.kinds == mesh_parts.SKIN]
    row = np.full(len(neutral), -1)
    row[used] = np.arange(len(used))
    above = height(neutral)[faces] > 0
    crossed = (above.sum(1) % 3 > 0) & (row[faces] >= 0).all(1)
    faces, above = faces[crossed], above[crossed]
    alone = (above == (above.sum(1) == 1)[:, None]).argmax(1)  # on the other side than two are
    corners = np.take_along_axis(faces, (alone[:, None] + np.arange(3)) % 3, 1)
    a, b, c = height(neutral)[corners].T
    one, other, none = a / (a - b), a / (a - c), np.zeros_like(a)
    first, last = np.stack([1 - one, one, none], 1), np.stack([1 - other, none, other], 1)
    ends = [(vertices[corners] * share[..., None]).sum(1) for share in (first, last)]
    x, _, z = (0.5 * (ends[0] + ends[1])).T
    around = np.argsort(np.arctan2(x, z - z.mean()))
    length = np.linalg.norm(ends[1] - ends[0], axis=1)[around]
    until = np.cumsum(length)
    at = np.arange(APART_MM / 2, until[-1], APART_MM)
    step = np.searchsorted(until, at)
    share, which = ((until[step] - at) / length[step])[:, None], around[step]
    shares, corners = first[which] + share * (last - first)[which], corners[which]
    roots = (vertices[corners] * shares[..., None]).sum(1)
    normal, along = beards.frames(vertices, corners)[..., 2], (ends[1] - ends[0])[which]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    up = np.cross(normal, along)
    up *= np.sign(up[:, 1:2])
    known = np.einsum("kns,ns->nk", seen[:, row[corners]], shares)
    cloth = np.array(color, np.float32) ** 2 * STUDIO.shade(normal.astype(np.float32), known)
    known[:, 1:] *= MATTE
    parts = []
    for rise in HEM_MM:
        middle = roots + rise * up + HEM_OUT_MM * normal
        lines = np.stack([middle - 0.5 * THREAD_MM * along, middle + 0.5 * THREAD_MM * along], 1)
        bright = 1 + WEAVE * rng.standard_normal((len(at), 1))
        lit = strand_light(along, normal, cloth, known, STUDIO)
        albedo = cloth * np.clip(cloth / np.maximum(lit, 1e-4), 0, 20) * bright
        widths, opacities = (np.full((len(at), 1), v, np.float32) for v in (HEM_WIDTH_MM, 0.97))
        args = widths, corners, vertices, opacities, np.clip(albedo, 0, 1).astype(np.float32), known
        parts.append(beards.attached(lines, *args))
    return beards.joined(parts)
