"""One room on two Janus servers, in cascade: whoever publishes on one does so on the other too.

The bridge tells each server to send what its people publish to the other (`publish_remotely`, to a
remote publisher there). The media passes from server to server, sealed as it came, never through
here.
"""

import asyncio
import contextlib
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Any

from app.call.rooms.janus_api import JanusError, JanusSession
from app.call.rooms.janus_server import admin_key, token
from app.call.rooms.room import LOOK_S, RETRY_S, why
from app.call.wire.invite import Invite
from sensors.types import InputError

NO_PUBLISHER = 428
REMOTE_ID = "livedrive"  # of what a server sends to the other, for one publisher
STREAMS = (  # what everybody publishes, as in Connection
    {"type": "audio", "mid": "0", "mindex": 0, "codec": "opus"},
    {"type": "audio", "mid": "1", "mindex": 1, "codec": "opus"},
    {"type": "data", "mid": "2", "mindex": 2},
)


@dataclass(frozen=True, kw_only=True)
class ServerAccess:
    """A room on one of the two servers, and that server's key."""

    invite: Invite
    key: str


class ServerError(Exception):
    """A server is away, or refuses with `code`; the message names it."""

    def __init__(self, problem: str, code: int = 0) -> None:
        super().__init__(problem)
        self.code = code


class RoomEnd:
    """The room on one server. Use as an async context manager; every method raises ServerError
    once the server is gone or refuses."""

    def __init__(self, access: ServerAccess, now_s: int) -> None:
        self.host, self.url = access.invite.host, access.invite.url
        self.passed: set[str] = set()  # its publishers that publish on the other server too
        self._invite = replace(access.invite, token=token(access.key, now_s))
        self._admin_key = admin_key(access.key)
        self._stack = contextlib.AsyncExitStack()

    async def __aenter__(self) -> "RoomEnd":
        import aiohttp

        with self._named():
            try:
                http = await self._stack.enter_async_context(aiohttp.ClientSession())
                session = JanusSession(http, self._invite)
                self._session = await self._stack.enter_async_context(session)
                await self._enter()
                self._handle = await session.attach()
            except BaseException:
                await self._stack.aclose()
                raise
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._stack.aclose()

    async def publishers(self) -> dict[str, dict[str, Any]]:
        """Everybody who publishes in the room, by the server's number."""
        people = (await self.ask("listparticipants"))["participants"]
        return {person["id"]: person for person in people if person.get("publisher")}

    async def ask(self, request: str, **fields: object) -> dict[str, Any]:
        body = {"request": request, "room": self._invite.room, "admin_key": self._admin_key}
        with self._named():
            return await self._session.request(self._handle, body | fields)

    async def stop(self, request: str, **fields: object) -> None:
        """As ask; what is not there need not be stopped."""
        try:
            await self.ask(request, **fields)
        except ServerError as error:
            if not error.code:
                raise

    async def _enter(self) -> None:
        """Make the room where there is none, and see that it is the invite's: its PIN fits."""
        handle = await self._session.attach()
        await self._session.create_room(handle, self._admin_key)
        room = {"room": self._invite.room, "pin": self._invite.pin}
        await self._session.message(handle, {"request": "join", "ptype": "publisher"} | room)
        await self._session.event_with(handle, "publishers")
        await self._session.detach(handle)

    @contextlib.contextmanager
    def _named(self) -> Generator[None]:
        import aiohttp

        try:
            yield
        except JanusError as error:
            raise ServerError(f"{self.url} refuses: {error}", error.code) from None
        except (aiohttp.ClientError, OSError, TimeoutError) as error:
            raise ServerError(f"{self.url} does not answer: {why(error)}") from None


class Bridge:
    """Runs until it is cancelled; then the rooms are apart again."""

    def __init__(
        self,
        servers: tuple[ServerAccess, ServerAccess],
        tell: Callable[[str], None],
        date_s: Callable[[], int],
    ) -> None:
        self._servers, self._tell, self._date_s = servers, tell, date_s

    async def run(self) -> None:
        """Raises InputError where the servers do not let it begin."""
        begun, told = False, ""
        while True:
            try:
                one, two = (RoomEnd(server, self._date_s()) for server in self._servers)
                async with one, two:
                    self._tell("the room spans both servers")
                    begun, told = True, ""
                    await span(one, two)
            except ServerError as error:
                if not begun:
                    raise InputError(
                        f"call bridge: expected a room on both servers, got: {error}; "
                        "is it running, and are invite and key of it?"
                    ) from None
                if str(error) != told:
                    told = str(error)
                    self._tell(f"{told}; trying again until the room spans both servers")
            await asyncio.sleep(RETRY_S)


async def span(one: RoomEnd, two: RoomEnd) -> None:
    """Pass on who comes, and take back who goes, until cancelled; then take everybody back."""
    try:
        while True:
            await pass_on(one, two)
            await pass_on(two, one)
            await asyncio.sleep(LOOK_S)
    except asyncio.CancelledError:
        with contextlib.suppress(ServerError):
            for here, there in ((one, two), (two, one)):
                for number in here.passed:
                    await take_back(here, there, number)
        raise


async def pass_on(here: RoomEnd, there: RoomEnd) -> None:
    """Whoever publishes here, and nobody else of here, publishes there too."""
    people = await here.publishers()
    own = {number: p for number, p in people.items() if not p.get("remote")}
    remote = {number for number, p in (await there.publishers()).items() if p.get("remote")}
    good = remote & own.keys() & here.passed
    for number in remote - good:  # has gone, or was passed on by an earlier session
        await take_back(here, there, number)
    for number in own.keys() - good:
        shown = {"id": number, "display": own[number].get("display", "")}
        answer = await there.ask("add_remote_publisher", streams=STREAMS, **shown)
        to = {"remote_id": REMOTE_ID, "host": there.host, "port": answer["port"]}
        await here.stop("unpublish_remotely", publisher_id=number, remote_id=REMOTE_ID)
        try:
            await here.ask("publish_remotely", publisher_id=number, **to)
            here.passed.add(number)
        except ServerError as error:
            if error.code != NO_PUBLISHER:
                raise
            await take_back(here, there, number)  # left meanwhile


async def take_back(here: RoomEnd, there: RoomEnd, number: str) -> None:
    await there.stop("remove_remote_publisher", id=number)
    await here.stop("unpublish_remotely", publisher_id=number, remote_id=REMOTE_ID)
