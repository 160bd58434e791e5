"""Hostile clients for `bench web`: `python -m app.bench.network.hostile_clients ADDRESS N S`.

They run for S seconds whenever a line is read from stdin. A quarter connects and leaves, a quarter
never reads, a quarter floods, a quarter sends garbage. They run at idle priority: real attackers do
not use this machine's CPU.
"""

import asyncio
import os
import sys
from collections.abc import Awaitable, Callable
from urllib.parse import urlsplit

import numpy as np

from app.process.child import lower_priority
from sensors.types import LOOPBACK

FLOOD = b"x" * 900
PATIENCE_S = 5.0


class HostileClients:
    """Each client repeats its attack until the time is over."""

    def __init__(self, address: str, num: int, seconds: float, seed: int = 0) -> None:
        self._address = address
        parts = urlsplit(address)
        self._host, self._port = parts.hostname or LOOPBACK, parts.port or 80
        self._num, self._seconds = num, seconds
        self._rng = np.random.default_rng(seed)
        self._reached = False

    async def run(self) -> None:
        attacks = (self._connect, self._stall, self._flood, self._send_garbage)
        end = asyncio.get_running_loop().time() + self._seconds
        clients = [self._repeat(attacks[k % len(attacks)], end) for k in range(self._num)]
        await asyncio.gather(*clients)
        if not self._reached:  # the bench sees that this process ends
            raise ConnectionError(f"nobody listens at {self._address}")

    async def _repeat(self, attack: Callable[[], Awaitable[None]], end: float) -> None:
        import aiohttp

        clock = asyncio.get_running_loop().time
        while (left := end - clock()) > 0:
            try:
                async with asyncio.timeout(min(left, PATIENCE_S)):
                    await attack()
            except (aiohttp.ClientError, OSError, TimeoutError):
                await asyncio.sleep(0.02)  # refused: try again

    async def _connect(self) -> None:
        _, writer = await asyncio.open_connection(self._host, self._port)
        self._reached = True
        writer.close()

    async def _stall(self) -> None:
        """Ask for the stream and never read it."""
        import aiohttp

        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"{self._address}head", max_msg_size=0),
        ):
            await asyncio.sleep(PATIENCE_S)

    async def _flood(self) -> None:
        import aiohttp

        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"{self._address}json") as ws,
        ):
            while True:
                await ws.send_bytes(FLOOD)

    async def _send_garbage(self) -> None:
        reader, writer = await asyncio.open_connection(self._host, self._port)
        try:
            writer.write(self._rng.bytes(20_000))
            await writer.drain()
            await reader.read()
        finally:
            writer.close()


if __name__ == "__main__":
    if sys.platform == "linux":
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    else:
        lower_priority(19)
    clients = HostileClients(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]))
    for _ in sys.stdin:
        asyncio.run(clients.run())
