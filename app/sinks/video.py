"""H.264 video with the session's sound, in step to the sample.

The file is written in fragments, so that what was written before a crash or a full disk plays.
"""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.drive.sink import FrameResult, RunInfo
from app.terminal import outputs
from sensors import files
from sensors.types import FPS, SAMPLE_RATE, SAMPLES_PER_FRAME

BT_709, LIMITED = 1, 1  # libav's numbers: matrix, primaries and curve of HD; values 16 to 235


class _Disk:
    """What libav writes to: it hears of no failure, as it dies of one in a header and forgets one
    in the last fragment. `check` raises it instead, and a Ctrl-C that came meanwhile."""

    def __init__(self, path: Path) -> None:
        self._path, self._file = path, path.open("wb", buffering=0)  # at once, in case of a crash
        self._failure: OSError | None = None
        self._stopped = False
        self.seek, self.tell, self.close = self._file.seek, self._file.tell, self._file.close

    def write(self, data: bytes) -> int:
        rest = memoryview(data)
        while rest and self._failure is None:
            try:
                rest = rest[self._file.write(rest) :]
            except OSError as error:
                self._failure = OSError(error.errno, error.strerror, str(self._path))
            except KeyboardInterrupt:
                self._stopped = True
        return len(data)

    def check(self) -> None:
        if self._failure:
            raise self._failure
        if self._stopped:
            self._stopped = False
            raise KeyboardInterrupt


class _Pictures:
    """The H.264 of a container. Its colours are BT.709 and say so: players guess by the size what
    others are."""

    def __init__(self, container: Any, width: int, height: int, **options: str) -> None:
        from av.video.reformatter import VideoReformatter

        self.width, self.height = width, height
        self._container, self._reformatter, self._count = container, VideoReformatter(), 0
        self._stream = container.add_stream("libx264", rate=FPS)
        self._stream.width, self._stream.height, self._stream.pix_fmt = width, height, "yuv420p"
        self._stream.options = {"crf": "18", "preset": "veryfast", "threads": "1", **options}
        context = self._stream.codec_context
        context.colorspace = context.color_primaries = context.color_trc = BT_709
        context.color_range = LIMITED

    def write(self, pixels: NDArray[np.uint8]) -> None:  # [H, W, 3 or 4]
        import av
        from av.video.reformatter import ColorRange, Colorspace

        layout = "rgba" if pixels.shape[2] == 4 else "rgb24"
        picture = self._reformatter.reformat(
            av.VideoFrame.from_ndarray(pixels, format=layout),
            format="yuv420p",
            dst_colorspace=Colorspace.ITU709,
            dst_color_range=ColorRange.MPEG,
        )
        picture.pts, picture.time_base = self._count, Fraction(1, FPS)
        self._container.mux(self._stream.encode(picture))
        self._count += 1

    def finish(self) -> None:
        self._container.mux(self._stream.encode(None))


class VideoSink:
    """Every tick is one picture; a tick without a picture repeats the last one."""

    def __init__(self, path: Path) -> None:
        outputs.check("--video", path, outputs.VIDEOS)
        self._path = path
        self._last: NDArray[np.uint8] | None = None
        self._count = 0

    def on_start(self, info: RunInfo) -> None:
        import av

        self._disk = _Disk(files.create(self._path, private=True))
        # The list of edits, which says where picture and sound begin, needs their first packets.
        kind, options = _format(self._path, "frag_keyframe+delay_moov")
        options["flush_packets"] = "1"  # a fragment at once, not in lumps of 256 kB
        self._container: Any = av.open(self._disk, "w", kind, options=options)
        self._video = _Pictures(self._container, info.width, info.height, g=str(FPS))
        self._audio = self._container.add_stream("aac", rate=SAMPLE_RATE)
        self._audio.layout = "mono"
        self._audio.bit_rate = 128_000

    def on_frame(self, result: FrameResult) -> None:
        import av

        if result.picture is not None:
            self._last = result.picture
        if self._last is None:
            self._last = np.zeros((self._video.height, self._video.width, 4), np.uint8)
        sound = av.AudioFrame.from_ndarray(result.sensors.audio[None], "fltp", "mono")
        sound.sample_rate, sound.pts = SAMPLE_RATE, self._count * SAMPLES_PER_FRAME
        sound.time_base = Fraction(1, SAMPLE_RATE)
        self._video.write(self._last)
        self._container.mux(self._audio.encode(sound))
        self._count += 1
        self._disk.check()

    def close(self) -> None:
        if self._count:
            self._video.finish()
            self._container.mux(self._audio.encode(None))
        self._container.close()
        self._disk.close()
        self._disk.check()


def film(
    path: Path,
    pictures: Iterable[NDArray[np.uint8]],
    sound: NDArray[np.int16] | None = None,
    sample_rate: int = SAMPLE_RATE,
) -> None:
    """Pictures [H, W, 3 or 4] of one size, at FPS, and their sound [n], if they have one."""
    import av

    outputs.check("video", path, outputs.VIDEOS)
    kind, options = _format(path, "faststart")  # plays before all of it has come
    with files.replacing(path) as draft:
        opened: Any = av.open(str(draft), "w", kind, options=options)
        with opened as container:
            _film(container, pictures, sound, sample_rate)


def _format(path: Path, movflags: str) -> tuple[str, dict[str, str]]:
    """libav's name of the file's format, and its options, where it has such flags."""
    kind = path.suffix.lower().removeprefix(".")
    return ("matroska", {}) if kind == "mkv" else (kind, {"movflags": movflags})


def _film(
    container: Any,
    pictures: Iterable[NDArray[np.uint8]],
    sound: NDArray[np.int16] | None,
    sample_rate: int,
) -> None:
    import av

    video = voice = None
    for picture in pictures:
        if video is None:
            video = _Pictures(container, picture.shape[1], picture.shape[0])
            if sound is not None:
                voice = container.add_stream("aac", rate=sample_rate, layout="mono")
        video.write(picture)
    if video is not None:
        video.finish()
    if voice is not None and sound is not None:
        chunk = av.AudioFrame.from_ndarray(sound[None], "s16", "mono")
        chunk.sample_rate = sample_rate
        container.mux(voice.encode(chunk))
        container.mux(voice.encode(None))
