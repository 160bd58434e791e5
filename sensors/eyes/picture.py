"""What every eye camera gives: pictures with times, or a reason why not.

Flow: link (HTTP, serial, USB, V4L2, file) -> Shot -> EyeCamera -> EyePacket.
"""

from dataclasses import dataclass
from io import BytesIO
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

MIN_SIDE, MAX_SIDE = 16, 4096  # px
MAX_JPEG_BYTES = 4 << 20
ZERO_RUN = bytes(48)  # no Huffman table in use codes a picture with 384 zero bits in a row
MIN_CONTRAST = 4  # grey levels; a covered lens still has sensor noise


class BadPictureError(Exception):
    """This picture is damaged; the next one may be whole."""


class CameraLostError(Exception):
    """The connection is gone; it has to be made again."""


@dataclass(frozen=True, eq=False)
class Shot:
    """One picture as the camera sent it, of one eye or of both side by side."""

    image: NDArray[np.uint8]  # [H, W]
    arrival_ns: int  # on our clock
    device_ns: int | None = None  # on the camera's clock, where it has one
    skipped: int = 0  # pictures that came with it and were older


class Link(Protocol):
    """An open connection to a camera."""

    def read(self, timeout_s: float) -> Shot | None:
        """The newest picture; None if none came in time.

        Raises BadPictureError and CameraLostError.
        """
        ...

    def close(self) -> None: ...


def decode_jpeg(data: bytes) -> NDArray[np.uint8]:
    """[H, W] brightness. Raises BadPictureError for anything that is not one whole JPEG."""
    from PIL import Image

    if len(data) > MAX_JPEG_BYTES:
        raise BadPictureError(f"JPEG of {len(data)} bytes")
    if not data.startswith(b"\xff\xd8") or not data.rstrip(b"\0\n\r").endswith(b"\xff\xd9"):
        raise BadPictureError("JPEG without its start or end")
    if data.rstrip(b"\0").find(ZERO_RUN) >= 0:  # it would decode, as grey stripes
        raise BadPictureError("JPEG with zeros inside")
    try:
        image = Image.open(BytesIO(data), formats=("JPEG",))
        if max(image.size) > MAX_SIDE:
            raise BadPictureError(f"JPEG of {image.size[0]} x {image.size[1]}")
        image.draft("L", image.size)
        return np.asarray(image.convert("L"))
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise BadPictureError(f"JPEG: {error}") from None


def check_content(
    image: NDArray[np.uint8],  # [H, W]
) -> None:
    """Raise BadPictureError if there is nothing to see: all pixels alike, as from a dead sensor."""
    if min(image.shape) < MIN_SIDE or max(image.shape) > MAX_SIDE:
        raise BadPictureError(f"picture of {image.shape[1]} x {image.shape[0]}")
    sparse = image[::8, ::8]
    if int(sparse.max()) - int(sparse.min()) < MIN_CONTRAST:
        raise BadPictureError("picture without content")
