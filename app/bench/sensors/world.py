"""The stand-in world of `bench soak`, `sensors` and `faults`: a microphone and cameras."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

MIC = "pulse:mic"
VOICE = Path("recordings/demo/audio.wav")
REPEAT = 100_000


@contextmanager
def microphone(voice: Path = VOICE) -> Iterator[str]:
    """A PulseAudio server of our own that plays `voice` into its microphone; yields its --mic."""
    import soundfile

    from sensors.standins.pulse import PulseServer
    from sensors.types import SAMPLE_RATE, InputError

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
def cameras(num: int, *, rate_hz: float = 30.0, jitter_ms: float = 8.0) -> Iterator[list[str]]:
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
