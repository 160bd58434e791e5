"""`livedrive calibrate`: the routine's schedule, what it collects, and where it is kept."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from app.commands.calibrate import Calibrate
from app.compose import calibrate
from app.drive.calibration import in_session, keep, of_session, of_user, profile_path, undo
from app.drive.eye_routine import collect, words_of
from app.web.info import ServerInfo
from encoder.eyes.calibration import EyeCalibration
from encoder.eyes.encoder import EyeReading
from encoder.eyes.format import unit
from encoder.eyes.routine import ROUTINE, RoutineStep, TargetSamples
from render.types import AHEAD
from sensors.clock import ManualClock
from sensors.session.recording import RecordingWriter
from sensors.types import AudioPacket, EyePacket, InputError, Packet, SourceInfo


class Pictures:
    """Ten seconds of pictures whose grey says which frame they are."""

    info = SourceInfo("test", eyes=(0, 1))
    dropped = 0

    def __init__(self, frames: int = 310) -> None:
        self.count, self.frames = 0, frames

    @property
    def exhausted(self) -> bool:
        return self.count >= self.frames

    def open(self) -> None: ...
    def close(self) -> None: ...

    def poll(self) -> list[Packet]:
        t, self.count = self.count, self.count + 1
        t_ns = t * 1_000_000_000 // 30
        image = np.full((400, 400), t % 250, np.uint8)
        eyes: list[Packet] = [EyePacket(t_ns, eye, t, image) for eye in (0, 1)]
        return [*eyes, AudioPacket(t_ns, 1600 * t, np.zeros(1600, np.float32))]


class Grey:
    """An encoder that reads the lid off the grey; the right eye is never seen."""

    def step(self, eyes: np.ndarray, framing: object) -> tuple[EyeReading, object]:
        lids, score = eyes[:, 0, 0].astype(np.float32) / 250, np.float32([0.9, 0.1])
        features = np.zeros((2, 80), np.float32)
        return EyeReading(features, AHEAD, lids, score, AHEAD, AHEAD), framing


grey = Grey()


def test_collects_what_each_target_showed() -> None:
    said: list[str] = []

    def show(target: RoutineStep) -> None:
        said.append(words_of(target))

    takes = collect(Pictures(), grey, ManualClock(), show, live=False)  # type: ignore[arg-type]
    assert [take.target for take in takes] == list(ROUTINE)
    assert len(said) == len(ROUTINE) and said[0] == "look straight ahead"
    assert said[1].endswith("left") and said[4].endswith("down")
    assert sum(len(take.gaze) for take in takes) == 300
    second = takes[1]
    assert np.array_equal(np.rint(250 * second.lids[:, 0]), np.arange(42, 84))
    assert second.good[:, 0].all() and not second.good[:, 1].any()


def test_a_short_recording_is_one_line() -> None:
    with pytest.raises(InputError, match="whole routine"):
        collect(Pictures(50), grey, ManualClock(), lambda _: None, live=False)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="got none"):
        Calibrate().run()


def test_is_kept_for_the_user_and_in_the_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert of_user() is None
    calibration = EyeCalibration(shift=((0.1, 0.0), (0.0, 0.2)))
    calibration.save(profile_path())
    assert of_user() == calibration
    kept = in_session(SimpleNamespace(calibration=calibration))  # type: ignore[arg-type]
    recording = SimpleNamespace(card={"calibration": kept}, folder=tmp_path)
    assert of_session(recording) == calibration  # type: ignore[arg-type]
    empty = SimpleNamespace(card={"calibration": {}}, folder=tmp_path)
    assert of_session(empty) is None  # type: ignore[arg-type]
    cut = SimpleNamespace(card={"calibration": {"eyes": {"format": 3}}}, folder=tmp_path)
    with pytest.raises(InputError, match=r"got another; restore session.json"):
        of_session(cut)  # type: ignore[arg-type]  # red before: calibrate again, of no help here
    assert in_session(SimpleNamespace(calibration=None)) == {}  # type: ignore[arg-type]


def test_a_calibration_can_be_taken_back(tmp_path: Path) -> None:
    path = tmp_path / "eyes.json"
    with pytest.raises(InputError, match="got none"):
        undo(path)
    first, second = (EyeCalibration(shift=((x, 0.0), (0.0, 0.0))) for x in (0.1, 0.2))
    keep(first, path)
    assert not undo(path) and of_user(path) is None  # none was there before
    assert undo(path) and of_user(path) == first
    keep(second, path)
    assert undo(path) and of_user(path) == first
    assert undo(path) and of_user(path) == second
    assert {f.stat().st_mode & 0o777 for f in tmp_path.iterdir()} == {0o600}


def wandering(seed: int) -> list[TargetSamples]:
    rng, rows = np.random.default_rng(seed), list[TargetSamples]()
    for target in ROUTINE:
        frames = int(target.seconds * 30)
        gaze = np.tile(unit(rng.uniform(-0.4, 0.4, 2)), (frames, 2, 1))
        rows.append(
            TargetSamples(target, gaze, gaze, np.ones((frames, 2)), np.ones((frames, 2), bool))
        )
    return rows


def test_nothing_is_written_where_nobody_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: it was written."""
    path = tmp_path / "eyes.json"
    keep(EyeCalibration(), path)
    monkeypatch.setattr(calibrate, "takes_of_cameras", lambda *words: wandering(3))
    with pytest.raises(InputError, match="nothing was written"):
        Calibrate(eyes=("uvc:0",), out=path).run()
    assert of_user(path) == EyeCalibration() and len(list(tmp_path.iterdir())) == 1
    assert "did not follow" in capsys.readouterr().out


class Page:
    """A page that somebody opens a while after the start."""

    made: ClassVar[list[Page]] = []

    def __init__(self, info: ServerInfo, clock: object) -> None:
        self.info, self.link, self.status, self.ended = info, self, {"watching": 0}, False
        self.said: list[dict[str, object]] = []
        self.made.append(self)

    def on_start(self, info: object) -> None: ...
    def close(self) -> None:
        self.ended = True

    def read(self) -> None:
        self.said.append({})
        self.status["watching"] = int(len(self.said) > 5)

    def say(self, target: dict[str, object]) -> None:
        assert self.status["watching"], "nobody was there yet"
        self.said.append(target)


def test_a_page_shows_the_targets_once_somebody_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Red before: there was terminal text alone, which nobody sees in a headset."""
    monkeypatch.setattr("app.web.sink.WebSink", Page)
    monkeypatch.setattr("sensors.live.source.LiveSource", lambda *words: Pictures(400))
    monkeypatch.setattr("encoder.eyes.encoder.load_eye_encoder", lambda folder: grey)
    takes = calibrate.takes_of_cameras(("uvc:0",), 8443)
    (page,) = Page.made
    said = [target for target in page.said if target]
    assert len(takes) == len(said) == len(ROUTINE) and page.ended and page.info.targets
    assert [t["yaw_deg"] for t in said[1:3]] == [15, -15] and said[5]["words"].startswith("blink")  # type: ignore[union-attr]


def test_a_session_without_eyes_is_told(tmp_path: Path) -> None:
    """Red before: it wrote a calibration."""
    with RecordingWriter(tmp_path / "voice", created="") as writer:
        writer.append(AudioPacket(0, 0, np.zeros(48_000 * 11, np.float32)))
    with pytest.raises(InputError, match="pictures of the eyes"):
        Calibrate(session=tmp_path / "voice", out=tmp_path / "eyes.json").run()
    assert not (tmp_path / "eyes.json").exists()


def test_the_routine_waits_for_the_cameras_and_names_one_that_is_missing() -> None:
    """Red before: all targets were shown to nobody, and then no eye had been seen."""
    said, left = list[str](), [7]

    def opening() -> str:
        left[0] -= 1
        return "uvc:0: connecting" if left[0] > 0 else ""

    def run(frames: int, problems: Callable[[], str]) -> list[TargetSamples]:
        clock = ManualClock()
        source = Pictures(frames)
        show = lambda target: said.append(words_of(target))  # noqa: E731
        return collect(source, grey, clock, show, live=True, problems=problems)  # type: ignore[arg-type]

    takes = run(370, opening)
    assert len(said) == len(ROUTINE) == len(takes) and left[0] <= 0
    said.clear()
    told = "uvc:9: it is not there; see: livedrive devices"
    for problem in ("uvc:9: it is not there", told):  # red before: the command stood there twice
        with pytest.raises(InputError, match=f"got none: {told}$"):
            run(600, lambda problem=problem: problem)
    assert not said


def test_a_file_that_cannot_be_written_is_told_before_the_routine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: the routine was done for nothing."""
    monkeypatch.setattr(calibrate, "takes_of_cameras", lambda *words: pytest.fail("it began"))
    (tmp_path / "file").write_text("")
    for path in (tmp_path, tmp_path / "file" / "eyes.json", Path("/proc/eyes.json")):
        with pytest.raises(InputError):
            Calibrate(eyes=("uvc:0",), out=path).run()
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
