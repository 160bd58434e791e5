"""A LiveSource that is polled and assembled while its devices fail, for `bench faults`."""

import random
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from sensors.types import NS, AudioPacket, Clock, EyePacket, Packet

HANG_S = 20.0  # longer without good data counts as a hang
POLL_NS = 4_000_000


@dataclass
class Fault:
    """One row of the table."""

    name: str
    start: Callable[[], None]
    stop: Callable[[], None]
    hold_s: tuple[float, float] = (0.2, 1.5)
    recovery_s: list[float] = field(default_factory=list[float])
    hangs: int = 0


class FaultWatch(threading.Thread):
    """Polls and assembles as a run does, and remembers when good data was captured."""

    def __init__(self, source: Any, clock: Clock) -> None:
        super().__init__(daemon=True)
        self.crash: BaseException | None = None
        self.sound_ns = self.picture_ns = 0
        self.frames = 0
        self._source, self._clock, self._closing = source, clock, threading.Event()
        self.start()

    def run(self) -> None:
        from sensors.assemble import Assembler

        assembler = Assembler()
        try:
            self._source.open()
            while not self._closing.is_set():
                for packet in self._source.poll():
                    self._note(packet)
                    assembler.push(packet)
                for frame in assembler.ready():
                    assert frame.index == self.frames
                    self.frames += 1
                self._clock.sleep_until_ns(self._clock.now_ns() + POLL_NS)
            self._source.close()
        except BaseException as error:  # any crash is the finding of this command
            self.crash = error

    def close(self) -> None:
        self._closing.set()
        self.join()

    def _note(self, packet: Packet) -> None:
        if isinstance(packet, EyePacket):
            self.picture_ns = packet.t_ns
        elif isinstance(packet, AudioPacket) and not packet.gap:
            self.sound_ns = packet.t_ns


def repeat(
    faults: list[Fault], times: int, rng: random.Random, newest_ns: Callable[[], int], clock: Clock
) -> None:
    """Each fault `times` times, in random order; `newest_ns` dates the newest good data."""
    start_ns = clock.now_ns()
    while not newest_ns() and clock.now_ns() < start_ns + HANG_S * NS:
        sleep(clock, 0.01)
    order = faults * times
    rng.shuffle(order)
    for fault in order:
        sleep(clock, rng.uniform(0.1, 0.6))
        fault.start()
        sleep(clock, rng.uniform(*fault.hold_s))
        fault.stop()
        over_ns = clock.now_ns()
        while newest_ns() <= over_ns and clock.now_ns() < over_ns + HANG_S * NS:
            sleep(clock, 0.005)
        if newest_ns() <= over_ns:
            fault.hangs += 1
        else:
            fault.recovery_s.append((clock.now_ns() - over_ns) / NS)


def watched(
    source: Any, faults: list[Fault], times: int, rng: random.Random, rows: list[Fault], eyes: bool
) -> None:
    from sensors.clock import MonotonicClock

    clock = MonotonicClock()
    rows += faults
    watch = FaultWatch(source, clock)

    def newest_ns() -> int:
        if watch.crash is not None:
            raise RuntimeError(f"the live source crashed: {watch.crash!r}") from watch.crash
        return watch.picture_ns if eyes else watch.sound_ns

    try:
        repeat(faults, times, rng, newest_ns, clock)
    finally:
        watch.close()


def sleep(clock: Clock, seconds: float) -> None:
    clock.sleep_until_ns(clock.now_ns() + int(seconds * NS))
