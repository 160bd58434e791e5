"""Mute for the driver: it gets no sound and no pictures of the eyes, so that the face does
not show what is not to be heard or seen. The call's process holds back the packets itself.
With a call that has failed the run ends.
"""

from app.call.live.link import CallLink
from app.drive.controls import muted
from sensors.types import EyePacket, Packet, Source, SourceInfo


class Gate:
    """Wraps the sensors of a live run."""

    def __init__(self, source: Source, link: CallLink) -> None:
        self._source, self._link = source, link

    @property
    def info(self) -> SourceInfo:
        return self._source.info

    @property
    def exhausted(self) -> bool:
        return self._source.exhausted or bool(self._link.error)

    @property
    def dropped(self) -> int:
        return self._source.dropped

    def open(self) -> None:
        self._source.open()

    def poll(self) -> list[Packet]:
        link = self._link
        found: list[Packet] = []
        for packet in self._source.poll():
            if not (link.eyes_muted and isinstance(packet, EyePacket)):
                found.append(muted(packet) if link.muted else packet)
        return found

    def close(self) -> None:
        self._source.close()
