"""HeadSource: the poses of one tracker as a Source, whatever brings them.

Flow: HeadLink (a port, a recording, the web page) -> HeadSource.poll -> LiveSource -> Assembler.
"""

from collections.abc import Callable
from typing import Protocol

from sensors.head.gate import ReadingCounts
from sensors.types import NS, Clock, HeadPacket, Packet, SourceInfo

LOST_NS = NS // 2  # without a pose for so long, a tracker counts as lost
WAITING, LOST = "no pose yet", "lost"


class HeadLink(Protocol):
    """A connection that delivers packets; may be opened and closed repeatedly."""

    counts: ReadingCounts

    def open(self) -> None: ...
    def poll(self) -> list[HeadPacket]:
        """Those that came since the last call, in order; never waits."""
        ...

    def close(self) -> None: ...


class HeadSource:
    """One tracker; `problem` says why there is no pose now."""

    exhausted = False

    def __init__(
        self, name: str, connect: Callable[[], HeadLink], clock: Clock, expected: bool = True
    ) -> None:
        """`connect` makes a new link; what cannot be opened raises InputError there. `expected`:
        it is a problem that no pose has come yet."""
        self.name = name
        self._at_first = WAITING if expected else ""
        self.problem = self._at_first
        self.counts = ReadingCounts()
        self._connect, self._clock = connect, clock
        self._link: HeadLink | None = None
        self._newest_ns: int | None = None

    @property
    def info(self) -> SourceInfo:
        return SourceInfo(self.name, audio=False, head=True, devices={"head": self.name})

    @property
    def dropped(self) -> int:
        """Poses that were left out, for whatever reason."""
        return self.counts.bad + self.counts.jumps + self.counts.flooded

    def open(self) -> None:
        self._link = self._connect()
        self._link.open()
        self.counts, self._newest_ns, self.problem = self._link.counts, None, self._at_first

    def poll(self) -> list[Packet]:
        if self._link is None:
            raise RuntimeError("poll before open")
        packets: list[Packet] = [*self._link.poll()]
        now_ns = self._clock.now_ns()
        if packets:
            self._newest_ns, self.problem = now_ns, ""
        elif self._newest_ns is not None and now_ns - self._newest_ns > LOST_NS:
            self.problem = LOST
        return packets

    def close(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None
