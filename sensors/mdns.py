"""What announces itself on the local network (mDNS, RFC 6762).

It asks the network, so only commands that were told to do that call it.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sensors.types import InputError

ANSWER_MS = 1500
MAX_NAME = 40


@dataclass(frozen=True)
class Announced:
    """One service of one machine. Anybody on the network can announce anything."""

    name: str  # printable
    host: str  # IPv4 address
    port: int
    properties: dict[bytes, bytes | None]


def announced(
    service: str,  # e.g. "_oscjson._tcp.local."
    asked_by: str,  # the words that asked for it, for errors
    seconds: float = 3.0,
    interfaces: Sequence[str] | None = None,
) -> Iterator[Announced]:
    """Services that answer within `seconds`; `interfaces`: local addresses, default all.

    Raises InputError without zeroconf or a network.
    """
    try:
        from zeroconf import (
            BadTypeInNameException,
            InterfaceChoice,
            IPVersion,
            ServiceBrowser,
            Zeroconf,
        )
    except ImportError as error:
        raise InputError(
            f"{asked_by}: expected zeroconf, got {error}; run: pip install livedrive[web]"
        ) from None
    names: list[str] = []

    def heard(**told: object) -> None:
        names.append(str(told["name"]))

    chosen = list(interfaces) if interfaces else InterfaceChoice.All
    try:
        network = Zeroconf(interfaces=chosen, ip_version=IPVersion.V4Only)
    except OSError as error:
        raise InputError(
            f"{asked_by}: expected a network, got: {error.strerror or error}; connect one"
        ) from None
    browser = ServiceBrowser(network, service, handlers=[heard])
    try:
        time.sleep(seconds)
        for name in sorted(set(names)):
            try:
                found = network.get_service_info(service, name, ANSWER_MS)
            except BadTypeInNameException:  # whoever announced it may say anything
                continue
            addresses = found.parsed_addresses(IPVersion.V4Only) if found else []
            if found and addresses and found.port:
                shown = "".join(c for c in name.removesuffix(f".{service}") if c.isprintable())
                yield Announced(shown[:MAX_NAME], addresses[0], found.port, found.properties or {})
    finally:
        browser.cancel()  # its thread would outlive the network
        network.close()
