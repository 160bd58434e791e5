"""Strands attached to triangles of the skin: brows, lashes and beards.

A strand knows its triangle and where it is from its root there, in the triangle's own frame: so it
fits anyone's skin.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from render.decoder.kernels import surface as kernels
from render.decoder.surface import BEHIND
from render.lighting import Lighting, developed
from render.strands import strand_light
from render.types import Floats


@dataclass(frozen=True, eq=False)
class Beard:
    """[B] Gaussians; the frame of a triangle: its first edge, across it, its normal."""

    corners: NDArray[np.uint16]  # [B, 3] vertices of the triangle
    shares: Floats  # [B, 3] barycentric coordinates of the root
    offsets: Floats  # [B, 3] mm from the root, in the triangle's frame
    along: Floats  # [B, 3] unit: the strand's direction there, in the same frame
    scales: Floats  # [B, 3] mm: along the strand, and twice across it
    opacities: Floats  # [B]
    albedo: Floats  # [B, 3] stored: the square root of linear
    seen: Floats  # [B, 4] shares of the sky, of the key light and the rims at rest

    def __len__(self) -> int:
        return len(self.corners)

    def take(self, rows: NDArray[np.bool_]) -> "Beard":
        """Some of the strands, in this order."""
        return Beard(*(getattr(self, f.name)[rows] for f in fields(Beard)))

    def attach(self, vertices: Floats, means: Floats, quats: Floats) -> None:
        """[V, 3] mm -> where the strands are: means [B, 3] mm, quats [B, 4], filled."""
        kernels.attach(
            *(vertices, self.corners, self.shares, self.offsets, self.along, BEHIND, means, quats)
        )

    def lit(self, rest: Floats, lights: Lighting) -> Floats:  # [V, 3] mm -> [B, 3] stored
        """Colours, with the light that reaches them at rest."""
        if not len(self):
            return np.zeros((0, 3), np.float32)
        turns = frames(rest, self.corners)
        along = np.einsum("nij,nj->ni", turns, self.along)
        outward = np.ascontiguousarray(turns[..., 2])
        return developed(strand_light(along, outward, self.albedo**2, self.seen, lights))


def none() -> Beard:
    return of({})


def joined(parts: list[Beard]) -> Beard:
    """All of them together."""
    names = [f.name for f in fields(Beard)]
    return Beard(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))


def frames(vertices: Floats, corners: NDArray[np.integer]) -> Floats:  # -> [B, 3, 3]
    """The frames of triangles [B, 3]: columns are their axes."""
    a, b, c = (vertices[corners[:, k]] for k in range(3))
    first, normal = b - a, np.cross(b - a, c - a)
    first = first / (np.linalg.norm(first, axis=1, keepdims=True) + 1e-12)
    normal = normal / (np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12)
    return np.stack([first, np.cross(normal, first), normal], -1)


def attached(
    lines: Floats,  # [n, K, 3] mm: strands from the root, on the face at rest
    widths: Floats,  # [n, K - 1] mm: standard deviation across each piece
    corners: NDArray[np.integer],  # [n, 3] vertices of the triangle each stands on
    rest: Floats,  # [V, 3] mm
    opacities: Floats,  # [n, K - 1]
    albedo: Floats,  # [n, 3] linear
    seen: Floats,  # [n, 4]
) -> Beard:
    """One Gaussian a piece."""
    pieces = lines.shape[1] - 1
    turns = frames(rest, corners)
    shares = barycentric(lines[:, 0], rest, corners)
    roots = (rest[corners] * shares[..., None]).sum(1)
    middles = 0.5 * (lines[:, 1:] + lines[:, :-1]) - roots[:, None]
    steps = lines[:, 1:] - lines[:, :-1]
    length = np.linalg.norm(steps, axis=2, keepdims=True)
    local = [np.einsum("nij,npi->npj", turns, x) for x in (middles, steps / (length + 1e-9))]
    scales = np.concatenate([LENGTH * length, np.repeat(widths[..., None], 2, 2)], 2)
    offsets, along, sizes = (x.reshape(-1, 3).astype(np.float32) for x in (*local, scales))
    return Beard(
        corners=np.repeat(corners.astype(np.uint16), pieces, 0),
        shares=np.repeat(shares, pieces, 0).astype(np.float32),
        offsets=offsets,
        along=along,
        scales=sizes,
        opacities=opacities.ravel().astype(np.float32),
        albedo=np.repeat(np.sqrt(albedo), pieces, 0).astype(np.float32),
        seen=np.repeat(seen, pieces, 0).astype(np.float32),
    )


LENGTH = 0.36  # standard deviation of a Gaussian along its piece, as a share of it


def barycentric(points: Floats, rest: Floats, corners: NDArray[np.integer]) -> Floats:  # [n, 3]
    """Places on triangles nearest to points, drawn inside."""
    a, b, c = (rest[corners[:, k]] for k in range(3))
    e, f, p = b - a, c - a, points - a
    ee, ef, ff = (e * e).sum(1), (e * f).sum(1), (f * f).sum(1)
    ep, fp = (e * p).sum(1), (f * p).sum(1)
    det = ee * ff - ef * ef + 1e-9
    u, v = (ff * ep - ef * fp) / det, (ee * fp - ef * ep) / det
    shares = np.clip(np.stack([1 - u - v, u, v], 1), 0, 1)
    return (shares / shares.sum(1, keepdims=True)).astype(np.float32)


def tensors(beard: Beard) -> dict[str, NDArray[np.generic]]:
    """Tensors for an avatar file; empty without strands."""
    if not len(beard):
        return {}
    return {
        "beard_corners": beard.corners,
        "beard_shares": np.rint(beard.shares * 255).astype(np.uint8),
        "beard_offsets": beard.offsets.astype(np.float16),
        "beard_along": np.rint(beard.along * 127).astype(np.int8),
        "beard_scales": beard.scales[:, :2].astype(np.float16),
        "beard_opacities": np.rint(beard.opacities * 255).astype(np.uint8),
        "beard_albedo": np.rint(beard.albedo * 255).astype(np.uint8),
        "beard_seen": np.rint(beard.seen * 255).astype(np.uint8),
    }


def of(t: dict[str, NDArray[np.generic]]) -> Beard:
    """From the tensors of an avatar file."""

    def part(name: str, unit: float, width: int) -> Floats:
        stored = t.get(f"beard_{name}", np.zeros((0, width) if width else 0))
        return stored.astype(np.float32) / np.float32(unit)

    shares, along, scales = part("shares", 255, 3), part("along", 127, 3), part("scales", 1, 2)
    return Beard(
        corners=t.get("beard_corners", np.zeros((0, 3))).astype(np.uint16),
        shares=shares / np.maximum(shares.sum(1, keepdims=True), 1e-6),
        offsets=part("offsets", 1, 3),
        along=along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-6),
        scales=scales[:, [0, 1, 1]],
        opacities=part("opacities", 255, 0),
        albedo=part("albedo", 255, 3),
        seen=part("seen", 255, 4),
    )
