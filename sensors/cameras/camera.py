"""EyeCamera: a thread that keeps one camera alive and holds its newest pictures.

Flow: CameraLink.read -> checks -> Views -> newest pictures -> poll. The states are connecting, live
and waiting; a lost camera is tried again with growing pauses and never holds up the tick.
"""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from sensors.cameras import reasons
from sensors.cameras.views import Views
from sensors.clock_map import ClockMap
from sensors.picture import BadPictureError, CameraLink, CameraLostError, Shot, check_content
from sensors.types import EYE_NAMES, NS, Clock, EyePacket, InputError

READ_S = 0.25  # how long a read may block; the thread ends this fast
STALL_NS = NS  # no picture for so long: connect again
MAX_BAD_RUN = 30  # damaged pictures in a row: connect again
MAX_ODD_RUN = 5  # pictures of another size in a row: the camera has changed its size
RETRY_S = (0.1, 0.2, 0.4, 0.8)  # waits between attempts to connect; the last one repeats
MIN_INTERVAL_NS = NS // 150  # pictures that follow faster are not even checked
JOIN_S = 1.5
# Pictures held for the next poll. A frame ends before its sound has come in, so the picture that
# belongs to it may have up to three younger ones at 120 Hz; the assembler takes the right one.
NEWEST = 4

Connect = Callable[[], CameraLink]


@dataclass
class CameraCounts:
    """What a camera has done since it was opened."""

    pictures: int = 0  # whole ones
    damaged: int = 0  # refused by a check
    unused: int = 0  # newer ones came before they were polled
    connects: int = 0


class EyeCamera:
    """One camera, for one eye or for both."""

    def __init__(self, name: str, connect: Connect, views: Views, clock: Clock) -> None:
        self.name = name
        self.views = views
        self.counts = CameraCounts()
        self.state = "closed"  # connecting, live, waiting
        self.problem = ""  # why there is no picture now; empty while there is one
        self.delay_ns = 0  # of the newest picture: arrival to here, decoded and cut
        self.newest_ns: int | None = None  # time of the newest picture
        self._connect, self._clock = connect, clock
        self._newest: deque[list[EyePacket]] = deque(maxlen=NEWEST)
        self._lock = threading.Lock()
        self._closing = threading.Event()  # a new one each time it is opened
        self._thread: threading.Thread | None = None
        self._map = ClockMap()
        self._counter = 0
        self._last_ns = -1
        self._shape: tuple[int, ...] | None = None
        self._odd_run = 0

    @property
    def devices(self) -> dict[str, str]:
        return {f"eye_{EYE_NAMES[eye]}": self.name for eye in self.views.eyes}

    @property
    def dropped(self) -> int:
        """Pictures that arrived and were not delivered by `poll`."""
        return self.counts.damaged + self.counts.unused

    def open(self) -> None:
        """Start connecting; returns at once."""
        self.counts, self.problem = CameraCounts(), "connecting"
        self._closing, earlier = threading.Event(), self._thread
        work = (self._closing, earlier)
        self._thread = threading.Thread(target=self._run, args=work, name=self.name, daemon=True)
        self._thread.start()

    def poll(self) -> list[EyePacket]:
        """The newest pictures that have not been handed out yet, oldest first."""
        with self._lock:
            shots = list(self._newest)
            self._newest.clear()
        return [packet for shot in shots for packet in shot]

    def close(self) -> None:
        if self._thread is not None:
            self._closing.set()
            self._thread.join(JOIN_S)
        self._newest.clear()
        self.state = "closed"

    def _run(self, closing: threading.Event, earlier: threading.Thread | None) -> None:
        if earlier is not None:
            earlier.join()  # its driver may still hold the camera
        failures = 0
        while not closing.is_set():
            self.state = "connecting"
            try:
                link = self._connect()
                self.counts.connects += 1
                before = self.counts.pictures
                try:
                    self._stream(link, closing)
                finally:
                    link.close()
                    failures = 0 if self.counts.pictures > before else failures
            except (CameraLostError, InputError, OSError) as error:
                if closing.is_set():
                    return  # nobody asks any more
                told = reasons.lost(error) if isinstance(error, OSError) else error
                self.problem = " ".join(str(told).split())
                self.state = "waiting"
                closing.wait(RETRY_S[min(failures, len(RETRY_S) - 1)])
                failures += 1

    def _stream(self, link: CameraLink, closing: threading.Event) -> None:
        """Read until the camera is lost or closed."""
        self._map, self._shape, self._odd_run = ClockMap(), None, 0
        seen_ns, kept_ns, bad_run = self._clock.now_ns(), -NS, 0
        while not closing.is_set():
            try:
                shot = link.read(READ_S)
                if closing.is_set():
                    return  # a late read: the camera stays closed
                if shot is None:
                    if self._clock.now_ns() - seen_ns > STALL_NS:
                        raise CameraLostError(f"no picture for {STALL_NS // NS} s")
                    continue
                seen_ns = shot.arrival_ns
                self._counter += shot.skipped
                self.counts.unused += shot.skipped
                if shot.arrival_ns - kept_ns < MIN_INTERVAL_NS:
                    self._counter += 1
                    self.counts.unused += 1
                    continue
                kept_ns = shot.arrival_ns
                self._keep(shot)
                bad_run = 0
            except BadPictureError as error:
                seen_ns = self._clock.now_ns()
                self.counts.damaged += 1
                self._counter += 1
                bad_run += 1
                if bad_run >= MAX_BAD_RUN:
                    raise CameraLostError(f"only damaged pictures ({error})") from None

    def _keep(self, shot: Shot) -> None:
        """Check the picture, cut it and hold it for the next poll. Raises BadPictureError."""
        self._check_shape(shot.image.shape)
        check_content(shot.image)
        t_ns = shot.arrival_ns
        if shot.device_ns is not None:
            t_ns = min(self._map.update(shot.device_ns, shot.arrival_ns), shot.arrival_ns)
        t_ns = self._last_ns = max(t_ns, self._last_ns + 1)
        views = self.views.cut(shot.image)
        packets = [EyePacket(t_ns, eye, self._counter, view) for eye, view in views]
        with self._lock:
            self.counts.unused += len(self._newest) == NEWEST
            self._newest.append(packets)
        self._counter += 1
        self.counts.pictures += 1
        self.newest_ns = t_ns
        self.delay_ns = self._clock.now_ns() - shot.arrival_ns
        self.state, self.problem = "live", ""

    def _check_shape(self, shape: tuple[int, ...]) -> None:
        """A picture of another size is damaged, until five in a row have that size."""
        if self._shape is None or shape == self._shape:
            self._shape, self._odd_run = shape, 0
            return
        self._odd_run += 1
        if self._odd_run <= MAX_ODD_RUN:
            expected = f"{self._shape[1]} x {self._shape[0]}"
            raise BadPictureError(f"picture of {shape[1]} x {shape[0]}, expected {expected}")
        self._shape, self._odd_run = shape, 0
