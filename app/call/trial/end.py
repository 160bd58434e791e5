"""One end of a trial, in a process of its own: `python -m app.call.trial.end CONFIG`.

It says the material in real time, plays its partner on a sound card that is only a clock, looks at
the partner's face 30 times a second, and writes down what it heard and saw.
"""

import asyncio
import gc
import json
import secrets
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from app.call.core.call import Call, Sight, new_identity
from app.call.core.status import report_of
from app.call.media.connection import bind_only
from app.call.media.face import FaceTrack
from app.call.rooms.direct import DirectGuest
from app.call.rooms.listen import host_direct
from app.call.rooms.room import LineSettings
from app.call.trial.material import Material, load_material
from app.call.wire.agreement import Hello
from app.call.wire.invite import parse
from app.call.wire.packet import Tick
from app.call.wire.seal import SECRET_BYTES
from sensors.types import NS, SAMPLE_RATE, SAMPLES_PER_FRAME

BLOCK = 480  # samples that the microphone delivers at a time
PULL = 240  # samples that the loudspeaker asks for at a time
STALL = SAMPLE_RATE // 10  # samples: whole blocks, pulls and ticks
WARM_UP_S = 6.0  # of connecting and settling, not judged


@dataclass(frozen=True, kw_only=True)
class EndSettings:
    name: str
    material: str  # file
    out: str  # file
    leg: int  # port of the relay; 0: none
    invite: str = ""  # empty: this end listens
    seconds: float = 20.0
    start: int = 0  # tick of the material to begin with


async def run(settings: EndSettings) -> None:
    bind_only("127.0.0.1")
    material = load_material(Path(settings.material))
    hello = Hello(
        identity=new_identity(), name=settings.name, basis=material.basis.number, accepted=True
    )
    recorder = Recorder(settings, material)
    line = LineSettings(reroute=recorder.reroute if settings.leg else None)
    secret = parse(settings.invite).secret if settings.invite else secrets.token_bytes(SECRET_BYTES)
    call = Call(secret, hello, material.basis, _tell, recorder.show, time.monotonic_ns)
    if settings.invite:
        call.room = DirectGuest(parse(settings.invite), call.events(), line)
        task = asyncio.create_task(call.room.run())
    else:
        call.room, task, invite = await host_direct(
            ("127.0.0.1", 0), "127.0.0.1", secret, call.events(), line
        )
        print(json.dumps({"invite": str(invite)}), flush=True)
    await recorder.play(call)
    await asyncio.sleep(1)  # the other end has the same right to be heard out
    call.say_bye()
    task.cancel()
    await call.room.close()
    recorder.save()


class Recorder:
    """Plays the material and keeps what came of the partner."""

    def __init__(self, settings: EndSettings, material: Material) -> None:
        self._settings, self._material = settings, material
        self._face = FaceTrack()
        self._heard: list[np.ndarray] = []
        self._seen: list[tuple[int, np.ndarray, float]] = []  # our clock, code, media of the sound
        self._ticks: dict[int, np.ndarray] = {}
        self._origin_ns = self._first_heard_ns = 0
        self._cpu_s = self._wall_s = 0.0
        self._sent_bytes = 0
        self._second = 0
        self._stalls_ns: list[int] = []  # when the card had nothing to play
        self._judged = False
        self._partner: Mapping[str, Any] = {}

    async def reroute(self, host: str, port: int) -> tuple[str, int]:  # noqa: ARG002
        return "127.0.0.1", self._settings.leg

    def show(self, sight: Sight, now_ns: int) -> None:
        self._face.push(sight.tick, sight.due, now_ns)
        self._ticks[sight.tick.index] = sight.tick.expression

    async def play(self, call: Call) -> None:
        settings = self._settings
        while not call.may_send():
            await asyncio.sleep(0.05)
            call.step()
        gc.collect()
        gc.freeze()
        self._origin_ns = time.monotonic_ns()
        loop = asyncio.get_running_loop()
        played = loop.create_future()
        start_s, total = loop.time(), int((settings.seconds + WARM_UP_S) * SAMPLE_RATE)

        def beat(now: int) -> None:
            """The sound card's: a timer alone, as a card costs no turn of a task."""
            late = int((loop.time() - start_s) * SAMPLE_RATE) - now
            missed = max(late, 0) // STALL * STALL
            try:
                self._stand_still(now, missed)
                now += missed
                self._play_on(call, now)
            except Exception as error:  # nobody awaits a timer
                played.set_exception(error)
            if played.done():
                return
            if now + PULL < total:
                loop.call_at(start_s + (now + PULL) / SAMPLE_RATE, beat, now + PULL)
            else:
                played.set_result(None)

        beat(0)
        await played
        self._cpu_s = time.process_time() - self._cpu_s
        self._wall_s = time.monotonic() - self._wall_s
        self._sent_bytes = call.sent_bytes - self._sent_bytes
        for partner in report_of(call, time.monotonic_ns(), {}).values():
            self._partner = partner

    def _play_on(self, call: Call, now: int) -> None:
        """The next 5 ms, from sample `now` on."""
        due_ns = self._origin_ns + now * NS // SAMPLE_RATE
        if not self._judged and now >= WARM_UP_S * SAMPLE_RATE:
            self._judged, self._first_heard_ns = True, due_ns
            self._begin(call)
        if now % BLOCK == 0 and now:
            call.speak(now - BLOCK, self._sound(now - BLOCK), due_ns - BLOCK * NS // SAMPLE_RATE)
        sound = call.pull(PULL, due_ns)
        if self._judged:
            self._heard.append(sound)
        if now // SAMPLES_PER_FRAME > (now - PULL) // SAMPLES_PER_FRAME and now:
            self._tick(call, now // SAMPLES_PER_FRAME - 1)
            self._look(call, due_ns)
        if now // SAMPLE_RATE > self._second:
            self._second = now // SAMPLE_RATE
            call.step()

    def _stand_still(self, now: int, count: int) -> None:
        """The machine was busy elsewhere: the card went on, with nothing to play or to hear."""
        for at in range(now, now + count, PULL):
            self._stalls_ns.append(self._origin_ns + at * NS // SAMPLE_RATE)
            if self._judged:
                self._heard.append(np.zeros(PULL, np.float32))

    def _begin(self, call: Call) -> None:
        """What came before is warm-up."""
        for partner in call.partners.values():
            partner.voice.counts = type(partner.voice.counts)()
        self._face.counts = type(self._face.counts)()
        self._cpu_s, self._wall_s = time.process_time(), time.monotonic()
        self._sent_bytes = call.sent_bytes

    def _sound(self, at: int) -> np.ndarray:
        sound = self._material.sound
        at = (at + self._settings.start * SAMPLES_PER_FRAME) % len(sound)
        rest = sound[at : at + BLOCK]
        return rest if len(rest) == BLOCK else np.concatenate([rest, sound[: BLOCK - len(rest)]])

    def _tick(self, call: Call, index: int) -> None:
        m = self._material
        row = (index + self._settings.start) % len(m.expression)
        end_ns = self._origin_ns + (index + 1) * SAMPLES_PER_FRAME * NS // SAMPLE_RATE
        call.tick(Tick(index, m.expression[row], m.gaze[row]), end_ns)

    def _look(self, call: Call, now_ns: int) -> None:
        for partner in call.partners.values():
            if partner.timeline.started:
                media = partner.timeline.media_at(now_ns)
                shown = self._face.pose(media, now_ns)
                if shown is not None and self._judged:
                    self._seen.append((now_ns, shown.tick.expression, media))

    def save(self) -> None:
        report: dict[str, Any] = {
            "partner": self._partner,
            "due": self._face.counts.due,
            "held": self._face.counts.held,
            "cpu_share": self._cpu_s / self._wall_s,
            "sealed_kbps": self._sent_bytes * 8 / self._wall_s / 1e3,
            "stalls_ns": self._stalls_ns,
            "origin_ns": self._origin_ns,
            "first_heard_ns": self._first_heard_ns,
            "settings": asdict(self._settings),
        }
        np.savez(
            self._settings.out,
            heard=np.concatenate(self._heard) if self._heard else np.zeros(0, np.float32),
            seen_ns=np.array([t for t, *_ in self._seen], np.int64),
            seen=np.array([code for _, code, _ in self._seen], np.float32).reshape(-1, 256),
            ticks=np.array(list(self._ticks), np.int64),
            codes=np.array(list(self._ticks.values()), np.float32).reshape(-1, 256),
            report=json.dumps(report),
        )


def _tell(line: str) -> None:
    print(json.dumps({"told": line}), flush=True)


if __name__ == "__main__":
    asyncio.run(run(EndSettings(**json.loads(sys.argv[1]))))
