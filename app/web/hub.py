"""Listeners of one stream: each has a short queue, and a slow one loses only its own messages."""

import asyncio
import contextlib
from collections import deque
from collections.abc import Sequence

from aiohttp import WSCloseCode, WSMsgType, web

from app.web.guard import RateLimit

STALL_S = 5.0  # a message must be taken within this time
CLOSE_S = 1.0  # wait for the other side's goodbye
MAX_MESSAGES = 20.0  # a second that a listener may send; it has nothing to say
MAX_LISTENERS = 32  # of one stream


class Hub:
    """Gives each message to all listeners. When a box is full, the oldest message in it goes."""

    def __init__(self, depth: int, binary: bool) -> None:
        self.sent = self.dropped = 0  # messages, over all listeners
        self._depth, self._binary = depth, binary
        self._boxes: set[_Box] = set()
        self._lines: set[web.WebSocketResponse] = set()

    def __len__(self) -> int:
        return len(self._boxes)

    def post(self, message: bytes) -> None:
        for box in self._boxes:
            self.dropped += box.put(message)

    def begin(self, message: bytes) -> None:
        """All listeners get this next, and then what is posted from now on."""
        for box in self._boxes:
            box.begin(message)

    async def finish(self, patience_s: float) -> None:
        """Return when all has been sent and everybody knows that it is over, or after
        `patience_s`."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                while any(self._boxes):
                    await asyncio.sleep(0.01)
                over = [line.close(code=WSCloseCode.GOING_AWAY) for line in self._lines]
                await asyncio.gather(*over, return_exceptions=True)

    async def serve(
        self, request: web.Request, first: Sequence[bytes] = ()
    ) -> web.WebSocketResponse:
        """Send `first`, then whatever is posted, until the listener leaves or misbehaves."""
        if len(self._boxes) >= MAX_LISTENERS:
            raise web.HTTPServiceUnavailable(text="Too many listeners.\n")
        ws = web.WebSocketResponse(
            max_msg_size=1024, autoping=False, compress=False, timeout=CLOSE_S
        )
        await ws.prepare(request)
        box = _Box(self._depth)
        self._boxes.add(box)
        self._lines.add(ws)
        transport = request.transport
        feed = asyncio.create_task(self._feed(ws, transport, box, first))
        try:
            await _mind(ws, transport)
        finally:
            self._boxes.discard(box)
            self._lines.discard(ws)
            feed.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionError):
                await feed
        return ws

    async def _feed(
        self,
        ws: web.WebSocketResponse,
        transport: asyncio.Transport | None,
        box: "_Box",
        first: Sequence[bytes],
    ) -> None:
        try:
            for message in first:
                await self._send(ws, message)
            while True:
                await self._send(ws, await box.get())
        except (TimeoutError, ConnectionError):
            if transport:
                transport.abort()

    async def _send(self, ws: web.WebSocketResponse, message: bytes) -> None:
        async with asyncio.timeout(STALL_S):
            if self._binary:
                await ws.send_bytes(message)
            else:
                await ws.send_str(message.decode())
        self.sent += 1


async def _mind(ws: web.WebSocketResponse, transport: asyncio.Transport | None) -> None:
    """Read what a listener sends, which should be next to nothing; return when it is gone."""
    loop = asyncio.get_running_loop()
    budget = RateLimit(MAX_MESSAGES, loop.time())
    async for message in ws:
        if not budget.spend(loop.time()):
            if transport:
                transport.abort()  # a polite goodbye would have to be read by the flooder
            return
        if message.type == WSMsgType.PING:
            await ws.pong(message.data)


class _Box:
    """At most `depth` messages, oldest first."""

    def __init__(self, depth: int) -> None:
        self._waiting: deque[bytes] = deque(maxlen=depth)
        self._first: bytes | None = None  # goes before all that waits
        self._filled = asyncio.Event()

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, message: bytes) -> bool:
        """True: an older message had to go."""
        full = len(self._waiting) == self._waiting.maxlen
        self._waiting.append(message)
        self._filled.set()
        return full

    def begin(self, message: bytes) -> None:
        self._waiting.clear()
        self._first = message
        self._filled.set()

    async def get(self) -> bytes:
        await self._filled.wait()
        if self._first is not None:
            first, self._first = self._first, None
            if not self._waiting:
                self._filled.clear()
            return first
        message = self._waiting.popleft()
        if not self._waiting:
            self._filled.clear()
        return message
