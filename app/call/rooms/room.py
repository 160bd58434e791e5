"""The protocol of rooms: how the ends of a call find each other and exchange packets."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from app.call.media.connection import Reroute
from app.call.media.srtp import Stream

BYE, HELLO, OFFER, ANSWER, AVATAR = b"B", b"H", b"O", b"A", b"V"  # first byte of a message
RETRY_S = 1.0
LOOK_S = 0.25  # between two looks at a line
SILENT_S = 3.0  # without a packet: a new connection is made
CONNECT_S = 8.0  # for a new connection; its handshake is repeated after 1, 2 and 4 s


def why(error: Exception) -> str:
    """Why a connection failed, in the system's words: those of aiohttp begin with how it tried."""
    if isinstance(error, OSError):
        number = error.errno or 0  # below 0: of looking a name up
        return os.strerror(number) if number > 0 else error.strerror or "no answer"
    return str(error)[:80] or "no answer"


@dataclass(frozen=True, kw_only=True)
class Events:
    """Callbacks of a room into the call."""

    packet: Callable[[str, Stream, bytes], None]  # identity, stream, sealed
    seal: Callable[[bytes], bytes]  # a message, with who sends it
    open: Callable[[bytes], tuple[str, bytes]]  # identity and message; SealError
    message: Callable[[str, bytes], None]  # identity and message, of a kind not the room's own
    opened: Callable[[], None]  # messages can be said now
    ready: Callable[[], bool]  # both ends have accepted
    tell: Callable[[str], None]  # a line for the person


@dataclass(frozen=True, kw_only=True)
class LineSettings:
    """Addresses that the media uses."""

    ice_servers: tuple[str, ...] = ()
    reroute: Reroute | None = field(default=None, compare=False)


class Room(Protocol):
    """Direct, or through a server."""

    async def run(self) -> None:
        """Connect, and again whenever the line breaks, until cancelled. Raises InputError where
        trying again would be in vain."""
        ...

    def send(self, stream: Stream, sealed: bytes, pts: int) -> bool:
        """Media for everyone; False: nobody took it."""
        ...

    def say(self, message: bytes) -> None:
        """A message for everyone, sealed here."""
        ...

    async def close(self) -> None: ...
