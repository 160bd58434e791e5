"""What the head's eyes do, as a small drawing for the corner of each eye camera's picture.

Seen from straight ahead, as the head is driven: every headset's cameras sit elsewhere, so marks
on the picture itself would only be right for one of them.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.decoder.decoder import Decoder
from render.decoder.identity import Identity

SECTORS = 28  # of the lid outline
PUPIL_MM = 15.0  # from the centre of the eyeball
Floats = NDArray[np.float32]


class Marks(NamedTuple):
    """Places in mm from the centre of the eyeball, as seen from the front: x right, y down."""

    pupil: NDArray[np.float64]  # [2]
    lids: NDArray[np.float64]  # [n, 2] a closed line
    opening: float  # 0 shut, 1 open
    yaw_deg: float  # towards the subject's left
    pitch_deg: float  # upwards


def frame_corners(
    frame: NDArray[np.floating],  # [5] DrivenFrame.eye_frames of one eye
) -> NDArray[np.float64]:  # [4, 2]
    """Where the framed part of a camera's picture has its corners, 0..1 from the upper left."""
    x, y, size, turn = frame[:4].astype(np.float64)
    corners = size * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    turned = corners @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return 0.5 + 0.5 * (turned + (x, y))


class EyeMarks:
    """Prepared for one identity."""

    def __init__(self, decoder: Decoder, identity: Identity) -> None:
        self._decoder, self._centers = decoder, identity.eye_centers
        self._blinks = [decoder.rig_names.index(f"eyeBlink_{side}") for side in "LR"]
        members = [self._margin(identity, eye) for eye in range(2)]
        self._rest = [identity.geometry[m] for m in members]
        rows = [(3 * m[:, None] + np.arange(3)).ravel() for m in members]
        self._moves: list[Any] = [decoder.basis[r] for r in rows]

    def of(self, eye: int, expression: Floats, gaze: Floats) -> Marks:
        """Marks of one eye (0 = left) for code [256] and gaze [2, 3]."""
        rig, look = self._decoder.rig(expression), gaze[eye]
        moved: Floats = (self._moves[eye] @ rig).reshape(-1, 3)
        lids = self._rest[eye] + moved
        edge = from_front(lids - self._centers[eye])
        return Marks(
            pupil=from_front(PUPIL_MM * look[None])[0],
            lids=0.5 * edge + 0.25 * (np.roll(edge, 1, axis=0) + np.roll(edge, -1, axis=0)),
            opening=float(np.clip(1.0 - rig[self._blinks[eye]], 0.0, 1.0)),
            yaw_deg=float(np.degrees(np.arctan2(look[0], look[2]))),
            pitch_deg=float(np.degrees(np.arcsin(np.clip(look[1], -1.0, 1.0)))),
        )

    def _margin(self, identity: Identity, eye: int) -> NDArray[np.int64]:
        """Vertices of the lid edges: in each direction the lid vertex nearest to the opening."""
        lids = self._decoder.regions["eyelids"].astype(np.int64)
        lids = lids[(identity.geometry[lids, 0] > 0) == (eye == 0)]
        places = from_front(identity.geometry[lids] - identity.eye_centers[eye])
        away = (places - places.mean(0)) * (0.5, 1.0)  # an open eye is twice as wide as high
        sector = np.floor((np.arctan2(away[:, 1], away[:, 0]) / (2 * np.pi) + 0.5) * SECTORS)
        far = np.hypot(away[:, 0], away[:, 1])
        chosen = [np.flatnonzero(sector == k) for k in range(SECTORS)]
        edge = np.array([members[far[members].argmin()] for members in chosen if len(members)])
        beside = np.maximum(far[np.roll(edge, 1)], far[np.roll(edge, -1)])
        return lids[edge[far[edge] <= 1.15 * beside]]  # a sector may hold no edge vertex at all


def from_front(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Points [n, 3] mm in the head's axes -> [n, 2] for someone before the head, whose right is
    the head's left."""
    return (points[:, :2] * np.array([1.0, -1.0])).astype(np.float64)
