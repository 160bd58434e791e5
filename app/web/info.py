"""Settings of the web server, passed to its process at the start."""

import ipaddress
import socket
from dataclasses import dataclass

import psutil

from render.types import SHARED_DENSITY, Density
from sensors.types import LOOPBACK


@dataclass(frozen=True)
class ServerInfo:
    """Crosses to the server's process as JSON."""

    host: str  # address to listen at
    port: int  # 0: any that is free
    avatar: str
    gaussians: Density = SHARED_DENSITY
    page: bool = True  # False: JSON only, for a `ws://` target
    microphone: bool = False  # the run listens to the page's microphone
    head: bool = False  # ... and to its headset
    sound: bool = False  # the page plays the partners of a call
    targets: bool = False  # a calibration: the page shows where to look, and no head
    gains: str | None = None  # path of a gains file for the JSON
    seats: str | None = None  # handle of a call's seats: partners are shown too

    @property
    def what(self) -> str:
        return "page" if self.page else "face as JSON"

    @property
    def is_local(self) -> bool:
        return is_loopback(self.host)

    @property
    def hosts(self) -> list[str]:
        """What a headset can type to reach this machine."""
        if self.host not in ("0.0.0.0", "::"):
            return [self.host]
        known = [entry for net in psutil.net_if_addrs().values() for entry in net]
        found = [entry.address for entry in known if entry.family == socket.AF_INET]
        return [address for address in found if not is_loopback(address)] or [LOOPBACK]


def is_loopback(host: str) -> bool:
    """Whether a host name or address can only mean this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False
