"""An avatar's file on its way: offered by its owner, sent once to those who said that they take it.

It is packed, at most 1 MB, and goes in parts over the reliable channel, again and again until
everybody who wants it has it. Who receives it checks its size, its hash and then the avatar itself.
"""

import hashlib
import lzma
import struct
from collections.abc import Iterable, Mapping
from pathlib import Path

from app.call.wire.agreement import Hello
from app.call.wire.packet import MalformedError
from sensors import files
from sensors.types import InputError

MAX_PACKED = 1_000_000  # bytes
MAX_FILE = 4_000_000  # bytes that it may unpack to
MEMORY = 32 << 20  # bytes that unpacking may take
PART = 1024  # bytes; what passes from one room server to another is one datagram
PARTS_A_STEP = 128  # 130 kB a second
HEAD = struct.Struct("<HI")  # number of the part, bytes of all


class Parcel:
    """The file that this end offers."""

    def __init__(self, path: Path) -> None:
        """Raises InputError where the file is too large to be sent."""
        data = files.read_bytes(path)
        self.packed = lzma.compress(data)
        self.digest = hashlib.sha256(data).hexdigest()
        if len(self.packed) > MAX_PACKED or len(data) > MAX_FILE:
            raise InputError(
                f"--offer-avatar: expected a file of {MAX_PACKED} bytes at most when packed, got "
                f"{len(self.packed)} of {path}; make it with fewer strands of hair"
            )
        self._next = 0

    def parts(self) -> list[bytes]:
        """The next few parts; begins again after the last."""
        count = -(-len(self.packed) // PART)
        numbers = [(self._next + k) % count for k in range(min(PARTS_A_STEP, count))]
        self._next = (numbers[-1] + 1) % count
        head = len(self.packed)
        return [HEAD.pack(n, head) + self.packed[n * PART : (n + 1) * PART] for n in numbers]


class Receipt:
    """The parts of a partner's file received so far."""

    def __init__(self, digest: str, size: int) -> None:
        self.digest, self._size = digest, size
        self._parts: dict[int, bytes] = {}

    def add(self, part: bytes) -> bytes | None:
        """The file, once it is whole. Raises MalformedError for what is not of it."""
        if len(part) < HEAD.size:
            raise MalformedError("avatar: expected a part of a file, got less")
        (number, size), body = HEAD.unpack_from(part), part[HEAD.size :]
        count = -(-self._size // PART)
        wanted = min(PART, self._size - number * PART)
        if size != self._size or size > MAX_PACKED or number >= count or len(body) != wanted:
            raise MalformedError(f"avatar: expected a part of {self._size} bytes, got another")
        self._parts[number] = body
        if len(self._parts) < count:
            return None
        packed = b"".join(self._parts[n] for n in range(count))
        self._parts.clear()
        return self._unpacked(packed)

    def _unpacked(self, packed: bytes) -> bytes:
        unpacker = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=MEMORY)
        try:
            data = unpacker.decompress(packed, MAX_FILE + 1)
        except lzma.LZMAError:
            data = b""
        if len(data) > MAX_FILE or hashlib.sha256(data).hexdigest() != self.digest:
            raise MalformedError("avatar: expected the file that was offered, got another")
        return data


def still_here(found: Mapping[str, bytes], here: Iterable[Hello]) -> dict[str, bytes]:
    """Of files by digest those of people who are here: others make room for who comes."""
    wanted = {hello.parcel for hello in here}
    return {digest: data for digest, data in found.items() if digest in wanted}
