"""Finds the lines of `decoder/lines.py` on the face model: done once, kept in the weights."""

import numpy as np

from render.decoder.lines import Line
from render.decoder.mesh_parts import SKIN_VERTICES
from render.training.data.face_data import FaceData
from render.types import Floats

MOUTH_MM, MOUTH_COLUMNS, MOUTH_FALLOFF_MM = 21.0, 43, 5.0
LID_COLUMNS, LID_FALLOFF_MM, EYE_MM = 25, 4.5, 34.0
UPPER_LID_SHARE = 0.85  # the lower lid hardly moves
PAIRS_A_COLUMN = 6
SOCKET = slice(SKIN_VERTICES, 13294)


def mouth(face: FaceData) -> Line:
    """Upper against lower lip, where they touch on the model's own neutral face."""
    v = face.neutral
    upper, lower = face.regions["lips_upper"], face.regions["lips_lower"]
    distance = np.linalg.norm(v[upper][:, None] - v[lower][None], axis=-1)
    close = (distance.min(1) < 1.25) & (np.abs(v[upper][:, 0]) < MOUTH_MM + 0.5)
    pairs_u, pairs_l = upper[close], lower[distance[close].argmin(1)]
    columns = np.linspace(-MOUTH_MM, MOUTH_MM, MOUTH_COLUMNS).astype(np.float32)
    members = np.concatenate([np.arange(SKIN_VERTICES), np.arange(SOCKET.start, SOCKET.stop)])
    near = np.linalg.norm(v[members] - v[upper].mean(0), axis=1) < 60
    members = members[near]
    du, dl = (_distance(v[members], v[p]) for p in (pairs_u, pairs_l))
    # Which lip a vertex belongs to: its own, else that of the nearest vertex of either lip.
    lip = np.where(_distance(v[members], v[upper]) <= _distance(v[members], v[lower]), 1.0, -1.0)
    share = 0.5 * lip * np.exp(-((np.where(lip > 0, du, dl) / MOUTH_FALLOFF_MM) ** 2))
    share *= np.clip((24.0 - np.abs(v[members, 0])) / 3.0, 0, 1)  # the corners hold both lips
    return _line(v, pairs_u, pairs_l, columns, members, share)


def lid(face: FaceData, side: str) -> Line:
    """Upper against lower lid of one eye (side "l" or "r"), where they meet in a full blink."""
    rest = face.neutral
    shut = rest + face.rig[face.rig_names.index(f"eyeBlink_{side.upper()}")]
    centre = rest[face.regions[f"eyeball_{side}"]].mean(0)
    skin = np.arange(SKIN_VERTICES)
    skin = skin[np.linalg.norm(rest[skin] - centre, axis=1) < EYE_MM]
    moved = rest[skin, 1] - shut[skin, 1]
    upper = skin[moved > 1.0]
    lower = skin[(moved < 0.5) & (rest[skin, 1] < centre[1] + 0.5)]
    distance = np.linalg.norm(shut[upper][:, None] - shut[lower][None], axis=-1)
    close = distance.min(1) < 1.25
    pairs_u, pairs_l = upper[close], lower[distance[close].argmin(1)]
    x = rest[pairs_u, 0]
    columns = np.linspace(x.min() + 0.5, x.max() - 0.5, LID_COLUMNS).astype(np.float32)
    lashes = face.regions[f"eyelashes_{side}"]
    du, dl = _distance(shut[skin], shut[pairs_u]), _distance(shut[skin], shut[pairs_l])
    is_upper = _distance(rest[skin], rest[pairs_u]) < _distance(rest[skin], rest[pairs_l])
    share = np.where(
        is_upper,
        UPPER_LID_SHARE * np.exp(-((du / LID_FALLOFF_MM) ** 2)),
        (UPPER_LID_SHARE - 1) * np.exp(-((dl / LID_FALLOFF_MM) ** 2)),
    )
    # A lash takes the share of the skin it grows from.
    from scipy.spatial import KDTree

    _, root = KDTree(rest[skin]).query(rest[lashes])
    members = np.concatenate([skin, lashes])
    return _line(rest, pairs_u, pairs_l, columns, members, np.concatenate([share, share[root]]))


def _line(v: Floats, upper, lower, columns: Floats, members, share) -> Line:  # type: ignore[no-untyped-def]
    place = 0.5 * (v[upper, 0] + v[lower, 0])
    nearest = np.argsort(np.abs(place[None] - columns[:, None]), axis=1)[:, :PAIRS_A_COLUMN]
    kept = np.abs(share) > 0.01
    return Line(
        upper.astype(np.int32),
        lower.astype(np.int32),
        nearest.astype(np.int32),
        columns,
        members[kept].astype(np.int32),
        v[members[kept], 0].astype(np.float32),
        share[kept].astype(np.float32),
    )


def _distance(points: Floats, targets: Floats) -> Floats:
    from scipy.spatial import KDTree

    return KDTree(targets).query(points)[0]
