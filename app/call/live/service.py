"""The call's process: network, Opus and loudspeaker, away from the tick.

loop ==socket==> Service -> Call -> Room          Partner -> Seats ==memory==> whoever draws
                              Speaker <- Call.pull
"""

import asyncio
import json
import secrets
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.call.core.call import Call, Sight
from app.call.core.parcel import Parcel
from app.call.core.status import report_of, status_lines, told_lines
from app.call.live import protocol
from app.call.live.protocol import CallSettings
from app.call.live.shelf import Shelf
from app.call.live.speaker import Speaker
from app.call.media.connection import bind_only
from app.call.media.voice import PULL
from app.call.rooms import janus_server
from app.call.rooms.addresses import ELSEWHERE, here, own_address
from app.call.rooms.direct import DirectGuest
from app.call.rooms.janus import JanusRoom
from app.call.rooms.janus_server import room_invite
from app.call.rooms.listen import host_direct
from app.call.rooms.room import LineSettings
from app.call.table.seats import Seats
from app.call.wire.agreement import Hello, new_identity
from app.call.wire.invite import Invite, parse
from app.call.wire.packet import Basis
from app.call.wire.seal import SECRET_BYTES
from app.process.channel import Channel
from sensors.types import NS, SAMPLE_RATE, Clock

PLAYED = 480  # samples that go to the echo canceller at a time
TELL_S = 1.0
WEB_NS = 80_000_000  # that a page holds sound back for an even stream: sound.js


class Service:
    """Runs until the loop's end of the socket closes."""

    def __init__(self, end: Channel, seats: Seats, basis: Basis, clock: Clock, date_s: int) -> None:
        """`date_s`: of the calendar, since 1970: a server's token ends at a date."""
        self._end, self._seats, self._basis, self._clock = end, seats, basis, clock
        self._date_s = date_s
        self._lock = threading.Lock()  # the loudspeaker asks from a thread of its own
        self._played = np.zeros(0, np.float32)
        self._call: Call | None = None
        self._shelf: Shelf | None = None

    async def run(self, settings: CallSettings) -> None:
        invite = parse(settings.invite) if settings.invite else None
        secret = invite.secret if invite else secrets.token_bytes(SECRET_BYTES)
        if own := here(settings.address) if settings.address else "":
            bind_only(own)
            settings = replace(settings, listen=own)
        elif settings.address and not settings.ice_servers:
            self.tell(ELSEWHERE.format(settings.address))
        hello = Hello(
            identity=new_identity(),
            name=settings.name,
            avatar=settings.avatar,
            basis=self._basis.number,
            accepted=settings.accept,
        )
        call = self._call = Call(
            secret, hello, self._basis, self.tell, self._show, self._clock.now_ns
        )
        if settings.avatar_file:
            parcel = call.parcel = Parcel(Path(settings.avatar_file))
            call.change(parcel=parcel.digest, parcel_bytes=len(parcel.packed))
        if settings.avatars:
            self._shelf = Shelf(Path(settings.avatars), self.tell)
        ended = asyncio.get_running_loop().create_future()
        asyncio.get_running_loop().add_reader(self._end, self._read, ended)
        with self._played_aloud(settings):  # before anybody is let in who would not be heard
            room = await self._open_room(settings, secret, invite, call, ended)
            cpu_s, began_ns = time.process_time(), self._clock.now_ns()
            telling = asyncio.create_task(self._keep_telling(call, settings))
            await asyncio.wait([ended, room], return_when=asyncio.FIRST_COMPLETED)
            with self._lock:
                passed_ns = max(self._clock.now_ns() - began_ns, 1)
                cpu_share = (time.process_time() - cpu_s) * NS / passed_ns
                report = report_of(call, self._seats.behind_ms(), cpu_share)
                call.say_bye()
            self._post(protocol.pack_json(protocol.REPORT, report))
        telling.cancel()
        assert call.room is not None
        await call.room.close()
        call.close()
        if room.done():
            room.result()
        room.cancel()

    async def _open_room(
        self,
        settings: CallSettings,
        secret: bytes,
        invite: Invite | None,
        call: Call,
        ended: asyncio.Future[None],
    ) -> asyncio.Task[None]:
        """Running; its invite goes to the loop, that of a new room once the server has let us in.
        Raises InputError where it does not."""
        line = LineSettings(ice_servers=settings.ice_servers)
        identity, events = call.hello.identity, call.events()
        events = replace(
            events, packet=self._alone(events.packet), message=self._alone(events.message)
        )
        if invite is not None and invite.kind == "direct":
            call.room = DirectGuest(invite, events, line)
        elif invite is not None:
            call.room = JanusRoom(invite, identity, events, line)
        elif settings.room:
            invite = room_invite(
                settings.server, settings.room, secret, settings.server_key, self._date_s
            )
            key = janus_server.admin_key(settings.server_key)
            room = call.room = JanusRoom(invite, identity, events, line, key)
            task = asyncio.create_task(room.run())
            await asyncio.wait([task, room.entered, ended], return_when=asyncio.FIRST_COMPLETED)
            if task.done():
                task.result()
            self._post(protocol.pack_json(protocol.INVITE, str(invite)))
            return task
        else:
            address = settings.address or own_address()
            call.room, task, invite = await host_direct(
                (settings.listen, settings.port), address, secret, events, line
            )
            self._post(protocol.pack_json(protocol.INVITE, str(invite)))
            return task
        self._post(protocol.pack_json(protocol.INVITE, str(invite)))
        return asyncio.create_task(call.room.run())

    def _alone(self, act: Callable[..., None]) -> Callable[..., None]:
        """`act`, but never while the loudspeaker's thread reads from the partners."""

        def locked(*given: object) -> None:
            with self._lock:
                act(*given)

        return locked

    def tell(self, line: str) -> None:
        """A line for the person, printed by the loop."""
        self._post(protocol.LINE + line.encode()[:400])

    @contextmanager
    def _played_aloud(self, settings: CallSettings) -> Generator[None]:
        """Raises InputError where there is no such loudspeaker."""
        if settings.speaker in ("none", "web"):
            later_ns = WEB_NS if settings.speaker == "web" else 0
            pulling = asyncio.create_task(self._pull_unheard(later_ns))
            close: Callable[[], object] = pulling.cancel
        else:
            close = Speaker(settings.speaker, self._clock, self._pull).close
        try:
            yield
        finally:
            close()

    async def _pull_unheard(self, later_ns: int) -> None:
        """Without a loudspeaker the clock plays, so that the faces keep their time; a page is heard
        that much later."""
        due_ns = self._clock.now_ns()
        while True:
            due_ns = max(due_ns + PULL * NS // SAMPLE_RATE, self._clock.now_ns() - NS)
            await asyncio.sleep(max(0, (due_ns - self._clock.now_ns()) / NS))
            self._pull(PULL, due_ns + later_ns)

    def _pull(self, count: int, heard_ns: int) -> np.ndarray:
        with self._lock:
            call = self._call
            assert call is not None
            sound = call.pull(count, heard_ns)
            for partner in call.partners.values():
                if partner.timeline.started:
                    anchor = partner.timeline.anchor
                    self._seats.hear(partner.identity, anchor, partner.voice.level)
        self._played = np.concatenate([self._played, sound])
        while len(self._played) >= PLAYED:
            words = (self._played[:PLAYED] * 32767).astype("<i2")
            self._played = self._played[PLAYED:]
            self._post(protocol.PLAYED + words.tobytes())
        return sound

    async def _keep_telling(self, call: Call, settings: CallSettings) -> None:
        before = ""
        while True:
            with self._lock:
                call.step()
                self._seat_partners(call)
                lines = status_lines(call, self._seats.behind_ms())
                files = dict(call.files)
                said = "; ".join(told_lines(call))
            if settings.tells and said != before:
                self.tell(said or "nothing is recorded")
            before = said
            if self._shelf is not None:
                await asyncio.to_thread(self._shelf.keep, files)
            self._seats.lines = lines
            self._seats.may_record = call.may_record()
            await asyncio.sleep(TELL_S)

    def _seat_partners(self, call: Call) -> None:
        here = {partner.identity: hello for partner, hello in call.present()}
        for row in self._seats.rows:
            if row["identity"] and row["identity"].decode() not in here:
                self._seats.leave(row["identity"].decode())
        for identity, hello in here.items():
            file = self._shelf.path(hello.parcel) if self._shelf else ""
            self._seats.take(identity, hello.name, hello.avatar, file)

    def _show(self, sight: Sight, now_ns: int) -> None:
        self._seats.post(sight.identity, sight.tick, sight.due, now_ns)

    def _read(self, ended: asyncio.Future[None]) -> None:
        call = self._call
        assert call is not None
        kinds: dict[bytes, Callable[[bytes], None]] = {
            protocol.SOUND: lambda p: call.speak(*protocol.unpack_sound(p)),
            protocol.TICK: lambda p: call.tick(*protocol.unpack_tick(p)),
            protocol.STATE: lambda p: call.change(**json.loads(p[1:])),
        }
        for packet in self._end.waiting():
            if not packet or packet[:1] == protocol.END:
                if not ended.done():
                    ended.set_result(None)
                return
            with self._lock:
                kinds[packet[:1]](packet)
                self._seats.may_record = call.may_record()

    def _post(self, packet: bytes) -> None:
        send = self._end.send if packet[:1] == protocol.PLAYED else self._end.insist
        with suppress(OSError):  # the loop is busy or gone
            send(packet)
