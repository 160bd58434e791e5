"""Opus: mono, 32 kb/s, 10 ms a packet, with error correction in band.

PyAV's decoder cannot read the copy of a lost packet that the next one carries, and its encoder is
slower by a third, so both call the libopus that PyAV brings along (or the system's) directly.
"""

import ctypes
import ctypes.util
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sensors.types import SAMPLE_RATE

PACKET = 480  # samples
LOOK_AHEAD = 312  # samples: what goes in at sample s comes out at s + 312
BIT_RATE = 32_000
LOSS_PERCENT = 10  # that the encoder prepares for
MAX_PAYLOAD = 400  # bytes; 32 kb/s needs 40
VOIP = 2048  # the numbers of opus_defines.h
ENCODER = {
    4002: BIT_RATE,
    4012: 1,  # in-band error correction
    4014: LOSS_PERCENT,
    4010: 1,  # complexity of 10: half the time of 4, spectra .15 dB farther from the voice
}
FLOATS = ctypes.POINTER(ctypes.c_float)
Sound = NDArray[np.float32]


class OpusEncoder:
    """480 samples in, one payload out."""

    def __init__(self) -> None:
        self._lib = _library()
        error = ctypes.c_int()
        self._state = self._lib.opus_encoder_create(SAMPLE_RATE, 1, VOIP, ctypes.byref(error))
        if error.value or not self._state:
            raise OSError(f"libopus: expected an encoder, got error {error.value}")
        for request, value in ENCODER.items():
            self._lib.opus_encoder_ctl(self._state, request, ctypes.c_int32(value))
        self._in = np.zeros(PACKET, np.float32)
        self._samples = self._in.ctypes.data_as(FLOATS)
        self._out = ctypes.create_string_buffer(MAX_PAYLOAD)

    def encode(self, samples: Sound) -> bytes:  # [PACKET] -1..1
        np.maximum(samples, -1, out=self._in)
        np.minimum(self._in, 1, out=self._in)
        to, limit = self._out, MAX_PAYLOAD
        size = self._lib.opus_encode_float(self._state, self._samples, PACKET, to, limit)
        if size < 0:
            raise OSError(f"libopus: expected a payload, got error {size}")
        return self._out.raw[:size]

    def close(self) -> None:
        if self._state:
            self._lib.opus_encoder_destroy(self._state)
            self._state = None


class OpusDecoder:
    """One payload in, 480 samples out; what was lost is taken from the next packet or made up."""

    def __init__(self) -> None:
        self._lib = _library()
        error = ctypes.c_int()
        self._state = self._lib.opus_decoder_create(SAMPLE_RATE, 1, ctypes.byref(error))
        if error.value or not self._state:
            raise OSError(f"libopus: expected a decoder, got error {error.value}")
        self._out = np.zeros(PACKET, np.float32)
        self._samples = self._out.ctypes.data_as(FLOATS)

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
        data, size, out = payload or None, len(payload), self._samples
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
    number, state, data = ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p
    rate, size, error = ctypes.c_int32, ctypes.c_int32, ctypes.POINTER(number)
    functions = {
        "opus_encoder_create": (state, [rate, number, number, error]),
        "opus_encoder_ctl": (number, [state, number]),  # and one more
        "opus_encode_float": (size, [state, FLOATS, number, data, size]),
        "opus_encoder_destroy": (None, [state]),
        "opus_decoder_create": (state, [rate, number, error]),
        "opus_decode_float": (number, [state, data, size, FLOATS, number, number]),
        "opus_decoder_destroy": (None, [state]),
    }
    for called, (result, arguments) in functions.items():
        function = getattr(lib, called)
        function.restype, function.argtypes = result, arguments
    return lib
