"""Which address of this machine others can reach."""

import socket
from contextlib import suppress
from ipaddress import ip_address

import psutil

from sensors.types import LOOPBACK

ELSEWHERE = (
    "{} is not an address of this machine: the others reach the call there; outside your network "
    "they see and hear you only with --ice"
)


def own_address() -> str:
    """The first IPv4 address that is not loopback; 127.0.0.1 where there is none."""
    for entries in psutil.net_if_addrs().values():
        for entry in entries:
            if entry.family == socket.AF_INET and not entry.address.startswith(
                ("127.", "169.254.")
            ):
                return entry.address
    return LOOPBACK


def here(address: str) -> str:
    """The IP address of this machine that an address or a name means; empty where it is not of this
    machine, as that of a router."""
    with suppress(OSError, UnicodeError):
        found = socket.getaddrinfo(address.strip("[]"), 0, type=socket.SOCK_DGRAM)
        for family, kind, *_, place in sorted(found, key=lambda row: row[0] != socket.AF_INET):
            with suppress(OSError), socket.socket(family, kind) as probe:
                if not ip_address(place[0]).is_unspecified:
                    probe.bind((place[0], 0))
                    return str(place[0])
    return ""
