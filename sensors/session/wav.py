"""audio.wav of a session: a writer that survives `kill -9`, and the repair of its header.

Flow: RecordingWriter -> WavWriter -> audio.wav. Every packet goes straight to the operating system
and the header follows it, so a kill can leave the header at most one packet behind.
"""

import errno
import os
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sensors import files
from sensors.types import SAMPLE_RATE, InputError

HEADER_BYTES = 44
MAX_DATA_BYTES = 0xFFFFFFFF - HEADER_BYTES
FORMATS = {"float32": (3, 4), "pcm16": (1, 2)}  # name -> WAV format tag, bytes a sample


class WavWriter:
    """Appends 48 kHz mono samples; when `append` returns, the samples are handed to the system."""

    def __init__(self, path: Path, audio_format: str) -> None:
        self._format = audio_format
        self._tag, self._width = FORMATS[audio_format]
        self._file = path.open("wb", buffering=0)
        self.num_samples = 0
        files.write_all(self._file, _header(self._tag, self._width, 0))

    def has_room(self, num_samples: int) -> bool:
        """4 GiB hold 6.2 hours of float32."""
        return (self.num_samples + num_samples) * self._width <= MAX_DATA_BYTES

    def append(
        self,
        samples: NDArray[np.float32],  # [n] -1..1
    ) -> int:
        """Write the samples; return the offset of the first one in the file."""
        offset = self.num_samples
        if not self.has_room(len(samples)):
            raise OSError(errno.EFBIG, "audio.wav holds no more than 4 GiB; start a new session")
        if self._format == "float32":
            data = samples.astype("<f4")
        else:
            data = np.clip(np.rint(samples * np.float32(32768)), -32768, 32767).astype("<i2")
        files.write_all(self._file, data.tobytes())
        self.num_samples += len(samples)
        self._file.seek(0)
        files.write_all(self._file, _header(self._tag, self._width, self.num_samples))
        self._file.seek(0, 2)
        return offset

    def close(self) -> None:
        self._file.close()


def repair_header(path: Path) -> int:
    """Make the header of an interrupted recording agree with the file; return its samples."""
    with files.open_regular(path, update=True) as file:
        size = os.fstat(file.fileno()).st_size
        head = file.read(HEADER_BYTES)
        if len(head) < HEADER_BYTES:
            return 0
        tag, width = struct.unpack_from("<H", head, 20)[0], struct.unpack_from("<H", head, 32)[0]
        if (tag, width) not in FORMATS.values():
            raise InputError(
                f"{path}: expected the sound of a session, got another header; restore it, or "
                "make a session of what is left with: livedrive session create"
            )
        num_samples = (size - HEADER_BYTES) // width
        file.seek(0)
        file.write(_header(tag, width, num_samples))
        file.truncate(HEADER_BYTES + num_samples * width)
    return num_samples


def _header(tag: int, width: int, num_samples: int) -> bytes:
    data_bytes = num_samples * width
    return b"".join(
        [
            struct.pack("<4sI4s", b"RIFF", HEADER_BYTES - 8 + data_bytes, b"WAVE"),
            struct.pack("<4sIHHII", b"fmt ", 16, tag, 1, SAMPLE_RATE, SAMPLE_RATE * width),
            struct.pack("<HH4sI", width, width * 8, b"data", data_bytes),
        ]
    )
