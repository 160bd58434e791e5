"""What the hair of the head covers of a photographed face; brows and beard are the face's own."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, label, maximum_filter
from scipy.spatial import KDTree

from render.avatars.maker import Maker
from render.avatars.photos.colors import light
from render.avatars.photos.shape.detector import BROWS
from render.avatars.textures import SIZE
from render.types import Doubles, Ints

Places = NDArray[np.bool_]  # [T] texels

BROW_MM = 4.5  # from the points of a brow: its hair
HAIR_TEXELS = 7  # width of a strand's surroundings that it blurs
# Of the lips: a moustache begins so far above, a chin ends below; beside them nothing hangs.
ABOVE_LIPS_MM, BELOW_LIPS_MM, BESIDE_LIPS_MM = 14.0, 42.0, 6.0

MIRROR = np.array([-1.0, 1.0, 1.0])
SEEN = 0.3  # of the best weight
LEAST = 0.3  # of what is above the lips: a beard, or a moustache


@dataclass(frozen=True)
class HairPlaces:
    """Where on the atlas hair may be."""

    edge: Doubles  # [T] 0..1 of the face, where hair of the head lies
    brows: Places
    mouth: Places  # between moustache and chin, where hair is a beard
    moustache: Places
    lips: Places
    jaws: Places  # as high as that, as wide as the face: a beard, if it is joined to one there
    opposite: Ints  # of each of these its place on the other side, among them

    @classmethod
    def of(cls, maker: Maker, at: Doubles, points: Doubles) -> "HairPlaces":
        """Places [T, 3] of texels and the detector's points [468, 3] on a face at rest, in mm."""
        red = maker.template[maker.regions["lips"]]
        (_, low, _), (wide, high, _) = red.min(0), red.max(0)
        height, beside = at[:, 1], np.abs(at[:, 0])
        jaws = (height < high + ABOVE_LIPS_MM) & (height > low - BELOW_LIPS_MM) & (at[:, 2] > 0)
        mouth = jaws & (beside < wide + BESIDE_LIPS_MM)
        upper, lips = mouth & (height >= high), mouth & (height > low) & (height < high)
        opposite = np.asarray(KDTree(at[jaws]).query(at[jaws] * MIRROR)[1], np.int32)
        return cls(_edge(maker, at), _on_brows(at, points), mouth, upper, lips, jaws, opposite)


def covered(color: Doubles, tone: Doubles, places: HairPlaces) -> Doubles:  # [T, 3], [3] -> [T]
    """What is unlike the skin's tone at the face's edge, 0..1, and what of it reaches in from
    there, but for brows and beard."""
    unlike, edge = 1 - light.likeness(color, tone), places.edge
    own = places.brows | places.lips | bearded(color, tone, places)
    reaching = _joined((unlike > 0.5) & ~own, edge > 0.5)
    near = maximum_filter(reaching.reshape(SIZE, -1), HAIR_TEXELS).astype(np.float64)
    beside = np.maximum(near, gaussian_filter(near, HAIR_TEXELS / 2)).ravel()
    return np.maximum(edge * unlike, np.where(own, 0, beside))


def bearded(color: Doubles, tone: Doubles, places: HairPlaces) -> Places:
    """What is unlike the skin's tone around the mouth on both sides, and above it, too, as shade
    is not, and what is joined to that."""
    unlike = light.likeness(color, tone) < 0.5
    near = maximum_filter(unlike.reshape(SIZE, -1), HAIR_TEXELS).ravel().astype(bool)
    both = np.zeros_like(unlike)
    both[places.jaws] = unlike[places.jaws] & near[places.jaws][places.opposite]
    if both[places.moustache].mean() < LEAST:
        return np.zeros_like(both)
    return _joined(both & (places.edge == 0), places.mouth)


def beard_color(
    colors: list[Doubles],  # K of [T, 3]
    weights: list[Doubles],  # K of [T], how well each place is seen
    tone: Doubles,
    places: HairPlaces,
) -> Doubles | None:  # [3] linear
    """None where no beard is seen."""
    found = [
        color[bearded(color, tone, places) & ~places.lips & (weight > SEEN * weight.max())]
        for color, weight in zip(colors, weights, strict=True)
    ]
    seen = np.concatenate(found)
    return np.median(seen, 0) if len(seen) else None


def _joined(spots: Places, start: Places) -> Places:
    """The connected spots of which a part lies in `start`."""
    numbers = np.empty((SIZE, 2 * SIZE), np.int32)
    label(spots.reshape(numbers.shape), output=numbers)
    numbers = numbers.ravel()
    return np.isin(numbers, np.setdiff1d(numbers[start], 0))


def _edge(maker: Maker, at: Doubles) -> Doubles:  # [T, 3] mm -> [T] 0..1
    """Where hair may lie over the face: above the brows and at the temples."""
    wide, high = np.abs(maker.template[maker.regions["brows"], :2]).max(0)
    above = (at[:, 1] - high + 10) / 8
    beside = (np.abs(at[:, 0]) - wide + 6) / 6
    return np.clip(np.maximum(above, beside), 0, 1)


def _on_brows(at: Doubles, points: Doubles) -> Places:  # [T, 3], [468, 3] mm
    """Near the detector's points of a brow, but for its tail, where hair begins that hangs down."""
    lines = points[np.array(BROWS)[:, 1:]]  # [4, 4, 3]
    share = np.linspace(0, 1, 8)[:, None, None, None]
    along = lines[:, :-1] + share * (lines[:, 1:] - lines[:, :-1])
    return KDTree(along.reshape(-1, 3)).query(at)[0] < BROW_MM
