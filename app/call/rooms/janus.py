"""A room of two to eight people on a Janus server, which passes on what it cannot read.

Everybody publishes two sealed streams and a data channel, and subscribes to everybody else; the
display name is an identity, drawn for this call. When the server goes, all come back to it.
"""

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any

from app.call.media.connection import Connection
from app.call.media.srtp import Stream
from app.call.rooms.feed import Feed
from app.call.rooms.janus_api import JanusError, JanusSession
from app.call.rooms.room import CONNECT_S, LOOK_S, RETRY_S, Events, LineSettings, why
from app.call.wire.agreement import MAX_PEOPLE
from app.call.wire.invite import Invite
from app.call.wire.seal import SealError
from sensors.types import InputError

WRONG_PIN, NO_ROOM, ROOM_FULL = 433, 426, 432
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
        self._feeds: dict[str, asyncio.Task[None]] = {}
        self._been_in = self._is_in = False
        self.entered = asyncio.get_running_loop().create_future()  # done once the server lets us in

    async def run(self) -> None:
        import aiohttp

        while True:
            try:
                async with (
                    aiohttp.ClientSession() as http,
                    JanusSession(http, self._invite) as session,
                ):
                    await self._take_part(session)
            except JanusError as error:  # a room that we come back to may still count us as in it
                if error.code == WRONG_PIN or not self._been_in and error.code != NO_ROOM:
                    wanted = REFUSED.get(error.code, "to be let in")
                    raise InputError(
                        f"call: expected {wanted}, got: {error}; ask for a new invite"
                    ) from None
            except (aiohttp.ClientError, OSError, TimeoutError) as error:
                if not self._been_in:
                    raise InputError(
                        f"call: expected a room server at {self._invite.url}, got: "
                        f"{why(error)}; is it running?"
                    ) from None
            if self._is_in:
                self._events.tell("the room's server is gone; will reconnect when it answers")
                self._is_in = False
            await asyncio.sleep(RETRY_S)

    def send(self, stream: Stream, sealed: bytes, pts: int) -> bool:
        return self._publisher is not None and self._publisher.send(stream, sealed, pts)

    def say(self, message: bytes) -> None:
        if self._publisher is not None and self._publisher.channel_is_open:
            self._publisher.say(self._events.seal(message))

    async def close(self) -> None:
        feeds, publisher = [*self._feeds.values()], self._publisher
        self._feeds.clear()
        self._publisher = None
        for feed in feeds:
            feed.cancel()
        if publisher is not None:
            await publisher.close()
        await asyncio.gather(*feeds, return_exceptions=True)

    async def _take_part(self, session: JanusSession) -> None:
        """Take part until the server is gone or unreachable."""
        publisher = self._publisher = Connection(
            None,
            self._message,
            ice_servers=self._line.ice_servers,
            reroute=self._line.reroute,
            on_open=self._events.opened,
        )
        parts = [self._listen(session, publisher), self._watch(publisher)]
        tasks = [asyncio.create_task(part) for part in parts]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in tasks:
                task.cancel()
            await self.close()

    async def _listen(self, session: JanusSession, publisher: Connection) -> None:
        """Every event tells of people who have come or gone, those that answer us too."""
        room, handle = self._invite.room, await session.attach()
        if self._admin_key:
            await session.create_room(handle, self._admin_key)
        join = {"request": "join", "ptype": "publisher", "room": room, "pin": self._invite.pin}
        await session.message(handle, join | {"display": self._identity})
        while True:
            event = await session.event(handle)
            self._follow(session, event.get("publishers", []))
            for key in ("leaving", "unpublished"):
                feed = self._feeds.pop(str(event.get(key)), None)
                if feed is not None:
                    feed.cancel()
            if event.get("videoroom") == "joined":
                if not self.entered.done():
                    self.entered.set_result(None)
                offer = {"type": "offer", "sdp": await publisher.offer()}
                await session.message(handle, {"request": "publish"}, offer)
            elif "jsep" in event:
                await publisher.accept(event["jsep"]["sdp"])

    async def _watch(self, publisher: Connection) -> None:
        """Until the line to the server breaks; or it does not open in time."""
        try:
            async with asyncio.timeout(CONNECT_S):
                while publisher.state != "connected":
                    await asyncio.sleep(LOOK_S)
        except TimeoutError:
            self._events.tell("no media gets to the room's server; trying again")
            return
        self._been_in = self._is_in = True
        while publisher.state == "connected":
            await asyncio.sleep(LOOK_S)

    def _follow(self, session: JanusSession, publishers: list[Any]) -> None:
        for publisher in publishers[: MAX_PEOPLE - 1]:
            number, identity = str(publisher.get("id")), str(publisher.get("display", ""))
            if number not in self._feeds and identity != self._identity:
                take = self._packets_of(identity)
                feed = Feed(number, self._invite, self._line, take, self._message)
                self._feeds[number] = asyncio.create_task(feed.run(session))

    def _packets_of(self, identity: str) -> Callable[[Stream, bytes], None]:
        return lambda stream, sealed: self._events.packet(identity, stream, sealed)

    def _message(self, data: bytes) -> None:
        """A message of a data channel; not trusted, as the server may send anything."""
        with contextlib.suppress(SealError):
            identity, message = self._events.open(data)
            self._events.message(identity, message)
