"""The programs that `--send` can reach: one row a scheme.

To add a protocol: a file in app/sinks/protocols/ with its encoder, and a row here.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

from sensors.types import Clock, InputError

if TYPE_CHECKING:
    from app.sinks.protocols.face import Encoder
    from app.sinks.protocols.send import Destination, Renewed, SendSink
    from app.web.sink import WebSink
    from render.decoder.decoder import Decoder


MAX_PATH = 256  # bytes; every datagram holds it, and `--head livelink:` reads no longer name


@dataclass(frozen=True)
class Address:
    """A URL of `--send`, read."""

    url: str
    scheme: str
    host: str
    port: int
    path: str  # without slashes at its ends; may be empty


@dataclass(frozen=True)
class SinkScheme:
    """One scheme. `open` gets the address and returns the sink that serves it, which may be one
    that serves others, too; it raises InputError at an address that cannot be used."""

    open: "Callable[[Address, Outlet], SendSink | WebSink]"
    example: str  # URL; its port is the default
    help: str
    path: str = ""  # what one behind the port names; empty: none is taken


class Outlet:
    """What the schemes share: who is driven, the gains, and one thread for all datagrams."""

    def __init__(
        self, decoder: "Decoder", avatar: str, clock: Clock, gains: Path | None = None
    ) -> None:
        """Raises InputError at a gains file that is wrong."""
        from app.sinks.protocols.face import FaceReader

        self.avatar, self.clock, self.gains = avatar, clock, gains
        self._reader = FaceReader(decoder, gains)
        self._sender: SendSink | None = None

    def datagrams(self, address: Address, encode: "Encoder") -> "SendSink":
        """Send every tick to the address over UDP."""
        from app.sinks.protocols.send import Destination

        return self.followed(address.url, Destination(address.host, address.port, encode), None)

    def followed(
        self, url: str, place: "Destination | None", renewed: "Renewed | None"
    ) -> "SendSink":
        """The same to a place that may change, or is not known yet."""
        from app.sinks.protocols.send import Receiver, SendSink

        self._sender = self._sender or SendSink(self._reader)
        self._sender.receivers.append(Receiver(url, place, renewed))
        return self._sender


def _vmc(address: Address, outlet: Outlet) -> "SendSink":
    from app.sinks.protocols.vmc import VmcEncoder

    return outlet.datagrams(address, VmcEncoder())


def _vrchat(address: Address, outlet: Outlet) -> "SendSink":
    """The path is the prefix of the parameters; the host `auto` is looked for, and asked which of
    them its avatar has as bits, then again as it may start late and avatars may change."""
    from app.sinks.protocols import oscquery
    from app.sinks.protocols.send import Destination
    from app.sinks.protocols.vrchat import PREFIX, VRChatEncoder

    if address.host != "auto":
        return outlet.datagrams(address, VRChatEncoder(address.path or PREFIX))
    there = oscquery.find()
    if there is None:
        print(f"livedrive: {address.url}: no VRChat with OSC on is here yet", file=sys.stderr)

    def place() -> Destination | None:
        if there is None:
            return None
        path = address.path or there.prefix or PREFIX
        bits = there.bits if path == there.prefix else None
        return Destination(there.host, there.port, VRChatEncoder(path, bits))

    def renewed() -> Destination | None:
        nonlocal there
        before, there = there, oscquery.again(there)
        return None if there == before else place()

    return outlet.followed(address.url, place(), renewed)


def _livelink(address: Address, outlet: Outlet) -> "SendSink":
    """The path is the name of the subject."""
    from app.sinks.protocols.livelink import SUBJECT, LiveLinkEncoder

    return outlet.datagrams(address, LiveLinkEncoder(address.path or SUBJECT))


def _ws(address: Address, outlet: Outlet) -> "WebSink":
    from app.web.info import ServerInfo
    from app.web.sink import WebSink

    gains = str(outlet.gains.resolve()) if outlet.gains else None
    info = ServerInfo(address.host, address.port, outlet.avatar, page=False, gains=gains)
    return WebSink(info, outlet.clock)


SCHEMES: dict[str, SinkScheme] = {
    "vmc": SinkScheme(_vmc, "vmc://127.0.0.1:39539", "VMC programs: VSeeFace, Warudo, VNyan"),
    "vrchat": SinkScheme(
        _vrchat, "vrchat://127.0.0.1:9000", "VRChat over OSC; vrchat://auto looks for it", "prefix"
    ),
    "livelink": SinkScheme(
        _livelink, "livelink://127.0.0.1:11111", "Live Link Face: Unreal Engine", "subject"
    ),
    "ws": SinkScheme(
        _ws, "ws://127.0.0.1:9001", "JSON that programs fetch from here over WebSocket"
    ),
}
HELP = "; ".join(f"{entry.example} ({entry.help})" for entry in SCHEMES.values())


def parse(url: str) -> Address:
    """Read one URL; raises InputError naming the known schemes."""
    known = ", ".join(entry.example for entry in SCHEMES.values())
    problem = InputError(f"--send: expected an address like {known}, got {url!r}; name one")
    try:
        parts = urlsplit(url)
        if parts.scheme not in SCHEMES or not parts.hostname:
            raise problem
        usual = urlsplit(SCHEMES[parts.scheme].example).port
        port = usual if parts.port is None else parts.port
    except ValueError:
        raise problem from None
    path = unquote(parts.path.strip("/"))
    if not port or not path.isprintable():
        raise problem
    if path and not SCHEMES[parts.scheme].path:
        raise InputError(
            f"--send: expected nothing behind the port of {parts.scheme}://, got {'/' + path!r}; "
            f"try --send {parts.scheme}://{parts.netloc}"
        )
    if (size := len(path.encode())) > MAX_PATH:
        raise InputError(
            f"--send: expected a {SCHEMES[parts.scheme].path} of {MAX_PATH} bytes at most behind "
            f"the port of {parts.scheme}://, got {size}; give a shorter one"
        )
    return Address(url, parts.scheme, parts.hostname, port, path)


def open_all(urls: Sequence[str], outlet: Outlet) -> "list[SendSink | WebSink]":
    """The sinks that serve these URLs, each once. Raises InputError before anything is opened
    where a URL is wrong."""
    addresses = [parse(url) for url in urls]
    sinks = [SCHEMES[address.scheme].open(address, outlet) for address in addresses]
    return list(dict.fromkeys(sinks))
