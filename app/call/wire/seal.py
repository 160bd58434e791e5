"""End-to-end encryption: ChaCha20-Poly1305 with a counter nonce.

Each sender has a random `identity` and, derived from it and the invite's secret, one key a stream.
A counter is used once a key, so a nonce never comes twice; a window refuses what was seen before.
"""

import hmac
import re
import struct
from hashlib import sha256
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

SECRET_BYTES = 16
IDENTITY = re.compile(r"[0-9a-f]{32}")
STREAMS = ("voice", "codes", "control")
COUNTER = struct.Struct("<I")
OVERHEAD = COUNTER.size + 16  # bytes that sealing adds
COUNTERS = 2**32
WINDOW = 1024  # counters behind the newest that are still told apart; 10 s of voice and more


class SealError(ValueError):
    """Not sealed with this key, or seen before; counted and dropped."""


def derive(secret: bytes, purpose: str, identity: bytes = b"") -> bytes:
    """32 bytes by HKDF (RFC 5869) with SHA-256; nothing of `secret` can be told from them."""
    drawn = hmac.new(identity, secret, sha256).digest()
    return hmac.new(drawn, b"livedrive call 1 " + purpose.encode() + b"\x01", sha256).digest()


def _cipher(secret: bytes, identity: bytes, stream: str) -> "ChaCha20Poly1305":
    from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

    return ChaCha20Poly1305(derive(secret, stream, identity))


class Sealer:
    """The sending side of one stream."""

    def __init__(self, secret: bytes, identity: bytes, stream: str) -> None:
        self._cipher = _cipher(secret, identity, stream)
        self._next = 0

    def seal(self, plain: bytes, counter: int | None = None) -> bytes:
        """`counter`: default the next one; it may only grow."""
        counter = self._next if counter is None else counter
        if not self._next <= counter < COUNTERS:
            raise SealError(f"seal: expected a counter of {self._next} or more, got {counter}")
        self._next = counter + 1
        head = COUNTER.pack(counter)
        return head + self._cipher.encrypt(bytes(8) + head, plain, b"")


class Opener:
    """The receiving side of one stream."""

    def __init__(self, secret: bytes, identity: bytes, stream: str) -> None:
        self._cipher = _cipher(secret, identity, stream)
        self._newest = -1
        self._seen = 0  # bit k: counter newest - k was opened

    def open(self, sealed: bytes) -> tuple[int, bytes]:
        """Counter and content; SealError for forged, damaged, repeated or very old ones."""
        from cryptography.exceptions import InvalidTag

        if len(sealed) < OVERHEAD:
            raise SealError(f"seal: expected {OVERHEAD} bytes or more, got {len(sealed)}")
        (counter,) = COUNTER.unpack_from(sealed)
        age = self._newest - counter
        if age >= WINDOW or (age >= 0 and self._seen >> age & 1):
            raise SealError(f"seal: counter {counter} came before")
        try:
            nonce = bytes(8) + sealed[: COUNTER.size]
            plain = self._cipher.decrypt(nonce, sealed[COUNTER.size :], b"")
        except InvalidTag:
            raise SealError("seal: expected this call's secret, got another") from None
        if age < 0:
            self._seen = (self._seen << min(-age, WINDOW) | 1) & (1 << WINDOW) - 1
            self._newest = counter
        else:
            self._seen |= 1 << age
        return counter, plain


class Keyring:
    """Keys of all streams of this end and of every partner that has proved to hold the secret."""

    def __init__(self, secret: bytes, identity: str) -> None:
        self.identity = identity  # 32 hex digits
        self._secret = secret
        self._sealers = {s: Sealer(secret, bytes.fromhex(identity), s) for s in STREAMS}
        self._openers: dict[tuple[str, str], Opener] = {}

    def seal(self, stream: str, plain: bytes, counter: int | None = None) -> bytes:
        return self._sealers[stream].seal(plain, counter)

    def open(self, identity: str, stream: str, sealed: bytes) -> tuple[int, bytes]:
        """What `identity` sealed; SealError also for an `identity` that is none, or our own."""
        if identity == self.identity or not IDENTITY.fullmatch(identity):
            raise SealError("seal: expected the identity of somebody else")
        known = self._openers.get((identity, stream))
        opener = known or Opener(self._secret, bytes.fromhex(identity), stream)
        opened = opener.open(sealed)
        self._openers[identity, stream] = opener
        return opened
