"""Messages from a page: poses of the headset, chunks of its microphone's sound, what was picked.

page: XRViewerPose -> 9 numbers -> WebSocket /pose -> Uplink -> socket -> ServerLink.poses
page: AudioWorklet -> 480 samples -> WebSocket /microphone -> Uplink -> socket -> WebMicrophone

page: POST /controls {"emotion": "happy:0.5"} -> Picks -> socket -> ServerLink.picks

All are checked in form here; the loop checks the numbers of a pose.
"""

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

from app.web.link import POSE, POSE_HEAD, SOUND, SOUND_HEAD
from render.decoder.learned.avatar_files import label
from sensors.files import parse_json

# The page's clock in ms; position m and quaternion xyzw of WebXR; 1 where it is tracked.
MESSAGE = struct.Struct("<9d")
CHUNK_HEAD = struct.Struct("<q")  # counter of the chunk's first sample, from the page
MAX_CHUNK = 4800  # samples in one message


class PoseMessages:
    """One pose a message."""

    name = "a pose"
    taken = "another page turns the head"
    max_size = MESSAGE.size
    max_rate = 250.0

    def begin(self) -> None:
        """Poses of one page do not depend on those of another."""

    def packet(self, data: bytes, arrival_ns: int) -> bytes | None:
        if len(data) != MESSAGE.size:
            return None
        return POSE_HEAD.pack(POSE, arrival_ns) + data


class SoundMessages:
    """Whole, finite samples that come after the last ones; a dropped chunk shows as a gap."""

    name = "sound"
    taken = "another page has the microphone"
    max_size = CHUNK_HEAD.size + 4 * MAX_CHUNK
    max_rate = 200.0

    def __init__(self) -> None:
        self._page = 0  # number of the microphone's page, growing
        self._expected = 0  # counter of the next sample, at least

    def begin(self) -> None:
        self._page += 1
        self._expected = 0

    def packet(self, data: bytes, arrival_ns: int) -> bytes | None:
        num, rest = divmod(len(data) - CHUNK_HEAD.size, 4)
        if rest or not 1 <= num <= MAX_CHUNK:
            return None
        (first,) = CHUNK_HEAD.unpack_from(data)
        samples = np.frombuffer(data, "<f4", offset=CHUNK_HEAD.size)
        if not self._expected <= first < 1 << 53 or not np.isfinite(samples).all():
            return None
        self._expected = first + num
        return SOUND_HEAD.pack(SOUND, self._page, first, arrival_ns) + data[CHUNK_HEAD.size :]


class Picks:
    """What people at the page may change of the run, and how it stands; all pages share it."""

    max_rate = 20.0

    def __init__(self, avatar: str, avatars: Sequence[str]) -> None:
        found = dict.fromkeys([*avatars, avatar])  # which may be a file
        self._avatars = {label(name): name for name in found}
        self.emotions = list[str]()  # the loop tells them
        self.state: dict[str, Any] = {"avatar": avatar, "emotion": None, "muted": False}

    @property
    def offers(self) -> dict[str, Any]:
        return {"avatars": list(self._avatars), "emotions": self.emotions, **self.shown}

    @property
    def shown(self) -> dict[str, Any]:
        """The state in the words of a page."""
        return self.state | {"avatar": label(self.state["avatar"])}

    def read(self, data: bytes) -> dict[str, Any]:
        """The fields of `state` that are asked for; ValueError where one is none, or impossible."""
        asked = parse_json(data)
        if not isinstance(asked, dict) or not all(self._is_good(*item) for item in asked.items()):  # pyright: ignore
            raise ValueError("no such control")
        if "avatar" in asked:
            asked["avatar"] = self._avatars[asked["avatar"]]  # pyright: ignore
        return asked  # pyright: ignore

    def _is_good(self, name: object, value: object) -> bool:
        if name == "muted":
            return isinstance(value, bool)
        if name == "avatar":
            return isinstance(value, str) and value in self._avatars
        words, colon, intensity = value.partition(":") if isinstance(value, str) else ("", "", "")
        known = words in self.emotions and (not colon or 0 <= float(intensity) <= 1)
        return name == "emotion" and (value is None or known)
