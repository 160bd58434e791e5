"""Light between teeth, gums and lips that the occlusion of a face leaves out.

Teeth scatter light and pass it on to each other, which fills the shade of lips. The upper lip keeps
sky and key light off the teeth behind it, but the lower ones, the tongue and the lower lip light
these; lower teeth sink behind their lip as the mouth opens.
"""

# pyright: reportUntypedFunctionDecorator=false
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from render.types import Floats, Ints

# What reaches teeth, by the share that is seen straight: v (v (a v + b) + c), the fit of Jimenez et
# al. 2016 for an albedo of 0.8.
FIT = np.array([1.2999, -3.1944, 2.8945], np.float32)
MOST, SOON = np.float32(0.75), np.float32(0.25)  # what front ones tend to, how soon
HIGH_MM, LEAST = 8.0, 0.4  # so far up the upper teeth they see that share of their edges' light
BACK_MM = (4.0, 14.0)  # behind the foremost tooth: in all of that light, out of it
PARTED_MM = (5.0, 14.0)  # gap of the lips over which lower teeth sink behind them
SUNK = np.array([0.45, 0.8], np.float32)  # of their light, lost at their edges and HIGH_MM down


@dataclass(frozen=True)
class TeethLight:
    """Which of the decoder's vertices it reaches."""

    rows: Ints  # of the shares of light: teeth and gums
    lower: Ints  # front teeth below the lips
    upper: Ints  # those above
    low: Floats  # [lower] 0..1 how far they are in front
    high: Floats  # [upper] the same, and down
    sunk: Floats  # [lower] share of light that is lost behind a lip

    @classmethod
    def of(
        cls,
        teeth: Ints,  # rows of the used vertices
        gums: NDArray[np.bool_],  # [U]
        points: Floats,  # [U, 3] mm, on the mean face
        lips_mm: float,  # how high its lips are
    ) -> "TeethLight":
        place, (near, far) = points[teeth], BACK_MM
        front = np.clip((far - (place[:, 2].max() - place[:, 2])) / (far - near), 0, 1)
        below = place[:, 1] < lips_mm
        lower, upper = below & (front > 0), ~below & (front > 0)
        up = np.clip((place[upper, 1] - place[upper, 1].min()) / HIGH_MM, 0, 1)
        down = np.clip((place[lower, 1].max() - place[lower, 1]) / HIGH_MM, 0, 1)
        shares = front[lower], front[upper] * (1 - (1 - LEAST) * up), np.interp(down, (0, 1), SUNK)
        rows = np.union1d(teeth, np.flatnonzero(gums)).astype(np.int32)
        return cls(rows, teeth[lower], teeth[upper], *(s.astype(np.float32) for s in shares))

    def of_vertices(self, used: Ints) -> "TeethLight":  # [U]
        """The same for shares of all vertices of the mesh."""
        rows, lower, upper = (used[rows] for rows in (self.rows, self.lower, self.upper))
        return replace(self, rows=rows, lower=lower, upper=upper)

    def fill(self, seen: Floats, parted_mm: float) -> None:
        """[4, U] shares of the sky, of the key light and the rims: the first two changed in place;
        how far the lips part."""
        near, far = PARTED_MM
        parted = np.float32(min(max((parted_mm - near) / (far - near), 0), 1))
        scatter(self.rows, FIT, seen)
        light_teeth(self.lower, self.upper, self.low, self.high, self.sunk, parted, seen)


def scattered(seen: Floats) -> Floats:
    """Shares of light on teeth that are seen straight -> that reach them."""
    out = np.ascontiguousarray(seen.T, np.float32)
    scatter(np.arange(len(seen), dtype=np.int32), FIT, out)
    return out.T


@njit(cache=True, nogil=True, error_model="numpy")
def scatter(
    rows: Ints,  # [n] vertices of teeth and gums
    fit: Floats,  # [3]
    seen: Floats,  # [2 and more, U], the first two changed in place
) -> None:
    a, b, c = fit[0], fit[1], fit[2]
    for k in range(2):
        for row in rows:
            u = np.uintp(row)
            share = seen[k, u]
            seen[k, u] = max(share, share * (share * (a * share + b) + c))


@njit(cache=True, nogil=True, error_model="numpy")
def light_teeth(
    lower: Ints,  # [n] see TeethLight
    upper: Ints,  # [m]
    low: Floats,  # [n]
    high: Floats,  # [m]
    sunk: Floats,  # [n]
    parted: np.float32,  # 0..1
    seen: Floats,  # [4, U], changed in place
) -> None:
    one = np.float32(1)
    for k in range(2):
        total, count = np.float32(0), np.float32(0)
        for n in range(len(lower)):
            row = np.uintp(lower[n])
            share = seen[k, row]
            inner = MOST * (one - np.exp(-share / SOON))
            total, count = total + low[n] * inner, count + low[n]
            lit = share + low[n] * (max(share, inner) - share)
            seen[k, row] = lit * (one - parted * sunk[n])
        for n in range(len(upper)):
            row = np.uintp(upper[n])
            seen[k, row] = max(seen[k, row], high[n] * total / count)
