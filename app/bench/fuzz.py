"""`livedrive bench fuzz`: damaged bytes at every border, to see that no exception escapes.

Valid inputs are mutated (bytes changed, cut, repeated, swapped, lengths forged) and fed to the same
parsers that live sensors and replay use. Allowed outcomes are a result or the border's own error.
"""

import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from app.terminal.thresholds import at_most
from sensors.types import InputError

MAX_GROWTH_MB = 100.0
TRICKS = 6


class Fuzzer:
    """Mutates bytes; equal seeds make equal bytes."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def mutate(self, data: bytes) -> bytes:
        """One to four tricks."""
        out = bytearray(data)
        for _ in range(int(self.rng.integers(1, 5))):
            self._trick(out)
        return bytes(out)

    def pieces(self, data: bytes) -> list[bytes]:
        """The same bytes in up to six reads."""
        edges = sorted(int(e) for e in self.rng.integers(0, len(data) + 1, self.rng.integers(6)))
        return [data[a:b] for a, b in zip([0, *edges], [*edges, len(data)], strict=True)]

    def _trick(self, out: bytearray) -> None:
        rng, size = self.rng, max(len(out), 1)
        at, num = int(rng.integers(size)), int(rng.integers(1, max(size // 4, 2)))
        kind = rng.integers(TRICKS)
        if kind == 0:
            for k in rng.integers(size, size=8):
                out[k : k + 1] = rng.bytes(1)
        elif kind == 1:
            del out[at : at + num]
        elif kind == 2:
            out[at:at] = out[at : at + num]
        elif kind == 3:
            out[at : at + 4] = int(rng.choice([0, 1, 2**31, 2**32 - 1])).to_bytes(4, "little")
        elif kind == 4:
            out[at:at] = rng.bytes(num)
        else:
            out[at : at + num] = bytes(num)


def measure_fuzz(num: int, seed: int) -> dict[str, Any]:
    """`num` inputs, shared out as BORDERS says; the report holds metrics and thresholds."""
    import psutil
    from tqdm import tqdm

    process, escaped = psutil.Process(os.getpid()), list[str]()
    metrics: dict[str, Any] = {}
    growth = 0.0
    with TemporaryDirectory() as folder:
        for name, (make, share) in BORDERS.items():
            fuzzer = Fuzzer(seed)
            feed, count = make(fuzzer, Path(folder)), max(int(num * share), 1)
            feed()
            before = process.memory_info().rss
            for k in tqdm(range(count), desc=name, disable=None):
                try:
                    feed()
                except Exception as error:  # what this command looks for
                    escaped.append(f"{name} {k}: {error!r}")
            growth = max(growth, (process.memory_info().rss - before) / 2**20)
            metrics[f"{name}_inputs"] = count
    metrics["escaped"] = escaped[:20]
    for line in escaped[:5]:
        print(line)
    thresholds = [
        at_most("escaped_exceptions", len(escaped), 0),
        at_most("memory_growth_mb", growth, MAX_GROWTH_MB),
    ]
    return {"metrics": metrics, "bars": thresholds}


def _serial(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    from sensors.cameras.openiris import MARK, Framing
    from sensors.picture import BadPictureError, JpegDecoder
    from sensors.standins.eye_pictures import film

    decode = JpegDecoder()
    line = b"".join(MARK + len(d).to_bytes(2, "little") + d for d in film(2, 48, 48))

    def feed() -> None:
        framing = Framing()
        for piece in fuzzer.pieces(fuzzer.mutate(line)):
            for data in framing.feed(piece):
                try:
                    decode(data)
                except BadPictureError:
                    continue

    return feed


def _http(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
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
        try:
            for piece in fuzzer.pieces(fuzzer.mutate(answer)):
                data = body.feed(piece)
                if stream is None and body.content_type:
                    stream = Multipart(body.content_type)
                for part in stream.feed(data) if stream else ():
                    try:
                        decode(part.data)
                    except BadPictureError:
                        continue
        except CameraLostError:
            return

    return feed


def _usb(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    from sensors.cameras.usb.descriptors import DescriptorError, parse
    from sensors.cameras.usb.streaming import Payloads, Probe
    from sensors.picture import BadPictureError, JpegDecoder
    from sensors.standins.eye_pictures import film
    from sensors.standins.usb_descriptors import configuration_descriptor

    decode, descriptor = JpegDecoder(), configuration_descriptor(800, 400, 30)
    (data,) = film(1, 48, 48)
    payloads = [bytes([2, k % 2 | 2 * (k % 3 == 2)]) + data[k::3] for k in range(6)]
    payloads.append(bytes([2, 0x82]) + data)

    def feed() -> None:
        with suppress(DescriptorError):
            parse(fuzzer.mutate(descriptor)).best()
        with suppress(ValueError):
            Probe.unpack(fuzzer.mutate(Probe(1, 1, 333_333).pack()))
        stream = Payloads(100_000)
        for payload in payloads:
            picture = stream.feed(fuzzer.mutate(payload))
            try:
                if picture is not None:
                    decode(picture.data)
            except BadPictureError:
                continue

    return feed


def _osc(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
    from pythonosc.osc_message_builder import OscMessageBuilder

    from app.drive.emotion_port import ADDRESS, words_in

    message = OscMessageBuilder(ADDRESS)
    for value in ("happy", 0.5, 1, True):
        message.add_arg(value)
    inner, outer = OscBundleBuilder(IMMEDIATELY), OscBundleBuilder(IMMEDIATELY)
    inner.add_content(message.build())
    outer.add_content(inner.build())
    outer.add_content(message.build())
    datagrams = [message.build().dgram, outer.build().dgram]

    def feed() -> None:
        words_in(fuzzer.mutate(datagrams[int(fuzzer.rng.integers(2))]))

    return feed


def _head(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    from app.bench import fuzz_head

    return fuzz_head.feed(fuzzer.mutate, lambda n: int(fuzzer.rng.integers(n)))


def _session(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    from sensors.session.files import replay_frames
    from sensors.session.recording import Recording, RecordingWriter
    from sensors.standins.eye_pictures import eye_picture
    from sensors.types import AudioPacket, EyePacket

    whole, damaged = folder / "whole", folder / "damaged"
    with RecordingWriter(whole, created="") as writer:
        for k in range(4):
            writer.append(EyePacket(k * 33_000_000, k % 2, k // 2, eye_picture(k, noise=False)))
            writer.append(AudioPacket(k * 10**7, k * 480, np.zeros(480, np.float32)))
    files = {path.name: path.read_bytes() for path in sorted(whole.iterdir())}
    open_card = files["session.json"].replace(b'"closed": true', b'"closed": false')

    def feed() -> None:
        shutil.rmtree(damaged, ignore_errors=True)
        damaged.mkdir()
        for name, data in files.items():
            (damaged / name).write_bytes(data)
        if fuzzer.rng.random() < 0.5:  # one that has to be repaired
            (damaged / "session.json").write_bytes(open_card)
        name = str(fuzzer.rng.choice(sorted(files)))
        (damaged / name).write_bytes(fuzzer.mutate((damaged / name).read_bytes()))
        try:
            with Recording(damaged) as recording:
                for _ in replay_frames(recording):
                    pass
        except InputError:
            return

    return feed


# Sessions are files that are written and repaired: one costs as much as a hundred of the others.
BORDERS = {
    "serial": (_serial, 0.25),
    "http": (_http, 0.25),
    "usb": (_usb, 0.25),
    "osc": (_osc, 0.1),
    "head": (_head, 0.1),
    "session": (_session, 0.05),
}
