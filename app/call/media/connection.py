"""One WebRTC connection: ICE, DTLS and SRTP by aiortc, with our own packets in it.

aiortc would encode, and play through a jitter buffer of its own (70 to 400 ms), so our packets pass
its senders and receivers by.
"""

import asyncio
import re
from collections.abc import Awaitable, Callable, Sequence
from typing import TYPE_CHECKING, Any

from app.call.media.srtp import RtpReceiver, RtpSender, Stream
from app.call.wire import ice

if TYPE_CHECKING:
    from aiortc import RTCDataChannel, RTCSessionDescription
    from av.packet import Packet

MEDIA: tuple[Stream, ...] = ("voice", "codes")  # in the order of their lines in the SDP
CANDIDATE = re.compile(r"(?m)^(a=candidate:\S+ \d+ udp \d+ )(\S+) (\d+)( typ \S+).*$")
Reroute = Callable[[str, int], Awaitable[tuple[str, int]]]


class Connection:
    """To one partner, or to a server that passes on."""

    def __init__(
        self,
        on_packet: Callable[[Stream, bytes], None] | None,  # None: nothing is received
        on_message: Callable[[bytes], None] | None = None,  # None: no data channel
        sends: bool = True,
        ice_servers: Sequence[str] = (),  # as app/call/wire/ice.py reads them
        reroute: Reroute | None = None,  # where to send instead of to a candidate
        on_open: Callable[[], None] | None = None,  # messages can be said
    ) -> None:
        from aiortc import RTCConfiguration, RTCIceServer, RTCPeerConnection

        parsed = [ice.parse(url) for url in ice_servers]
        servers = [RTCIceServer(s.url, s.name, s.password) for s in parsed]
        self.pc = RTCPeerConnection(RTCConfiguration(iceServers=servers))
        self._on_packet, self._reroute = on_packet, reroute
        self._sends = sends
        self._senders: dict[Stream, RtpSender] = {}
        self._receiver: RtpReceiver | None = None
        self._channel = None
        if on_message is not None:
            self._channel = self.pc.createDataChannel("control")

            def listen(channel: "RTCDataChannel") -> None:
                channel.on("message", heard)

            def heard(message: str | bytes) -> None:
                on_message(message if isinstance(message, bytes) else b"")

            listen(self._channel)
            if on_open is not None:
                self._channel.on("open", on_open)
            self.pc.on("datachannel", listen)
        self.pc.on("connectionstatechange", self._open)

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
        """False: there is nobody yet."""
        sender = self._senders.get(stream) if self.state == "connected" else None
        return sender is not None and sender.send(payload, pts)

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
        for _ in MEDIA if self._sends else ():
            self.pc.addTrack(_track())

    async def _describe(self, description: "RTCSessionDescription") -> str:
        await self.pc.setLocalDescription(description)
        return _plain(self.pc.localDescription.sdp)

    async def _set_remote(self, sdp: str, kind: str) -> None:
        from aiortc import RTCSessionDescription

        if self._reroute is not None:
            sdp = await rerouted(sdp, self._reroute)
        await self.pc.setRemoteDescription(RTCSessionDescription(_plain(sdp), kind))

    def _open(self) -> None:
        """Both streams' senders and receivers come in the order of the SDP's lines."""
        if self.state != "connected" or self._senders or self._receiver:
            return
        lines = [*zip(MEDIA, self.pc.getTransceivers(), strict=False)]
        if self._sends:
            for stream, line in lines:
                self._senders[stream] = RtpSender(line)
        if self._on_packet is not None:
            self._receiver = RtpReceiver(
                {line.receiver: stream for stream, line in lines}, self._on_packet
            )


async def rerouted(sdp: str, reroute: Reroute) -> str:
    """The description with each candidate's address replaced."""
    parts: list[str] = []
    at = 0
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


def _track():  # noqa: ANN202
    from aiortc import MediaStreamTrack

    class Track(MediaStreamTrack):
        """What aiortc asks for and gets nothing of: see RtpSender."""

        kind = "audio"

        async def recv(self) -> "Packet[Any]":
            return await asyncio.get_running_loop().create_future()

    return Track()
