"""The stand-in world of `bench soak`, `sensors`, `faults`: microphone, cameras, a screen."""

# pyright: reportMissingTypeStubs=false

import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from sensors.types import LOOPBACK

MIC = "pulse:mic"
VOICE = Path("recordings/demo/audio.wav")
REPEAT = 100_000


@contextmanager
def microphone(voice: Path = VOICE) -> Generator[str]:
    """A PulseAudio server of our own that plays `voice` into its microphone; yields its --mic."""
    import soundfile

    from sensors.standins.pulse import PulseServer
    from sensors.types import SAMPLE_RATE, InputError

    if not voice.is_file():
        raise InputError(
            f"{voice}: expected a voice for the stand-in microphone, got no file; run this in the "
            "folder of the repository"
        )
    sound, rate = soundfile.read(str(voice), dtype="int16", always_2d=True)
    if rate != SAMPLE_RATE:
        raise InputError(f"{voice}: expected {SAMPLE_RATE} Hz, got {rate}; give another file")
    with TemporaryDirectory(prefix="pulse") as folder:
        server = PulseServer(Path(folder))
        before = dict(os.environ)
        os.environ.update(server.environment)
        try:
            server.start()
            server.play(sound[:, 0].astype(np.int16), REPEAT)
            yield MIC
        finally:
            server.close()
            os.environ.clear()
            os.environ.update(before)


@contextmanager
def cameras(num: int, *, rate_hz: float = 30.0, jitter_ms: float = 8.0) -> Generator[list[str]]:
    """MJPEG servers in processes of their own; yields their addresses."""
    with ExitStack() as stack:
        urls: list[str] = []
        for seed in range(num):
            words = [sys.executable, "-m", "sensors.standins.mjpeg", "--rate", str(rate_hz)]
            words += ["--jitter-ms", str(jitter_ms), "--seed", str(seed)]
            server = stack.enter_context(
                subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            )
            assert server.stdin is not None
            assert server.stdout is not None
            stack.callback(server.stdin.close)  # which ends it
            urls.append(server.stdout.readline().strip())
        yield urls


@contextmanager
def tracker() -> Generator[str]:
    """A program that sends VMC poses, in a process of its own; yields the --head that hears it."""
    with socket.socket(type=socket.SOCK_DGRAM) as free:
        free.bind((LOOPBACK, 0))
        port = free.getsockname()[1]
    words = [sys.executable, "-m", "app.bench.sensors.visitors", "tracker", str(port)]
    with subprocess.Popen(words) as sender:
        try:
            yield f"vmc://:{port}"
        finally:
            sender.terminate()


@contextmanager
def screen() -> Generator[None]:
    """The user's screen, or one that nobody sees."""
    from sensors.types import InputError

    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        yield
        return
    if not shutil.which("Xvfb"):
        raise InputError("bench soak: expected a screen or Xvfb, got neither; run: make system")
    words = ["Xvfb", "-displayfd", "1", "-screen", "0", "1280x800x24", "-nolisten", "tcp"]
    quiet = subprocess.DEVNULL
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=quiet, text=True) as server:
        assert server.stdout is not None
        os.environ["DISPLAY"] = f":{server.stdout.readline().strip()}"
        try:
            yield
        finally:
            del os.environ["DISPLAY"]
            server.terminate()
