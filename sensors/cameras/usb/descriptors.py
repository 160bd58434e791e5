"""The configuration descriptor of a UVC camera, parsed from bytes alone.

Flow: USB configuration descriptor -> parse -> CameraDescription -> negotiation (streaming.py).
Section numbers are those of the UVC 1.5 class specification.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field

VIDEO_CLASS = 0x0E
CONTROL, STREAMING = 1, 2  # interface subclasses
INTERFACE, ENDPOINT, CLASS_INTERFACE = 0x04, 0x05, 0x24  # descriptor types
BULK = 2
GREY_GUIDS = (b"Y800", b"GREY", b"Y8  ")
YUY2_GUID = b"YUY2"
MAX_FRAMES = 256  # sizes that one camera may list


class DescriptorError(Exception):
    """The bytes do not describe a usable camera."""


@dataclass(frozen=True)
class FrameSize:
    """One picture size of one format."""

    format_index: int
    frame_index: int
    kind: str  # mjpeg, grey, yuy2
    width: int
    height: int
    interval: int  # 100 ns units, the shortest


@dataclass
class CameraDescription:
    """The parts that streaming and the extension units need."""

    control_interface: int = -1
    streaming_interface: int = -1
    endpoint: int = 0  # bulk input
    clock_hz: int = 0  # of the presentation times
    frames: list[FrameSize] = field(default_factory=list[FrameSize])
    extension_units: list[int] = field(default_factory=list[int])

    def best(self) -> FrameSize:
        """The size nearest to two 400 x 400 views, the fastest of that size."""
        return min(self.frames, key=lambda f: (abs(f.height - 400), -f.width, f.interval))


def parse(data: bytes) -> CameraDescription:
    """Read a whole configuration descriptor. Raises DescriptorError."""
    camera = CameraDescription()
    subclass, interface, format_index, kind = 0, 0, 0, ""
    isochronous = False
    for block in _blocks(data):
        if block[1] == INTERFACE and len(block) >= 9:
            interface = block[2]
            subclass = block[6] if block[5] == VIDEO_CLASS else 0
            if subclass == CONTROL:
                camera.control_interface = interface
        elif block[1] == ENDPOINT and len(block) >= 7 and subclass == STREAMING:
            if block[3] & 3 == BULK and block[2] & 0x80:
                camera.endpoint, camera.streaming_interface = block[2], interface
            else:
                isochronous = True
        elif block[1] == CLASS_INTERFACE and subclass == CONTROL:
            _read_control(block, camera)
        elif block[1] == CLASS_INTERFACE and subclass == STREAMING:
            if block[2] in (4, 6):  # uncompressed or MJPEG format, 3.1 of the payload papers
                format_index, kind = block[3] if len(block) > 3 else 0, _kind(block)
            elif block[2] in (5, 7) and kind and len(camera.frames) < MAX_FRAMES:
                camera.frames.append(_frame(block, format_index, kind))
    if camera.control_interface < 0 or not camera.frames:
        raise DescriptorError("no UVC video that can be decoded")
    if not camera.endpoint:
        how = "isochronous transfers, which need the system's driver" if isochronous else "no data"
        raise DescriptorError(f"it uses {how}; try uvc:0")
    return camera


def _blocks(data: bytes) -> Iterator[bytes]:
    """Single descriptors: length, type, content."""
    at = 0
    while at + 2 <= len(data):
        length = data[at]
        if length < 3 or at + length > len(data):
            return
        yield data[at : at + length]
        at += length


def _read_control(block: bytes, camera: CameraDescription) -> None:
    if block[2] == 1 and len(block) >= 12:  # header, 3.7.2
        camera.clock_hz = struct.unpack_from("<I", block, 7)[0]
    elif block[2] == 6 and len(block) >= 4:  # extension unit, 3.7.2.7
        camera.extension_units.append(block[3])


def _kind(block: bytes) -> str:
    if block[2] == 6:
        return "mjpeg"
    guid = block[5:9]
    return "grey" if guid in GREY_GUIDS else "yuy2" if guid == YUY2_GUID else ""


def _frame(block: bytes, format_index: int, kind: str) -> FrameSize:
    if len(block) < 26:
        raise DescriptorError(f"frame descriptor of {len(block)} bytes, expected 26 or more")
    width, height = struct.unpack_from("<HH", block, 5)
    num = block[25] or 1  # 0: a range, whose first value is the shortest interval
    shortest = [
        struct.unpack_from("<I", block, 26 + 4 * k)[0]
        for k in range(num)
        if 30 + 4 * k <= len(block)
    ]
    return FrameSize(format_index, block[3], kind, width, height, min(shortest, default=0))
