"""One WebRTC connection: ICE, DTLS and SRTP by aiortc, with our own packets in it.

aiortc would encode, and play through a jitter buffer of its own (70 to 400 ms); it takes packets
that are encoded already, and its receivers' handler is replaced. Both are in this file only.
"""

import asyncio
import re
from collections.abc import Awaitable, Callable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Literal

from sensors.types import SAMPLE_RATE

if TYPE_CHECKING:
    from av import Packet

Stream = Literal["voice", "codes"]
MEDIA: tuple[Stream, ...] = ("voice", "codes")  # in the order of their lines in the SDP
TIME_BASE = Fraction(1, SAMPLE_RATE)
WAITING = 20  # packets that wait to be sent; more are dropped
CANDIDATE = re.compile(r"(?m)^(a=candidate:\S+ \d+ udp \d+ )(\S+) (\d+)( typ \S+).*$")
Reroute = Callable[[str, int], Awaitable[tuple[str, int]]]


class Connection:
    """To one partner, or to a server that passes on."""

    def __init__(
        self,
        on_packet: Callable[[Stream, bytes], None] | None,  # None: nothing is received
        on_message: Callable[[bytes], None] | None = None,  # None: no data channel
        sends: bool = True,
        ice_servers: Sequence[str] = (),  # stun:HOST:PORT, turn:NAME:PASSWORD@HOST:PORT
        reroute: Reroute | None = None,  # where to send instead of to a candidate
        on_open: Callable[[], None] | None = None,  # messages can be said
    ) -> None:
        from aiortc import RTCConfiguration, RTCPeerConnection

        servers = [_ice_server(url) for url in ice_servers]
        self.pc = RTCPeerConnection(RTCConfiguration(iceServers=servers))
        self._on_packet, self._reroute = on_packet, reroute
        self._tracks = {stream: _track() for stream in MEDIA if sends}
        self._channel = None
        if on_message is not None:
            self._channel = self.pc.createDataChannel("control")
            self._channel.on("message", lambda m: on_message(m if isinstance(m, bytes) else b""))
            if on_open is not None:
                self._channel.on("open", on_open)
            self.pc.on("datachannel", lambda c: c.on("message", on_message))
        self.pc.on("track", self._receive)

    @property
    def state(self) -> str:
        """new, connecting, connected, failed or closed."""
        return self.pc.connectionState

    async def offer(self) -> str:
        self._add_tracks()
        return await self._describe(await self.pc.createOffer())

    async def answer(self, offer: str) -> str:
        await self._set_remote(offer, "offer")
        self._add_tracks()
        return await self._describe(await self.pc.createAnswer())

    async def accept(self, answer: str) -> None:
        await self._set_remote(answer, "answer")

    def send(self, stream: Stream, payload: bytes, pts: int) -> bool:
        """False: nobody takes it fast enough, or there is nobody yet."""
        queue = self._tracks[stream].queue if stream in self._tracks else None
        if queue is None or self.state != "connected" or queue.full():
            return False
        queue.put_nowait((payload, pts))
        return True

    @property
    def channel_is_open(self) -> bool:
        return self._channel is not None and self._channel.readyState == "open"

    def say(self, message: bytes) -> bool:
        """Over the reliable channel; False while it is not open."""
        if self._channel is None or not self.channel_is_open:
            return False
        self._channel.send(message)
        return True

    async def close(self) -> None:
        await self.pc.close()

    def _add_tracks(self) -> None:
        for track in self._tracks.values():
            self.pc.addTrack(track)

    async def _describe(self, description) -> str:  # noqa: ANN001
        await self.pc.setLocalDescription(description)
        return _plain(self.pc.localDescription.sdp)

    async def _set_remote(self, sdp: str, kind: str) -> None:
        from aiortc import RTCSessionDescription

        if self._reroute is not None:
            sdp = await rerouted(sdp, self._reroute)
        await self.pc.setRemoteDescription(RTCSessionDescription(_plain(sdp), kind))

    def _receive(self, track: object) -> None:
        """Every receiver so far gets our handler; they come in the order of the SDP's lines."""
        if self._on_packet is None:
            return
        for stream, receiver in zip(MEDIA, self.pc.getReceivers(), strict=False):
            receiver._handle_rtp_packet = self._handler(stream)

    def _handler(self, stream: Stream):  # noqa: ANN202
        assert self._on_packet is not None
        take = self._on_packet

        async def handle(packet, arrival_time_ms: int) -> None:  # noqa: ANN001, ARG001
            take(stream, packet.payload)

        return handle


async def rerouted(sdp: str, reroute: Reroute) -> str:
    """The description with each candidate's address replaced."""
    parts, at = [], 0
    for match in CANDIDATE.finditer(sdp):
        head, host, port, kind = match.groups()
        host, port = await reroute(host, int(port))
        parts += [sdp[at : match.start()], f"{head}{host} {port}{kind}"]
        at = match.end()
    return "".join([*parts, sdp[at:]])


def bind_only(address: str) -> None:
    """Offer candidates of this address only, and loopback if it is that."""
    import aioice.ice

    aioice.ice.get_host_addresses = lambda use_ipv4, use_ipv6: [address]  # noqa: ARG005


def _plain(sdp: str) -> str:
    """Without header extensions: eight bytes less a packet."""
    return "".join(line for line in sdp.splitlines(True) if not line.startswith("a=extmap"))


def _ice_server(url: str):  # noqa: ANN202
    from aiortc import RTCIceServer

    match = re.fullmatch(r"(turns?):([^:@]+):([^@]+)@(.+)", url)
    if match:
        scheme, name, password, host = match.groups()
        return RTCIceServer(f"{scheme}:{host}", name, password)
    return RTCIceServer(url)


def _track():  # noqa: ANN202
    import av
    from aiortc import MediaStreamTrack

    class Track(MediaStreamTrack):
        """Hands packets to aiortc as they come."""

        kind = "audio"

        def __init__(self) -> None:
            super().__init__()
            self.queue: asyncio.Queue[tuple[bytes, int]] = asyncio.Queue(WAITING)

        async def recv(self) -> "Packet":
            payload, pts = await self.queue.get()
            packet = av.Packet(payload)
            packet.pts, packet.time_base = pts, TIME_BASE
            return packet

    return Track()
