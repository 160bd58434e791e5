"""Beards: thin Gaussians along strands that stand on triangles of the skin, and go where it goes.

Hair of the head rests; a beard follows the jaw and the lips. A strand knows its triangle and
where it is from its root there, in the triangle's own frame: so it fits anyone's skin.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render import kernels
from render.surface import BEHIND

Floats = NDArray[np.float32]
OFFSET_STEPS = np.float32(5)  # a millimetre in a file; int8 reaches 25 mm


@dataclass(frozen=True, eq=False)
class Beard:
    """[B] Gaussians; the frame of a triangle: its first edge, across it, its normal."""

    corners: NDArray[np.uint16]  # [B, 3] vertices of the triangle
    shares: Floats  # [B, 3] barycentric coordinates of the root
    offsets: Floats  # [B, 3] mm from the root, in the triangle's frame
    along: Floats  # [B, 3] unit: the strand's direction there, in the same frame
    scales: Floats  # [B, 3] mm: along the strand, and twice across it
    opacities: Floats  # [B]
    colors: Floats  # [B, 3] with the light that reaches them at rest

    def __len__(self) -> int:
        return len(self.corners)

    def stand(self, vertices: Floats, means: Floats, quats: Floats) -> None:
        """[V, 3] mm -> where the strands are: means [B, 3] mm, quats [B, 4], filled."""
        kernels.stand(
            *(vertices, self.corners, self.shares, self.offsets, self.along, BEHIND, means, quats)
        )


def none() -> Beard:
    return of({})


def frames(vertices: Floats, corners: NDArray[np.integer]) -> Floats:  # -> [B, 3, 3]
    """The frames of triangles [B, 3]: columns are their axes."""
    a, b, c = (vertices[corners[:, k]] for k in range(3))
    first, normal = b - a, np.cross(b - a, c - a)
    first = first / (np.linalg.norm(first, axis=1, keepdims=True) + 1e-12)
    normal = normal / (np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12)
    return np.stack([first, np.cross(normal, first), normal], -1)


def tensors(beard: Beard) -> dict[str, NDArray[np.generic]]:
    """For an avatar file; nothing for the shaven."""
    if not len(beard):
        return {}
    return {
        "beard_corners": beard.corners,
        "beard_shares": np.rint(beard.shares * 255).astype(np.uint8),
        "beard_offsets": np.rint(np.clip(beard.offsets, -25, 25) * OFFSET_STEPS).astype(np.int8),
        "beard_along": np.rint(beard.along * 127).astype(np.int8),
        "beard_scales": beard.scales.astype(np.float16),
        "beard_opacities": np.rint(beard.opacities * 255).astype(np.uint8),
        "beard_colors": np.rint(beard.colors * 255).astype(np.uint8),
    }


def of(t: dict[str, NDArray[np.generic]]) -> Beard:
    """From the tensors of an avatar file."""

    def part(name: str, unit: float, width: int) -> Floats:
        stored = t.get(f"beard_{name}", np.zeros((0, width) if width else 0))
        return stored.astype(np.float32) / np.float32(unit)

    shares, along = part("shares", 255, 3), part("along", 127, 3)
    return Beard(
        corners=t.get("beard_corners", np.zeros((0, 3))).astype(np.uint16),
        shares=shares / np.maximum(shares.sum(1, keepdims=True), 1e-6),
        offsets=part("offsets", float(OFFSET_STEPS), 3),
        along=along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-6),
        scales=part("scales", 1, 3),
        opacities=part("opacities", 255, 0),
        colors=part("colors", 255, 3),
    )
