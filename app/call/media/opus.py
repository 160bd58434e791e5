"""Opus: mono, 32 kb/s, 10 ms a packet, with error correction in band.

Encoded by PyAV. PyAV's decoder cannot read the copy of a lost packet that the next one carries,
so decoding calls the libopus that PyAV brings along (or the system's) directly.
"""

import ctypes
import ctypes.util
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sensors.types import SAMPLE_RATE

PACKET = 480  # samples
LOOK_AHEAD = 312  # samples: what goes in at sample s comes out at s + 312
BIT_RATE = 32_000
LOSS_PERCENT = 10  # that the encoder prepares for
MAX_PAYLOAD = 400  # bytes; 32 kb/s needs 40
Sound = NDArray[np.float32]


class OpusEncoder:
    """480 samples in, one payload out."""

    def __init__(self) -> None:
        import av

        self._av = av
        self._codec = av.CodecContext.create("libopus", "w")
        self._codec.bit_rate = BIT_RATE
        self._codec.format, self._codec.layout = "s16", "mono"
        self._codec.sample_rate, self._codec.time_base = SAMPLE_RATE, Fraction(1, SAMPLE_RATE)
        self._codec.options = {
            "application": "voip",
            "frame_duration": "10",
            "fec": "1",
            "packet_loss": str(LOSS_PERCENT),
            "compression_level": "4",  # a third of the time of 10, hardly to be heard
        }
        self._at = 0

    def encode(self, samples: Sound) -> bytes:  # [PACKET] -1..1
        words = (np.clip(samples, -1, 1) * 32767).astype(np.int16)
        frame = self._av.AudioFrame.from_ndarray(words[None], format="s16", layout="mono")
        frame.sample_rate, frame.pts = SAMPLE_RATE, self._at
        frame.time_base = Fraction(1, SAMPLE_RATE)
        self._at += PACKET
        return b"".join(bytes(packet) for packet in self._codec.encode(frame))


class OpusDecoder:
    """One payload in, 480 samples out; what was lost is taken from the next packet or made up."""

    def __init__(self) -> None:
        self._lib = _library()
        error = ctypes.c_int()
        self._state = self._lib.opus_decoder_create(SAMPLE_RATE, 1, ctypes.byref(error))
        if error.value or not self._state:
            raise OSError(f"libopus: expected a decoder, got error {error.value}")
        self._out = np.zeros(PACKET, np.float32)

    def decode(self, payload: bytes) -> Sound:
        """[PACKET]; a payload that is no Opus of 10 ms is concealed."""
        return self._run(payload, 0)

    def recover(self, following: bytes) -> Sound:
        """[PACKET] of a lost packet, from the copy in the one after it; then decode that one."""
        return self._run(following, 1)

    def conceal(self) -> Sound:
        """[PACKET] made up from what came before; fades out by itself."""
        return self._run(b"", 0)

    def close(self) -> None:
        if self._state:
            self._lib.opus_decoder_destroy(self._state)
            self._state = None

    def _run(self, payload: bytes, correction: int) -> Sound:
        out = self._out.ctypes.data_as(ctypes.POINTER(ctypes.c_float))
        data, size = payload or None, len(payload)
        count = self._lib.opus_decode_float(self._state, data, size, out, PACKET, correction)
        if count != PACKET:
            if payload:
                return self.conceal()
            self._out[:] = 0
        return self._out.copy()


def _library() -> ctypes.CDLL:
    import av

    package = Path(av.__file__).parent
    places = (package.parent / "av.libs", package / ".dylibs", package)
    bundled = [path for place in places for path in place.glob("libopus*")]
    name = str(bundled[0]) if bundled else ctypes.util.find_library("opus")
    if name is None:
        raise OSError(
            "libopus: expected it beside PyAV or in the system, got none; install libopus0"
        )
    lib = ctypes.CDLL(name)
    lib.opus_decoder_create.restype = ctypes.c_void_p
    lib.opus_decoder_create.argtypes = [
        ctypes.c_int32,
        ctypes.c_int,
        ctypes.POINTER(ctypes.c_int),
    ]
    lib.opus_decode_float.restype = ctypes.c_int
    lib.opus_decode_float.argtypes = [
        ctypes.c_void_p,
        ctypes.c_char_p,
        ctypes.c_int32,
        ctypes.POINTER(ctypes.c_float),
        ctypes.c_int,
        ctypes.c_int,
    ]
    lib.opus_decoder_destroy.argtypes = [ctypes.c_void_p]
    return lib
