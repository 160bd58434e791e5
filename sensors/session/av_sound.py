"""Sound that libsndfile does not read (m4a, aac, mp4, mov, webm, ...), through PyAV.

It has the three things of a `soundfile.SoundFile` that `media.sound_blocks` uses.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from sensors.session.opening import opened, start_s
from sensors.types import InputError


class AvSound:
    """The first sound stream of a file, read once from front to end; silence until it begins."""

    frames = 0  # not known before the end

    def __init__(self, path: Path) -> None:
        self._container = opened(path, "a sound file", "a wav, flac, ogg, mp3 or m4a")
        streams = self._container.streams.audio
        if self._container.format.name == "tty" or not streams or not streams[0].rate:
            self._container.close()
            raise InputError(f"{path}: expected a sound file, got no sound in it; check the name")
        self.samplerate = int(streams[0].rate)
        length, base = streams[0].duration, streams[0].time_base
        self.seconds = float(length * base) if length and base else None  # None: not known
        late = start_s(self._container, streams[0])
        if self.seconds is not None:
            self.seconds += late
        self._blocks = self._decode(streams[0], round(late * self.samplerate))
        self._rest = np.zeros((0, 1), np.float32)

    def read(self, num: int, **_: object) -> NDArray[np.float32]:  # [n <= num, channels]
        """The next samples, -1..1; none at the end."""
        parts = [self._rest]
        while sum(map(len, parts)) < num:
            block = next(self._blocks, None)
            if block is None:
                break
            parts.append(block)
        found = np.concatenate([part for part in parts if len(part)] or [self._rest])
        self._rest = found[num:]
        return found[:num]

    def _decode(self, stream: Any, silent: int) -> Iterator[NDArray[np.float32]]:
        import av
        from av import error as av_error

        layout = "stereo" if stream.channels == 2 else "mono"  # of two, one may be dead
        if silent:
            yield np.zeros((silent, 2 if layout == "stereo" else 1), np.float32)
        to_float = av.AudioResampler(format="fltp", layout=layout, rate=self.samplerate)
        try:
            frames = cast(Iterator[Any], self._container.decode(stream))
            for frame in frames:
                for part in to_float.resample(frame):
                    yield np.asarray(part.to_ndarray().T, np.float32)
        except av_error.FFmpegError:
            return  # cut off: the sound ends here

    def __enter__(self) -> "AvSound":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._blocks.close()  # type: ignore[attr-defined]  # a generator
        self._container.close()
