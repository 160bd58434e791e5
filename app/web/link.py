"""The socket between the loop and the web server's process: ticks one way, sound the other.

    loop -> WebSink -> ServerLink == socket ==> server
    page's microphone, poses and picks -> server == socket ==> ServerLink -> loop

Neither end ever waits: what does not fit is dropped and counted, but for what people pick and what
is told once. When one end dies, the other reads the end of the stream.
"""

import contextlib
import json
import struct
from collections import deque
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.process.channel import Channel
from encoder.types import DrivenFrame
from render.decoder.coding import EXPRESSION_DIM
from sensors.types import HeadPose

TICK = np.dtype(
    [
        ("index", "<i8"),
        ("t_ns", "<i8"),
        ("expression", "<f4", (EXPRESSION_DIM,)),
        ("gaze", "<f4", (2, 3)),
        ("position", "<f8", (3,)),  # of the head, mm
        ("quat", "<f8", (4,)),  # wxyz
        ("breath", "<f4"),
    ]
)
SOUND, STATUS, POSE, PICKS = b"A", b"S", b"H", b"C"  # first byte of a packet from the server
SOUND_HEAD = struct.Struct("<cqqq")  # kind, page number, first sample, arrival in ns
POSE_HEAD = struct.Struct("<cq")  # kind, arrival in ns; then the page's message
MAX_SOUNDS = 256  # packets of 10 ms that wait for the loop; the oldest go first
MAX_POSES = 256


def pack_tick(driven: DrivenFrame) -> bytes:
    tick = np.zeros((), TICK)
    tick["index"], tick["t_ns"] = driven.index, driven.t_ns
    tick["expression"], tick["gaze"] = driven.expression, driven.gaze
    tick["position"], tick["quat"] = driven.head.position, driven.head.quat
    tick["breath"] = driven.breath
    return tick.tobytes()


def unpack_tick(packet: bytes) -> DrivenFrame:
    tick = np.frombuffer(packet, TICK)[0]
    head = HeadPose(tuple(tick["position"].tolist()), tuple(tick["quat"].tolist()))
    return DrivenFrame(
        int(tick["index"]),
        int(tick["t_ns"]),
        tick["expression"],
        tick["gaze"],
        head,
        float(tick["breath"]),
    )


class ServerLink:
    """The loop's end."""

    def __init__(self, end: Channel) -> None:
        self.status: dict[str, Any] = {}  # what the server last said of itself
        # page, first sample, arrival in ns, samples [n]
        self.sounds: deque[tuple[int, int, int, NDArray[np.float32]]] = deque(maxlen=MAX_SOUNDS)
        self.poses: deque[tuple[int, bytes]] = deque(maxlen=MAX_POSES)  # arrival ns, message
        self._picks: dict[str, Any] = {}
        self.dropped = 0  # ticks that the server was too slow for
        self.ended = False
        self._end = end
        self._reading = Lock()  # the loop reads, and who hears the page's microphone

    def post(self, driven: DrivenFrame) -> None:
        try:
            self._end.send(pack_tick(driven))
        except BlockingIOError:
            self.dropped += 1
        except OSError:
            self.ended = True

    def say(self, **words: Any) -> None:
        """Tell the server `emotions` that a page may pick, `controls`, or the `target` of a
        calibration."""
        with contextlib.suppress(OSError):
            self._end.insist(json.dumps(words).encode())

    def show(self, changed: dict[str, Any]) -> None:
        """Controls that were changed elsewhere."""
        self.say(controls=changed)

    def hear(self, samples: bytes) -> None:
        """Let pages play this: 48 kHz mono, 16 bits. From any thread."""
        with contextlib.suppress(OSError):
            self._end.send(SOUND + samples)

    def picks(self) -> dict[str, Any]:
        """What people at the page have picked since the last call: fields of Controls."""
        with self._reading:
            self._read()
            found, self._picks = self._picks, {}
        return found

    def read(self) -> None:
        """Take in what the server has sent. From any thread."""
        with self._reading:
            self._read()

    def _read(self) -> None:
        for packet in () if self.ended else self._end.waiting():
            if packet[:1] == SOUND:
                _, page, first, arrival_ns = SOUND_HEAD.unpack_from(packet)
                samples = np.frombuffer(packet, "<f4", offset=SOUND_HEAD.size)
                self.sounds.append((page, first, arrival_ns, samples.astype(np.float32)))
            elif packet[:1] == POSE:
                _, arrival_ns = POSE_HEAD.unpack_from(packet)
                self.poses.append((arrival_ns, packet[POSE_HEAD.size :]))
            elif packet[:1] == PICKS:
                self._picks |= json.loads(packet[1:])
            elif packet[:1] == STATUS:
                self.status |= json.loads(packet[1:])
            else:
                self.ended = True

    def finish(self) -> None:
        """Post no more: the server tells its last counts and ends."""
        with contextlib.suppress(OSError):
            self._end.finish()

    def close(self) -> None:
        self._end.close()
