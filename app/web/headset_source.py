"""The headset's poses as a HeadSource: what `--head web` and `--head auto` with a page listen to.

page -> server's process -> ServerLink.poses -> ReadingGate -> HeadSource.poll -> LiveSource
"""

from collections.abc import Callable

from app.web.link import ServerLink
from app.web.messages import MESSAGE
from sensors.head import headset
from sensors.head.gate import Reading, ReadingGate
from sensors.head.source import HeadSource
from sensors.types import Clock, HeadPacket

NAME = "web"


class PageHeadsetLink:
    """Takes the poses that the server has passed on."""

    def __init__(self, link: ServerLink, tell: Callable[[str], None]) -> None:
        self._link, self._gate = link, ReadingGate(NAME, tell)
        self.counts = self._gate.counts

    def open(self) -> None:
        self._link.poses.clear()

    def poll(self) -> list[HeadPacket]:
        self._link.read()
        packets: list[HeadPacket] = []
        while self._link.poses:
            arrival_ns, message = self._link.poses.popleft()
            packet = self._gate(reading(message), arrival_ns)
            if packet is not None:
                packets.append(packet)
        return packets

    def close(self) -> None:
        self._link.poses.clear()


def web_head(
    link: ServerLink, clock: Clock, tell: Callable[[str], None], expected: bool = True
) -> HeadSource:
    """The headset of the page behind `link`."""
    return HeadSource(NAME, lambda: PageHeadsetLink(link, tell), clock, expected)


def reading(message: bytes) -> Reading:
    """A page's message as a reading; one that is no pose becomes one that the gate refuses."""
    time_ms, x, y, z, *turn, tracked = MESSAGE.unpack(message)
    return headset.reading((x, y, z), turn, time_ms / 1e3, tracked > 0)
