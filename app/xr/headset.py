"""The headset's poses as a HeadSource: what `--head xr` and `--head auto` with --xr listen to.

headset's process -> shared memory -> ReadingGate -> HeadSource.poll -> LiveSource
"""

from collections.abc import Callable
from math import isfinite

from app.xr.link import XrMemory
from sensors.head import headset
from sensors.head.gate import ReadingGate
from sensors.head.source import HeadSource
from sensors.types import Clock, HeadPacket

NAME = "xr"


class HeadsetLink:
    """Takes the poses that the headset's process has left."""

    def __init__(self, memory: XrMemory, clock: Clock, tell: Callable[[str], None]) -> None:
        self._memory, self._clock, self._gate = memory, clock, ReadingGate(NAME, tell)
        self.counts = self._gate.counts
        self._number = -1

    def open(self) -> None:
        self._skip()

    def poll(self) -> list[HeadPacket]:
        packets: list[HeadPacket] = []
        for pose in self._memory.poses.after(self._number):
            self._number = int(pose["number"])
            gaze, face = pose["gaze"].tolist(), pose["face"].tolist()
            read = headset.reading(
                pose["position"].tolist(),
                pose["xyzw"].tolist(),
                tracked=bool(pose["tracked"]),
                gaze=gaze if all(map(isfinite, gaze)) else None,
                face=face if all(map(isfinite, face)) else None,
            )
            packet = self._gate(read, min(int(pose["t_ns"]), self._clock.now_ns()))
            if packet is not None:
                packets.append(packet)
        return packets

    def close(self) -> None:
        self._skip()

    def _skip(self) -> None:
        """What was left before does not count."""
        for pose in self._memory.poses.after(self._number):
            self._number = int(pose["number"])


def xr_head(
    memory: XrMemory, clock: Clock, tell: Callable[[str], None], expected: bool = True
) -> HeadSource:
    """The headset behind `memory`."""
    return HeadSource(NAME, lambda: HeadsetLink(memory, clock, tell), clock, expected)
