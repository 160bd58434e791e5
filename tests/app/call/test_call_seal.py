"""Sealing and invites: nothing is read, forged or repeated, and a link says all or nothing."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.call.wire.invite import Invite, parse
from app.call.wire.seal import OVERHEAD, WINDOW, Opener, Sealer, SealError, derive
from sensors.types import InputError

SECRET, IDENTITY = bytes(range(16)), bytes(range(16, 32))
DIRECT = Invite("direct", "192.0.2.7", 8765, SECRET, bytes(32))


def pair() -> tuple[Sealer, Opener]:
    return Sealer(SECRET, IDENTITY, "voice"), Opener(SECRET, IDENTITY, "voice")


@given(st.lists(st.binary(max_size=300), max_size=20))
def test_what_is_sealed_is_opened(contents: list[bytes]) -> None:
    sealer, opener = pair()
    for number, content in enumerate(contents):
        sealed = sealer.seal(content)
        assert len(sealed) == len(content) + OVERHEAD
        assert opener.open(sealed) == (number, content)


@given(st.binary(min_size=1, max_size=300), st.data())
def test_no_bit_can_be_changed(content: bytes, data: st.DataObject) -> None:
    sealer, opener = pair()
    sealed = bytearray(sealer.seal(content))
    bit = data.draw(st.integers(0, 8 * len(sealed) - 1))
    sealed[bit // 8] ^= 1 << bit % 8
    with pytest.raises(SealError):
        opener.open(bytes(sealed))
    assert content not in bytes(sealed) or len(content) < 4


@given(st.binary(max_size=100))
def test_forgeries_are_refused(data: bytes) -> None:
    with pytest.raises(SealError):
        pair()[1].open(data)


def test_repeats_are_refused_and_late_ones_taken_once() -> None:
    sealer, opener = pair()
    sealed = [sealer.seal(bytes([k % 256])) for k in range(WINDOW + 10)]
    for k in (5, 3, 4, 9):
        assert opener.open(sealed[k])[0] == k
    for k in (5, 3, 4, 9):
        with pytest.raises(SealError, match="before"):
            opener.open(sealed[k])
    opener.open(sealed[WINDOW + 9])
    assert opener.open(sealed[10])[0] == 10  # just inside
    with pytest.raises(SealError):
        opener.open(sealed[8])  # too old to tell


def test_a_forged_far_counter_does_not_shut_out_the_true_ones() -> None:
    sealer, opener = pair()
    opener.open(sealer.seal(b"one"))
    with pytest.raises(SealError):
        opener.open(b"\xff\xff\xff\xff" + bytes(40))
    assert opener.open(sealer.seal(b"two")) == (1, b"two")


def test_a_counter_is_never_used_twice() -> None:
    sealer, _ = pair()
    sealer.seal(b"", 7)
    with pytest.raises(SealError):
        sealer.seal(b"", 7)
    sealer.seal(b"", 8)


def test_streams_senders_and_secrets_have_keys_of_their_own() -> None:
    sealed = Sealer(SECRET, IDENTITY, "voice").seal(b"hello")
    others = [
        Opener(SECRET, IDENTITY, "codes"),
        Opener(SECRET, bytes(16), "voice"),
        Opener(bytes(16), IDENTITY, "voice"),
    ]
    for other in others:
        with pytest.raises(SealError):
            other.open(sealed)


def test_keys_are_hkdf() -> None:
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.kdf.hkdf import HKDF

    reference = HKDF(hashes.SHA256(), 32, IDENTITY, b"livedrive call 1 voice").derive(SECRET)
    assert derive(SECRET, "voice", IDENTITY) == reference


@given(
    st.binary(min_size=16, max_size=16),
    st.binary(min_size=32, max_size=32),
    st.integers(1, 65535),
    st.sampled_from(["example.org", "192.0.2.1", "2001:db8::1"]),
    st.sampled_from(["", "choir"]),
)
def test_an_invite_comes_back_from_its_link(
    secret: bytes, fingerprint: bytes, port: int, host: str, room: str
) -> None:
    kind = "room" if room else "direct"
    token = "1,janus,janus.plugin.videoroom:ab+/=" if room else ""
    invite = Invite(kind, host, port, secret, fingerprint, room, token)  # type: ignore[arg-type]
    assert parse(f" {invite}\n") == invite


def test_the_secret_is_in_no_log_and_not_in_the_pin() -> None:
    link = str(DIRECT)
    assert link.split("#")[1][:22] not in repr(DIRECT)
    assert SECRET.hex() not in DIRECT.pin and len(DIRECT.pin) == 32


@pytest.mark.parametrize(
    "link",
    [
        "",
        "hello",
        "https://example.org/",
        str(DIRECT)[:-1],
        str(DIRECT).split("#")[0],
        str(DIRECT).replace("8765", "0"),
        str(DIRECT).replace("8765", "99999"),
        str(DIRECT).replace("192.0.2.7", ""),
        str(DIRECT).split(".AAAA")[0],  # no fingerprint beyond this machine
        str(DIRECT).replace("/#", "/room#"),
        str(DIRECT).replace("livedrive:", "livedrive-room:"),
        "livedrive://x:1/#" + "A" * 5000,
    ],
)
def test_half_an_invite_is_refused_in_one_line_without_its_secret(link: str) -> None:
    with pytest.raises(InputError) as caught:
        parse(link)
    line = str(caught.value)
    assert "\n" not in line and "livedrive call host" in line and len(line) < 400
    assert "AAECAwQFBgcICQoLDA0ODw" not in line
