"""One person in a room, in a process of their own: `python -m app.call.trial.person CONFIG`.

They talk until the standard input closes, and print how many others they see whenever that changes.
On a line of the input, "begin" counts anew and "report" prints what became of each partner.
"""

import asyncio
import json
import os
import signal
import sys
import time
from dataclasses import dataclass

from app.call.core.call import Call, Sight
from app.call.core.status import report_of
from app.call.media.connection import bind_only
from app.call.media.voice import PULL
from app.call.rooms.janus import JanusRoom
from app.call.rooms.room import LineSettings
from app.call.trial.material import synthetic_material
from app.call.trial.relay import Leg, LossyLine, open_line
from app.call.wire.agreement import Hello, new_identity
from app.call.wire.invite import parse
from app.call.wire.packet import Tick
from sensors.types import NS, SAMPLE_RATE, SAMPLES_PER_FRAME

BLOCK = 480  # samples that the microphone delivers at a time
SEEN_NS = NS  # a partner of whom no tick came for so long is not seen


@dataclass(frozen=True, kw_only=True)
class PersonSettings:
    name: str
    host: str  # address that the media is sent from
    invite: str
    admin_key: str = ""  # of who makes the room
    loss: float = 0.0  # share of the packets, both ways


class Person:
    def __init__(self, settings: PersonSettings, line: LineSettings) -> None:
        self._material = material = synthetic_material(3, 0)
        self._seen: dict[str, int] = {}
        self._told = 0
        self._cpu_s, self._wall_s = time.process_time(), time.monotonic()
        invite = parse(settings.invite)
        hello = Hello(
            identity=new_identity(),
            name=settings.name,
            basis=material.basis.number,
            accepted=True,
        )
        self._call = call = Call(
            *(invite.secret, hello, material.basis, _tell, self._show), time.monotonic_ns
        )
        events = call.events()
        self.room = JanusRoom(invite, hello.identity, events, line, settings.admin_key)
        call.room = self.room

    async def talk(self, closed: asyncio.Event) -> None:
        call, start_ns, now = self._call, time.monotonic_ns(), 0
        while not closed.is_set():
            now += PULL
            due_ns = start_ns + now * NS // SAMPLE_RATE
            await asyncio.sleep(max(0, (due_ns - time.monotonic_ns()) / NS))
            if now % BLOCK == 0:
                self._say(now - BLOCK, due_ns - BLOCK * NS // SAMPLE_RATE)
            if now // SAMPLES_PER_FRAME > (now - PULL) // SAMPLES_PER_FRAME:
                self._show_face(now // SAMPLES_PER_FRAME - 1, start_ns)
            call.pull(PULL, due_ns)
            if now % (10 * BLOCK) == 0 and (sees := self._sees(time.monotonic_ns())) != self._told:
                self._told = sees
                _say({"sees": sees})
            if now % SAMPLE_RATE == 0:
                call.step()

    def _say(self, at: int, t_ns: int) -> None:
        place = at % (len(self._material.sound) - BLOCK)
        self._call.speak(at, self._material.sound[place : place + BLOCK], t_ns)

    def _show_face(self, index: int, start_ns: int) -> None:
        m, end_ns = self._material, start_ns + (index + 1) * SAMPLES_PER_FRAME * NS // SAMPLE_RATE
        row = index % len(m.expression)
        self._call.tick(Tick(index, m.expression[row], m.gaze[row]), end_ns)

    def obey(self, word: str) -> None:
        """Handle one line of the input."""
        if word == "begin":
            for partner in self._call.partners.values():
                partner.voice.counts = type(partner.voice.counts)()
                partner.counts = type(partner.counts)()
            self._cpu_s, self._wall_s = time.process_time(), time.monotonic()
        elif word == "report":
            share = (time.process_time() - self._cpu_s) / (time.monotonic() - self._wall_s)
            _say({"report": [*report_of(self._call, {}, share).values()]})

    def _show(self, sight: Sight, now_ns: int) -> None:
        self._seen[sight.identity] = now_ns

    def _sees(self, now_ns: int) -> int:
        return sum(seen_ns > now_ns - SEEN_NS for seen_ns in self._seen.values())


async def lossy_leg(loss: float, host: str) -> LineSettings:
    """Everything to and from the server passes a relay that loses packets."""
    legs: dict[tuple[str, int], tuple[Leg, Leg]] = {}

    async def reroute(there: str, port: int) -> tuple[str, int]:
        if (there, port) not in legs:
            near, far = await open_line(LossyLine(name="leg", loss=loss), 1, host)
            far.near = (there, port)
            legs[there, port] = near, far
        return host, legs[there, port][0].port

    return LineSettings(reroute=reroute)


async def run(settings: PersonSettings) -> None:
    bind_only(settings.host)
    line = await lossy_leg(settings.loss, settings.host) if settings.loss else LineSettings()
    person, closed = Person(settings, line), asyncio.Event()

    def read() -> None:
        said = os.read(sys.stdin.fileno(), 4096)  # all of it: a buffered line would wake nobody
        for word in said.decode().split():
            person.obey(word)
        if not said:
            closed.set()

    asyncio.get_running_loop().add_reader(sys.stdin, read)
    room = asyncio.create_task(person.room.run())
    talk = asyncio.create_task(person.talk(closed))
    await asyncio.wait([room, talk], return_when=asyncio.FIRST_COMPLETED)
    if room.done():
        room.result()
    os._exit(0)  # aiortc leaves tasks behind that log errors, or do not end


def _tell(line: str) -> None:
    _say({"told": line})


def _say(value: dict[str, object]) -> None:
    sys.stdout.write(json.dumps(value) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the trial, which closes our input
    asyncio.run(run(PersonSettings(**json.loads(sys.argv[1]))))
