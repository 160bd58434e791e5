"""A lossy line on this machine: what one end sends to a leg leaves from the other, late or never.

Delay is uniform around its mean, so packets overtake each other; losses are single, or come in
bursts (Gilbert-Elliott: a bad state that ends with probability 1 / burst a packet).
"""

import asyncio
import random
from dataclasses import dataclass
from typing import cast

from sensors.types import LOOPBACK

HEADERS = 28  # bytes of IP and UDP, counted with every packet


@dataclass(frozen=True, kw_only=True)
class LossyLine:
    name: str
    delay_ms: float = 0.0
    jitter_ms: float = 0.0
    loss: float = 0.0  # share of packets
    burst: float = 0.0  # packets lost in a row, on average; 0: each by itself


LINES = (
    LossyLine(name="clean"),
    LossyLine(name="20+-5 ms, 1 % loss", delay_ms=20, jitter_ms=5, loss=0.01),
    LossyLine(name="40+-20 ms, 5 % loss", delay_ms=40, jitter_ms=20, loss=0.05),
    LossyLine(name="10 % loss in bursts", delay_ms=20, jitter_ms=5, loss=0.10, burst=3),
)


class Leg(asyncio.DatagramProtocol):
    """One end's way into the line."""

    def __init__(self, line: LossyLine, chance: random.Random) -> None:
        self.sent = self.lost = self.bytes = 0
        self.other: Leg | None = None
        self.near: tuple[str, int] | None = None  # who sends here, once it has
        self._line, self._chance, self._bad = line, chance, False
        self._transport: asyncio.DatagramTransport | None = None

    @property
    def port(self) -> int:
        assert self._transport is not None
        return self._transport.get_extra_info("sockname")[1]

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        self.near = addr  # the newest: a connection made anew has a new port
        self.sent += 1
        self.bytes += len(data) + HEADERS
        if self._is_lost():
            self.lost += 1
            return
        line = self._line
        delay_ms = line.delay_ms + self._chance.uniform(-line.jitter_ms, line.jitter_ms)
        assert self.other is not None
        if delay_ms > 0:
            loop = asyncio.get_running_loop()
            loop.call_later(delay_ms / 1e3, self.other.deliver, data)
        else:
            self.other.deliver(data)

    def deliver(self, data: bytes) -> None:
        if self.near and self._transport and not self._transport.is_closing():
            self._transport.sendto(data, self.near)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()

    def _is_lost(self) -> bool:
        line, draw = self._line, self._chance.random()
        if not line.burst:
            return draw < line.loss
        enter = line.loss / (1 - line.loss) / line.burst
        self._bad = draw > 1 / line.burst if self._bad else draw < enter
        return self._bad


async def open_line(line: LossyLine, seed: int, address: str = LOOPBACK) -> tuple[Leg, Leg]:
    """Two legs; each end sends to its own."""
    loop = asyncio.get_running_loop()
    legs: list[Leg] = []
    for side in range(2):
        chance = random.Random(2 * seed + side)
        _, leg = await loop.create_datagram_endpoint(
            lambda chance=chance: Leg(line, chance), local_addr=(address, 0)
        )
        legs.append(leg)
    legs[0].other, legs[1].other = legs[1], legs[0]
    return legs[0], legs[1]
