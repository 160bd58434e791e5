"""The decoder's mouth as `encoder/evaluation/articulation.py` measures it: lips and teeth, mm.

Activations are limited as the decoder limits them: a mouth is measured as it is drawn.
"""

# pyright: reportMissingTypeStubs=false

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.face.geometry import TEETH_LOWER, TEETH_UPPER

if TYPE_CHECKING:
    from encoder.evaluation.articulation import MouthMotion
    from render.decoder.decoder import Decoder

Floats = NDArray[np.float32]
COLUMNS_MM = (-10.0, -5.0, 0.0, 5.0, 10.0)  # across the mouth, where teeth are looked for
HALF_MM = 2.0  # of a column's width
MIDDLE_MM = 8.0  # half width of the middle of the lips, which is what protrudes
FRONT_MM = 6.0  # behind the foremost tooth of a column; what lies deeper is its back


def mouth_of(avatar: str) -> "Callable[[Floats], MouthMotion]":
    """codes [T, 256] -> the mouth of a shipped avatar, over time."""
    from app.face.mesh import lip_marks
    from encoder.evaluation.articulation import MouthMotion, teeth_seen_mm
    from render.decoder import identity
    from render.decoder.decoder import Decoder

    decoder, rest = Decoder.load(), identity.load(avatar).geometry
    marks, regions = lip_marks(decoder, rest), decoder.regions
    teeth = [regions.get("teeth_upper", TEETH_UPPER), regions.get("teeth_lower", TEETH_LOWER)]
    lips = [regions["lips_upper"], regions["lips_lower"]]
    sets = [members[np.abs(rest[members, 0]) < max(COLUMNS_MM) + HALF_MM] for members in lips]
    sets += [_fronts(rest, members) for members in teeth]
    sets.append(regions["lips"])
    moves = [(_basis(decoder, members), rest[members]) for members in sets]
    columns = [_columns(rest[members, 0]) for members in sets[:4]]
    middle = [np.abs(rest[members, 0]) < MIDDLE_MM for members in sets[:2]]
    width = float(np.linalg.norm(np.subtract(*rest[regions["lips"]][list(marks.corners)])))
    edge = rest[sets[2]][rest[sets[2], 1] < rest[sets[2], 1].min() + 1.5]

    def mouth(codes: Floats) -> MouthMotion:
        rig = decoder.posing.limited(codes.astype(np.float32) @ decoder.coding.to_rig)
        upper, lower, above, below, whole = (
            (rig @ linear).reshape(len(rig), -1, 3) + still for linear, still in moves
        )
        sides = [
            np.stack([extreme(part[:, members, 1], 1) for members in around], 1)
            for part, around, extreme in zip(
                (upper, lower, above, below), columns, (np.min, np.max, np.min, np.max), strict=True
            )
        ]
        forward = [
            (part[:, members, 2] - still[members, 2]).mean(1)
            for part, members, (_, still) in zip((upper, lower), middle, moves, strict=False)
        ]
        left, right = marks.corners
        return MouthMotion(
            opening=np.maximum(marks.opening_mm(whole), 0),
            width=np.linalg.norm(whole[:, left] - whole[:, right], axis=-1) - width,
            protrusion=np.mean(forward, 0),
            tuck=_nearest_mm(lower, edge),
            teeth=teeth_seen_mm(*sides),
        )

    return mouth


def _basis(decoder: "Decoder", members: NDArray[np.integer]) -> Floats:  # [n] -> [R, n * 3]
    rows = (members[:, None].astype(np.int64) * 3 + np.arange(3)).ravel()
    basis: Any = decoder.posing.basis
    return np.asarray(basis[rows].toarray(), np.float32).T


def _columns(x: Floats) -> list[NDArray[np.intp]]:
    return [np.flatnonzero(np.abs(x - at) < HALF_MM) for at in COLUMNS_MM]


def _fronts(rest: Floats, members: NDArray[np.integer]) -> NDArray[np.integer]:
    """The front teeth's faces, without their backs and what stands behind them."""
    found = list[NDArray[np.integer]]()
    for column in _columns(rest[members, 0]):
        depth = rest[members[column], 2]
        found.append(members[column[depth > depth.max() - FRONT_MM]])
    return np.unique(np.concatenate(found))


def _nearest_mm(lip: Floats, edge: Floats) -> NDArray[np.float64]:  # [T, N, 3], [M, 3] -> [T]
    from scipy.spatial import KDTree

    tree: Any = KDTree(edge)
    distance = np.asarray(tree.query(lip.reshape(-1, 3))[0], np.float64)
    return distance.reshape(lip.shape[:2]).min(1)
