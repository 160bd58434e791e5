"""The parts of the window that need no screen: eye marks, controls, the loop behind them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.commands.replay import Replay
from app.drive.controls import Controls, muted
from app.drive.loop import Drive, drive
from app.drive.sink import FrameResult, RunInfo
from app.drive.view import PortraitView, View
from app.window.panels.eyes import EyeMarks
from encoder.types import DrivenFrame
from render.decoder import identity
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.types import AHEAD
from sensors.clock import ManualClock
from sensors.types import NS, SAMPLES_PER_FRAME, AudioPacket, EyePacket, InputError, SourceInfo


@pytest.mark.slow
def test_eye_marks_follow_gaze_and_lids() -> None:
    decoder, who = Decoder.load(), identity.load("ben")
    marks = EyeMarks(decoder, who)

    def code(blink: float) -> np.ndarray:
        rig = np.zeros(len(decoder.rig_names), np.float32)
        rig[[decoder.rig_names.index(f"eyeBlink_{side}") for side in "LR"]] = blink
        return decoder.encode(rig)

    up = np.tile(np.array([0, np.sin(0.3), np.cos(0.3)], np.float32), (2, 1))
    left = np.tile(np.array([np.sin(0.3), 0, np.cos(0.3)], np.float32), (2, 1))
    for eye in range(2):
        rest, high, aside = (marks.of(eye, code(0), look) for look in (AHEAD, up, left))
        assert high.pupil[1] < rest.pupil[1] - 2 and high.pitch_deg == pytest.approx(17.2, abs=0.1)
        # Someone before the head sees its left at their right.
        assert aside.pupil[0] > rest.pupil[0] + 2 and aside.yaw_deg == pytest.approx(17.2, abs=0.1)
        shut = marks.of(eye, code(1), AHEAD)
        assert rest.opening == pytest.approx(1, abs=0.02)
        assert shut.opening == pytest.approx(0, abs=0.02)
        assert np.ptp(shut.lids[:, 1]) < 0.4 * np.ptp(rest.lids[:, 1])
        inside = (rest.lids.min(0) < rest.pupil) & (rest.pupil < rest.lids.max(0))
        assert inside.all()


class Panel:
    """A panel whose controls change at given ticks."""

    def __init__(self, **at: int) -> None:
        self.at, self.ticks = at, 0

    def read(self) -> Controls:
        self.ticks += 1
        asked = {name: self.ticks > tick for name, tick in self.at.items()}
        return Controls(
            avatar="ben",
            muted=asked.get("muted", False),
            resets=int(asked.get("reset", False)),
            recentred=int(asked.get("recentre", False)),
            closed=asked.get("closed", False),
        )


class Sound:
    """A source of ten frames, one a poll."""

    info, dropped = SourceInfo("sound"), 0

    def __init__(self) -> None:
        self.sent = 0

    @property
    def exhausted(self) -> bool:
        return self.sent >= 10

    def open(self) -> None: ...

    def poll(self) -> list[AudioPacket]:
        first = self.sent * SAMPLES_PER_FRAME
        self.sent += 1
        return [AudioPacket(first * NS // 48000, first, np.ones(SAMPLES_PER_FRAME, np.float32))]

    def close(self) -> None: ...


class Steps:
    """A driver that says how often it was stepped and how loud it was."""

    def init_state(self, seed: int) -> int:
        return 0

    def step(self, frame, state, timer):  # noqa: ANN001, ANN201
        for wanted in frame.requests:
            state = 0 if wanted == "reset" else 100 + state
        code = np.array([state, frame.audio.max()], np.float32)
        return DrivenFrame(frame.index, frame.t_ns, code, AHEAD), state + 1

    def close(self) -> None: ...


class Keep:
    def __init__(self) -> None:
        self.codes: list[tuple[float, float]] = []

    def on_start(self, info: RunInfo) -> None: ...

    def on_frame(self, result: FrameResult) -> None:
        steps, loudness = result.driven.expression
        self.codes.append((steps, loudness))

    def close(self) -> None: ...


def run(panel: Panel) -> list[tuple[float, float]]:
    sink = Keep()
    drive(parts(panel, sink))
    return sink.codes


def parts(panel: Panel, sink: Keep, view: View | None = None) -> Drive:
    return Drive(
        source=Sound(),  # type: ignore[arg-type]
        driver=Steps(),  # type: ignore[arg-type]
        clock=ManualClock(),
        sinks=[sink],
        view=view,
        panel=panel,
    )


@pytest.mark.slow
def test_the_loop_mutes_starts_anew_and_ends_when_asked() -> None:
    assert run(Panel()) == [(k, 1.0) for k in range(10)]
    assert [loud for _, loud in run(Panel(muted=4))] == [1.0] * 4 + [0.0] * 6
    assert [steps for steps, _ in run(Panel(reset=6))] == [0, 1, 2, 3, 4, 5, 0, 1, 2, 3]
    steps = [steps for steps, _ in run(Panel(recentre=6))]
    assert steps == [0, 1, 2, 3, 4, 5, 106, 107, 108, 109]  # once, and nothing is forgotten
    assert len(run(Panel(closed=3))) == 3


def test_the_loop_draws_the_avatar_that_is_picked() -> None:
    class Drawing:
        """Decoder and renderer in one: remembers whom it drew."""

        def __init__(self) -> None:
            self.drawn: list[str] = []

        def decode(
            self, expression: object, gaze: object, who: Identity, *_: object, **__: object
        ) -> tuple[None, None]:
            self.drawn.append(who.name)
            return None, None

        name = "test"

        def draw(self, gaussians: object, camera: object) -> None: ...
        def close(self) -> None: ...
        def read_rgba(self) -> np.ndarray:
            return np.zeros((4, 4, 4), np.uint8)

    class Picks(Panel):
        def read(self) -> Controls:
            return replace(super().read(), avatar="ben" if self.ticks <= 4 else "kofi")

    drawing = Drawing()
    view = PortraitView(drawing, identity.load("ben"), drawing, None)  # type: ignore[arg-type]
    drive(parts(Picks(), Keep(), view))
    assert drawing.drawn == ["ben"] * 5 + ["kofi"] * 6  # the first one warms up


def test_a_window_has_the_pace_of_the_recording() -> None:
    with pytest.raises(InputError, match="--fast or --window"):
        Replay(session=Path("recordings/smoke"), fast=True, window=True).run()


def test_muting_hushes_sound_and_leaves_pictures() -> None:
    packet = AudioPacket(5, 7, np.ones(3, np.float32), gap=True)
    silent = muted(packet)
    assert isinstance(silent, AudioPacket)
    assert (silent.t_ns, silent.first_sample, silent.gap) == (5, 7, True)
    assert not silent.samples.any() and packet.samples.all()
    eye = EyePacket(0, 0, 0, np.zeros((400, 400), np.uint8))
    assert muted(eye) is eye


def test_pictures_never_overwrite_each_other(tmp_path: Path) -> None:
    from app.window.window import free_name

    for number in range(1, 4):
        path = free_name(tmp_path, "ben")
        assert path.name == f"livedrive-ben-{number:03d}.png"
        path.touch()
    file = free_name(tmp_path, str(tmp_path / "my" / "ben.safetensors"))  # red before: a crash
    assert file == tmp_path / "livedrive-ben.safetensors-001.png"
