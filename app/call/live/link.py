"""The loop's end of a call: starts the call's process, feeds it and reads its messages.

Microphone -> CallMicrophone (own thread, every few ms) -> call's process
                    \\-> LiveSource -> ... -> DrivenFrame -> CallSink -> call's process
"""

import contextlib
import json
import subprocess
import tempfile
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from app.call.live import protocol
from app.call.live.echo import EchoCanceller
from app.call.live.protocol import CallSettings
from app.call.table.seats import Seats
from app.call.wire.packet import Tick
from app.drive.sink import FrameResult, RunInfo
from app.process import child
from app.process.channel import pair
from sensors.live.source import LiveMicrophone
from sensors.types import NS, AudioPacket, Clock, InputError, Packet, SourceInfo

START_S, END_S = 60, 5
LOOK_S = 0.1  # between two looks at what an ending process says
POLL_S = 0.004
WAITING = 256  # packets of sound that wait for the loop


class CallLink:
    """Socket and memory to the call's process, which `start` starts."""

    def __init__(self, settings: CallSettings, tell: Callable[[str], None]) -> None:
        self.seats = Seats()
        self.report: dict[str, Any] = {}
        self.invite = ""
        self.error = ""
        self.ended = False
        self.muted = self.eyes_muted = False
        self._shown = False  # whether the panel has it muted
        self.on_played: list[Callable[[bytes], None]] = []  # each gets what the partners say
        self._tell = tell
        self._avatars = tempfile.TemporaryDirectory(prefix="livedrive-call-")
        self._settings = replace(settings, avatars=self._avatars.name)
        self._socket, self._theirs = pair()
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None

    def start(self, clock: Clock) -> str:
        """Open or join the call; its invite. Raises InputError where that cannot be."""
        handles = [self.seats.handle]
        self._process = child.start("app.call", self._settings, handles, self._theirs)
        self._theirs.close()
        until_ns = clock.now_ns() + START_S * NS
        while not self.invite:
            self.read()
            if self.ended or clock.now_ns() > until_ns:
                raise InputError(
                    self.error or "call: expected it to open in time, got nothing; try again"
                )
            clock.sleep_until_ns(clock.now_ns() + NS // 50)
        return self.invite

    def change(self, **state: object) -> None:
        """Fields of the hello: accepted, muted, eyes_muted, records, may_record, ..."""
        self.muted = bool(state.get("muted", self.muted))
        self.eyes_muted = bool(state.get("eyes_muted", self.eyes_muted))
        self._insist(protocol.pack_json(protocol.STATE, state))

    def picks(self) -> dict[str, Any]:
        """Whether somebody in the terminal has muted, or no longer: fields of Controls."""
        before, self._shown = self._shown, self.muted
        return {"muted": self._shown} if self._shown != before else {}

    def show(self, changed: dict[str, Any]) -> None:
        """The mute button of a window or a page."""
        if "muted" in changed:
            self._shown = changed["muted"]
            self.change(muted=self._shown)

    def post(self, packet: bytes) -> None:
        try:
            self._socket.send(packet)
        except BlockingIOError:
            return  # it is too slow: what it misses is concealed at the other end
        except OSError:
            self.ended = True

    def _insist(self, packet: bytes) -> None:
        """Post what nobody conceals: who is muted, and the end."""
        try:
            self._socket.insist(packet)
        except OSError:
            self.ended = True

    def read(self) -> None:
        """Read what the call's process has sent; never blocks."""
        with self._lock:
            for packet in () if self.ended else self._socket.waiting():
                self._take(packet[:1], packet[1:])

    def close(self) -> None:
        if self._process is None:
            self._theirs.close()
        else:
            self.read()  # for what came while files were finished the report would find no room
            self._insist(protocol.END)
            for _ in range(round(END_S / LOOK_S)):
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._process.wait(LOOK_S)
                    break
                self.read()
            else:
                self._process.kill()
                self._process.wait()
            self.read()
        self._socket.close()
        self._avatars.cleanup()

    def _take(self, kind: bytes, body: bytes) -> None:
        if kind == protocol.PLAYED:
            for played in self.on_played:
                played(body)
        elif kind == protocol.LINE:
            self._tell(body.decode(errors="replace"))
        elif kind == protocol.INVITE:
            self.invite = json.loads(body)
        elif kind == protocol.REPORT:
            self.report = json.loads(body)
        elif kind == protocol.ERROR:
            self.error = body.decode(errors="replace")
        else:
            self.ended = True


class CallMicrophone:
    """A microphone whose sound goes to the call at once, cleaned, and then to the loop."""

    def __init__(
        self, microphone: LiveMicrophone, link: CallLink, cleaner: EchoCanceller | None
    ) -> None:
        self._microphone, self._link, self._cleaner = microphone, link, cleaner
        if cleaner is not None:
            link.on_played.append(cleaner.played)
        self.problem, self.losses, self.reopened = "", 0, 0
        self._packets: deque[Packet] = deque(maxlen=WAITING)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="call microphone", daemon=True)

    @property
    def info(self) -> SourceInfo:
        return self._microphone.info

    @property
    def exhausted(self) -> bool:
        return self._microphone.exhausted

    @property
    def dropped(self) -> int:
        return self._microphone.dropped

    @property
    def drift_ppm(self) -> float:
        return self._microphone.drift_ppm

    def open(self) -> None:
        self._microphone.open()
        self._thread.start()

    def poll(self) -> list[Packet]:
        microphone = self._microphone
        found: list[Packet] = []
        self.problem, self.losses = microphone.problem, microphone.losses
        self.reopened = microphone.reopened
        while self._packets:
            found.append(self._packets.popleft())
        return found

    def close(self) -> None:
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()
        self._microphone.close()

    def _run(self) -> None:
        while not self._closing.wait(POLL_S):
            self._link.read()
            for packet in self._microphone.poll():
                if isinstance(packet, AudioPacket):
                    if self._cleaner is not None:
                        packet = replace(packet, samples=self._cleaner.clean(packet.samples))
                    sound = np.nan_to_num(packet.samples)
                    self._link.post(protocol.pack_sound(packet.first_sample, packet.t_ns, sound))
                self._packets.append(packet)


class CallSink:
    """Sends every tick to the call."""

    def __init__(self, link: CallLink, tell: Callable[[str], None]) -> None:
        self._link, self._tell, self._told = link, tell, False

    def on_start(self, info: RunInfo) -> None: ...

    def on_frame(self, result: FrameResult) -> None:
        self._link.read()
        if self._link.ended and not self._link.error and not self._told:
            self._told = True
            self._tell("the call's process has ended, nobody hears you; driving goes on, q leaves")
        driven = result.driven
        tick = Tick(
            index=driven.index,
            expression=driven.expression,
            gaze=driven.gaze,
            head_mm=np.array(driven.head.position, np.float32),
            head_wxyz=np.array(driven.head.quat, np.float32),
            breath=driven.breath,
        )
        self._link.post(protocol.pack_tick(tick, driven.t_ns))

    def close(self) -> None:
        self._link.close()

    def network_report(self) -> dict[str, Any]:
        """{"call": what each partner's line did}."""
        return {"call": self._link.report}
