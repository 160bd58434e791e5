"""Cameras behind the operating system's driver, and recorded eye videos played as if live.

Flow: V4L2 device | video file | session -> Shot. FFmpeg (PyAV) reads all of them.
"""

import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors.cameras import reasons
from sensors.picture import BadPictureError, CameraLostError, JpegDecoder, Shot, gray
from sensors.session.eye_video import open_video, pictures_of
from sensors.session.recording import Recording
from sensors.types import FPS, NS, Clock

LOOK_S = 0.002  # between two looks for a picture where the driver does not wait for one
MOST_UNEVEN = 10  # times as long as by its mean rate a video may be


class DriverLink:
    """A camera that FFmpeg opens by itself, e.g. /dev/video0 with format v4l2.

    Reading blocks in the driver; a camera that stalls there holds up its own thread only.
    """

    def __init__(
        self, device: str, container_format: str, clock: Clock, options: Mapping[str, str]
    ) -> None:
        import av
        from av import error as av_error

        self._clock, self._decode = clock, JpegDecoder()
        try:
            self._container: Any = av.open(device, format=container_format, options=dict(options))
        except (av_error.FFmpegError, ValueError, OSError) as error:
            raise reasons.lost(error) from None
        self._stream = self._container.streams.video[0]
        self._jpeg = self._stream.codec_context.name == "mjpeg"
        self._packets = self._container.demux(self._stream)

    def read(self, timeout_s: float) -> Shot | None:
        from av import error as av_error

        try:
            packet = next(self._packets)
            arrival_ns = self._clock.now_ns()
            if self._jpeg:
                return Shot(self._decode(bytes(packet)), arrival_ns)
            frames = packet.decode()
        except av_error.BlockingIOError:  # of macOS, whose driver does not wait for a picture
            self._packets = self._container.demux(self._stream)
            time.sleep(LOOK_S)
            return None
        except av_error.InvalidDataError as error:
            raise BadPictureError(str(error)) from None
        except (av_error.FFmpegError, StopIteration, OSError) as error:
            raise reasons.lost(error, otherwise=f"the driver failed {error}") from None
        return Shot(gray(frames[-1]), arrival_ns) if frames else None

    def close(self) -> None:
        self._container.close()


class PlayedCameraLink:
    """Pictures that were recorded, at their own pace and over and over."""

    def __init__(self, pictures: Iterator[tuple[int, NDArray[np.uint8]]], clock: Clock) -> None:
        """`pictures` yields (time since the start, picture [H, W]), without end."""
        self._pictures, self._clock = pictures, clock
        self._start_ns = clock.now_ns()
        self._next = next(pictures, None)

    def read(self, timeout_s: float) -> Shot | None:
        if self._next is None:
            raise CameraLostError("the recording has no pictures")
        now_ns = self._clock.now_ns()
        due_ns = self._start_ns + self._next[0]
        if due_ns > now_ns + int(timeout_s * NS):
            time.sleep(timeout_s)
            return None
        if due_ns > now_ns:
            time.sleep((due_ns - now_ns) / NS)
        image, skipped = self._next[1], -1
        while self._next is not None and self._start_ns + self._next[0] <= self._clock.now_ns():
            image, skipped = self._next[1], skipped + 1
            self._next = next(self._pictures, None)
        return Shot(image, self._clock.now_ns(), None, max(skipped, 0))

    def close(self) -> None:
        pass


def file_pictures(path: Path) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Pictures of a video file at its own times, in an endless loop."""
    *times_ns, length_ns = _times_ns(path)
    start_ns = whole = 0
    while True:
        with open_video(path) as container:
            for t_ns, picture in zip(times_ns, pictures_of(container), strict=False):
                if picture is not None:
                    whole += 1
                    yield start_ns + t_ns, picture
        if not whole:
            return
        start_ns += length_ns


def _times_ns(path: Path) -> list[int]:
    """When each picture of a video is shown, and when the last one is over; evenly spread where
    the file tells no times."""
    with open_video(path) as container:
        stream = container.streams.video[0]
        period_ns = int(NS / (stream.average_rate or FPS))
        stamps = [packet.pts for packet in container.demux(stream) if packet.size]
        base = stream.time_base
    even = [k * period_ns for k in range(len(stamps) + 1)]
    if not stamps or None in stamps or len(set(stamps)) < len(stamps):
        return even
    stamps.sort()  # packets lie in the order of decoding
    own = [int((stamp - stamps[0]) * base * NS) for stamp in stamps]
    if own[-1] > MOST_UNEVEN * even[-1]:  # a damaged file's
        return even
    return [*own, own[-1] + period_ns]


def session_pictures(folder: Path) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Both eyes of a session side by side, at 30 FPS, for ever; a missing eye is black."""
    start_ns = 0
    while True:
        with Recording(folder) as recording:
            if not recording.eyes:
                return
            first_ns = min(int(s.t_ns[0]) for s in recording.eyes.values())
            last_ns = max(int(s.t_ns[-1]) for s in recording.eyes.values())
            for t_ns in range(first_ns, last_ns + 1, NS // FPS):
                both = np.zeros((400, 800), np.uint8)
                for eye, stream in recording.eyes.items():
                    packet = stream.sample(t_ns)
                    if packet is not None:
                        both[:, 400 * eye : 400 * eye + 400] = packet.image
                yield start_ns + t_ns - first_ns, both
        start_ns += last_ns - first_ns + NS // FPS
