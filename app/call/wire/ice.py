"""STUN and TURN servers, as `--ice` names them."""

import re
from dataclasses import dataclass

from sensors.types import InputError

URL = re.compile(
    r"(?:(?P<stun>stuns?):|(?P<turn>turns?):(?P<name>[^\s:@]+):(?P<password>[^\s@]+)@)"
    r"(?P<host>[^\s:/@?]+)(?P<port>:\d{1,5})?(?P<over>\?transport=(?:udp|tcp))?"
)


@dataclass(frozen=True)
class IceServer:
    """Helps two ends to find a way to each other; TURN passes on what finds no direct one."""

    url: str  # without name and password
    name: str | None = None
    password: str | None = None


def parse(text: str) -> IceServer:
    """Raises InputError."""
    found = URL.fullmatch(text)
    if found is None or int((found["port"] or ":0")[1:]) > 65535:
        raise InputError(
            f"--ice: expected stun:HOST:PORT or turn:NAME:PASSWORD@HOST:PORT, got {text!r}; "
            "try stun:stun.example.org:3478"
        )
    parts = (found["stun"] or found["turn"], ":", found["host"], found["port"], found["over"])
    return IceServer("".join(part or "" for part in parts), found["name"], found["password"])
