"""Framing of HTTP and serial pictures from bytes alone: any split, any dirt, bounded memory."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensors.cameras.multipart import MAX_BUFFER, HttpBody, Multipart
from sensors.cameras.openiris import MARK, Framing
from sensors.picture import BadPictureError, CameraLostError, JpegDecoder, check_content
from sensors.standins.eye_pictures import eye_picture, film, jpeg, zero_middle

FILM = film(3, 64, 48)
HEAD = (
    b"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=frame\r\n"
    b"Transfer-Encoding: chunked\r\n\r\n"
)


def multipart(pictures: list[bytes], *, length: bool = True) -> bytes:
    body = b""
    for k, data in enumerate(pictures):
        body += b"\r\n--frame\r\nContent-Type: image/jpeg\r\nX-Timestamp: %d.000250\r\n" % k
        body += b"Content-Length: %d\r\n" % len(data) if length else b""
        body += b"\r\n" + data
    return body + b"\r\n--frame"


def chunked(body: bytes, size: int) -> bytes:
    pieces = [body[at : at + size] for at in range(0, len(body), size)]
    return b"".join(b"%x\r\n%b\r\n" % (len(piece), piece) for piece in pieces)


def cut(data: bytes, cuts: list[int]) -> list[bytes]:
    edges = [0, *sorted(c % (len(data) + 1) for c in cuts), len(data)]
    return [data[a:b] for a, b in zip(edges, edges[1:], strict=False)]


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(0, 20_000), max_size=20), st.integers(1, 900), st.booleans())
def test_any_split_of_an_http_stream_gives_the_same_pictures(
    cuts: list[int], size: int, length: bool
) -> None:
    body, parts, stream = HttpBody(), [], None
    for piece in cut(HEAD + chunked(multipart(FILM, length=length), size), cuts):
        data = body.feed(piece)
        if body.content_type and stream is None:
            stream = Multipart(body.content_type)
        if stream is not None:
            parts += stream.feed(data)
    tail = b"" if length else b"\r\n"
    assert [p.data for p in parts] == [data + tail for data in FILM]
    assert [p.device_ns for p in parts] == [k * 10**9 + 250_000 for k in range(3)]


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(0, 20_000), max_size=20), st.binary(max_size=40))
def test_any_split_of_a_serial_line_gives_the_same_pictures(cuts: list[int], dirt: bytes) -> None:
    line = b"".join(
        dirt.replace(b"\xff", b"") + MARK + len(d).to_bytes(2, "little") + d for d in FILM
    )
    framing, got = Framing(), []
    for piece in cut(line, cuts):
        got += framing.feed(piece)
    assert got == FILM


def test_a_serial_picture_with_missing_bytes_costs_only_itself() -> None:
    packets = [MARK + len(d).to_bytes(2, "little") + d for d in FILM]
    assert Framing().feed(packets[0][:-50] + packets[1] + packets[2]) == FILM[1:]


def test_garbage_is_counted_and_not_kept() -> None:
    stream, framing = Multipart("multipart/x; boundary=frame"), Framing()
    rng = np.random.default_rng(0)
    for _ in range(100):
        noise = rng.bytes(100_000)
        assert stream.feed(noise) == []
        framing.feed(noise)
    assert stream.garbage_bytes > 9_000_000
    assert len(stream._buffer) < MAX_BUFFER
    assert len(framing._buffer) < 1 << 17
    (part,) = stream.feed(b"--frame\r\nContent-Length: 3\r\n\r\nabc")
    assert part.data == b"abc"


@pytest.mark.parametrize(
    "head",
    [
        b"HTTP/1.1 404 Not Found\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\n\r\n",
        b"x" * 20_000,
        HEAD + b"no size\r\n",
        HEAD + b"0\r\n\r\n",
    ],
)
def test_what_is_no_picture_stream_is_refused(head: bytes) -> None:
    with pytest.raises(CameraLostError):
        HttpBody().feed(head)


def test_only_whole_jpegs_are_pictures() -> None:
    image = eye_picture(1, 64, 48)
    data = jpeg(image, 95)
    assert np.abs(JpegDecoder()(data).astype(int) - image).mean() < 3
    for bad in (
        b"",
        data[:-2],
        data[: len(data) // 2] + b"\xff\xd9",
        zero_middle(data),
        b"\xff\xd8\xff\xd9",
    ):
        with pytest.raises(BadPictureError):
            JpegDecoder()(bad)


def test_a_picture_without_content_is_no_eye() -> None:
    check_content(eye_picture(0))
    for flat in (np.full((400, 400), 7, np.uint8), np.zeros((8, 8), np.uint8)):
        with pytest.raises(BadPictureError):
            check_content(flat)


@pytest.mark.parametrize("head", ["404 Not Found", "200 OK\r\nContent-Type: text/html"])
def test_the_page_of_a_camera_is_no_stream_of_it(head: str) -> None:
    """Red before: told what was expected and got, and not what to give instead."""
    with pytest.raises(CameraLostError, match="; give the address of the camera's stream"):
        HttpBody().feed(f"HTTP/1.1 {head}\r\n\r\n".encode())
