"""`livedrive bench faults`: each way in which a sensor can fail, many times at random moments.

A LiveSource on the stand-in devices is polled and assembled all the time. Recovery is from the end
of a fault to the first good data that was captured after it.
"""

import os
import random
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from app.bars import at_most
from sensors.types import NS, AudioPacket, Clock, EyePacket, Packet

HANG_S = 20.0  # longer without good data counts as a hang
POLL_NS = 4_000_000
STOP_S = 3.0


@dataclass
class Fault:
    """One row of the table."""

    name: str
    start: Callable[[], None]
    stop: Callable[[], None]
    hold_s: tuple[float, float] = (0.2, 1.5)
    recovery_s: list[float] = field(default_factory=list[float])
    hangs: int = 0


class Watch(threading.Thread):
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


def measure_faults(times: int) -> dict[str, Any]:
    """Run all groups side by side; the report holds the table and the bars."""
    rows: list[Fault] = []
    crashes: list[BaseException] = []
    groups = (_microphone, _http, _serial, _usb, _stopped)
    threads = [
        threading.Thread(target=_guarded, args=(group, times, seed, rows, crashes))
        for seed, group in enumerate(groups)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    table = {row.name: _summary(row) for row in rows}
    recovery = [s for row in rows for s in row.recovery_s]
    p95 = max(entry["recovery_p95_s"] for entry in table.values())
    bars = [
        at_most("crashes", len(crashes), 0),
        at_most("hangs", sum(row.hangs for row in rows), 0),
        at_most("recovery_p95_s_of_the_worst", p95, 2.0),
    ]
    show(table)
    metrics = {"faults": len(recovery), "crashes": len(crashes), "recovery_p95_s": p95}
    if crashes:
        metrics["first_crash"] = repr(crashes[0])
    return {"metrics": metrics, "table": table, "bars": bars}


def show(table: dict[str, dict[str, float]]) -> None:
    from rich.console import Console
    from rich.table import Table

    out = Table("fault", "times", "hangs", "p50 s", "p95 s", "worst s")
    for name, v in table.items():
        recovery = (f"{v[f'recovery_{k}_s']:.2f}" for k in ("p50", "p95", "max"))
        out.add_row(name, f"{v['times']:.0f}", f"{v['hangs']:.0f}", *recovery)
    Console().print(out)


def _summary(row: Fault) -> dict[str, float]:
    values = row.recovery_s or [HANG_S]
    p50, p95, worst = (round(float(np.percentile(values, q)), 3) for q in (50, 95, 100))
    return {
        "times": len(row.recovery_s) + row.hangs,
        "hangs": row.hangs,
        "recovery_p50_s": p50,
        "recovery_p95_s": p95,
        "recovery_max_s": worst,
    }


def _guarded(
    group: Callable[[int, random.Random, list[Fault]], None],
    times: int,
    seed: int,
    rows: list[Fault],
    crashes: list[BaseException],
) -> None:
    try:
        group(times, random.Random(seed), rows)
    except BaseException as error:  # shown as a crash in the table's bars
        crashes.append(error)


def _repeat(
    faults: list[Fault], times: int, rng: random.Random, newest_ns: Callable[[], int], clock: Clock
) -> None:
    """Each fault `times` times, in random order; `newest_ns` dates the newest good data."""
    order = faults * times
    rng.shuffle(order)
    for fault in order:
        _sleep(clock, rng.uniform(0.1, 0.6))
        fault.start()
        _sleep(clock, rng.uniform(*fault.hold_s))
        fault.stop()
        over_ns = clock.now_ns()
        while newest_ns() <= over_ns and clock.now_ns() < over_ns + HANG_S * NS:
            _sleep(clock, 0.005)
        if newest_ns() <= over_ns:
            fault.hangs += 1
        else:
            fault.recovery_s.append((clock.now_ns() - over_ns) / NS)


def _watched(
    source: Any, faults: list[Fault], times: int, rng: random.Random, rows: list[Fault], eyes: bool
) -> None:
    from sensors.clock import MonotonicClock

    clock = MonotonicClock()
    rows += faults
    watch = Watch(source, clock)

    def newest_ns() -> int:
        if watch.crash is not None:
            raise RuntimeError(f"the live source crashed: {watch.crash!r}") from watch.crash
        return watch.picture_ns if eyes else watch.sound_ns

    try:
        start_ns = clock.now_ns()
        while not newest_ns() and clock.now_ns() < start_ns + HANG_S * NS:
            _sleep(clock, 0.01)
        _repeat(faults, times, rng, newest_ns, clock)
    finally:
        watch.close()


def _microphone(times: int, rng: random.Random, rows: list[Fault]) -> None:
    from sensors.clock import MonotonicClock
    from sensors.live import LiveSource
    from sensors.microphone import Microphone
    from sensors.standins.pulse import PulseServer

    clock = MonotonicClock()
    with TemporaryDirectory(prefix="pulse") as folder:
        server = PulseServer(Path(folder))
        os.environ.update(server.environment)  # PortAudio is one a process: this group owns it
        server.start()
        faults = [
            Fault("microphone unplugged", server.unplug, server.plug),
            Fault("sound server killed", server.kill, server.start),
            Fault("sound server stalls", server.stall, server.go_on),
        ]
        source = LiveSource(Microphone("pulse:mic", clock), [], clock)
        try:
            _watched(source, faults, times, rng, rows, eyes=False)
        finally:
            server.close()


def _http(times: int, rng: random.Random, rows: list[Fault]) -> None:
    from sensors.clock import MonotonicClock
    from sensors.eyes.spec import cameras
    from sensors.live import LiveSource
    from sensors.standins.eye_pictures import film
    from sensors.standins.mjpeg import FAULTS, MjpegServer

    clock, server = MonotonicClock(), MjpegServer(film(30), jitter_ms=8)

    def switch(fault: str) -> Callable[[], None]:
        return lambda: setattr(server, "fault", fault)

    faults = [Fault(f"camera: {name}", switch(name), switch("")) for name in FAULTS]
    try:
        source = LiveSource(None, cameras([server.url], clock), clock)
        _watched(source, faults, times, rng, rows, eyes=True)
    finally:
        server.close()


def _serial(times: int, rng: random.Random, rows: list[Fault]) -> None:
    from sensors.clock import MonotonicClock
    from sensors.eyes.spec import cameras
    from sensors.live import LiveSource
    from sensors.standins.eye_pictures import film
    from sensors.standins.serial_camera import SerialCamera

    clock = MonotonicClock()
    line = SerialCamera(film(30, 240, 240))

    def switch(name: str, on: bool) -> Callable[[], None]:
        return lambda: setattr(line, name, on)

    faults = [
        Fault("serial noise", switch("noise", True), switch("noise", False)),
        Fault("serial silence", switch("silent", True), switch("silent", False)),
    ]
    try:
        source = LiveSource(None, cameras([f"serial:{line.port}"], clock), clock)
        _watched(source, faults, times, rng, rows, eyes=True)
    finally:
        line.close()


def _usb(times: int, rng: random.Random, rows: list[Fault]) -> None:
    from sensors.clock import MonotonicClock
    from sensors.eyes.spec import cameras
    from sensors.live import LiveSource
    from sensors.standins.eye_pictures import film
    from sensors.standins.usb_camera import UsbCamera

    clock, camera = MonotonicClock(), UsbCamera(film(30, 800, 400))

    def switch(fault: str) -> Callable[[], None]:
        return lambda: setattr(camera, "fault", fault)

    faults = [
        Fault(
            "USB unplugged",
            lambda: setattr(camera, "plugged", False),
            lambda: setattr(camera, "plugged", True),
        ),
        Fault("USB payloads damaged", switch("payloads"), switch("")),
        Fault("USB silent", switch("silent"), switch("")),
    ]
    source = LiveSource(None, cameras(["usb:35bd:0202"], clock, camera), clock)
    _watched(source, faults, times, rng, rows, eyes=True)


def _stopped(times: int, rng: random.Random, rows: list[Fault]) -> None:
    """SIGSTOP for three seconds, of a process that runs a LiveSource with one camera."""
    from sensors.clock import MonotonicClock
    from sensors.standins.eye_pictures import film
    from sensors.standins.mjpeg import MjpegServer

    clock, server = MonotonicClock(), MjpegServer(film(30), jitter_ms=8)
    words = [sys.executable, "-m", "app.bench_faults", server.url]
    child = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    newest = [0]

    def follow() -> None:
        for line in child.stdout or ():
            newest[0] = int(line)

    reader = threading.Thread(target=follow, daemon=True)
    reader.start()
    fault = Fault(
        "process stopped for 3 s",
        lambda: child.send_signal(signal.SIGSTOP),
        lambda: child.send_signal(signal.SIGCONT),
        (STOP_S, STOP_S),
    )
    rows.append(fault)

    def newest_ns() -> int:
        if child.poll() is not None:
            raise RuntimeError(f"the stopped process ended with {child.returncode}")
        return newest[0]

    try:
        while not newest_ns():
            _sleep(clock, 0.01)
        _repeat([fault], times, rng, newest_ns, clock)
    finally:
        child.kill()
        child.wait()
        server.close()


def _follow(url: str) -> None:
    """The child of `_stopped`: prints the time of each frame that sees a fresh picture."""
    from sensors.assemble import Assembler
    from sensors.clock import MonotonicClock
    from sensors.eyes.spec import cameras
    from sensors.live import LiveSource

    clock, assembler = MonotonicClock(), Assembler()
    source = LiveSource(None, cameras([url], clock), clock)
    source.open()
    while True:
        for packet in source.poll():
            assembler.push(packet)
        for frame in assembler.ready():
            if frame.eyes_valid.all():
                print(frame.t_ns, flush=True)
        clock.sleep_until_ns(clock.now_ns() + POLL_NS)


def _sleep(clock: Clock, seconds: float) -> None:
    clock.sleep_until_ns(clock.now_ns() + int(seconds * NS))


if __name__ == "__main__":
    _follow(sys.argv[1])
