"""ClockMap: a device's own time on our clock, from arrivals that are only ever late.

Flow: microphone and cameras -> ClockMap -> packet times. A sample counter or a frame timestamp is
exact but starts anywhere and drifts; an arrival is on our clock but late by a random delay. The
smallest delays of the last seconds (the lower envelope) tie the two together, good to 0.02 ms.
"""

from collections import deque
from typing import cast

import numpy as np
from numpy.typing import NDArray

from sensors.types import NS

BUCKET_NS = NS // 2  # one smallest delay is kept for each half second
WINDOW = 20  # buckets that the envelope looks at
HISTORY = 600  # buckets that the drift estimate looks at: five minutes
MIN_HISTORY = 40  # half a minute; before that the drift is taken as 0
JUMP_NS = 20_000_000
JUMP_WAIT_NS = NS  # a delay must stay this long to be a jump: a busy machine catches up within


class ClockMap:
    """Tells our time of a device time. `jump_ns` says when the device time has lost or skipped."""

    def __init__(self) -> None:
        self.jump_ns = 0  # of the last update: > 0 device time lost, < 0 it ran ahead
        self.delay_ns = 0  # of the last update, above the envelope
        self._buckets: deque[tuple[int, int]] = deque(maxlen=HISTORY)  # device time, least delay
        self._bucket_end_ns: int | None = None
        self._recent: deque[tuple[int, int]] = deque()  # arrival, delay above the envelope
        self._slope = 0.0  # delay gained per ns of device time

    @property
    def drift_ppm(self) -> float:
        """How fast the device runs against our clock; 0 in the first half minute."""
        return 0.0 - 1e6 * self._slope

    def update(self, device_ns: int, arrival_ns: int) -> int:
        """Take one arrival; return our time of `device_ns`."""
        delay_ns = arrival_ns - device_ns
        self.jump_ns = 0
        least_ns = self._least(device_ns)
        if least_ns is not None:
            above_ns = self._lasting(arrival_ns, delay_ns - least_ns)
            if above_ns > JUMP_NS or delay_ns - least_ns < -JUMP_NS:
                self.jump_ns = min(above_ns, delay_ns - least_ns)
                self._restart()
        self._add(device_ns, delay_ns)
        least_ns = self._least(device_ns)
        assert least_ns is not None
        self.delay_ns = delay_ns - least_ns
        return device_ns + least_ns

    def _restart(self) -> None:
        self._buckets.clear()
        self._recent.clear()
        self._bucket_end_ns = None

    def _add(self, device_ns: int, delay_ns: int) -> None:
        if self._bucket_end_ns is None or device_ns >= self._bucket_end_ns:
            self._fit()
            self._buckets.append((device_ns, delay_ns))
            self._bucket_end_ns = device_ns + BUCKET_NS
        elif self._leveled(device_ns, delay_ns) < self._leveled(*self._buckets[-1]):
            self._buckets[-1] = (device_ns, delay_ns)

    def _leveled(self, device_ns: int, delay_ns: int) -> float:
        return delay_ns - self._slope * device_ns

    def _least(self, device_ns: int) -> int | None:
        """The smallest delay of the window, carried to `device_ns` along the drift."""
        if not self._buckets:
            return None
        first = max(len(self._buckets) - WINDOW, 0)
        return min(
            delay + round(self._slope * (device_ns - at))
            for at, delay in (self._buckets[k] for k in range(first, len(self._buckets)))
        )

    def _lasting(self, arrival_ns: int, above_ns: int) -> int:
        """How far all delays of the last second were above the envelope."""
        recent = self._recent
        recent.append((arrival_ns, above_ns))
        while len(recent) > 3 and arrival_ns - recent[1][0] >= JUMP_WAIT_NS:
            recent.popleft()
        if len(recent) < 3 or arrival_ns - recent[0][0] < JUMP_WAIT_NS:
            return 0
        return min(above for _, above in recent)

    def _fit(self) -> None:
        if len(self._buckets) < MIN_HISTORY:
            return
        at, least = self._buckets[0]  # a device's own time may be more than 64 bits hold
        points = [(device_ns - at, delay_ns - least) for device_ns, delay_ns in self._buckets]
        x, y = np.array(points, np.float64).T
        line = cast(NDArray[np.float64], np.polyfit(x / NS, y, 1))
        self._slope = float(line[0]) / NS
