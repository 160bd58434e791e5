"""Which emotion is shown, and that a session keeps it: words -> packet -> recording -> replay."""

from pathlib import Path

import numpy as np
import pytest

from app.drive.controls import Controls, Panel
from app.drive.emotion import EmotionControl
from app.drive.loop import Drive, drive
from app.drive.sink import FrameResult, RunInfo
from app.drive.tape import Tape
from encoder.types import DrivenFrame
from render.types import AHEAD
from sensors.assemble import Assembler
from sensors.clock import ManualClock
from sensors.session.recording import Recording, RecordingWriter
from sensors.session.replay import ReplaySource
from sensors.types import FPS, NS, AudioPacket, EmotionPacket, Packet, SourceInfo


def sound(k: int) -> AudioPacket:
    return AudioPacket(k * NS // FPS, k * 1600, np.full(1600, 0.1, np.float32))


def words_of(control: EmotionControl, packets: list[Packet], words: str | None = None) -> list:
    led = list(control.inject_emotion(packets, words))
    return [p.words if isinstance(p, EmotionPacket) else "-" for p in led]


def test_words_are_said_once() -> None:
    control = EmotionControl()
    assert words_of(control, [], "sad") == []
    assert words_of(control, [sound(0), sound(1)], "sad") == ["sad", "-", "-"]
    assert words_of(control, [sound(2)], "sad") == ["-"]
    assert words_of(control, [sound(3)], "angry:0.5") == ["angry:0.5", "-"]
    assert words_of(control, [sound(4)], None) == ["", "-"]


def test_what_was_recorded_counts_until_somebody_asks_for_more() -> None:
    recorded = [EmotionPacket(5, "sad"), sound(0), EmotionPacket(9, ""), sound(1)]
    assert words_of(EmotionControl(), recorded) == ["sad", "-", "", "-"]
    assert next(iter(EmotionControl().inject_emotion(recorded, None))) is recorded[0]
    assert words_of(EmotionControl(), recorded, "neutral") == ["neutral", "-", "-"]
    control = EmotionControl()
    assert words_of(control, recorded[:2], None) == ["sad", "-"]
    assert words_of(control, [sound(1)], "happy") == ["happy", "-"]
    assert words_of(control, [EmotionPacket(9, "angry"), sound(2)], "happy") == ["-"]
    assert words_of(control, [sound(3)], None) == ["angry", "-"]


class Made:
    """A recorder that remembers."""

    problem = ""

    def __init__(self, folder: Path) -> None:
        self.packets: list[Packet] = []

    def append(self, packet: Packet) -> None:
        self.packets.append(packet)

    def close(self) -> None: ...


def test_a_session_begun_later_knows_the_emotion_of_its_start(tmp_path: Path) -> None:
    made: list[Made] = []
    tape = Tape(None, lambda folder: made.append(Made(folder)) or made[-1])
    tape.append(EmotionPacket(0, "sad"))
    tape.append(sound(0))
    tape.apply(Controls("ben", recording=True))
    tape.append(sound(1))
    tape.append(sound(2))
    first = made[0].packets[0]
    assert isinstance(first, EmotionPacket) and (first.t_ns, first.words) == (sound(1).t_ns, "sad")
    assert [isinstance(p, EmotionPacket) for p in made[0].packets] == [True, False, False]
    tape.close()


class Sounds:
    """Ten frames of sound at once."""

    info, dropped, exhausted = SourceInfo("sounds"), 0, False

    def open(self) -> None: ...

    def poll(self) -> list[Packet]:
        self.exhausted = True
        return [sound(k) for k in range(10)]

    def close(self) -> None: ...


class Echo:
    """A driver that notes what it was told to feel."""

    def __init__(self) -> None:
        self.felt: list[str] = []

    def init_state(self, seed: int) -> int:
        return 0

    def step(self, frame, state, timer):  # noqa: ANN001, ANN201
        self.felt.append(frame.emotion)
        return DrivenFrame(frame.index, frame.t_ns, np.zeros(256, np.float32), AHEAD), state

    def close(self) -> None: ...


class Nothing:
    def on_start(self, info: RunInfo) -> None: ...

    def on_frame(self, result: FrameResult) -> None: ...

    def close(self) -> None: ...


def run(source, emotion: str | None = None, record=None) -> list[str]:  # noqa: ANN001
    driver, clock = Echo(), ManualClock()
    parts = Drive(
        source=source,
        driver=driver,  # type: ignore[arg-type]
        clock=clock,
        sinks=[Nothing()],
        panel=Panel(Controls("ben", emotion)),
        record=record,
    )
    drive(parts)
    return driver.felt


@pytest.mark.slow
def test_a_run_is_recorded_with_its_emotion_and_replays_with_it(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "tape", created="") as writer:
        assert run(Sounds(), "sad:0.5", writer.append) == ["sad:0.5"] * 10
    line = (tmp_path / "tape" / "timeline.jsonl").read_text().splitlines()[0]
    assert line == '{"stream":"emotion","t_ns":0,"words":"sad:0.5"}'
    for eyes in (True, False):
        source = ReplaySource(Recording(tmp_path / "tape"), ManualClock(), eyes=eyes)
        assert run(source) == ["sad:0.5"] * 10
    source = ReplaySource(Recording(tmp_path / "tape"), ManualClock())
    assert run(source, "neutral") == ["neutral"] * 10


def test_a_killed_recording_keeps_its_emotions(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "tape", created="")
    for packet in (EmotionPacket(0, "happy"), sound(0), EmotionPacket(5, "sad"), sound(1)):
        writer.append(packet)
    writer._timeline.close()  # noqa: SLF001  # killed: not closed
    packets = [p for e in Recording(tmp_path / "tape").entries
               if (p := Recording(tmp_path / "tape").packet(e))]  # fmt: skip
    assert [p.words for p in packets if isinstance(p, EmotionPacket)] == ["happy", "sad"]


def test_an_emotion_begins_at_the_first_frame_that_ends_after_it() -> None:
    assembler = Assembler()
    assembler.push(EmotionPacket(2 * NS // FPS + 1, "happy"))
    for k in range(4):
        assembler.push(sound(k))
    assert [frame.emotion for frame in assembler.ready()] == ["", "", "happy", "happy"]
