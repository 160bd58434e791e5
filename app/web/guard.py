"""Who may ask the server for what: token, origin, host, number and rate of connections.

On the loopback address only this machine can connect, so what must be kept out are pages of other
sites in a browser here (origin, host name). Beyond it every request needs the token.
"""

import asyncio
import secrets
from collections import deque
from collections.abc import Awaitable, Callable
from urllib.parse import urlsplit

from aiohttp import hdrs, web

from app.web.info import is_loopback

COOKIE = "livedrive"
MAX_CONNECTIONS = 64
MAX_ACCEPTS = 60  # new connections in ACCEPT_S; more are closed unheard
ACCEPT_S = 1.0
IDLE_S = 5.0  # a connection must have become a WebSocket by then
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def check(token: str | None):  # noqa: ANN201
    """Middleware that refuses strangers; `token` None: the server is bound to loopback."""

    @web.middleware
    async def middleware(request: web.Request, handler: Handler) -> web.StreamResponse:
        host = urlsplit(f"//{request.host}").hostname or ""
        if token is None and not is_loopback(host):
            raise web.HTTPForbidden(text="This server answers to localhost only.\n")
        if token is not None:
            given = request.query.get("token") or request.cookies.get(COOKIE, "")
            if not secrets.compare_digest(given.encode(), token.encode()):
                raise web.HTTPForbidden(text="The address lacks its token: use it as printed.\n")
        origin = request.headers.get(hdrs.ORIGIN)
        if origin is not None and urlsplit(origin).netloc != request.host:
            raise web.HTTPForbidden(text="Pages of other sites are refused.\n")
        response = await handler(request)
        if token is not None and not response.prepared:
            response.set_cookie(COOKIE, token, httponly=True, secure=True, samesite="Strict")
        return response

    return middleware


class Doorman:
    """Makes the protocol of each new connection: the server's, or one that hangs up at once."""

    def __init__(self, server: web.Server, loop: asyncio.AbstractEventLoop) -> None:
        self.refused = 0
        self._server, self._loop = server, loop
        self._accepts: deque[float] = deque(maxlen=MAX_ACCEPTS)
        self._settled: set[object] = set()

    def __call__(self) -> asyncio.Protocol:
        now = self._loop.time()
        busy = len(self._accepts) == MAX_ACCEPTS and now - self._accepts[0] < ACCEPT_S
        if busy or len(self._server.connections) >= MAX_CONNECTIONS:
            self.refused += 1
            return _HangUp()
        self._accepts.append(now)
        protocol = self._server()
        self._loop.call_later(IDLE_S, self._end_idle, protocol)
        return protocol

    def settle(self, request: web.Request) -> None:
        """This connection has become a WebSocket: it may stay."""
        self._settled.add(request.protocol)

    def leave(self, request: web.Request) -> None:
        self._settled.discard(request.protocol)

    def _end_idle(self, protocol: web.RequestHandler) -> None:
        if protocol not in self._settled and protocol.transport is not None:
            protocol.transport.abort()


class _HangUp(asyncio.Protocol):
    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        transport.abort()


class Budget:
    """How many messages a client may send: `rate` a second, with bursts of one second's worth."""

    def __init__(self, rate: float, now_s: float) -> None:
        self._rate, self._left, self._last_s = rate, rate, now_s

    def spend(self, now_s: float) -> bool:
        """False: too many."""
        self._left = min(self._rate, self._left + (now_s - self._last_s) * self._rate)
        self._last_s = now_s
        self._left -= 1
        return self._left >= 0
