"""The loudspeaker of a call: asks for 5 ms at a time, and tells when they will be heard."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.call.media.voice import PULL
from sensors.audio.portaudio import library
from sensors.types import NS, SAMPLE_RATE, Clock, InputError

Pull = Callable[[int, int], NDArray[np.float32]]  # samples, and when the first is heard, in ns
LATENCY_S = 0.02


class Speaker:
    """An output of PortAudio; `pull` is called in its thread."""

    def __init__(self, name: str | None, clock: Clock, pull: Pull) -> None:
        """`name`: default the system's. Raises InputError where there is none."""
        sounddevice = library()
        try:
            self._stream: Any = sounddevice.OutputStream(
                samplerate=SAMPLE_RATE,
                channels=1,
                dtype="float32",
                blocksize=PULL,
                latency=LATENCY_S,
                device=name,
                callback=self._fill,
            )
        except (sounddevice.PortAudioError, ValueError) as error:
            raise InputError(
                f"--speaker: expected an output, got: {' '.join(str(error).split())}; "
                "try --speaker none, or see livedrive devices"
            ) from None
        self._clock, self._pull = clock, pull
        self.latency_ns = round(float(self._stream.latency) * NS)
        self._stream.start()

    def close(self) -> None:
        self._stream.abort()
        self._stream.close()

    def _fill(self, out: NDArray[np.float32], count: int, time: object, status: object) -> None:  # noqa: ARG002
        out[:, 0] = self._pull(count, self._clock.now_ns() + self.latency_ns)
