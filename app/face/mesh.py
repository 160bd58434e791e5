"""The decoder as judging sees it: many codes at once -> lips and upper face of one avatar."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from encoder.evaluation.judging import FaceMesh
    from encoder.evaluation.metrics import LipMarks
    from render.decoder.decoder import Decoder


def face_mesh(avatar: str) -> "FaceMesh":
    """Vertex sets `lips` and `upper_face`, head at rest, mm."""
    from encoder.evaluation.judging import FaceMesh
    from render.decoder import identity
    from render.decoder.decoder import Decoder

    decoder, who = Decoder.load(), identity.load(avatar)
    lips, upper_face = decoder.regions["lips"], decoder.regions["upper_face"]
    blinks = [decoder.rig_names.index(f"eyeBlink_{side}") for side in "LR"]

    def moving(members: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        linear, rest = decoder.moves(members), who.geometry[members]

        def vertices(codes: np.ndarray) -> np.ndarray:
            return (codes @ linear).reshape(*codes.shape[:-1], -1, 3) + rest

        return vertices

    def blink(codes: np.ndarray) -> np.ndarray:
        return decoder.rig(codes)[..., blinks].mean(-1)

    marks = lip_marks(decoder, who.geometry)
    return FaceMesh(moving(lips), moving(upper_face), blink, marks)


def lip_marks(decoder: "Decoder", rest: np.ndarray) -> "LipMarks":
    """Of the region `lips`, from a person's vertices [V, 3] mm at rest."""
    from encoder.evaluation.metrics import LipMarks

    lips = decoder.regions["lips"]
    upper, lower = (
        np.flatnonzero(np.isin(lips, decoder.regions[f"lips_{part}"]))
        for part in ("upper", "lower")
    )
    return LipMarks.find(rest[lips], upper, lower)
