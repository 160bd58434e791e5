"""Light on front teeth that the occlusion of a face leaves out.

What comes in between lips that hardly part is passed on between them and the teeth. The upper lip
keeps sky and key light off the teeth behind it, but the lower ones, the tongue and the lower lip
light these; lower teeth sink behind their lip as the mouth opens.
"""

# pyright: reportUntypedFunctionDecorator=false
from dataclasses import dataclass

import numpy as np
from numba import njit

from render.types import Floats, Ints

MOST, SOON = np.float32(0.75), np.float32(0.25)  # share of light they tend to; how soon
UP_MM, LEAST = 8.0, 0.4  # so far above the edges of the upper teeth: of what their edges see
BACK_MM = (4.0, 14.0)  # behind the foremost tooth: in all of that light, out of it
PARTED_MM, SUNK = (5.0, 14.0), 0.45  # gap of the lips; of the light on lower teeth, how much is lost


@dataclass(frozen=True)
class TeethLight:
    """Which of the decoder's vertices it reaches."""

    lower: Ints  # rows of the shares of light: front teeth below the lips
    upper: Ints  # those above
    front: tuple[Floats, Floats]  # [lower], [upper] 0..1 how far they are in front, upper: and down

    @classmethod
    def of(cls, teeth: Ints, points: Floats, lips_mm: float) -> "TeethLight":
        """Rows of the used vertices that are teeth [n], where these vertices are on the mean face
        [U, 3] mm, the height of its lips."""
        place, (near, far) = points[teeth], BACK_MM
        front = np.clip((far - (place[:, 2].max() - place[:, 2])) / (far - near), 0, 1)
        below = place[:, 1] < lips_mm
        lower, upper = below & (front > 0), ~below & (front > 0)
        up = np.clip((place[upper, 1] - place[upper, 1].min()) / UP_MM, 0, 1)
        shares = front[lower], front[upper] * (1 - (1 - LEAST) * up)
        return cls(teeth[lower], teeth[upper], tuple(s.astype(np.float32) for s in shares))

    def fill(self, seen: Floats, parted_mm: float) -> None:
        """[4, U] shares of the sky, of the key light and the rims: the first two changed in place;
        how far the lips part."""
        near, far = PARTED_MM
        sunk = np.float32(1 - SUNK * min(max((parted_mm - near) / (far - near), 0), 1))
        light_teeth(self.lower, self.upper, *self.front, sunk, seen)


@njit(cache=True, nogil=True, error_model="numpy")
def light_teeth(
    lower: Ints,  # [n] rows of the shares, and ...
    upper: Ints,  # [m]
    low: Floats,  # [n] ... see TeethLight.front
    high: Floats,  # [m]
    sunk: np.float32,  # 0..1 what is left of the light on the lower ones
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
            seen[k, row] = sunk * (share + low[n] * (max(share, inner) - share))
        for n in range(len(upper)):
            row = np.uintp(upper[n])
            seen[k, row] = max(seen[k, row], high[n] * total / count)
