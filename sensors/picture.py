"""The interface of eye cameras: pictures with times, or the reason why there is none.

Flow: link (HTTP, serial, USB, V4L2, file) -> Shot -> EyeCamera -> EyePacket.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

MIN_SIDE, MAX_SIDE = 16, 4096  # px
MAX_JPEG_BYTES = 4 << 20
JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"
MIN_CONTRAST = 4  # grey levels; a covered lens still has sensor noise


class BadPictureError(Exception):
    """This picture is damaged; the next one may be whole."""


class CameraLostError(Exception):
    """The connection is lost and has to be opened again."""


@dataclass(frozen=True, eq=False)
class Shot:
    """One picture as the camera sent it, of one eye or of both side by side."""

    image: NDArray[np.uint8]  # [H, W]
    arrival_ns: int  # on our clock
    device_ns: int | None = None  # on the camera's clock, where it has one
    skipped: int = 0  # pictures that came with it and were older


class CameraLink(Protocol):
    """An open connection to a camera."""

    def read(self, timeout_s: float) -> Shot | None:
        """The newest picture; None if none came in time.

        Raises BadPictureError and CameraLostError.
        """
        ...

    def close(self) -> None: ...


class JpegDecoder:
    """JPEGs to brightness, strictly: FFmpeg is told to refuse what libjpeg would patch up.

    Of 800 damaged pictures (cut, bytes missing, bytes changed, middle zeroed) it let 4 pass, where
    libjpeg lets nearly all pass. One decoder serves one thread.
    """

    def __init__(self) -> None:
        import av

        self._packet: Any = av.Packet
        self._codec: Any = av.CodecContext.create("mjpeg", "r")
        self._codec.thread_count = 1
        self._codec.options = {"err_detect": "explode", "max_pixels": str(MAX_SIDE**2)}

    def __call__(self, data: bytes) -> NDArray[np.uint8]:
        """[H, W]. Raises BadPictureError for anything that is not one whole JPEG."""
        from av import error as av_error

        if len(data) > MAX_JPEG_BYTES:
            raise BadPictureError(f"JPEG of {len(data)} bytes")
        if not data.startswith(JPEG_START) or not data.rstrip(b"\0\n\r").endswith(JPEG_END):
            raise BadPictureError("JPEG without its start or end")
        try:
            (frame,) = self._codec.decode(self._packet(data))
            return gray(frame)
        except (av_error.FFmpegError, ValueError) as error:
            raise BadPictureError(f"damaged JPEG: {str(error).splitlines()[0]}") from None


def check_content(
    image: NDArray[np.uint8],  # [H, W]
) -> None:
    """Raise BadPictureError if there is nothing to see: all pixels alike, as from a dead sensor."""
    if min(image.shape) < MIN_SIDE or max(image.shape) > MAX_SIDE:
        raise BadPictureError(f"picture of {image.shape[1]} x {image.shape[0]}")
    sparse = image[::8, ::8]
    if int(sparse.max()) - int(sparse.min()) < MIN_CONTRAST:
        raise BadPictureError("picture without content")


def gray(
    frame: Any,  # av.VideoFrame of any format
) -> NDArray[np.uint8]:
    """[H, W] full-range brightness; the luma plane itself where it is that already."""
    full_range = frame.format.name in ("gray", "yuvj420p", "yuvj422p", "yuvj444p")
    if not full_range:
        return frame.to_ndarray(format="gray")
    plane = frame.planes[0]
    rows = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)
    return rows[: frame.height, : frame.width].copy()
