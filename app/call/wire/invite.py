"""An invite: one link that holds where to go, a secret and whose certificate to expect.

    livedrive://192.0.2.7:8765/#SECRET.FINGERPRINT                  two people, directly
    livedrive-room://example.org:8989/choir?token=T#SECRET.FINGERPRINT   a room on a Janus server

Secret and fingerprint stand behind the #, as base64url. No server ever sees them.
"""

import re
from base64 import urlsafe_b64decode, urlsafe_b64encode
from dataclasses import dataclass, replace
from typing import Literal
from urllib.parse import parse_qs, quote, urlsplit

from app.call.wire.seal import SECRET_BYTES, derive
from sensors.types import LOOPBACK, InputError

FINGERPRINT_BYTES = 32  # SHA-256 of the certificate
SCHEMES: dict[str, Literal["direct", "room"]] = {"livedrive": "direct", "livedrive-room": "room"}
ROOM = re.compile(r"[A-Za-z0-9_-]{1,40}")
TOKEN = re.compile(r"[A-Za-z0-9.,:+/=_-]{1,200}")
MAX_LENGTH = 600


def in_url(host: str) -> str:
    """A host as URLs have it: an address of IPv6 in brackets, whether it had some or not."""
    return f"[{host.strip('[]')}]" if ":" in host else host


@dataclass(frozen=True)
class Invite:
    """Whoever has it may join; it is sent to people, never to a server."""

    kind: Literal["direct", "room"]
    host: str
    port: int
    secret: bytes  # 16
    fingerprint: bytes = b""  # 32; empty: no TLS, on this machine only
    room: str = ""
    token: str = ""  # what a room server asks for

    def __str__(self) -> str:
        scheme = next(name for name, kind in SCHEMES.items() if kind == self.kind)
        query = f"?token={quote(self.token, safe='')}" if self.token else ""
        parts = [self.secret, self.fingerprint] if self.fingerprint else [self.secret]
        fragment = ".".join(_text(part) for part in parts)
        return f"{scheme}://{in_url(self.host)}:{self.port}/{self.room}{query}#{fragment}"

    def __repr__(self) -> str:  # the secret stands in no log
        return str(replace(self, secret=b"", token="")) + "..."

    @property
    def url(self) -> str:
        """The WebSocket of the room's server."""
        return f"{'wss' if self.fingerprint else 'ws'}://{in_url(self.host)}:{self.port}"

    @property
    def pin(self) -> str:
        """What a room server asks of those who enter; it tells nothing of the secret."""
        return derive(self.secret, "room pin").hex()[:32]


def parse(link: str) -> Invite:
    """Raises InputError for anything but a whole invite."""
    link = link.strip()
    try:
        if len(link) > MAX_LENGTH:
            raise ValueError(f"{len(link)} characters")
        url = urlsplit(link)
        kind, room = SCHEMES[url.scheme], url.path.lstrip("/")
        token = "".join(parse_qs(url.query).get("token", []))
        secret, _, fingerprint = url.fragment.partition(".")
        invite = Invite(
            kind=kind,
            host=url.hostname or "",
            port=url.port or 0,
            secret=_bytes(secret, SECRET_BYTES),
            fingerprint=_bytes(fingerprint, FINGERPRINT_BYTES) if fingerprint else b"",
            room=room,
            token=token,
        )
        _check(invite)
    except (ValueError, KeyError) as error:
        why = f"scheme {error}" if isinstance(error, KeyError) else str(error)
        raise InputError(
            f"invite: expected a whole link like livedrive://HOST:PORT/#SECRET.FINGERPRINT, got "
            f"{link.partition('#')[0][:60]!r} ({why}); copy what `livedrive call host` printed"
        ) from None
    return invite


def _check(invite: Invite) -> None:
    if not invite.host or not 0 < invite.port < 65536:
        raise ValueError("no host and port")
    if (
        (invite.kind == "room") != bool(invite.room)
        or invite.room
        and not ROOM.fullmatch(invite.room)
    ):
        raise ValueError(f"room {invite.room[:40]!r}")
    if invite.token and not TOKEN.fullmatch(invite.token):
        raise ValueError("token")
    if not invite.fingerprint and invite.host not in (LOOPBACK, "::1", "localhost"):
        raise ValueError("no fingerprint")


def _text(data: bytes) -> str:
    return urlsafe_b64encode(data).decode().rstrip("=")


def _bytes(text: str, length: int) -> bytes:
    data = urlsafe_b64decode(text + "=" * (-len(text) % 4))
    if len(data) != length or _text(data) != text:
        raise ValueError(f"{len(data)} bytes behind the #, {length} expected")
    return data
