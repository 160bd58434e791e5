"""Links to a tracker: a UDP port, or a recording played in a loop."""

import contextlib
import socket
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

from sensors.head.gate import Reading, ReadingCounts, ReadingGate
from sensors.listening import cannot_listen
from sensors.types import FPS, NS, Clock, HeadPacket

BURST = 32  # datagrams that are read before the thread rests
PAUSE_S = 0.002  # then: a flood costs the tick little
LOOK_S = 0.2  # how often the thread looks whether it shall end
BUFFER = 1 << 16  # bytes that the system may hold: under a flood, what is read is not old
WAITING = 256  # packets; the oldest go first
Decode = Callable[[bytes], list[Reading]]


class UdpLink:
    """Datagrams to a port, read by a thread of its own."""

    def __init__(
        self,
        host: str,
        port: int,
        decode: Decode,
        max_datagram: int,
        gate: ReadingGate,
        clock: Clock,
    ) -> None:
        self.counts = gate.counts
        self._address = (host, port)
        self._decode, self._max_datagram = decode, max_datagram
        self._gate, self._clock = gate, clock
        self._packets = deque[HeadPacket](maxlen=WAITING)
        self._closed = threading.Event()
        self._socket: socket.socket | None = None
        self._thread: threading.Thread | None = None

    @property
    def port(self) -> int:
        """The one that was opened, also where 0 asked for any."""
        assert self._socket is not None
        return int(self._socket.getsockname()[1])

    def open(self) -> None:
        host, port = self._address
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.settimeout(LOOK_S)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        try:
            self._socket.bind(self._address)
        except (OSError, OverflowError, TypeError, UnicodeError) as error:
            self._socket.close()
            raise cannot_listen("--head", host, port, error) from None
        self._thread = threading.Thread(target=self._listen, name="head", daemon=True)
        self._thread.start()

    def poll(self) -> list[HeadPacket]:
        packets: list[HeadPacket] = []
        with contextlib.suppress(IndexError):
            while len(packets) < WAITING:
                packets.append(self._packets.popleft())
        return packets

    def close(self) -> None:
        self._closed.set()
        if self._thread is not None:
            self._thread.join()
        if self._socket is not None:
            self._socket.close()

    def _listen(self) -> None:
        assert self._socket is not None
        read = 0
        while not self._closed.is_set():
            try:
                datagram = self._socket.recv(self._max_datagram + 1)
            except OSError:  # nothing came; or Windows tells of a datagram that was too long
                read = 0
                continue
            self._take(datagram, self._clock.now_ns())
            read += 1
            if read >= BURST:
                read = 0
                self._closed.wait(PAUSE_S)

    def _take(self, datagram: bytes, arrival_ns: int) -> None:
        if len(datagram) > self._max_datagram:
            return
        for reading in self._decode(datagram):
            packet = self._gate(reading, arrival_ns)
            if packet is not None:
                self._packets.append(packet)


class PlayedHeadLink:
    """Recorded poses, played at their pace from the moment of opening, over and over."""

    def __init__(self, packets: Sequence[HeadPacket], clock: Clock) -> None:
        self.counts = ReadingCounts()
        self._packets, self._clock = packets, clock
        self._start_ns = self._next = 0
        first_ns = packets[0].t_ns if packets else 0
        self._first_ns = first_ns
        self._round_ns = packets[-1].t_ns - first_ns + NS // FPS if packets else 0

    def open(self) -> None:
        self._start_ns, self._next = self._clock.now_ns(), 0

    def poll(self) -> list[HeadPacket]:
        due: list[HeadPacket] = []
        now_ns = self._clock.now_ns()
        while self._packets and len(due) < WAITING:
            rounds, at = divmod(self._next, len(self._packets))
            packet = self._packets[at]
            t_ns = self._start_ns + rounds * self._round_ns + packet.t_ns - self._first_ns
            if t_ns > now_ns:
                break
            due.append(replace(packet, t_ns=t_ns))
            self._next += 1
        self.counts.poses += len(due)
        return due

    def close(self) -> None:
        pass
