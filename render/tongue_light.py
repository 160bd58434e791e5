"""Light on the tongue that the occlusion of a face leaves out.

A raised tongue is lit between the teeth and through the lips, the more the nearer its tip comes to
them; towards the throat it is left in the dark. The mesh renderer does the same.
"""

# pyright: reportUntypedFunctionDecorator=false
from dataclasses import dataclass

import numpy as np
from numba import njit

from render.types import Floats, Ints

TIP_MM = np.float32(9.0)  # a tongue's tip at rest lies so far behind the teeth
SHARE = np.float32(1.0)  # of sky and key light that a tongue at the teeth sees at least
REACH_MM = np.float32(10.5)  # behind them where that is a quarter
SHUT_MM, PARTED_MM = np.float32(3.8), np.float32(5.4)  # gap of lips that let none, all of it in


@dataclass(frozen=True)
class TongueLight:
    """Which of the decoder's vertices it reaches."""

    rows: Ints  # of the shares of light
    vertices: Ints  # of the mesh, which these rows are

    @classmethod
    def of(cls, used: Ints, tongue: Ints) -> "TongueLight":
        """[U] vertices that shares are known of, vertices of the tongue."""
        rows = np.flatnonzero(np.isin(used, tongue)).astype(np.int32)
        return cls(rows, used[rows])

    def fill(self, vertices: Floats, rest: Floats, seen: Floats, parted_mm: float) -> None:
        """[V, 3] mm, [V, 3] mm at rest, [4, U] shares of the sky, of the key light and the rims:
        these are changed in place; how far the lips part."""
        light_tongue(vertices, rest, self.vertices, self.rows, seen, np.float32(parted_mm))


@njit(cache=True, nogil=True, error_model="numpy")
def light_tongue(
    vertices: Floats,  # [V, 3] mm
    rest: Floats,  # [V, 3] mm
    members: Ints,  # [n] vertices of the tongue, and ...
    rows: Ints,  # [n] ... which rows of the shares they are
    seen: Floats,  # [4, U], changed in place
    parted_mm: np.float32,
) -> None:
    one, none, teeth = np.float32(1), np.float32(0), np.float32(-np.inf)
    most = SHARE * min(max((parted_mm - SHUT_MM) / (PARTED_MM - SHUT_MM), none), one)
    for member in members:
        teeth = max(teeth, rest[np.uintp(member), 2] + TIP_MM)
    for n in range(len(members)):
        deep = max(teeth - vertices[np.uintp(members[n]), 2], none) / REACH_MM
        near = one / (one + deep * deep)
        row = np.uintp(rows[n])
        for k in range(2):
            seen[k, row] = max(seen[k, row], most * near * near)
