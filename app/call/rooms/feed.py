"""The media that one person in a room publishes, received over a connection of its own."""

import asyncio
import contextlib
from collections.abc import Callable

from app.call.media.connection import Connection
from app.call.media.srtp import Stream
from app.call.rooms.janus_api import JanusError, JanusSession
from app.call.rooms.room import CONNECT_S, LOOK_S, RETRY_S, SILENT_S, LineSettings
from app.call.wire.invite import Invite


class Feed:
    """Runs until cancelled; reconnects where the connection does not open or falls silent."""

    def __init__(
        self,
        number: str,  # of the server
        invite: Invite,
        line: LineSettings,
        on_packet: Callable[[Stream, bytes], None],
        on_message: Callable[[bytes], None],
    ) -> None:
        self._number, self._invite, self._line = number, invite, line
        self._on_packet, self._on_message = on_packet, on_message
        self._came_s: float | None = None  # when anything last came

    async def run(self, session: JanusSession) -> None:
        """Until the session ends."""
        with contextlib.suppress(ConnectionError):
            while True:
                with contextlib.suppress(JanusError, TimeoutError):  # gone, or the server is slow
                    await self._subscribe(session)
                await asyncio.sleep(RETRY_S)

    async def _subscribe(self, session: JanusSession) -> None:
        """Receive until nothing comes any more."""
        handle = await session.attach()
        line = self._line
        connection = Connection(
            self._packet,
            self._message,
            sends=False,
            ice_servers=line.ice_servers,
            reroute=line.reroute,
        )
        self._came_s = None
        room, pin = self._invite.room, self._invite.pin
        join = {"request": "join", "ptype": "subscriber", "room": room, "pin": pin}
        try:
            await session.message(handle, join | {"streams": [{"feed": self._number}]})
            offer = await session.event_with(handle, "jsep")
            answer = {"type": "answer", "sdp": await connection.answer(offer["jsep"]["sdp"])}
            await session.message(handle, {"request": "start", "room": room}, answer)
            await self._watch(connection)
        finally:
            with contextlib.suppress(ConnectionError):
                await session.detach(handle)
            await connection.close()

    async def _watch(self, connection: Connection) -> None:
        """Everybody says hello every second, so silence is a broken line."""
        now_s = asyncio.get_running_loop().time
        began_s = now_s()
        while connection.state not in ("failed", "closed"):
            came_s = self._came_s
            if now_s() - (came_s or began_s) > (SILENT_S if came_s else CONNECT_S):
                return
            await asyncio.sleep(LOOK_S)

    def _packet(self, stream: Stream, sealed: bytes) -> None:
        self._came_s = asyncio.get_running_loop().time()
        self._on_packet(stream, sealed)

    def _message(self, data: bytes) -> None:
        self._came_s = asyncio.get_running_loop().time()
        self._on_message(data)
