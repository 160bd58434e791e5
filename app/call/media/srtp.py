"""RTP packets past aiortc's tasks and queues: protected and sent at once, taken as they come.

aiortc's own way takes two more turns of the event loop for every packet, a fifth of all that an end
of a call has to do. ICE, DTLS and the keys of SRTP are aiortc's still; only this file reaches into
its objects for them.
"""

import secrets
import struct
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from aiortc import RTCRtpReceiver, RTCRtpTransceiver

Stream = Literal["voice", "codes"]
HEADER = struct.Struct("!BBHII")
VERSION, MARKER = 0x80, 0x80
RTCP = range(192, 224)  # second bytes, as RFC 5761 tells them apart
SRTP = range(128, 192)  # first bytes, as RFC 7983 does


class RtpSender:
    """The packets of one line of the SDP, whose own sender never gets any."""

    def __init__(self, line: "RTCRtpTransceiver") -> None:
        of_line: Any = line
        self._sender, self._kind = of_line.sender, MARKER | of_line._codecs[0].payloadType
        self._number, self._origin = secrets.randbits(15), secrets.randbits(32)

    def send(self, payload: bytes, pts: int) -> bool:
        """False: the way is not open."""
        transport = self._sender.transport
        session, pair = transport._tx_srtp, transport.transport._connection._nominated.get(1)
        if session is None or pair is None or pair.protocol.transport.is_closing():
            return False
        time = (self._origin + pts) & 0xFFFFFFFF
        header = HEADER.pack(VERSION, self._kind, self._number, time, self._sender._ssrc)
        self._number = (self._number + 1) & 0xFFFF
        pair.protocol.transport.sendto(session.protect(header + payload), pair.remote_addr)
        return True


class RtpReceiver:
    """Stands before the queue of one transport and takes the media out."""

    def __init__(
        self,
        streams: Mapping["RTCRtpReceiver", Stream],  # of one transport
        take: Callable[[Stream, bytes], None],
    ) -> None:
        import pylibsrtp
        from aiortc.rtp import RtpPacket

        self._streams, self._take = streams, take
        self._parse, self._damaged = RtpPacket.parse, (pylibsrtp.Error, ValueError)
        self._transport: Any = next(iter(streams)).transport
        connection = self._transport.transport._connection
        self._known: dict[bytes, Stream] = {}  # by SSRC
        self._queue: Callable[[bytes, int], None] = connection.data_received
        connection.data_received = self._received

    def _received(self, data: bytes, component: int) -> None:
        session = self._transport._rx_srtp
        if session is None or len(data) < 2 or data[0] not in SRTP or data[1] in RTCP:
            self._queue(data, component)
            return
        try:
            plain = session.unprotect(data)
            stream = self._known.get(plain[8:12]) if plain[0] == VERSION else None
            if stream is None:
                packet = self._parse(plain)
                stream = self._streams.get(self._transport._rtp_router.route_rtp(packet))
                if stream is None:
                    return
                self._known[plain[8:12]] = stream
                self._take(stream, packet.payload)
            else:
                self._take(stream, plain[HEADER.size :])
        except self._damaged:  # or it came before
            return
