"""Playback: a session that goes on like a live source, whatever is done to it."""

from pathlib import Path

import numpy as np
import pytest

from sensors.assemble import Assembler
from sensors.clock import ManualClock
from sensors.session.playback import Playback
from sensors.session.recording import Recording, RecordingWriter
from sensors.types import FPS, NS, AudioPacket, EmotionPacket, EyePacket, Packet

FRAMES = 30  # of a second, at the value k / FRAMES each


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with RecordingWriter(tmp_path / "s", created="") as writer:
        for k in range(FRAMES):
            t_ns = 7 * NS + k * NS // FPS
            writer.append(AudioPacket(t_ns, 5000 + 1600 * k, np.full(1600, k / 64, np.float32)))
            writer.append(EyePacket(t_ns, 0, k, np.full((400, 400), k, np.uint8)))
    return tmp_path / "s"


class Viewer:
    """Polls at 30 Hz and keeps the sound of every frame."""

    def __init__(self, folder: Path, eyes: bool = True) -> None:
        self.clock, self.away = ManualClock(), True
        self.source = Playback(Recording(folder), self.clock, eyes=eyes, waits=lambda: self.away)
        self.assembler, self.packets = Assembler(), list[Packet]()
        self.source.open()

    @property
    def emotions(self) -> list[str]:
        """That have come."""
        return [p.words for p in self.packets if isinstance(p, EmotionPacket)]

    def watch(self, frames: int) -> list[int]:
        shown: list[int] = []
        for _ in range(frames):
            self.clock.sleep_until_ns(self.clock.now_ns() + NS // FPS)
            for packet in self.source.poll():
                self.packets.append(packet)
                self.assembler.push(packet)
            for frame in self.assembler.ready():
                assert not frame.audio_gap
                assert abs(frame.t_ns - self.clock.now_ns()) < 2 * NS // FPS
                shown.append(round(float(frame.audio[800]) * 64))
        return shown


def test_a_jump_behind_the_last_sound_begins_anew(folder: Path) -> None:
    """Red before: where pictures go on after the sound, all of it came in one tick."""
    with RecordingWriter(folder.parent / "late", created="") as writer:
        for k in range(FRAMES):
            t_ns = 7 * NS + k * NS // FPS
            writer.append(AudioPacket(t_ns, 1600 * k, np.zeros(1600, np.float32)))
        writer.append(EyePacket(9 * NS, 0, 0, np.zeros((400, 400), np.uint8)))
    viewer = Viewer(folder.parent / "late", eyes=False)
    viewer.away = False
    assert viewer.watch(3)
    viewer.source.jump(1.9)
    assert len(viewer.watch(1)) <= 1


def test_it_waits_loops_pauses_and_jumps(folder: Path) -> None:
    viewer = Viewer(folder)
    assert viewer.watch(50) == []  # nobody has come
    viewer.away = False
    seen = viewer.watch(FRAMES + 12)
    assert seen[:FRAMES] == list(range(FRAMES))
    assert seen[FRAMES : FRAMES + 9] == list(range(9))  # and anew
    viewer.source.pause()
    assert viewer.watch(20) == []
    viewer.source.pause()
    after = viewer.watch(5)
    assert after[0] == seen[-1] + 1
    viewer.source.jump(0.5)
    assert viewer.watch(6)[:3] in ([14, 15, 16], [15, 16, 17])
    viewer.source.jump(60.25)  # far behind the end
    assert viewer.watch(4)
    sounds = [p for p in viewer.packets if isinstance(p, AudioPacket)]
    firsts = [p.first_sample for p in sounds]
    assert firsts == list(range(0, 1600 * len(firsts), 1600))  # counted on
    assert np.all(np.diff([p.t_ns for p in sounds]) > 0)
    pictures = [p.counter for p in viewer.packets if isinstance(p, EyePacket)]
    assert pictures == list(range(len(pictures)))
    viewer.source.stop()
    assert viewer.source.exhausted and viewer.watch(3) == []


def test_each_moment_has_its_emotion(tmp_path: Path) -> None:
    """Red before: that of the start never came, and the last one stayed when it began anew."""
    start_ns = 7 * NS
    with RecordingWriter(tmp_path / "s", created="") as writer:
        for k in range(FRAMES):
            t_ns = start_ns + k * NS // FPS
            if k in (0, 20):
                writer.append(EmotionPacket(t_ns, "sad" if k else "happy"))
            writer.append(AudioPacket(t_ns, 1600 * k, np.full(1600, k / 64, np.float32)))
    viewer = Viewer(tmp_path / "s", eyes=False)
    viewer.away = False
    viewer.watch(FRAMES // 2)
    assert viewer.emotions == ["happy"]
    viewer.watch(FRAMES)
    assert viewer.emotions[1] == "sad" and viewer.emotions[-1] == "happy"  # it has begun anew
    viewer.source.jump(0.9)
    viewer.watch(1)
    assert viewer.emotions[-1] == "sad"
    viewer.source.jump(0.3)
    viewer.watch(1)
    assert viewer.emotions[-1] == "happy"


def test_a_session_without_sound_is_at_its_end(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "s", created="") as writer:
        writer.append(EyePacket(0, 0, 0, np.zeros((400, 400), np.uint8)))
    assert Viewer(tmp_path / "s").source.exhausted
