"""WebMicrophone: the headset page's microphone as a Source, with the losses of a local one counted.

    page -> server's process -> ServerLink -> WebMicrophone.poll -> LiveSource -> Assembler

The page counts its samples; a jump of the counter is sound that was lost on the way. Times come
from the arrivals at the server, as for a local microphone (sensors/clock_map.py).
"""

import numpy as np
from numpy.typing import NDArray

from app.web.link import ServerLink
from sensors.clock_map import ClockMap
from sensors.types import NS, SAMPLE_RATE, AudioPacket, Clock, Packet, SourceInfo

WAITING = "no page has its microphone on"
SILENT_NS = NS  # without a packet: the page is closed, or its microphone off


class WebMicrophone:
    """Sound of whichever page has its microphone on; silence until one has."""

    info = SourceInfo("microphone of the page", devices={"audio": "web"})
    exhausted = False

    def __init__(self, link: ServerLink, clock: Clock) -> None:
        self.problem = WAITING
        self.losses = 0  # times that sound was lost
        self.reopened: int = 0  # times that another page took over
        self.dropped = 0  # samples known to be lost
        self._link, self._clock = link, clock
        self._is_open, self._heard_ns = False, 0
        self._page: int = 0
        self._offset = self._position = 0  # from the page's counter; next sample
        self._map = ClockMap()

    @property
    def drift_ppm(self) -> float:
        return self._map.drift_ppm

    def open(self) -> None:
        self._link.sounds.clear()
        self._is_open, self._page = True, 0
        self.losses = self.reopened = self.dropped = self._offset = self._position = 0

    def poll(self) -> list[Packet]:
        if not self._is_open:
            raise RuntimeError("poll before open")
        self._link.read()
        packets: list[Packet] = []
        while self._link.sounds:
            packets.append(self._packet(*self._link.sounds.popleft()))
        now_ns = self._clock.now_ns()
        if packets:
            self._heard_ns, self.problem = now_ns, ""
        elif now_ns - self._heard_ns > SILENT_NS:
            self.problem = WAITING
        return packets

    def close(self) -> None:
        self._is_open = False

    def _packet(
        self,
        page: int,
        first: int,
        arrival_ns: int,
        samples: NDArray[np.float32],  # [n]
    ) -> AudioPacket:
        is_new = page != self._page
        if is_new:  # how much time has passed since the last page, AudioTimeline finds out
            self.reopened += self._page > 0
            self._page, self._map = page, ClockMap()
            self._offset = self._position - first
        end_ns = self._map.update((first + len(samples)) * NS // SAMPLE_RATE, arrival_ns)
        self._offset += max(self._map.jump_ns, 0) * SAMPLE_RATE // NS  # the device lost time
        lost = first + self._offset - self._position
        self.dropped += lost
        self.losses += lost > 0
        position = first + self._offset
        self._position = position + len(samples)
        t_ns = end_ns - len(samples) * NS // SAMPLE_RATE
        return AudioPacket(t_ns, position, samples, gap=lost > 0 or is_new)
