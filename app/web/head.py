"""What the server makes of a tick: a cloud for pages, names for programs. Made only when wanted."""

import json
from pathlib import Path

import numpy as np

from app.sinks.arkit import ARKIT_NAMES
from app.sinks.face import FaceReader
from app.web.cloud import Ranges, base_message, pack, tick_message
from app.web.info import ServerInfo
from encoder.driver import DrivenFrame
from render import identity
from render.decoder import EXPRESSION_DIM, Decoder
from render.types import AHEAD


class Head:
    """One avatar, at rest and in motion."""

    def __init__(self, info: ServerInfo) -> None:
        self._decoder = Decoder.load(gaussians=info.gaussians)
        self._who = identity.load(info.avatar)
        self._read = FaceReader(self._decoder, Path(info.gains) if info.gains else None)
        _, rest = self._decoder.decode(np.zeros(EXPRESSION_DIM, np.float32), AHEAD, self._who)
        self._ranges = Ranges.around(rest)
        self._base = pack(rest, self._ranges)
        self.base = base_message(rest, self._ranges)

    def cloud(self, driven: DrivenFrame) -> bytes:
        _, gaussians = self._decoder.decode(driven.expression, driven.gaze, self._who)
        words = pack(gaussians, self._ranges)
        return tick_message(words, self._base, driven.index, driven.t_ns)

    def names(self, driven: DrivenFrame) -> bytes:
        """The face as JSON; angles in rad, yaw to the subject's left, pitch up."""
        face = self._read(driven)
        eyes = {
            side: {
                "direction": [round(float(v), 6) for v in face.gaze[eye]],
                "yaw": round(float(face.angles[eye, 0]), 6),
                "pitch": round(float(face.angles[eye, 1]), 6),
            }
            for eye, side in enumerate(("left", "right"))
        }
        shapes = [round(float(v), 6) for v in face.arkit]
        named = dict(zip(ARKIT_NAMES, shapes, strict=True))
        message = {"frame": face.index, "t_ns": face.t_ns, "arkit": named, "eyes": eyes}
        return json.dumps(message, separators=(",", ":")).encode()
