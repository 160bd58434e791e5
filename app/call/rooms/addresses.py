"""Which address of this machine others can reach."""

import socket

import psutil

from sensors.types import LOOPBACK


def own_address() -> str:
    """The first IPv4 address that is not loopback; 127.0.0.1 where there is none."""
    for entries in psutil.net_if_addrs().values():
        for entry in entries:
            if entry.family == socket.AF_INET and not entry.address.startswith(
                ("127.", "169.254.")
            ):
                return entry.address
    return LOOPBACK
