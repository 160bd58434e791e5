"""Where a scan's face is: units, axes and the rigid motion to the face model (millimetres).

By landmarks where they are given; else by trying every way a head can stand along the axes, each
with rigid ICP of the face, and keeping the best.
"""

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from sensors.types import InputError

Doubles = NDArray[np.float64]  # a fit is solved in double precision
UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
EXTENT_MM = (140.0, 800.0)  # longest side of a scan, from a face mask to a bust
HEAD_MM = 260.0  # from the crown: below are neck and shoulders
STAGES = (
    (250, 5000, 15, 36),
    (500, 10_000, 10, 8),
    (500, 10_000, 20, 1),
    (1000, 40_000, 30, 1),
)  # places of the face and of the scan, rounds of ICP, best kept
TRIM = 0.8  # share of the pairs that count, the nearest
TILTS = ((0, 0, 0), (0, 30, 0), (0, -30, 0), (25, 0, 0), (-25, 0, 0))  # degrees about x, y, z

MOST_TURN = 0.3  # rad, of one round


@dataclass(frozen=True)
class Pose:
    """x -> scale * rotation @ x + offset: from the face model to the scan."""

    scale: float
    rotation: Doubles  # [3, 3]
    offset: Doubles  # [3]

    def place(self, points: Doubles) -> Doubles:  # [n, 3]
        return self.scale * points @ self.rotation.T + self.offset

    def undo(self, points: Doubles) -> Doubles:  # [n, 3]
        return (points - self.offset) @ self.rotation / self.scale


def similarity(source: Doubles, target: Doubles, *, scaled: bool) -> Pose:
    """The motion that takes `source` [n, 3] nearest to `target` [n, 3] (Umeyama 1991)."""
    middle, aim = source.mean(0), target.mean(0)
    a, b = source - middle, target - aim
    u, spread, vt = np.linalg.svd(b.T @ a)
    sign = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * sign) @ vt
    scale = float((spread * sign).sum() / (a**2).sum()) if scaled else 1.0
    return Pose(scale, rotation, aim - scale * rotation @ middle)


def unit(points: Doubles, name: str) -> str:
    """Of a scan's coordinates, by its size."""
    longest = float(np.ptp(points, axis=0).max())
    for name_of, factor in UNITS.items():
        if EXTENT_MM[0] <= longest * factor <= EXTENT_MM[1]:
            return name_of
    raise InputError(
        f"{name}: expected a scan of a head, {EXTENT_MM[0]:.0f}..{EXTENT_MM[1]:.0f} mm long (or "
        f"the same in cm or m), got {longest:g}; scale it to millimetres, or mark the face with "
        "--landmarks FILE"
    )


def find(
    face: Doubles,  # [n, 3] mm places of the face model
    face_normals: Doubles,  # [n, 3]
    points: Doubles,  # [m, 3] mm of the scan
    normals: Doubles,  # [m, 3]
) -> tuple[Pose, float]:
    """The rigid motion of the face onto the scan, and the mean distance that is left, in mm."""
    starts = list[Pose]()
    for turn in turns():
        up = points @ turn[:, 1]
        crown = points[up > up.max() - HEAD_MM]
        middle = (np.percentile(crown, 2, axis=0) + np.percentile(crown, 98, axis=0)) / 2
        front = float((crown @ turn[:, 2]).max() - middle @ turn[:, 2])
        for turn_too in TILTS:
            tilted = turn @ rotation(np.radians(turn_too))
            # The face's own middle, half way between the middle of the head and its front.
            offset = middle + turn @ np.array([0, 0, front / 2]) - tilted @ face.mean(0)
            starts.append(Pose(1.0, tilted, offset))
    score = np.inf
    for of_face, of_scan, rounds, kept in STAGES:
        step, stride = max(1, len(face) // of_face), max(1, len(points) // of_scan)
        some, facing = face[::step], face_normals[::step]
        seen, outward = points[::stride], normals[::stride]
        tree = KDTree(seen)
        found = [icp(s, some, facing, seen, outward, tree, rounds) for s in starts]
        found.sort(key=lambda one: one[1])
        starts, score = [pose for pose, _ in found[:kept]], found[0][1]
    return starts[0], score


def turns() -> list[Doubles]:
    """The 24 rotations [3, 3] that take axes to axes."""
    found = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            turn = np.eye(3)[list(order)] * np.array(signs)
            if np.linalg.det(turn) > 0:
                found.append(turn)
    return found


def icp(
    pose: Pose,
    face: Doubles,
    face_normals: Doubles,
    points: Doubles,
    normals: Doubles,
    tree: KDTree,
    rounds: int,
) -> tuple[Pose, float]:
    """Trimmed rigid ICP, point to plane; pairs whose normals disagree count as far away."""
    score = np.inf
    for _ in range(rounds):
        at, facing = pose.place(face), face_normals @ pose.rotation.T
        distance, found = tree.query(at)
        nearest = np.asarray(found)
        agree = (facing * normals[nearest]).sum(1)
        cost = distance + 30 * (agree < 0.3)
        keep = np.asarray(cost <= np.quantile(cost, TRIM))
        score = float(np.minimum(cost, 30)[keep].mean())
        n, gap = normals[nearest[keep]], points[nearest[keep]] - at[keep]
        centre = at[keep].mean(0)
        rows = np.concatenate([np.cross(at[keep] - centre, n), n], 1)
        move = np.linalg.lstsq(rows, (n * gap).sum(1), rcond=1e-6)[0]
        move *= min(1.0, MOST_TURN / (np.linalg.norm(move[:3]) + 1e-9))
        turn = rotation(move[:3])
        pose = Pose(1.0, turn @ pose.rotation, turn @ (pose.offset - centre) + centre + move[3:])
    return pose, score


def rotation(turn: Doubles) -> Doubles:  # [3] rad -> [3, 3]
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(turn).as_matrix()
