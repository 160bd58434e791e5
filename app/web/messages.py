"""Messages from a page: poses of the headset, and counted chunks of its microphone's sound.

page: XRViewerPose -> 9 numbers -> WebSocket /pose -> Uplink -> socket -> ServerLink.poses
page: AudioWorklet -> 480 samples -> WebSocket /microphone -> Uplink -> socket -> WebMicrophone

Both are checked in form here; the loop checks the numbers of a pose.
"""

import struct

import numpy as np

from app.web.link import POSE, POSE_HEAD, SOUND, SOUND_HEAD

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
