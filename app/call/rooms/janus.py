"""A room of two to eight people on a Janus server, which passes on what it cannot read.

Everybody publishes two sealed streams and a data channel, and subscribes to everybody else; the
display name is an identity, drawn for this call. When the server goes, all come back to it.
"""

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any

from app.call.media.connection import Connection, Stream
from app.call.rooms.janus_api import JanusError, JanusSession
from app.call.rooms.room import Events, LineSettings
from app.call.wire.agreement import MAX_PEOPLE
from app.call.wire.invite import Invite
from app.call.wire.seal import SealError
from sensors.types import InputError

RETRY_S = 1.0
CONNECT_S = 8.0
WRONG_PIN, NO_ROOM, ROOM_EXISTS, ROOM_FULL = 433, 426, 427, 432
REFUSED = {WRONG_PIN: "the secret of this room", ROOM_FULL: "a free place"}


class JanusRoom:
    """One end's connections to the server."""

    def __init__(
        self,
        invite: Invite,
        identity: str,
        events: Events,
        line: LineSettings,
        admin_key: str = "",  # of who may make rooms: the host
    ) -> None:
        self._invite, self._identity = invite, identity
        self._events, self._line, self._admin_key = events, line, admin_key
        self._publisher: Connection | None = None
        self._subscribers: dict[str, tuple[str, int, Connection]] = {}  # feed -> who, handle
        self._been_in = False

    @property
    def url(self) -> str:
        scheme = "wss" if self._invite.fingerprint else "ws"
        host = self._invite.host
        return f"{scheme}://[{host}]" if ":" in host else f"{scheme}://{host}:{self._invite.port}"

    async def run(self) -> None:
        import aiohttp

        pin = self._invite.fingerprint
        tls = aiohttp.Fingerprint(pin) if pin else True
        told = False
        while True:
            try:
                async with (
                    aiohttp.ClientSession() as http,
                    JanusSession(http, self.url, self._invite.token, tls) as session,
                ):
                    await self._take_part(session)
            except JanusError as error:
                if error.code in REFUSED or not self._been_in and error.code != NO_ROOM:
                    wanted = REFUSED.get(error.code, "to be let in")
                    raise InputError(
                        f"call: expected {wanted}, got: {error}; ask for a new invite"
                    ) from None
            except (aiohttp.ClientError, OSError, TimeoutError) as error:
                if not self._been_in:
                    raise InputError(
                        f"call: expected a room server at {self.url}, got: {str(error)[:80]}; "
                        "is it running?"
                    ) from None
            if not told:
                self._events.tell("the room's server is gone; coming back as soon as it is there")
                told = True
            await self.close()
            await asyncio.sleep(RETRY_S)

    def send(self, stream: Stream, sealed: bytes, pts: int) -> bool:
        return self._publisher is not None and self._publisher.send(stream, sealed, pts)

    def say(self, message: bytes) -> None:
        if self._publisher is not None and self._publisher.channel_is_open:
            self._publisher.say(self._events.seal(message))

    async def close(self) -> None:
        connections = [c for *_, c in self._subscribers.values()]
        self._subscribers.clear()
        if self._publisher is not None:
            connections.append(self._publisher)
            self._publisher = None
        for connection in connections:
            await connection.close()

    async def _take_part(self, session: JanusSession) -> None:
        """Until the server goes."""
        room, handle = self._invite.room, await session.attach()
        if self._admin_key:
            await self._create(session, handle)
        join = {"request": "join", "ptype": "publisher", "room": room, "pin": self._invite.pin}
        await session.message(handle, join | {"display": self._identity})
        joined = await session.event_with(handle, "publishers")
        self._publisher = Connection(
            None, self._message, ice_servers=self._line.ice_servers, on_open=self._events.opened
        )
        offer = {"type": "offer", "sdp": await self._publisher.offer()}
        await session.message(handle, {"request": "publish"}, offer)
        answer = await session.event_with(handle, "jsep")
        await self._publisher.accept(answer["jsep"]["sdp"])
        self._been_in = True
        await self._subscribe_all(session, joined["publishers"])
        while True:
            event = await session.event(handle)
            await self._subscribe_all(session, event.get("publishers", []))
            for key in ("leaving", "unpublished"):
                await self._unsubscribe(session, event.get(key))

    async def _create(self, session: JanusSession, handle: int) -> None:
        body = {
            "request": "create",
            "admin_key": self._admin_key,
            "room": self._invite.room,
            "pin": self._invite.pin,
            "publishers": MAX_PEOPLE,
            "audiocodec": "opus",
            "opus_fec": False,  # it is ours, and sealed
            "is_private": True,
            "notify_joining": False,
        }
        try:
            await session.request(handle, body)
        except JanusError as error:
            if error.code != ROOM_EXISTS:
                raise

    async def _subscribe_all(self, session: JanusSession, publishers: list[Any]) -> None:
        for publisher in publishers[: MAX_PEOPLE - 1]:
            feed, identity = str(publisher.get("id")), str(publisher.get("display", ""))
            if feed not in self._subscribers and identity != self._identity:
                await self._subscribe(session, feed, identity)

    async def _subscribe(self, session: JanusSession, feed: str, identity: str) -> None:
        handle = await session.attach()
        room, pin = self._invite.room, self._invite.pin
        join = {"request": "join", "ptype": "subscriber", "room": room, "pin": pin}
        await session.message(handle, join | {"streams": [{"feed": feed}]})
        offer = await session.event_with(handle, "jsep")
        line = self._line
        connection = Connection(
            self._packets_of(identity),
            self._message,
            sends=False,
            ice_servers=line.ice_servers,
            reroute=line.reroute,
        )
        self._subscribers[feed] = identity, handle, connection
        answer = {"type": "answer", "sdp": await connection.answer(offer["jsep"]["sdp"])}
        await session.message(handle, {"request": "start", "room": room}, answer)

    async def _unsubscribe(self, session: JanusSession, feed: object) -> None:
        found = self._subscribers.pop(feed, None) if isinstance(feed, str) else None
        if found is not None:
            with contextlib.suppress(ConnectionError):
                await session.detach(found[1])
            await found[2].close()

    def _packets_of(self, identity: str) -> Callable[[Stream, bytes], None]:
        return lambda stream, sealed: self._events.packet(identity, stream, sealed)

    def _message(self, data: bytes) -> None:
        """From anybody's data channel; the server may send what it likes."""
        with contextlib.suppress(SealError):
            identity, message = self._events.open(data)
            self._events.message(identity, message)
