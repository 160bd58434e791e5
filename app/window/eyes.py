"""What the encoder says about the eyes, drawn where an eye camera would see it.

The marks are projected through the near-eye camera model of `render`; a headset whose cameras sit
elsewhere shows them beside the pupil, but never with another sign or size.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.decoder import Decoder
from render.identity import Identity
from render.near_eye import eye_camera
from render.types import Camera

SECTORS = 28  # of the lid outline
PUPIL_MM = 11.0  # from the centre of the eyeball
RAY_MM = 17.0
Floats = NDArray[np.float32]


class Marks(NamedTuple):
    """Places in an eye picture of 400 x 400, px."""

    pupil: NDArray[np.float64]  # [2]
    ray_end: NDArray[np.float64]  # [2]
    lids: NDArray[np.float64]  # [n, 2] a closed line
    opening: float  # 0 shut, 1 open
    yaw_deg: float  # towards the subject's left
    pitch_deg: float  # upwards


class EyeMarks:
    """Prepared for one identity."""

    def __init__(self, decoder: Decoder, identity: Identity) -> None:
        self._decoder, self._centers = decoder, identity.eye_centers
        self._cameras = [eye_camera(identity.eye_centers[eye], eye) for eye in range(2)]
        self._blinks = [decoder.rig_names.index(f"eyeBlink_{side}") for side in "LR"]
        members = [self._margin(identity, eye) for eye in range(2)]
        self._rest = [identity.geometry[m] for m in members]
        rows = [(3 * m[:, None] + np.arange(3)).ravel() for m in members]
        self._moves = [decoder.basis[r] for r in rows]

    def of(self, eye: int, expression: Floats, gaze: Floats) -> Marks:
        """Marks of one eye (0 = left) for code [256] and gaze [2, 3]."""
        rig, look, camera = self._decoder.rig(expression), gaze[eye], self._cameras[eye]
        lids = self._rest[eye] + (self._moves[eye] @ rig).reshape(-1, 3)
        edge = project(camera, lids)
        edge = 0.5 * edge + 0.25 * (np.roll(edge, 1, axis=0) + np.roll(edge, -1, axis=0))
        center = self._centers[eye]
        places = project(camera, np.stack([center + PUPIL_MM * look, center + RAY_MM * look]))
        return Marks(
            pupil=places[0],
            ray_end=places[1],
            lids=edge,
            opening=float(np.clip(1.0 - rig[self._blinks[eye]], 0.0, 1.0)),
            yaw_deg=float(np.degrees(np.arctan2(look[0], look[2]))),
            pitch_deg=float(np.degrees(np.arcsin(np.clip(look[1], -1.0, 1.0)))),
        )

    def _margin(self, identity: Identity, eye: int) -> NDArray[np.int64]:
        """Vertices of the lid edges: in each direction the lid vertex nearest to the opening."""
        lids = self._decoder.regions["eyelids"].astype(np.int64)
        lids = lids[(identity.geometry[lids, 0] > 0) == (eye == 0)]
        places = project(self._cameras[eye], identity.geometry[lids])
        away = (places - places.mean(0)) * (0.5, 1.0)  # an open eye is twice as wide as high
        sector = np.floor((np.arctan2(away[:, 1], away[:, 0]) / (2 * np.pi) + 0.5) * SECTORS)
        far = np.hypot(away[:, 0], away[:, 1])
        chosen = [np.flatnonzero(sector == k) for k in range(SECTORS)]
        edge = np.array([members[far[members].argmin()] for members in chosen if len(members)])
        beside = np.maximum(far[np.roll(edge, 1)], far[np.roll(edge, -1)])
        return lids[edge[far[edge] <= 1.15 * beside]]  # a sector may hold no edge vertex at all


def project(camera: Camera, points: NDArray[np.floating]) -> NDArray[np.float64]:
    """World points [n, 3] mm -> px [n, 2]."""
    in_camera = points @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    in_picture = in_camera @ camera.K.T
    return in_picture[:, :2] / in_picture[:, 2:]
