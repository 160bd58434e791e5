"""The head around the places of a face: each part is a blend of the shipped people.

A Gaussian process over the surface. Its covariance is that of the shipped people and their mirror
images, damped with the distance of two places (covariance localisation): a chin need not come
from the person whose nose fits best. Twelve people span faces of others to 1.1 mm; so blended,
to 0.6.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from render.avatars.alignment import similarity
from render.avatars.maker import Maker
from render.avatars.photos.shape.places import PointPlaces
from render.avatars.photos.shape.point_shapes import PointShapes
from render.avatars.registration import ATTACHED, SKIN_VERTICES, attached, visible
from render.decoder import identity
from render.decoder.learned import avatar_files
from render.types import Doubles, Ints

REACH_MM = 80.0  # over which parts of a face belong together
SPREAD = 1.3  # how much more people differ than the shipped ones
MODES = 120
LEAST = 1e-5  # of the largest variance
EXACT_MM = 0.3  # how near `through` comes to places that are told


@dataclass(frozen=True)
class HeadShapes:
    """Everything in millimetres; K modes of one deviation each, N places."""

    mean: Doubles  # [V, 3]
    heads: Doubles  # [P, V, 3] how people differ from it
    anchors: Doubles  # [V, 3] where each vertex is for blending: parts move as one
    points: PointShapes  # at the places
    weights: Doubles  # [K, P, N] shares of the people at the places, for one deviation

    def head(self, shares: Doubles) -> Doubles:  # [K] -> [V, 3]
        blend = np.tensordot(shares, self.weights, 1)  # [P, N]
        return self.mean + np.einsum("vp,pvi->vi", self._near @ blend.T, self.heads)

    def through(self, points: Doubles) -> Doubles:  # [N, 3] mm -> [V, 3] mm
        """The likeliest head that has these places."""
        modes = self.points.modes.reshape(len(self.points.modes), -1) / EXACT_MM
        off = (points - self.points.at).ravel() / EXACT_MM
        shares = np.linalg.solve(modes @ modes.T + np.eye(len(modes)), modes @ off)
        return self.head(shares.astype(np.float64))

    @cached_property
    def _near(self) -> Doubles:  # [V, N]
        return near(self.anchors, self.points.at)


def near(a: Doubles, b: Doubles) -> Doubles:  # [n, 3], [m, 3] -> [n, m] 0..1
    square = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
    return np.exp(-square / (2 * REACH_MM**2))


def build(maker: Maker, places: PointPlaces, left_out: tuple[str, ...] = ()) -> HeadShapes:
    """`left_out`: people not to learn from, for tests."""
    rest = maker.template.astype(np.float64)
    face, _ = visible(maker)
    found: list[Doubles] = []
    for name in avatar_files.shipped():
        if name not in left_out:
            head = identity.load(name).geometry.astype(np.float64)
            found.append(similarity(head[face], rest[face], scaled=False).place(head))
    mirror, flip = mirrored(rest), np.array([-1.0, 1.0, 1.0])
    heads = np.array([*found, *(head[mirror] * flip for head in found)])
    mean = heads.mean(0)
    heads -= mean
    at, own = places.of(mean), places.of(heads)  # [N, 3], [P, N, 3]
    count = len(at)
    covariance = np.einsum("pni,pmj->nimj", own, own, optimize=True) * (SPREAD**2 / len(heads))
    covariance *= near(at, at)[:, None, :, None]
    variances, axes = np.linalg.eigh(covariance.reshape(3 * count, 3 * count))
    variances, axes = variances[::-1][:MODES], axes[:, ::-1][:, :MODES]
    kept = variances > LEAST * variances[0]
    deviations = np.sqrt(variances[kept])
    axes = axes[:, kept].T.reshape(-1, count, 3)
    weights = np.einsum("pni,kni->kpn", own, axes) * (SPREAD**2 / len(heads))
    return HeadShapes(
        mean=mean,
        heads=heads,
        anchors=_anchors(maker, mean),
        points=PointShapes(at, axes * deviations[:, None, None]),
        weights=weights / deviations[:, None, None],
    )


def mirrored(vertices: Doubles) -> Ints:  # [V, 3] -> [V]
    """The vertex on the other side of the head."""
    _, found = KDTree(vertices).query(vertices * np.array([-1.0, 1.0, 1.0]))
    return np.asarray(found, np.int32)


def _anchors(maker: Maker, mean: Doubles) -> Doubles:
    """Eyeballs with their lashes, and what is in the mouth, each as one."""
    out = mean.copy()
    out[ATTACHED:] = attached(maker, mean)[ATTACHED:]
    bag = np.arange(SKIN_VERTICES, ATTACHED)  # hangs on the skin around it
    _, skin = KDTree(maker.template[:SKIN_VERTICES]).query(maker.template[bag])
    out[bag] = mean[skin]
    return out
