"""The ways in which each kind of sensor fails, on the stand-in devices (`bench faults`)."""

import os
import random
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil

from app.bench.sensors.fault_watch import POLL_NS, Fault, repeat, watched

STOP_S = 3.0


def microphone(times: int, rng: random.Random, rows: list[Fault]) -> None:
    from sensors.audio.microphone import Microphone
    from sensors.clock import MonotonicClock
    from sensors.live.source import LiveSource
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
            watched(source, faults, times, rng, rows, eyes=False)
        finally:
            server.close()


def http(times: int, rng: random.Random, rows: list[Fault]) -> None:
    from sensors.cameras.spec import cameras
    from sensors.clock import MonotonicClock
    from sensors.live.source import LiveSource
    from sensors.standins.eye_pictures import film
    from sensors.standins.mjpeg import FAULTS, MjpegServer

    clock, server = MonotonicClock(), MjpegServer(film(30), jitter_ms=8)

    def switch(fault: str) -> Callable[[], None]:
        return lambda: setattr(server, "fault", fault)

    faults = [Fault(f"camera: {name}", switch(name), switch("")) for name in FAULTS]
    try:
        source = LiveSource(None, cameras([server.url], clock), clock)
        watched(source, faults, times, rng, rows, eyes=True)
    finally:
        server.close()


def serial(times: int, rng: random.Random, rows: list[Fault]) -> None:
    from sensors.cameras.spec import cameras
    from sensors.clock import MonotonicClock
    from sensors.live.source import LiveSource
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
        watched(source, faults, times, rng, rows, eyes=True)
    finally:
        line.close()


def usb(times: int, rng: random.Random, rows: list[Fault]) -> None:
    from sensors.cameras.spec import cameras
    from sensors.clock import MonotonicClock
    from sensors.live.source import LiveSource
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
    watched(source, faults, times, rng, rows, eyes=True)


def stopped(times: int, rng: random.Random, rows: list[Fault]) -> None:
    """Three seconds without running, of a process that runs a LiveSource with one camera."""
    from sensors.clock import MonotonicClock
    from sensors.standins.eye_pictures import film
    from sensors.standins.mjpeg import MjpegServer

    clock, server = MonotonicClock(), MjpegServer(film(30), jitter_ms=8)
    words = [sys.executable, "-m", "app.bench.sensors.fault_kinds", server.url]
    child = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    process = psutil.Process(child.pid)
    newest = [0]

    def follow() -> None:
        for line in child.stdout or ():
            newest[0] = int(line)

    reader = threading.Thread(target=follow, daemon=True)
    reader.start()
    fault = Fault(
        "process stopped for 3 s",
        process.suspend,
        process.resume,
        (STOP_S, STOP_S),
    )
    rows.append(fault)

    def newest_ns() -> int:
        if child.poll() is not None:
            raise RuntimeError(f"the stopped process ended with {child.returncode}")
        return newest[0]

    try:
        repeat([fault], times, rng, newest_ns, clock)
    finally:
        child.kill()
        child.wait()
        server.close()


def _follow(url: str) -> None:
    """The child of `stopped`: prints the time of each frame that sees a fresh picture."""
    from sensors.assemble import Assembler
    from sensors.cameras.spec import cameras
    from sensors.clock import MonotonicClock
    from sensors.live.source import LiveSource

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


if __name__ == "__main__":
    _follow(sys.argv[1])
