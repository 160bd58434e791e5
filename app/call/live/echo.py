"""Echo cancelling, a noise gate and a high-pass for the microphone: WebRTC's audio processing, from
the `livekit` wheel. No server is involved.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from sensors.types import SAMPLE_RATE, InputError

BLOCK = 480  # samples: 10 ms, as the module wants them
MAX_PLAYED = 50  # blocks of loudspeaker that wait for the microphone
Sound = NDArray[np.float32]


class EchoCanceller:
    """Blocks of the loudspeaker in, blocks of the microphone through."""

    def __init__(self, echo: bool, noise: bool, delay_ms: int = 30) -> None:
        """`delay_ms`: from `played` to the microphone, roughly; the module finds it out."""
        try:
            from livekit import rtc
        except ImportError as error:
            raise InputError(
                f"--echo: expected livekit, got {error}; run: pip install livedrive[call], "
                "or go on with --echo off --noise off"
            ) from None
        self._rtc = rtc
        self._module = rtc.AudioProcessingModule(
            echo_cancellation=echo, noise_suppression=noise, high_pass_filter=True
        )
        self._delay_ms = delay_ms
        self._played: deque[bytes] = deque(maxlen=MAX_PLAYED)
        self._in, self._out = np.zeros(0, np.float32), np.zeros(0, np.float32)

    def played(self, words: bytes) -> None:
        """480 samples of 16 bits that the loudspeaker plays about now."""
        self._played.append(words)

    def clean(self, samples: Sound) -> Sound:
        """As many samples as came in, delayed by a block where they are not whole blocks."""
        while self._played:
            self._module.process_reverse_stream(self._frame(self._played.popleft()))
        self._in = np.concatenate([self._in, samples])
        while len(self._in) >= BLOCK:
            block, self._in = self._in[:BLOCK], self._in[BLOCK:]
            words = (np.clip(np.nan_to_num(block), -1, 1) * 32767).astype("<i2").tobytes()
            frame = self._frame(words)
            self._module.set_stream_delay_ms(self._delay_ms)
            self._module.process_stream(frame)
            heard = np.frombuffer(bytes(frame.data), "<i2").astype(np.float32) / 32767
            self._out = np.concatenate([self._out, heard])
        if len(samples) > len(self._out):  # at the first that are not of 10 ms, and never again
            self._out = np.concatenate([np.zeros(BLOCK - 1, np.float32), self._out])
        out, self._out = self._out[: len(samples)], self._out[len(samples) :]
        return out.astype(np.float32, copy=False)

    def _frame(self, words: bytes):  # noqa: ANN202
        return self._rtc.AudioFrame(words, SAMPLE_RATE, 1, BLOCK)
