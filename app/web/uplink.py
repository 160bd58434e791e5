"""What a page sends up: one WebSocket at a time, checked message by message, passed on to the loop.

page -> WebSocket -> Uplink -> socket -> ServerLink
"""

import asyncio
import time
from typing import Protocol

from aiohttp import WSCloseCode, WSMsgType, web

from app.process.channel import Channel
from app.web.guard import RateLimit
from app.web.hub import CLOSE_S

SILENT_S = 10.0  # a page that sends nothing for so long is disconnected


class Messages(Protocol):
    """The format of one kind of message."""

    name: str  # of a message, for the page that sent none
    taken: str  # what a second page is told
    max_size: int  # bytes of a message
    max_rate: float  # messages a second

    def begin(self) -> None:
        """Another page begins to send."""
        ...

    def packet(self, data: bytes, arrival_ns: int) -> bytes | None:
        """A good message as it goes to the loop; None: it is not one."""
        ...


class Uplink:
    """Serves one page at a time."""

    def __init__(self, end: Channel, messages: Messages) -> None:
        self._end, self._messages = end, messages
        self._taken = False
        self.passed = self.dropped = self.refused = 0  # messages

    def failures(self) -> dict[str, int]:
        return {"dropped": self.dropped, "refused": self.refused}

    async def serve(self, request: web.Request) -> web.WebSocketResponse:
        if self._taken:  # refused as a WebSocket: a page is told the reason of no other refusal
            ws = web.WebSocketResponse(timeout=CLOSE_S)
            await ws.prepare(request)
            reason = self._messages.taken.encode()
            await ws.close(code=WSCloseCode.TRY_AGAIN_LATER, message=reason)
            return ws
        self._taken = True
        self._messages.begin()
        try:
            return await self._listen(request)
        finally:
            self._taken = False

    async def _listen(self, request: web.Request) -> web.WebSocketResponse:
        loop, messages = asyncio.get_running_loop(), self._messages
        ws = web.WebSocketResponse(
            max_msg_size=messages.max_size + 64,
            receive_timeout=SILENT_S,
            timeout=CLOSE_S,
            autoping=False,
            compress=False,
        )
        await ws.prepare(request)
        budget = RateLimit(messages.max_rate, loop.time())
        try:
            async for message in ws:
                arrival_ns = time.monotonic_ns()
                data: bytes = message.data if message.type == WSMsgType.BINARY else b""
                packet = messages.packet(data, arrival_ns)
                if packet is None or not budget.spend(loop.time()):
                    self.refused += 1
                    reason = f"not {messages.name}".encode()
                    await ws.close(code=WSCloseCode.POLICY_VIOLATION, message=reason)
                    break
                self._pass_on(packet)
        except TimeoutError:
            await ws.close()
        return ws

    def _pass_on(self, packet: bytes) -> None:
        try:
            self._end.send(packet)
            self.passed += 1
        except BlockingIOError:
            self.dropped += 1
        except OSError:
            return  # the loop is gone; its end of the socket says so
