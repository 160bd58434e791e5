"""Lazy streams of a session: the sound in pieces, the pictures one by one.

Flow: Recording -> AudioStream, EyeStream -> packets. Opening checks the files and reads no content,
so a session of any length costs little memory.
"""

# pyright: reportMissingTypeStubs=false
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sensors import files
from sensors.session.eye_video import EyeVideoReader
from sensors.session.format import TIMELINE_FILE
from sensors.session.timeline import AudioEntry, EyeEntry
from sensors.types import SAMPLE_RATE, AudioPacket, EyePacket, InputError

READ_AHEAD = SAMPLE_RATE  # samples: a packet is a tick's, and each read takes as long as a second's


class AudioStream:
    """The sound of a session, read in the pieces that are asked for."""

    def __init__(self, path: Path, entries: list[AudioEntry]) -> None:
        self.entries = entries
        self.t_ns = np.array([e.t_ns for e in entries], np.int64)  # [packets]
        self._path = path
        self._file: Any = None
        self._check_order()
        self._read: tuple[int, NDArray[np.float32]] = 0, np.empty(0, np.float32)  # offset, samples
        self.num_samples = self._open()
        expected = max((e.offset + e.num_samples for e in entries), default=0)
        if self.num_samples < expected:
            self.close()
            raise InputError(
                f"{path} is truncated: expected {expected} samples, got {self.num_samples}; "
                "copy it again from where it was recorded"
            )

    def packet(self, entry: AudioEntry) -> AudioPacket:
        start, read = self._read
        first = entry.offset - start
        if first < 0 or first + entry.num_samples > len(read):
            first, read = 0, self._read_from(entry.offset, max(entry.num_samples, READ_AHEAD))
        samples = read[first : first + entry.num_samples]
        return AudioPacket(entry.t_ns, entry.first_sample, samples, entry.gap)

    def sample(
        self, t_ns: int, method: Literal["backward"] = "backward", tolerance_ns: int | None = None
    ) -> AudioPacket | None:
        """The newest packet that starts at or before `t_ns`."""
        index = _backward(self.t_ns, t_ns, method, tolerance_ns)
        return None if index is None else self.packet(self.entries[index])

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None
        self._read = 0, np.empty(0, np.float32)

    def _check_order(self) -> None:
        """Before a file is written: frames cannot be made of sound that goes back."""
        for before, entry in pairwise(self.entries):
            expected = before.first_sample + before.num_samples
            if entry.first_sample < expected:
                raise InputError(
                    f"{self._path.with_name(TIMELINE_FILE)}: expected sound from sample {expected} "
                    f"on, got {entry.first_sample}; restore the file"
                )

    def _read_from(self, offset: int, count: int) -> NDArray[np.float32]:
        if self._file is None:
            self._open()
        file: Any = self._file
        file.seek(offset)
        self._read = offset, file.read(count, dtype="float32")
        return self._read[1]

    def _open(self) -> int:
        import soundfile

        if not files.check_regular(self._path).exists():
            raise InputError(f"{self._path}: expected the session's sound, got no file; restore it")
        try:
            self._file = soundfile.SoundFile(str(self._path))
        except soundfile.LibsndfileError as error:
            raise InputError(
                f"{self._path}: expected a WAV file, got {error}; restore it"
            ) from None
        rate, channels = self._file.samplerate, self._file.channels
        if (rate, channels) != (SAMPLE_RATE, 1):
            self.close()
            raise InputError(
                f"{self._path}: expected {SAMPLE_RATE} Hz mono, got {rate} Hz with {channels} "
                "channel(s); bring it in with: livedrive session create DIR --audio x.wav"
            )
        return int(self._file.frames)


class EyeStream:
    """The pictures of one eye, decoded when asked for."""

    def __init__(self, path: Path, entries: list[EyeEntry]) -> None:
        self.path, self.entries = path, entries
        self.t_ns = np.array([e.t_ns for e in entries], np.int64)  # [pictures]
        self._video = EyeVideoReader(path)
        self.codec = self._video.codec

    def pace(self, rest_s: float) -> None:
        """See Recording.pace."""
        self._video.rest_s = rest_s

    def packet(self, entry: EyeEntry) -> EyePacket | None:
        """None where the video has ended early or the picture is damaged."""
        image = self._video.picture(entry.picture)
        return None if image is None else EyePacket(entry.t_ns, entry.eye, entry.counter, image)

    def sample(
        self, t_ns: int, method: Literal["backward"] = "backward", tolerance_ns: int | None = None
    ) -> EyePacket | None:
        """The newest picture taken at or before `t_ns`, if no older than the tolerance."""
        index = _backward(self.t_ns, t_ns, method, tolerance_ns)
        return None if index is None else self.packet(self.entries[index])

    def close(self) -> None:
        self._video.close()


def _backward(
    times_ns: NDArray[np.int64],  # [n] ascending
    t_ns: int,
    method: str,
    tolerance_ns: int | None,
) -> int | None:
    """Index of the newest time at or before `t_ns`, if within the tolerance."""
    if method != "backward":
        raise ValueError(f'method: expected "backward" (no future is ever used), got {method!r}')
    index = int(np.searchsorted(times_ns, t_ns, side="right")) - 1
    if index < 0 or (tolerance_ns is not None and t_ns - int(times_ns[index]) > tolerance_ns):
        return None
    return index
