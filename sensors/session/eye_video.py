"""Eye videos of a session: FFV1 gray (exact) or x264 (small) in Matroska, one picture a packet.

Flow: RecordingWriter -> EyeVideoWriter -> eye_*.mkv -> EyeVideoReader -> Recording -> EyePacket.
Every FFV1 picture stands alone and starts a cluster, so `kill -9` costs the one picture that the
container still holds. One a second is marked as a key frame: FFmpeg keeps the index of those in
memory. Matroska times are milliseconds and only for players: the timeline is truth.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from fractions import Fraction
from itertools import chain, islice
from pathlib import Path
from threading import Event
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from sensors import files
from sensors.picture import gray
from sensors.session.opening import check_there, opened
from sensors.types import EYE_SIZE, FPS, InputError

MAX_SIDE = 4096  # px of a picture that is read
SIDE_BY_SIDE = 1.4  # a video of both eyes is at least so many times as wide as high
EYE_CODECS = ("ffv1", "x264")
MILLISECOND = Fraction(1, 1000)
CONTAINER_OPTIONS = {"cluster_time_limit": "1", "flush_packets": "1"}  # a picture a cluster
FFV1_OPTIONS = {"level": "3", "slices": "4", "slicecrc": "1"}
X264_OPTIONS = {"crf": "20", "preset": "medium", "bf": "0"}  # no B-frames: pictures stay in order
MAX_GROUP = 250  # pictures from one key frame of x264 to the next
FULL_RANGE = 2  # AVCOL_RANGE_JPEG: x264 has no gray here, its limited range would cost 36 levels


class EyeVideoWriter:
    """Appends [400, 400] pictures to one Matroska file."""

    def __init__(self, path: Path, eye_codec: str) -> None:
        import av

        self.num_pictures = 0
        self._last_pts = -1
        self._gray = eye_codec == "ffv1"
        options = CONTAINER_OPTIONS
        self._container: Any = av.open(str(path), "w", format="matroska", options=options)
        name, options = ("ffv1", FFV1_OPTIONS) if self._gray else ("libx264", X264_OPTIONS)
        stream = self._container.add_stream(name, rate=FPS, options=options)
        stream.width = stream.height = EYE_SIZE
        stream.pix_fmt = "gray" if self._gray else "yuvj420p"
        stream.codec_context.time_base = MILLISECOND
        stream.codec_context.thread_count = 1  # frame threads would hold pictures back
        if self._gray:
            stream.codec_context.gop_size = 1
        else:
            stream.codec_context.color_range = FULL_RANGE
        self._stream = stream

    def append(
        self,
        image: NDArray[np.uint8],  # [400, 400]
        t_ns: int,  # since the start of the session
    ) -> int:
        """Encode the picture; return its number in the file."""
        import av

        if self._gray:
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="gray")
        else:
            no_colour = np.full((EYE_SIZE // 2, EYE_SIZE), 128, np.uint8)
            frame = av.VideoFrame.from_ndarray(np.concatenate([image, no_colour]), "yuvj420p")
        self._last_pts = max(self._last_pts + 1, t_ns // 1_000_000)
        frame.pts, frame.time_base = self._last_pts, MILLISECOND
        for packet in self._stream.encode(frame):
            if self._gray:
                packet.is_keyframe = self.num_pictures % FPS == 0
            self._container.mux(packet)
        self.num_pictures += 1
        return self.num_pictures - 1

    def close(self) -> None:
        self._container.mux(self._stream.encode(None))
        self._container.close()


class EyeVideoReader:
    """Pictures by number; while one is used, a thread decodes the next, `rest_s` seconds later or
    when it is asked for."""

    def __init__(self, path: Path) -> None:
        self._path = files.check_regular(path)
        self.rest_s = 0.0
        self._asked_for = Event()  # the picture that is decoded ahead
        self._pictures: Iterator[NDArray[np.uint8] | None] | None = None
        self._worker: ThreadPoolExecutor | None = None
        self._ahead: Future[NDArray[np.uint8] | None] | None = None  # picture number `_next`
        self._next = 0
        self._current: NDArray[np.uint8] | None = None
        with open_video(path) as container:
            codec = container.streams.video[0].codec_context
            self.codec: str = codec.name
            if (codec.width, codec.height) != (EYE_SIZE, EYE_SIZE):
                raise InputError(
                    f"{path}: expected pictures of {EYE_SIZE} x {EYE_SIZE}, got "
                    f"{codec.width} x {codec.height}; bring it in with: livedrive session create"
                )

    def picture(self, number: int) -> NDArray[np.uint8] | None:
        """[400, 400], or None where the video has ended or this picture does not decode.

        A slice with a wrong FFV1 checksum does decode: FFmpeg patches it and gives no sign of it.
        """
        if self._pictures is None or not self._next - 1 <= number <= self._next + MAX_GROUP:
            self.close()
            self._next = number
            self._pictures, self._worker = self._decode(number), ThreadPoolExecutor(1, "eye video")
            self._read_ahead()
        while self._next <= number:
            assert self._ahead is not None
            self._asked_for.set()
            try:
                self._current = self._ahead.result()
            except EOFError:
                return None
            self._next += 1
            self._read_ahead()
        return self._current

    def close(self) -> None:
        """Release the file; the next `picture` opens it again."""
        if self._worker is not None:
            self._asked_for.set()
            self._worker.shutdown()  # after the picture that it decodes
        if self._pictures is not None:
            self._pictures.close()  # type: ignore[attr-defined]  # a generator
        self._pictures = self._worker = self._ahead = self._current = None
        self._next = 0

    def _read_ahead(self) -> None:
        assert self._worker is not None
        self._asked_for = Event()
        self._ahead = self._worker.submit(self._following, self._asked_for)

    def _following(self, asked_for: Event) -> NDArray[np.uint8] | None:
        assert self._pictures is not None
        asked_for.wait(self.rest_s)
        try:
            return next(self._pictures)
        except StopIteration:  # which no future can carry
            raise EOFError from None

    def _decode(self, first: int) -> Iterator[NDArray[np.uint8] | None]:
        with open_video(self._path) as container:
            container.streams.video[0].codec_context.thread_count = 1
            yield from pictures_of(container, first)


def pictures_of(container: Any, first: int = 0) -> Iterator[NDArray[np.uint8] | None]:
    """Every picture [H, W] of a video from the `first` on; None for one that is damaged, so that
    the numbers of the later ones stay right."""
    from av import error as av_error

    group, packets = list[Any](), container.demux(video=0)
    with suppress(av_error.FFmpegError):
        for packet in islice(packets, first):  # it is decoded from the last key frame before it
            if packet.is_keyframe:
                group.clear()
            group.append(packet)
    yield from islice(_decoded(chain(group, packets)), len(group), None)


def _decoded(packets: Iterator[Any]) -> Iterator[NDArray[np.uint8] | None]:
    from av import error as av_error

    try:
        for packet in packets:
            try:
                frames = packet.decode()
            except av_error.InvalidDataError:
                yield None
                continue
            for frame in frames:
                yield gray(frame)
    except av_error.FFmpegError:
        return  # cut off in the middle: the video ends here


def open_video(path: Path) -> Any:
    """Open for reading; raise unless it is a video."""
    check_there(path, "an eye video")
    container = opened(path, "a video", "an mkv, mp4 or avi")
    if container.format.name == "tty":  # FFmpeg "plays" text files
        container.close()
        raise InputError(f"{path}: expected a video, got a text file; check the name")
    streams = cast(Sequence[Any], container.streams.video)  # its types hide a missing decoder
    if not streams or streams[0].codec_context is None:  # None: no decoder for this one
        container.close()
        raise InputError(f"{path}: expected a video, got no picture stream; check the file")
    width, height = streams[0].codec_context.width, streams[0].codec_context.height
    if not width or not height:  # FFmpeg believes the name of a picture, whatever is in the file
        container.close()
        raise InputError(f"{path}: expected a video, got no picture in it; check the file")
    if max(width, height) > MAX_SIDE:
        container.close()
        raise InputError(
            f"{path}: expected at most {MAX_SIDE} x {MAX_SIDE} pixels, got {width} x {height}; "
            "scale the video down"
        )
    streams[0].codec_context.options = {"max_pixels": str(MAX_SIDE**2)}  # also in its packets
    return container


def count_pictures(path: Path) -> int:
    """Whole pictures in a video that may have been cut off; reads it, decodes only the last and,
    of x264, those since a key frame that it builds on."""
    import av
    from av import error as av_error

    count, group = 0, deque[Any](maxlen=MAX_GROUP)
    try:
        with av.open(str(path), metadata_errors="replace") as container:
            for packet in container.demux(video=0):
                if packet.size and not packet.is_corrupt:
                    count += 1
                    if packet.is_keyframe or packet.stream.codec_context.name == "ffv1":
                        group.clear()
                    group.append(packet)
            if group and not _last_decodes(container.streams.video[0].codec_context, group):
                count -= 1
    except av_error.InvalidDataError:
        return max(count - 1, 0)
    except (av_error.FFmpegError, IndexError):
        return count
    return count


def _last_decodes(codec: Any, packets: Sequence[Any]) -> bool:
    from av import error as av_error

    for packet in (*packets, None):  # None: what the decoder holds back
        with suppress(av_error.InvalidDataError):
            if any(frame.pts == packets[-1].pts for frame in codec.decode(packet)):
                return True
    return False
