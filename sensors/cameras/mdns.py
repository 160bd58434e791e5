"""Eye cameras that announce themselves on the local network, as OpenIris does.

Asks the network, so only where the user asks for it: `livedrive devices --network`.
"""

from collections.abc import Iterator, Sequence

from sensors.cameras.discovery import FoundDevice
from sensors.mdns import announced

SERVICE = "_openiristracker._tcp.local."
PORT = b"stream_port"  # of the pictures, in the announcement; else the service's own


def network_cameras(
    seconds: float = 3.0, interfaces: Sequence[str] | None = None
) -> Iterator[FoundDevice]:
    """Cameras that answer within `seconds`; `interfaces`: local addresses, default all."""
    for found in announced(SERVICE, "devices --network", seconds, interfaces):
        port = found.properties.get(PORT) or b""
        number = int(port) if port.isdigit() and len(port) < 6 else found.port
        yield FoundDevice("network", f"http://{found.host}:{number}/", found.name, "MJPEG", "")
