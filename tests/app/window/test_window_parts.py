"""The parts of the window that need no screen: shared memory, layout, eye marks, controls."""

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
from app.window.state.history import KEPT, History
from app.window.state.layout import MIN_SIZE, SIZE, arrange, toolbar_button
from app.window.state.shared import SLOTS, SharedMemory
from encoder.types import DrivenFrame
from render.decoder import identity
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.types import AHEAD
from sensors.clock import ManualClock
from sensors.types import NS, SAMPLES_PER_FRAME, AudioPacket, EyePacket, InputError, SourceInfo


@pytest.mark.parametrize("panels", [True, False])
@pytest.mark.parametrize(
    "size,scale",
    [(MIN_SIZE, 1.0), (SIZE, 1.0), (SIZE, 1.5), ((1920, 1080), 1.5), ((3840, 2160), 2.0)],
)
def test_no_two_areas_overlap(size: tuple[int, int], scale: float, panels: bool) -> None:
    layout = arrange(*size, scale, panels, buttons=8)
    areas = [layout.title, layout.status, layout.toolbar, layout.toast]
    areas += [layout.sidebar] if layout.sidebar else []
    for k, area in enumerate(areas):
        assert area.x >= 0 and area.y >= 0 and area.right <= size[0] and area.bottom <= size[1]
        assert not any(area.overlaps(other) for other in areas[k + 1 :])
    buttons = [toolbar_button(layout.toolbar, k, scale) for k in range(8)]
    assert not any(a.overlaps(b) for a, b in zip(buttons, buttons[1:], strict=False))
    assert all(layout.toolbar.overlaps(b) and b.right < layout.toolbar.right for b in buttons)


def test_ticks_arrive_whole_and_the_oldest_are_overwritten() -> None:
    memory = SharedMemory()
    assert memory.ticks.after(-1) == []
    for k in range(SLOTS + 5):
        memory.ticks.post(index=k, t_ns=k * NS, expression=np.full(256, k), eyes=k)
    found = memory.ticks.after(-1)
    assert [int(t["number"]) for t in found] == list(range(5, SLOTS + 5))
    assert all((t["eyes"] == t["number"]).all() for t in found)
    assert [int(t["index"]) for t in memory.ticks.after(SLOTS + 2)] == [SLOTS + 3, SLOTS + 4]
    memory.ticks.post(index=99)
    assert found[-1]["index"] == SLOTS + 4  # a copy
    memory.close()


def test_a_tick_in_the_making_is_not_read() -> None:
    memory, seen = SharedMemory(), []
    for k in range(SLOTS):
        memory.ticks.post(index=k)

    class Spy:
        """A value that looks at the ring while it is being written into it."""

        def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
            seen.append([int(t["number"]) for t in memory.ticks.after(-1)])
            return np.zeros(256, np.float32)

    memory.ticks.post(index=SLOTS, expression=Spy())  # over tick 0
    assert seen and all(numbers == list(range(1, SLOTS)) for numbers in seen)
    memory.close()


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


def test_history_keeps_its_size_and_counts() -> None:
    history, memory = History(), SharedMemory()
    for k in range(KEPT + 10):
        memory.ticks.post(
            index=k, stage_ms=np.full(10, k), level=(0.1, 1.0), audio_gap=k < 4, dropped=2
        )
        history.add(memory.ticks.after(k - 1)[-1])
    assert history.stage_ms.shape[0] == KEPT and history.tick_ms(100) == KEPT + 9
    assert (history.frames, history.dropped, history.audio_gaps) == (KEPT + 10, 2, 4)
    assert history.level_db == pytest.approx(-20, abs=0.1) and history.peak_db == pytest.approx(0)
    memory.close()


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
        code = np.array([state, frame.audio.max()], np.float32)
        return DrivenFrame(frame.index, frame.t_ns, code, AHEAD), state + 1

    def close(self) -> None: ...

    def recentred(self, state: int) -> int:
        return 100 + state


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
        path = free_name(tmp_path, "livedrive-ben")
        assert path.name == f"livedrive-ben-{number:03d}.png"
        path.touch()
