"""The headset's poses, as the server sees them: checked in form and passed on to the loop.

page: XRViewerPose -> 9 numbers -> WebSocket /pose -> PoseReceiver -> socket -> ServerLink.poses
"""

import asyncio
import socket
import struct
import time
from typing import Any

from aiohttp import WSCloseCode, WSMsgType, web

from app.web.guard import Budget
from app.web.hub import CLOSE_S
from app.web.link import POSE, POSE_HEAD

# The page's clock in ms; position m and quaternion xyzw of WebXR; 1 where it is tracked.
MESSAGE = struct.Struct("<9d")
MAX_POSES = 250.0  # messages a second
SILENT_S = 10.0  # a headset that sends nothing for so long is let go


class PoseReceiver:
    """Takes one headset at a time."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._taken = False
        self._poses = self._dropped = self._broken = 0

    def counts(self) -> dict[str, Any]:
        return {"poses": self._poses, "dropped": self._dropped, "refused": self._broken}

    async def serve(self, request: web.Request) -> web.WebSocketResponse:
        if self._taken:
            raise web.HTTPConflict(text="Another page turns the head.\n")
        self._taken = True
        try:
            return await self._listen(request)
        finally:
            self._taken = False

    async def _listen(self, request: web.Request) -> web.WebSocketResponse:
        loop = asyncio.get_running_loop()
        ws = web.WebSocketResponse(
            max_msg_size=MESSAGE.size + 64,
            receive_timeout=SILENT_S,
            timeout=CLOSE_S,
            autoping=False,
            compress=False,
        )
        await ws.prepare(request)
        budget = Budget(MAX_POSES, loop.time())
        try:
            async for message in ws:
                arrival_ns = time.monotonic_ns()
                data: bytes = message.data if message.type == WSMsgType.BINARY else b""
                if len(data) != MESSAGE.size or not budget.spend(loop.time()):
                    self._broken += 1
                    await ws.close(code=WSCloseCode.POLICY_VIOLATION, message=b"not a pose")
                    break
                self._pass_on(arrival_ns, data)
        except TimeoutError:
            await ws.close()
        return ws

    def _pass_on(self, arrival_ns: int, data: bytes) -> None:
        try:
            self._end.send(POSE_HEAD.pack(POSE, arrival_ns) + data)
            self._poses += 1
        except BlockingIOError:
            self._dropped += 1
        except OSError:
            return  # the loop is gone; its end of the socket says so
