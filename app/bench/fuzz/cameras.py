"""What eye cameras send: OpenIris over a serial line, MJPEG over HTTP, UVC payloads over USB."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from app.bench.fuzz.fuzzer import Fuzzer


def serial(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    from sensors.cameras.openiris import MARK, Framing
    from sensors.picture import BadPictureError, JpegDecoder
    from sensors.standins.eye_pictures import film

    decode = JpegDecoder()
    line = b"".join(MARK + len(d).to_bytes(2, "little") + d for d in film(2, 48, 48))

    def feed() -> None:
        framing = Framing()
        for piece in fuzzer.pieces(fuzzer.mutate(line)):
            for data in framing.feed(piece):
                with suppress(BadPictureError):
                    decode(data)

    return feed


def http(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    from sensors.cameras.multipart import HttpBody, Multipart
    from sensors.picture import BadPictureError, CameraLostError, JpegDecoder
    from sensors.standins.eye_pictures import film

    decode, parts = JpegDecoder(), b""
    for data in film(2, 48, 48):
        head = f"--edge\r\nContent-Length: {len(data)}\r\nX-Timestamp: 12.5\r\n\r\n".encode()
        parts += b"%x\r\n%b\r\n" % (len(head) + len(data), head + data)
    answer = (
        b"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=edge\r\n"
        b"Transfer-Encoding: chunked\r\n\r\n" + parts
    )

    def feed() -> None:
        body, stream = HttpBody(), None
        with suppress(CameraLostError):
            for piece in fuzzer.pieces(fuzzer.mutate(answer)):
                data = body.feed(piece)
                if stream is None and body.content_type:
                    stream = Multipart(body.content_type)
                for part in stream.feed(data) if stream else ():
                    with suppress(BadPictureError):
                        decode(part.data)

    return feed


def usb(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    """One of seven payloads, a descriptor or a probe damaged at a time."""
    from sensors.cameras.usb.descriptors import DescriptorError, parse
    from sensors.cameras.usb.streaming import Payloads, Probe
    from sensors.picture import BadPictureError, JpegDecoder
    from sensors.standins.eye_pictures import film
    from sensors.standins.usb_descriptors import configuration_descriptor

    decode, descriptor = JpegDecoder(), configuration_descriptor(800, 400, 30)
    (data,) = film(1, 48, 48)
    payloads = [bytes([2, k % 2 | 2 * (k % 3 == 2)]) + data[k::3] for k in range(6)]
    payloads.append(bytes([2, 0x82]) + data)
    probe, stream = Probe(1, 1, 333_333).pack(), Payloads(100_000)

    def feed() -> None:
        kind = fuzzer.pick(len(payloads) + 2)
        if kind == len(payloads):
            with suppress(DescriptorError):
                parse(fuzzer.mutate(descriptor)).best()
        elif kind > len(payloads):
            with suppress(ValueError):
                Probe.unpack(fuzzer.mutate(probe))
        else:
            picture = stream.feed(fuzzer.mutate(payloads[kind]))
            if picture is not None:
                with suppress(BadPictureError):
                    decode(picture.data)

    return feed
