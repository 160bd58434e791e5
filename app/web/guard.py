"""Access control of the server: token, origin, host, number and rate of connections.

On the loopback address only this machine can connect, so what must be kept out are pages of other
sites in a browser here (origin, host name). Beyond it every request needs the token.
"""

import asyncio
import secrets
import socket
import ssl
from collections.abc import Awaitable, Callable
from urllib.parse import urlsplit

from aiohttp import hdrs, web

from app.web.info import is_loopback

COOKIE = "livedrive_{port}"  # cookies are shared by all ports of a host
MAX_CONNECTIONS = 64
ACCEPTS = 20.0  # new connections a second, with bursts of one second's worth
BACKLOG = 32  # connections that may wait in the kernel
HANDSHAKE_S = 5.0
IDLE_S = 5.0  # a connection must have become a WebSocket by then
NO_TOKEN = "The address lacks its token: open it as livedrive printed it.\n"
FULL_S = 0.2  # pause when this machine has no descriptor or memory left for a connection
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def check(token: str | None, port: int):  # noqa: ANN201
    """Middleware that refuses strangers; `token` None: the server is bound to loopback."""
    cookie = COOKIE.format(port=port)

    @web.middleware
    async def middleware(request: web.Request, handler: Handler) -> web.StreamResponse:
        try:
            host = urlsplit(f"//{request.host}").hostname or ""
            origin = request.headers.get(hdrs.ORIGIN)
            site = None if origin is None else urlsplit(origin).netloc
        except ValueError:
            raise web.HTTPBadRequest(text="Host or Origin is no address.\n") from None
        if token is None and not is_loopback(host):
            raise web.HTTPForbidden(text="This server answers to localhost only.\n")
        if token is not None:
            given = request.query.get("token") or request.cookies.get(cookie, "")
            if not secrets.compare_digest(given.encode(errors="replace"), token.encode()):
                raise web.HTTPForbidden(text=NO_TOKEN)
        if site is not None and site != request.host:
            raise web.HTTPForbidden(text="Pages of other sites are refused.\n")
        response = await handler(request)
        if token is not None and not response.prepared:
            response.set_cookie(cookie, token, httponly=True, secure=True, samesite="Strict")
        return response

    return middleware


def listen(host: str, port: int, send_buffer: int) -> socket.socket:
    """A listening socket whose connections may hold that many bytes."""
    listener = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    # Windows would let another program take the port over, and with it the page's token.
    alone = getattr(socket, "SO_EXCLUSIVEADDRUSE", socket.SO_REUSEADDR)
    listener.setsockopt(socket.SOL_SOCKET, alone, 1)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, send_buffer)
    listener.bind((host.strip("[]"), port))
    listener.listen(BACKLOG)
    listener.setblocking(False)
    return listener


class ConnectionLimiter:
    """Accepts connections no faster than a flood may cost; who must wait, waits in the kernel."""

    def __init__(self, server: web.Server, listener: socket.socket) -> None:
        self.refused = 0
        self._server, self._listener = server, listener
        self._settled: set[object] = set()
        self._greetings: set[asyncio.Task[None]] = set()  # TLS handshakes under way

    async def work(self, tls: ssl.SSLContext | None) -> None:
        """Accept for ever."""
        loop = asyncio.get_running_loop()
        budget = RateLimit(ACCEPTS, loop.time())
        while True:
            try:
                end, _ = await loop.sock_accept(self._listener)
            except OSError:  # too many open files: those that wait stay in the kernel
                self.refused += 1
                await asyncio.sleep(FULL_S)
                continue
            if len(self._server.connections) + len(self._greetings) >= MAX_CONNECTIONS:
                self.refused += 1
                end.close()
            else:
                task = asyncio.create_task(self._greet(end, tls))
                self._greetings.add(task)
                task.add_done_callback(self._greetings.discard)
            while not budget.spend(loop.time()):
                await asyncio.sleep(1 / ACCEPTS)

    def settle(self, request: web.Request) -> None:
        """This connection has become a WebSocket: it may stay."""
        self._settled.add(request.protocol)

    def leave(self, request: web.Request) -> None:
        self._settled.discard(request.protocol)

    async def _greet(self, end: socket.socket, tls: ssl.SSLContext | None) -> None:
        loop, patience_s = asyncio.get_running_loop(), HANDSHAKE_S if tls else None
        try:
            _, protocol = await loop.connect_accepted_socket(
                self._server, end, ssl=tls, ssl_handshake_timeout=patience_s
            )
        except OSError:  # not TLS, or already gone
            end.close()
        else:
            loop.call_later(IDLE_S, self._end_idle, protocol)

    def _end_idle(self, protocol: web.RequestHandler) -> None:
        if protocol not in self._settled and protocol.transport is not None:
            protocol.transport.abort()


class RateLimit:
    """How many messages a client may send: `rate` a second, with bursts of one second's worth."""

    def __init__(self, rate: float, now_s: float) -> None:
        self._rate, self._left, self._last_s = rate, rate, now_s

    def spend(self, now_s: float) -> bool:
        """False: too many."""
        self._left = min(self._rate, self._left + (now_s - self._last_s) * self._rate)
        self._last_s = now_s
        if self._left < 1:
            return False
        self._left -= 1
        return True
