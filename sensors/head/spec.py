"""Where the head's pose comes from, in one line: the SPECs of `--head`. A new one is a row here."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from sensors.head import livelink, vmc
from sensors.head.gate import ReadingGate
from sensors.head.links import Decode, PlayedHeadLink, UdpLink
from sensors.head.source import HeadLink, HeadSource
from sensors.types import LOOPBACK, Clock, HeadPacket, InputError

Tell = Callable[[str], None]


@dataclass(frozen=True)
class HeadScheme:
    """One scheme. `open` gets the SPEC; it raises InputError at one that cannot be used, and what
    it returns makes a new link."""

    open: Callable[[str, Clock, Tell], Callable[[], HeadLink]]
    example: str
    help: str


def head_source(spec: str, clock: Clock, tell: Tell) -> HeadSource:
    """Build, and do not open, the tracker of a SPEC. `tell` gets one line where poses are bad."""
    scheme, colon, rest = spec.partition(":")
    if scheme not in SCHEMES or not colon or not rest:
        raise InputError(
            f"--head: expected still, synth, auto or one of {EXAMPLES}, got {spec!r}; "
            "try --head auto"
        )
    return HeadSource(spec, SCHEMES[scheme].open(spec, clock, tell), clock)


def _udp(decoder: Callable[[], Decode], port: int, max_datagram: int):  # noqa: ANN202
    def open_port(spec: str, clock: Clock, tell: Tell) -> Callable[[], HeadLink]:
        host, number = _address(spec, port)

        def connect() -> HeadLink:
            return UdpLink(host, number, decoder(), max_datagram, ReadingGate(spec, tell), clock)

        return connect

    return open_port


def _address(spec: str, port: int) -> tuple[str, int]:
    """Host and port to listen at; this machine alone unless the SPEC names another address."""
    scheme = spec.partition(":")[0]
    try:
        parts = urlsplit(spec)
        number = port if parts.port is None else parts.port
    except ValueError:  # no address, or no port
        parts, number = urlsplit(""), -1
    if not spec.startswith(f"{scheme}://") or number < 0 or parts.path.strip("/"):
        raise InputError(
            f"--head: expected {scheme}://:PORT or {scheme}://HOST:PORT with a port of 0 to 65535, "
            f"got {spec!r}; try {scheme}://:{port}"
        )
    return parts.hostname or LOOPBACK, number


def _path(spec: str) -> Path:
    """What follows the scheme; no shell expands a `~` there."""
    return Path(spec.partition(":")[2]).expanduser()


def _session(spec: str, clock: Clock, tell: Tell) -> Callable[[], HeadLink]:
    from sensors.session.recording import Recording

    with Recording(_path(spec)) as recording:
        poses = [
            packet for e in recording.heads if isinstance(packet := recording.packet(e), HeadPacket)
        ]
    return _played(spec, poses, clock)


def _file(spec: str, clock: Clock, tell: Tell) -> Callable[[], HeadLink]:
    path = _path(spec)
    if not path.is_file():
        raise InputError(f"--head: expected a Live Link Face CSV, got no file {path}; check it")
    return _played(spec, list(livelink.read_csv(path)), clock)


def _played(spec: str, poses: list[HeadPacket], clock: Clock) -> Callable[[], HeadLink]:
    if not poses:
        raise InputError(f"--head: expected poses of a head, got none in {spec}; choose another")
    return lambda: PlayedHeadLink(poses, clock)


SCHEMES = {
    "vmc": HeadScheme(
        _udp(vmc.VmcDecoder, 39539, vmc.MAX_DATAGRAM),
        "vmc://:39539",
        "head and neck bones, or the headset, of a VMC program",
    ),
    "livelink": HeadScheme(
        _udp(lambda: livelink.decode, livelink.PORT, livelink.MAX_DATAGRAM),
        "livelink://:11111",
        "the Live Link Face app of an iPhone",
    ),
    "vrchat": HeadScheme(
        _udp(vmc.TrackerDecoder, 9000, vmc.MAX_DATAGRAM),
        "vrchat://:9000",
        "OSC trackers as VRChat takes them",
    ),
    "session": HeadScheme(_session, "session:DIR", "a recorded session, over and over"),
    "file": HeadScheme(_file, "file:take.csv", "a CSV of Live Link Face, over and over"),
}
EXAMPLES = ", ".join(entry.example for entry in SCHEMES.values())
HELP = "; ".join(f"{entry.example} ({entry.help})" for entry in SCHEMES.values())
