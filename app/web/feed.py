"""Messages that the server makes of a tick: a cloud for pages, names for programs; on demand."""

import json
from pathlib import Path

import numpy as np

from app.call.table.company import Company
from app.call.table.seats import Seats
from app.face.arkit import ARKIT_NAMES
from app.sinks.protocols.face import FaceReader
from app.web.cloud import STATIONS, STILL, Ranges, base_message, pack, tick_message
from app.web.info import ServerInfo
from encoder.types import DrivenFrame
from render.decoder import identity
from render.decoder.decoder import EXPRESSION_DIM, Decoder
from render.types import AHEAD, Gaussians
from sensors import rotation
from sensors.types import HeadPose


class AvatarFeed:
    """One avatar, at rest and in motion."""

    def __init__(self, info: ServerInfo) -> None:
        self._decoder = Decoder.load(gaussians=info.gaussians)
        self._read = FaceReader(self._decoder, Path(info.gains) if info.gains else None)
        self._company = None if info.seats is None else Company(self._decoder, Seats(info.seats))
        self.show(info.avatar)

    def show(self, avatar: str) -> None:
        """From now on this one; `base` is theirs. Raises InputError."""
        self._who = identity.load(avatar)
        _, rest = self._decoder.decode(np.zeros(EXPRESSION_DIM, np.float32), AHEAD, self._who)
        self._neck = self._decoder.cached(self._who).neck
        self._begin(rest)

    def cloud(self, driven: DrivenFrame, now_ns: int) -> bytes:
        """The cloud of this tick; `base` is another one after somebody has come or gone.

        One alone is sent with the head at rest, and the page turns it; in company each has a neck
        of their own, and the server turns them."""
        head, breath, neck = driven.head, driven.breath, STILL
        if self._company is None and (breath or head != HeadPose()):
            neck = self._neck.stations(head, breath, STATIONS)
            head, breath = HeadPose(), 0.0
        _, gaussians = self._decoder.decode(driven.expression, driven.gaze, self._who, head, breath)
        if self._company is not None:
            gaussians = self._company.around(gaussians, now_ns)
            if len(gaussians) != len(self._base):
                self._begin(gaussians)
        words = pack(gaussians, self._ranges)
        return tick_message(words, self._base, driven.index, driven.t_ns, neck)

    def _begin(self, rest: Gaussians) -> None:
        self._ranges = Ranges.around(rest, self._neck.offset)
        self._base = pack(rest, self._ranges)
        self.base = base_message(rest, self._ranges)

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
        down, yaw, roll = rotation.to_angles(face.head.quat)
        head = {
            "position_mm": [round(v, 3) for v in face.head.position],
            "quaternion_wxyz": [round(v, 7) for v in face.head.quat],
            "yaw": round(yaw, 6),
            "pitch": round(-down, 6),
            "roll": round(roll, 6),
        }
        message = {
            "frame": face.index,
            "t_ns": face.t_ns,
            "arkit": named,
            "eyes": eyes,
            "head": head,
        }
        return json.dumps(message, separators=(",", ":")).encode()
