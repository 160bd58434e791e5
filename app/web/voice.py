"""The page's microphone, as the server sees it: counted chunks of sound, passed on to the loop.

page: AudioWorklet -> 480 samples -> WebSocket /microphone -> VoiceEndpoint
    -> socket -> WebMicrophone
"""

import asyncio
import socket
import struct
import time
from typing import Any

import numpy as np
from aiohttp import WSCloseCode, WSMsgType, web

from app.web.guard import Budget
from app.web.hub import CLOSE_S
from app.web.link import SOUND, SOUND_HEAD

CHUNK_HEAD = struct.Struct("<q")  # counter of the chunk's first sample, from the page
MAX_CHUNK = 4800  # samples in one message
MAX_CHUNKS = 200.0  # messages a second
TAKEN = b"another page has the microphone"
SILENT_S = 10.0  # a microphone that sends nothing for so long is let go


class VoiceEndpoint:
    """Takes one microphone at a time; what it sends is checked before it is passed on."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._page = 0  # number of the microphone's page, growing
        self._taken = False
        self._chunks = self._dropped = self._broken = 0

    def counts(self) -> dict[str, Any]:
        return {"chunks": self._chunks, "dropped": self._dropped, "refused": self._broken}

    async def serve(self, request: web.Request) -> web.WebSocketResponse:
        if self._taken:  # refused as a WebSocket: a page is told the reason of no other refusal
            ws = web.WebSocketResponse(timeout=CLOSE_S)
            await ws.prepare(request)
            await ws.close(code=WSCloseCode.TRY_AGAIN_LATER, message=TAKEN)
            return ws
        self._taken = True
        self._page += 1
        try:
            return await self._listen(request)
        finally:
            self._taken = False

    async def _listen(self, request: web.Request) -> web.WebSocketResponse:
        loop = asyncio.get_running_loop()
        ws = web.WebSocketResponse(
            max_msg_size=CHUNK_HEAD.size + 4 * MAX_CHUNK + 64,
            receive_timeout=SILENT_S,
            timeout=CLOSE_S,
            autoping=False,
            compress=False,
        )
        await ws.prepare(request)
        budget, expected = Budget(MAX_CHUNKS, loop.time()), 0
        try:
            async for message in ws:
                arrival_ns = time.monotonic_ns()
                data: bytes = message.data if message.type == WSMsgType.BINARY else b""
                first = self._checked(data, expected)
                if first is None or not budget.spend(loop.time()):
                    self._broken += 1
                    await ws.close(code=WSCloseCode.POLICY_VIOLATION, message=b"not sound")
                    break
                expected = first + (len(data) - CHUNK_HEAD.size) // 4
                self._pass_on(first, arrival_ns, data[CHUNK_HEAD.size :])
        except TimeoutError:
            await ws.close()
        return ws

    def _checked(self, data: bytes, expected: int) -> int | None:
        """The counter of a good chunk: whole, finite samples that come after the last ones."""
        num, rest = divmod(len(data) - CHUNK_HEAD.size, 4)
        if rest or not 1 <= num <= MAX_CHUNK:
            return None
        (first,) = CHUNK_HEAD.unpack_from(data)
        samples = np.frombuffer(data, "<f4", offset=CHUNK_HEAD.size)
        if not expected <= first < 1 << 53 or not np.isfinite(samples).all():
            return None
        return first

    def _pass_on(self, first: int, arrival_ns: int, samples: bytes) -> None:
        try:
            self._end.send(SOUND_HEAD.pack(SOUND, self._page, first, arrival_ns) + samples)
            self._chunks += 1
        except BlockingIOError:
            self._dropped += 1  # the counter will show the gap
        except OSError:
            return  # the loop is gone; its end of the socket says so
