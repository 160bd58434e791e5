"""Reads messages of OSC datagrams from untrusted senders.

python-osc follows nested bundles without end and logs what it cannot read, so it only gets single
messages whose form was checked here. Used by every port that listens (sensors/head, --listen).
"""

from collections.abc import Iterator

MAX_NESTING = 4  # bundles in bundles
MAX_ADDRESS = 256  # bytes
BUNDLE, BUNDLE_HEADER = b"#bundle\0", 16  # bytes, with the time tag
TYPES = frozenset("sifdhTFN")
Value = str | int | float | bool | None


def messages(datagram: bytes, nesting: int = 0) -> Iterator[bytes]:
    """The messages of a datagram and of its bundles, in order; what is malformed is left out."""
    if not datagram.startswith(BUNDLE):
        yield datagram
        return
    place = BUNDLE_HEADER
    while nesting < MAX_NESTING and place + 4 <= len(datagram):
        size = int.from_bytes(datagram[place : place + 4], "big")
        place += 4
        if size == 0 or size % 4 or place + size > len(datagram):
            return
        yield from messages(datagram[place : place + size], nesting + 1)
        place += size


def address(message: bytes) -> str:
    """Where a message goes; empty where that cannot be read."""
    start, end, _ = message[:MAX_ADDRESS].partition(b"\0")
    return start.decode("ascii", "replace") if end and start.startswith(b"/") else ""


def values(message: bytes) -> list[Value] | None:
    """The values of one message; None unless all are of known types and whole."""
    from pythonosc.osc_message import OscMessage, ParseError

    name, _, rest = message.partition(b"\0")
    types = rest[3 - len(name) % 4 :]  # addresses are filled up to words of 4 bytes
    if types[:1] != b",":
        return None
    kinds, end, _ = types[1:].partition(b"\0")
    if not end or not TYPES.issuperset(kinds.decode("latin-1")):
        return None
    try:
        return list(OscMessage(message).params)
    except (ParseError, UnicodeDecodeError):
        return None
