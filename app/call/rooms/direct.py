"""Two people without a server: one listens, the other knows the address from the invite.

A WebSocket over TLS, its certificate pinned by the invite, carries the sealed messages; a WebRTC
connection carries the media, once both have accepted. Whoever cannot seal a message is shown out.
"""

import asyncio
import contextlib
import ssl
from typing import TYPE_CHECKING

from app.call.media.connection import Connection
from app.call.media.srtp import Stream
from app.call.rooms.room import (
    ANSWER,
    BYE,
    CONNECT_S,
    OFFER,
    RETRY_S,
    SILENT_S,
    Events,
    LineSettings,
    why,
)
from app.call.wire.invite import Invite, in_url
from app.call.wire.seal import SealError
from sensors.listening import cannot_listen
from sensors.types import InputError

if TYPE_CHECKING:
    from aiohttp import ClientWebSocketResponse, web

    Socket = web.WebSocketResponse | ClientWebSocketResponse

PATH = "/call"
MAX_MESSAGE = 1 << 16
STRANGERS = 16  # connections that have not yet shown that they hold the secret
PROOF_S = 5.0  # time to prove it
CLOSE_S = 1.0  # that a closing handshake may take
HEARTBEAT_S = 5.0
WRONG_SECRET, BUSY = 4403, 4409  # why a WebSocket was closed
REFUSALS = {
    WRONG_SECRET: "call join: expected the secret of this call, got another; ask for a new invite",
    BUSY: "call join: expected a free place, got a call of two; ask for an invite to a room",
}


class DirectRoom:
    """The part that host and guest share."""

    def __init__(self, events: Events, line: LineSettings) -> None:
        self._events, self._line = events, line
        self._socket: Socket | None = None
        self._partner = ""  # identity
        self._connection: Connection | None = None
        self._came_s = 0.0  # when a packet last came
        self._tasks: set[asyncio.Task[None]] = set()

    def send(self, stream: Stream, sealed: bytes, pts: int) -> bool:
        return self._connection is not None and self._connection.send(stream, sealed, pts)

    def say(self, message: bytes) -> None:
        if self._socket is not None and not self._socket.closed:
            task = asyncio.create_task(_post(self._socket, self._events.seal(message)))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def close(self) -> None:
        if self._tasks:
            await asyncio.wait(self._tasks, timeout=1)
        if self._connection is not None:
            await self._connection.close()
        if self._socket is not None:
            await self._socket.close()

    async def _stay(self, socket: "Socket", partner: str) -> None:
        """Until the socket closes; `partner`: empty while unknown. Raises SealError where a message
        is not of this call."""
        self._socket, self._partner = socket, partner
        self._events.opened()
        async for message in socket:
            if isinstance(message.data, bytes):
                identity, opened = self._events.open(message.data)
                if self._partner not in ("", identity):
                    raise SealError("expected messages of one partner, got another identity")
                self._partner = identity
                await self._take(identity, opened)

    async def _take(self, identity: str, message: bytes) -> None:
        kind, body = message[:1], message[1:]
        if kind == OFFER and self._events.ready():
            connection = await self._new_connection()
            with contextlib.suppress(Exception):  # garbage; a host that is sound offers anew
                self.say(ANSWER + (await connection.answer(body.decode())).encode())
        elif kind == ANSWER and self._connection is not None:
            with contextlib.suppress(Exception):  # garbage, or an offer's that is no longer valid
                await self._connection.accept(body.decode())
        else:
            self._events.message(identity, message)

    async def _new_connection(self) -> Connection:
        if self._connection is not None:
            await self._connection.close()
        line = self._line
        self._connection = Connection(
            self._packet, ice_servers=line.ice_servers, reroute=line.reroute
        )
        self._came_s = asyncio.get_running_loop().time()
        return self._connection

    def _packet(self, stream: Stream, sealed: bytes) -> None:
        self._came_s = asyncio.get_running_loop().time()
        self._events.packet(self._partner, stream, sealed)


class DirectHost(DirectRoom):
    """Listens for one partner."""

    def __init__(
        self, listen: tuple[str, int], tls: ssl.SSLContext, events: Events, line: LineSettings
    ) -> None:
        super().__init__(events, line)
        self._listen, self._tls = listen, tls
        self._strangers: list[web.WebSocketResponse] = []  # oldest first
        self.refused = 0
        self.port = asyncio.get_running_loop().create_future()  # once it listens

    async def run(self) -> None:
        from aiohttp import web

        app = web.Application()
        app.router.add_get(PATH, self._serve)
        runner = web.AppRunner(app, access_log=None, handle_signals=False, shutdown_timeout=1)
        await runner.setup()
        try:
            try:
                await web.TCPSite(runner, *self._listen, ssl_context=self._tls).start()
            except OSError as error:
                raise cannot_listen("call host", *self._listen, error, "--port") from None
            self.port.set_result(runner.addresses[0][1])
            while True:
                await self._keep_connected()
                await asyncio.sleep(0.2)
        finally:
            await runner.cleanup()

    async def _keep_connected(self) -> None:
        if self._socket is None or self._socket.closed or not self._events.ready():
            return
        connection = self._connection
        patience_s = SILENT_S if connection and connection.state == "connected" else CONNECT_S
        is_silent = asyncio.get_running_loop().time() - self._came_s > patience_s
        if connection is None or connection.state in ("failed", "closed") or is_silent:
            connection = await self._new_connection()
            self.say(OFFER + (await connection.offer()).encode())

    async def _serve(self, request: "web.Request") -> "web.StreamResponse":
        from aiohttp import web

        socket = web.WebSocketResponse(
            max_msg_size=MAX_MESSAGE, heartbeat=HEARTBEAT_S, timeout=CLOSE_S
        )
        try:
            await socket.prepare(request)
            self._strangers.append(socket)
            if len(self._strangers) > STRANGERS:  # a silent connection loses its place
                await self._strangers.pop(0).close(code=WRONG_SECRET)
            async with asyncio.timeout(PROOF_S):
                first = await socket.receive_bytes()
            identity, message = self._events.open(first)
        except (SealError, TypeError, TimeoutError):
            await self._refuse(socket, WRONG_SECRET)
            return socket
        finally:
            if socket in self._strangers:
                self._strangers.remove(socket)
        old = self._socket
        if old is not None and not old.closed:
            if identity != self._partner:
                await self._refuse(socket, BUSY)
                return socket
            await old.close()
        await self._take(identity, message)
        with contextlib.suppress(SealError):
            await self._stay(socket, identity)
        return socket

    async def _refuse(self, socket: "web.WebSocketResponse", code: int) -> None:
        self.refused += 1
        if self.refused & (self.refused - 1) == 0:  # 1, 2, 4, 8, ...: a flood fills no screen
            why = "without the secret" if code == WRONG_SECRET else "while the call is full"
            self._events.tell(f"{self.refused} tried to join {why}; nothing was said to them")
        await socket.close(code=code)


class DirectGuest(DirectRoom):
    """Dials the address of the invite."""

    def __init__(self, invite: Invite, events: Events, line: LineSettings) -> None:
        super().__init__(events, line)
        self._invite = invite
        self._over = False  # the host has left, and its call with it

    async def run(self) -> None:
        import aiohttp

        invite, host = self._invite, self._invite.host
        url = f"https://{in_url(host)}:{invite.port}"
        told = ""  # partner of whom the loss was told
        pin = aiohttp.Fingerprint(invite.fingerprint)
        async with aiohttp.ClientSession() as session:
            while True:
                try:
                    async with session.ws_connect(
                        url + PATH, ssl=pin, max_msg_size=MAX_MESSAGE, heartbeat=HEARTBEAT_S
                    ) as socket:
                        if told:
                            self._events.tell("the connection is back")
                        told = ""
                        with contextlib.suppress(SealError):
                            await self._stay(socket, self._partner)
                        if socket.close_code in REFUSALS:
                            raise InputError(REFUSALS[socket.close_code])
                except aiohttp.ServerFingerprintMismatch:
                    raise InputError(
                        f"call join: expected the certificate that the invite names at {host}, got "
                        "another; ask for a new invite"
                    ) from None
                except (aiohttp.ClientError, OSError, TimeoutError) as error:
                    if not self._partner:
                        raise InputError(
                            f"call join: expected somebody at {host}:{invite.port}, got: "
                            f"{why(error)}; ask whether the call is open"
                        ) from None
                if self._over:
                    self._events.tell("the call is over: who opened it has left; q leaves")
                    await asyncio.get_running_loop().create_future()  # there is nobody to dial
                if told != self._partner:
                    told = self._partner
                    self._events.tell("the connection is lost; dialling again until it is back")
                await asyncio.sleep(RETRY_S)

    async def _take(self, identity: str, message: bytes) -> None:
        self._over = message[:1] == BYE
        await super()._take(identity, message)


async def _post(socket: "Socket", sealed: bytes) -> None:
    with contextlib.suppress(ConnectionError):
        await socket.send_bytes(sealed)
