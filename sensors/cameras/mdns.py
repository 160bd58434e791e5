"""Eye cameras that announce themselves on the local network, as OpenIris does (mDNS, RFC 6762).

Asks the network, so only where the user asks for it: `livedrive devices --network`.
"""

import time
from collections.abc import Iterator, Sequence

from sensors.cameras.discovery import FoundDevice
from sensors.types import InputError

SERVICE = "_openiristracker._tcp.local."
PORT = b"stream_port"  # of the pictures, in the announcement; else the service's own
ANSWER_MS = 1500


def network_cameras(
    seconds: float = 3.0, interfaces: Sequence[str] | None = None
) -> Iterator[FoundDevice]:
    """Cameras that answer within `seconds`; `interfaces`: local addresses, default all."""
    try:
        from zeroconf import InterfaceChoice, IPVersion, ServiceBrowser, Zeroconf
    except ImportError as error:
        raise InputError(
            f"devices --network: expected zeroconf, got {error}; run: pip install livedrive[web]"
        ) from None
    names: list[str] = []

    def heard(**told: object) -> None:
        names.append(str(told["name"]))

    chosen = list(interfaces) if interfaces else InterfaceChoice.All
    try:
        network = Zeroconf(interfaces=chosen, ip_version=IPVersion.V4Only)
    except OSError as error:
        raise InputError(
            f"devices --network: expected a network, got: {error.strerror or error}; connect one"
        ) from None
    try:
        ServiceBrowser(network, SERVICE, handlers=[heard])
        time.sleep(seconds)
        for name in sorted(set(names)):
            found = network.get_service_info(SERVICE, name, ANSWER_MS)
            addresses = found.parsed_addresses(IPVersion.V4Only) if found else []
            if found and addresses:
                port = (found.properties or {}).get(PORT) or b""
                number = int(port) if port.isdigit() and len(port) < 6 else found.port
                shown = "".join(c for c in name.removesuffix(f".{SERVICE}") if c.isprintable())
                spec = f"http://{addresses[0]}:{number}/"
                yield FoundDevice("network", spec, shown[:40], "MJPEG", "")
    finally:
        network.close()
