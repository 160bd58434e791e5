"""The web server's process: one page, its stream of Gaussians, JSON, and the page's microphone.

socket -> newest tick -> AvatarFeed -> Hub -> WebSocket /head (Gaussians), /json (names)
WebSocket /microphone -> socket
"""

import asyncio
import contextlib
import json
import mimetypes
import socket
import ssl
import time
from pathlib import Path
from typing import Any

from aiohttp import hdrs, web

from app.call.wire.invite import in_url
from app.process import child
from app.process.channel import Channel
from app.web import access, certificate
from app.web.guard import ConnectionLimiter, Handler, RateLimit, check, listen
from app.web.hub import Hub
from app.web.info import ServerInfo
from app.web.link import PICKS, SOUND, STATUS, TICK, unpack_tick
from app.web.messages import Picks, PoseMessages, SoundMessages
from app.web.uplink import Uplink
from encoder.types import DrivenFrame
from render.decoder.learned import avatar_files
from sensors.types import LOOPBACK, InputError

PAGE = Path(__file__).parent / "page"
SEND_BUFFER = 1 << 19  # bytes a connection's socket may hold: most of a tick
SOUND_DEPTH = 20  # packets of 10 ms that may wait for a page
JSON_DEPTH = 30  # ticks that may wait for a program; for a page only the newest does
STATUS_S = 0.5
NICENESS = 10  # the tick goes first
SHUTDOWN_S = 0.5  # what still talks after that is cut off
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self'; frame-ancestors 'none'; connect-src 'self' {sockets}"
    ),
    "Permissions-Policy": "microphone=(self), xr-spatial-tracking=(self)",
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}


class WebServer:
    """Runs until the loop's end of the socket closes."""

    def __init__(self, info: ServerInfo, end: Channel, now_s: float) -> None:
        """`now_s`: Unix time, for the dates of a certificate."""
        self._info, self._end, self._now_s = info, end, now_s
        self._listener = listen(info.host, info.port, SEND_BUFFER)
        self._token = None if info.is_local else access.ensure(certificate.folder())
        self._tls = None if info.is_local else self._certified()
        from app.web.feed import AvatarFeed  # takes seconds: what is wrong is told before

        self._head = AvatarFeed(info)
        self._clouds, self._names = Hub(1, binary=True), Hub(JSON_DEPTH, binary=False)
        self._targets, self._sounds = Hub(1, binary=False), Hub(SOUND_DEPTH, binary=True)
        self._voice, self._poses = Uplink(end, SoundMessages()), Uplink(end, PoseMessages())
        self._picks = Picks(info.avatar, avatar_files.names())
        self._picking = RateLimit(Picks.max_rate, time.monotonic())
        self._newest: DrivenFrame | None = None
        self._cloud: tuple[int, bytes] = (-1, b"")  # frame and message of the newest cloud made
        self._assets = {p.name: p.read_bytes() for p in PAGE.iterdir() if p.is_file()}
        self._ticks = 0

    async def run(self) -> None:
        loop = asyncio.get_running_loop()
        port = self._listener.getsockname()[1]
        app = web.Application(middlewares=[check(self._token, port)], client_max_size=1024)
        self._routes(app)
        runner = web.AppRunner(
            app, access_log=None, handle_signals=False, shutdown_timeout=SHUTDOWN_S
        )
        await runner.setup()
        assert runner.server is not None
        self._limiter = ConnectionLimiter(runner.server, self._listener)
        door = asyncio.create_task(self._limiter.work(self._tls))
        ended = loop.create_future()
        loop.add_reader(self._end, self._read, ended)
        self._tell(addresses=self._addresses(port))
        child.lower_priority(NICENESS)  # not before: on a busy machine the start took a minute
        while not ended.done():
            await asyncio.wait([ended], timeout=STATUS_S)
            self._tell(**self.counts())  # also once at the end
        loop.remove_reader(self._end)
        await asyncio.gather(self._names.finish(SHUTDOWN_S), self._clouds.finish(SHUTDOWN_S))
        door.cancel()
        await runner.cleanup()

    def counts(self) -> dict[str, Any]:
        return {
            "ticks": self._ticks,
            "pages": len(self._clouds),
            "programs": len(self._names),
            "watching": len(self._targets),
            "sent": self._clouds.sent + self._names.sent,
            "skipped": self._clouds.dropped + self._names.dropped,
            "refused": self._limiter.refused,
            "microphone": {"chunks": self._voice.passed, **self._voice.failures()},
            "headset": {"poses": self._poses.passed, **self._poses.failures()},
        }

    def _routes(self, app: web.Application) -> None:
        if self._info.page:
            app.router.add_get("/", self._asset)
            app.router.add_get("/head", self._serve_clouds)
            app.router.add_get("/json", self._serve_names)
            app.router.add_get("/offers", self._offers)
            app.router.add_post("/controls", self._pick)
            if self._info.targets:
                app.router.add_get("/targets", self._serving(self._targets))
            if self._info.sound:
                app.router.add_get("/sound", self._serving(self._sounds))
            if self._info.microphone:
                app.router.add_get("/microphone", self._serving(self._voice))
            if self._info.head:
                app.router.add_get("/pose", self._serving(self._poses))
            app.router.add_get("/{name}", self._asset)
        else:
            app.router.add_get("/", self._serve_names)

    def _certified(self) -> ssl.SSLContext:
        hosts = [*self._info.hosts, "localhost", LOOPBACK, socket.gethostname()]
        paths = certificate.ensure(certificate.folder(), hosts, self._now_s)
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        try:
            context.load_cert_chain(*paths)
        except ssl.SSLError as error:
            raise InputError(
                f"web: expected a certificate and its key in {paths[0].parent}, got: "
                f"{error.reason or error}; delete both files, and new ones are made"
            ) from None
        return context

    def _addresses(self, port: int) -> list[str]:
        token = self._token
        scheme = ("http" if self._info.page else "ws") + ("s" if token else "")
        hosts = [self._info.host] if token is None else self._info.hosts
        query = f"?token={token}" if token else ""
        return [f"{scheme}://{in_url(host)}:{port}/{query}" for host in hosts]

    def _read(self, ended: asyncio.Future[None]) -> None:
        """Take every waiting tick; all go to programs, only the newest to pages."""
        for packet in self._end.waiting():
            if not packet:
                if not ended.done():
                    ended.set_result(None)
                return
            if len(packet) != TICK.itemsize:
                self._hear(packet)
                continue
            self._newest = unpack_tick(packet)
            self._ticks += 1
            if self._names:
                self._names.post(self._head.names(self._newest))
        if self._clouds and self._newest:
            self._clouds.post(self._newest_cloud(self._newest))

    def _hear(self, packet: bytes) -> None:
        """What the loop has to say beside ticks."""
        if packet[:1] == SOUND:
            self._sounds.post(packet[1:])
            return
        said = json.loads(packet)
        self._picks.emotions = said.get("emotions", self._picks.emotions)
        with contextlib.suppress(InputError, OSError):  # an avatar's file is gone: the old stays
            self._follow(said.get("controls", {}))
        if "target" in said:
            self._targets.post(json.dumps(said["target"]).encode())

    def _newest_cloud(self, newest: DrivenFrame) -> bytes:
        if self._cloud[0] != newest.index:
            base = self._head.base
            self._cloud = (newest.index, self._head.cloud(newest, time.monotonic_ns()))
            if self._head.base is not base:  # somebody has come to the call, or gone
                self._clouds.begin(self._head.base)
        return self._cloud[1]

    async def _asset(self, request: web.Request) -> web.Response:
        name = request.match_info.get("name", "index.html")
        if name not in self._assets:
            raise web.HTTPNotFound
        sockets = f"ws://{request.host} wss://{request.host}"
        headers = {k: v.replace("{sockets}", sockets) for k, v in HEADERS.items()}
        kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
        return web.Response(
            body=self._assets[name], headers=headers | {hdrs.CONTENT_TYPE: f"{kind}; charset=utf-8"}
        )

    async def _offers(self, _: web.Request) -> web.Response:
        info, picks = self._info, self._picks.offers
        names = ("microphone", "head", "targets", "sound")
        return web.json_response({n: getattr(info, n) for n in names} | {"controls": picks})

    async def _pick(self, request: web.Request) -> web.Response:
        """Somebody at a page changes who is shown, the emotion, or mutes the sound."""
        if not self._picking.spend(time.monotonic()):
            raise web.HTTPTooManyRequests(text="Too many changes.\n")
        try:
            asked = self._picks.read(await request.read())
            self._follow(asked)
        except ValueError as error:
            raise web.HTTPBadRequest(text=f"{error}\n") from None
        with contextlib.suppress(OSError):  # the loop is gone
            self._end.insist(PICKS + json.dumps(asked).encode())
        return web.json_response(self._picks.shown)

    def _follow(self, changed: dict[str, Any]) -> None:
        """Show who is to be shown, and tell how it stands. Raises InputError."""
        if changed.get("avatar", self._picks.state["avatar"]) != self._picks.state["avatar"]:
            self._head.show(changed["avatar"])
            self._cloud = (-1, b"")
            self._clouds.begin(self._head.base)
        self._picks.state |= changed

    async def _serve_clouds(self, request: web.Request) -> web.StreamResponse:
        newest = [self._newest_cloud(self._newest)] if self._newest else []
        first = [self._head.base, *newest]
        return await self._stay(request, self._clouds.serve(request, first))

    async def _serve_names(self, request: web.Request) -> web.StreamResponse:
        first = [self._head.names(self._newest)] if self._newest else []
        return await self._stay(request, self._names.serve(request, first))

    def _serving(self, hub: Hub | Uplink) -> Handler:
        """A WebSocket that begins with nothing."""

        async def serve(request: web.Request) -> web.StreamResponse:
            return await self._stay(request, hub.serve(request))

        return serve

    async def _stay(self, request: web.Request, serving: Any) -> web.StreamResponse:
        self._limiter.settle(request)
        try:
            return await serving
        finally:
            self._limiter.leave(request)

    def _tell(self, **status: Any) -> None:
        with contextlib.suppress(OSError):  # the loop is busy or gone; the next status says it all
            self._end.send(STATUS + json.dumps(status).encode())
