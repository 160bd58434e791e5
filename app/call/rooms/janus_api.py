"""A session with a Janus server over its WebSocket: requests answered, events by handle."""

import asyncio
import contextlib
import secrets
from typing import TYPE_CHECKING, Any

from app.call.wire.agreement import MAX_PEOPLE
from app.call.wire.invite import Invite

if TYPE_CHECKING:
    from aiohttp import ClientSession, ClientWebSocketResponse

PLUGIN = "janus.plugin.videoroom"
ANSWER_S = 10.0
KEEP_ALIVE_S = 20.0
HEARTBEAT_S = 5.0
MAX_MESSAGE = 1 << 18
ROOM_EXISTS = 427


class JanusError(Exception):
    """The server refused; `code` is the plugin's."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(f"{reason} ({code})")
        self.code = code


class JanusSession:
    """Use as an async context manager; a lost connection ends every wait with ConnectionError."""

    def __init__(self, http: "ClientSession", invite: Invite) -> None:
        self._http, self._invite = http, invite
        self._socket: ClientWebSocketResponse | None = None
        self._id = 0
        self._waiting: dict[str, asyncio.Future[dict[str, Any]]] = {}
        self._events: dict[int, asyncio.Queue[dict[str, Any]]] = {}
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> "JanusSession":
        from aiohttp import Fingerprint

        pin = self._invite.fingerprint
        self._socket = await self._http.ws_connect(
            self._invite.url,
            protocols=("janus-protocol",),
            max_msg_size=MAX_MESSAGE,
            ssl=Fingerprint(pin) if pin else True,
            heartbeat=HEARTBEAT_S,
        )
        self._tasks.append(asyncio.create_task(self._read()))
        self._id = (await self._ask({"janus": "create"}))["data"]["id"]
        self._tasks.append(asyncio.create_task(self._keep_alive()))
        return self

    async def __aexit__(self, *_: object) -> None:
        for task in self._tasks:
            task.cancel()
        if self._socket is not None:
            with contextlib.suppress(OSError, asyncio.TimeoutError):
                await self._socket.close()

    async def attach(self) -> int:
        """A handle of the room plugin."""
        handle = (await self._ask({"janus": "attach", "plugin": PLUGIN}))["data"]["id"]
        self._events.setdefault(handle, asyncio.Queue())
        return handle

    async def detach(self, handle: int) -> None:
        await self._post({"janus": "detach", "handle_id": handle})
        self._events.pop(handle, None)

    async def request(self, handle: int, body: dict[str, Any]) -> dict[str, Any]:
        """A request that is answered at once, like create; JanusError where it is refused."""
        answer = await self._ask({"janus": "message", "handle_id": handle, "body": body})
        return _checked(answer.get("plugindata", {}).get("data", {}))

    async def create_room(self, handle: int, admin_key: str) -> None:
        """The invite's room, unless it is there already."""
        body = {
            "request": "create",
            "admin_key": admin_key,
            "room": self._invite.room,
            "pin": self._invite.pin,
            "publishers": MAX_PEOPLE,
            "audiocodec": "opus",
            "opus_fec": False,  # our own, and sealed
            "is_private": True,
            "notify_joining": False,
        }
        try:
            await self.request(handle, body)
        except JanusError as error:
            if error.code != ROOM_EXISTS:
                raise

    async def message(
        self, handle: int, body: dict[str, Any], jsep: dict[str, str] | None = None
    ) -> None:
        """A request that events answer, like join."""
        extra = {"jsep": jsep} if jsep else {}
        await self._post({"janus": "message", "handle_id": handle, "body": body} | extra)

    async def event(self, handle: int) -> dict[str, Any]:
        """The next event of the plugin: its data, with "jsep" where it brings one."""
        event = await self._events[handle].get()
        if event.get("janus") == "gone":
            raise ConnectionError("the room's server is gone")
        data = _checked(event.get("plugindata", {}).get("data", {}))
        return data | ({"jsep": event["jsep"]} if "jsep" in event else {})

    async def event_with(self, handle: int, key: str) -> dict[str, Any]:
        """The next event with `key`."""
        async with asyncio.timeout(ANSWER_S):
            while key not in (data := await self.event(handle)):
                pass
        return data

    async def _ask(self, message: dict[str, Any]) -> dict[str, Any]:
        future, transaction = asyncio.get_running_loop().create_future(), secrets.token_hex(8)
        self._waiting[transaction] = future
        try:
            await self._post(message, transaction)
            async with asyncio.timeout(ANSWER_S):
                answer = await future
        finally:
            del self._waiting[transaction]
        if answer.get("janus") == "error":
            error = answer.get("error", {})
            raise JanusError(int(error.get("code", 0)), str(error.get("reason", ""))[:80])
        return answer

    async def _post(self, message: dict[str, Any], transaction: str = "") -> None:
        if self._socket is None or self._socket.closed:
            raise ConnectionError("the room's server is gone")
        transaction = transaction or secrets.token_hex(8)
        session = {"session_id": self._id} if self._id else {}
        token = {"token": self._invite.token} if self._invite.token else {}
        await self._socket.send_json(message | session | token | {"transaction": transaction})

    async def _read(self) -> None:
        assert self._socket is not None
        try:
            async for message in self._socket:
                data = message.json()
                kind, waiting = data.get("janus"), self._waiting.get(data.get("transaction", ""))
                if kind == "ack":
                    continue
                if kind in ("event", "hangup", "detached") and "sender" in data:
                    if waiting and kind == "event" and "jsep" not in data and _is_answer(data):
                        waiting.set_result(data)
                        continue
                    if kind == "event":
                        queue = self._events.setdefault(data["sender"], asyncio.Queue())
                        queue.put_nowait(data)
                elif waiting is not None and not waiting.done():
                    waiting.set_result(data)
        finally:
            for queue in self._events.values():
                queue.put_nowait({"janus": "gone"})
            for future in self._waiting.values():
                if not future.done():
                    future.set_exception(ConnectionError("the room's server is gone"))

    async def _keep_alive(self) -> None:
        with contextlib.suppress(ConnectionError):
            while True:
                await asyncio.sleep(KEEP_ALIVE_S)
                await self._post({"janus": "keepalive"})


def _is_answer(data: dict[str, Any]) -> bool:
    return data.get("plugindata", {}).get("data", {}).get("videoroom") == "success"


def _checked(data: dict[str, Any]) -> dict[str, Any]:
    if "error_code" in data:
        raise JanusError(int(data["error_code"]), str(data.get("error", ""))[:80])
    return data
