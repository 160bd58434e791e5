"""The other end of `bench web`: `python -m app.bench.network.receivers`, a process of its own.

Prints its UDP ports, then reads the JSON address from stdin; at "end" it prints what has arrived.
"""

import asyncio
import contextlib
import json
import socket
import sys
import threading

from sensors.types import LOOPBACK

PORTS = 3


def main() -> None:
    """Count datagrams of each port, and the frames of the JSON stream."""
    sockets = [socket.socket(type=socket.SOCK_DGRAM) for _ in range(PORTS)]
    counts, frames = [0] * PORTS, list[int]()
    for end in sockets:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        end.bind((LOOPBACK, 0))

    def receive(k: int) -> None:
        while True:
            sockets[k].recv(4096)
            counts[k] += 1

    for k in range(PORTS):
        threading.Thread(target=receive, args=(k,), daemon=True).start()
    print(json.dumps([end.getsockname()[1] for end in sockets]), flush=True)
    address = sys.stdin.readline().strip()
    listener = threading.Thread(target=lambda: asyncio.run(_listen(address, frames)), daemon=True)
    listener.start()
    sys.stdin.readline()
    listener.join(5)
    first = min(frames, default=0)
    print(json.dumps({"datagrams": counts, "first": first, "frames": len(set(frames))}))


async def _listen(address: str, frames: list[int]) -> None:
    import aiohttp

    with contextlib.suppress(aiohttp.ClientError):
        async with aiohttp.ClientSession() as session, session.ws_connect(address) as ws:
            async for message in ws:
                frames.append(json.loads(message.data)["frame"])


if __name__ == "__main__":
    main()
