"""One end of a trial, in a process of its own: `python -m app.call.trial.end CONFIG`.

It says the material in real time, plays its partner on a sound card that is only a clock, looks at
the partner's face 30 times a second, and writes down what it heard and saw. What the person and the
card cost is counted apart from the call.
"""

import asyncio
import gc
import json
import secrets
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from app.call.core.call import Call, Sight
from app.call.core.status import report_of
from app.call.media.connection import bind_only
from app.call.media.face import FaceCounts, FaceTrack
from app.call.media.voice import PULL
from app.call.rooms.direct import DirectGuest
from app.call.rooms.listen import host_direct
from app.call.rooms.room import LineSettings
from app.call.trial.beats import Beats
from app.call.trial.material import Material, load_material
from app.call.wire.agreement import Hello, new_identity
from app.call.wire.invite import parse
from app.call.wire.packet import Tick
from app.call.wire.seal import SECRET_BYTES
from sensors.types import LOOPBACK, NS, SAMPLE_RATE, SAMPLES_PER_FRAME

LATE_NS = 10_000_000  # that a card's block may be served late before the trial tells of it
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
    bind_only(LOOPBACK)
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
            (LOOPBACK, 0), LOOPBACK, secret, call.events(), line
        )
        print(json.dumps({"invite": str(invite)}), flush=True)
    await recorder.play(call)
    await asyncio.sleep(1)  # keep running: the other end needs as long to finish
    call.say_bye()
    task.cancel()
    await call.room.close()
    recorder.save()


class Recorder:
    """Plays the material and keeps what came of the partner."""

    def __init__(self, settings: EndSettings, material: Material) -> None:
        self._settings, self._material = settings, material
        self._face, self._face_counts = FaceTrack(), FaceCounts()
        self._heard: list[np.ndarray] = []
        self._seen: list[tuple[int, np.ndarray, float]] = []  # our clock, code, media of the sound
        self._ticks: dict[int, np.ndarray] = {}
        self._origin_ns = self._first_heard_ns = 0
        self._cpu_s = self._wall_s = self._trial_s = 0.0
        self._sent_bytes = 0
        self._stalls_ns: list[int] = []  # when the card had nothing to play
        self._late_ns: list[tuple[int, int]] = []  # when a block was due, and was served too late
        self._concealed_ns: list[int] = []  # when each packet that was concealed was due
        self._judged = False
        self._partner: Mapping[str, Any] = {}

    async def reroute(self, host: str, port: int) -> tuple[str, int]:  # noqa: ARG002
        return LOOPBACK, self._settings.leg

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
        beats = Beats(time.monotonic_ns(), int((settings.seconds + WARM_UP_S) * SAMPLE_RATE))
        self._origin_ns = beats.origin_ns
        await asyncio.gather(
            beats.every(PULL, partial(self._sound_card, call, beats), self._stand_still),
            beats.every(SAMPLES_PER_FRAME, partial(self._look, call, beats), _nothing),
            beats.every(SAMPLE_RATE, partial(self._second, call, beats), _nothing),
        )
        self._cpu_s = time.process_time() - self._cpu_s
        self._trial_s = beats.trial_s - self._trial_s
        self._wall_s = time.monotonic() - self._wall_s
        self._sent_bytes = call.sent_bytes - self._sent_bytes
        for partner in report_of(call, {}).values():
            self._partner = partner
        for partner in call.partners.values():
            self._face_counts = partner.face

    def _sound_card(self, call: Call, beats: Beats, now: int, late_ns: int) -> None:
        """The next 10 ms, from sample `now` on."""
        due_ns = beats.at_ns(now)
        if not self._judged and now >= WARM_UP_S * SAMPLE_RATE:
            self._judged, self._first_heard_ns = True, due_ns
            self._begin(call, beats)
        if late_ns > LATE_NS:
            self._late_ns.append((due_ns, due_ns + late_ns))
        if now:
            before_ns = beats.at_ns(now - PULL)
            beats.of_call(call.speak, now - PULL, self._sound(now - PULL), before_ns)
        sound = beats.of_call(call.pull, PULL, due_ns)
        if self._judged:
            self._heard.append(sound)
            concealed = sum(p.voice.counts.concealed for p in call.partners.values())
            self._concealed_ns += [due_ns] * (concealed - len(self._concealed_ns))

    def _stand_still(self, now: int, then: int) -> None:
        """The machine was busy elsewhere: the card went on, with nothing to play or to hear."""
        for at in range(now, then, PULL):
            self._stalls_ns.append(self._origin_ns + at * NS // SAMPLE_RATE)
            if self._judged:
                self._heard.append(np.zeros(PULL, np.float32))

    def _look(self, call: Call, beats: Beats, now: int, late_ns: int) -> None:  # noqa: ARG002
        """Show the own face, 30 times a second, and look at the partner's."""
        if not now:
            return
        m, index, now_ns = self._material, now // SAMPLES_PER_FRAME - 1, beats.at_ns(now)
        row = (index + self._settings.start) % len(m.expression)
        beats.of_call(call.tick, Tick(index, m.expression[row], m.gaze[row]), now_ns)
        for partner in call.partners.values():
            if partner.timeline.started:
                media = partner.timeline.media_at(now_ns)
                shown = beats.of_call(self._face.pose, media, now_ns)
                if shown is not None and self._judged:
                    self._seen.append((now_ns, shown.tick.expression, media))

    def _second(self, call: Call, beats: Beats, now: int, late_ns: int) -> None:  # noqa: ARG002
        beats.of_call(call.step)

    def _begin(self, call: Call, beats: Beats) -> None:
        """Start of the measurement; everything before is warm-up."""
        for partner in call.partners.values():
            partner.voice.counts = type(partner.voice.counts)()
            partner.face = type(partner.face)()
        self._cpu_s, self._wall_s = time.process_time(), time.monotonic()
        self._trial_s, self._sent_bytes = beats.trial_s, call.sent_bytes

    def _sound(self, at: int) -> np.ndarray:
        sound = self._material.sound
        at = (at + self._settings.start * SAMPLES_PER_FRAME) % len(sound)
        rest = sound[at : at + PULL]
        return rest if len(rest) == PULL else np.concatenate([rest, sound[: PULL - len(rest)]])

    def save(self) -> None:
        report: dict[str, Any] = {
            "partner": self._partner,
            "due": self._face_counts.due,
            "held": self._face_counts.held,
            "cpu_share": (self._cpu_s - self._trial_s) / self._wall_s,
            "trial_cpu_share": self._trial_s / self._wall_s,
            "sealed_kbps": self._sent_bytes * 8 / self._wall_s / 1e3,
            "stalls_ns": self._stalls_ns,
            "late_ns": self._late_ns,
            "concealed_ns": self._concealed_ns,
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


def _nothing(*_: object) -> None: ...


def _tell(line: str) -> None:
    print(json.dumps({"told": line}), flush=True)


if __name__ == "__main__":
    asyncio.run(run(EndSettings(**json.loads(sys.argv[1]))))
