"""Who else takes part in `bench soak`, as processes of their own: a head tracker and a page.

python -m app.bench.sensors.visitors tracker PORT      VMC poses at 60 Hz
python -m app.bench.sensors.visitors page              address on stdin; takes every picture
"""

import asyncio
import contextlib
import math
import socket
import sys

from sensors.types import LOOPBACK

RATE_HZ = 60.0
AMPLITUDE_DEG, PERIOD_S = 12.0, 3.0


async def _tracker(port: int) -> None:
    """A head that turns slowly from side to side."""
    from sensors.head import vmc
    from sensors.standins.osc import bundle

    loop, sender = asyncio.get_running_loop(), socket.socket(type=socket.SOCK_DGRAM)
    start, sent = loop.time(), 0
    while True:
        half = math.radians(AMPLITUDE_DEG) / 2
        half *= math.sin(2 * math.pi * (loop.time() - start) / PERIOD_S)
        turn = (0.0, 1.6, 0.0, 0.0, math.sin(half), 0.0, math.cos(half))
        datagram = bundle((vmc.OK, 1), (vmc.BONE, "Head", *turn))
        with contextlib.suppress(OSError):  # nobody listens yet
            sender.sendto(datagram, (LOOPBACK, port))
        sent += 1
        await asyncio.sleep(max(0.0, start + sent / RATE_HZ - loop.time()))


async def _page(address: str) -> None:
    """What a browser receives; it is another machine that draws it."""
    import aiohttp

    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"{address}head", max_msg_size=0) as stream,
    ):
        async for _ in stream:
            pass


def main() -> None:
    """Until stdin is closed, or the run ends."""
    who = _tracker(int(sys.argv[2])) if sys.argv[1] == "tracker" else _page(input())
    asyncio.run(who)


if __name__ == "__main__":
    main()
