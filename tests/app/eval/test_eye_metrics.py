"""The parts of `livedrive eval eyes` that need neither weights nor rendered clips."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from app.eval.eyes import metrics as eye_metrics
from app.eval.eyes.clips import EyeClip
from app.eval.eyes.evaluate import make_thresholds, walk_metrics
from app.eval.eyes.metrics import Metrics, blinded, calibrated, encoder_metrics, fault_metrics
from app.eval.eyes.sheets import sheet
from encoder.eyes.encoder import EyeReading
from encoder.eyes.format import unit
from encoder.eyes.routine import ROUTINE

FRAMES = 90


class Told:
    """An encoder that reads gaze and lid off the first pixels; flat pictures are no eyes."""

    def __init__(self, lid: float = 1.0) -> None:
        self.lid = lid

    def __call__(self, eyes: np.ndarray) -> EyeReading:
        xy = (eyes[:, 0, :2].astype(np.float32) - 128) / 256
        lids = np.float32(self.lid) * eyes[:, 0, 2].astype(np.float32) / 255
        valid = (eyes[:, 0, 3] == (7, 9)).astype(np.float32)
        features, gaze = np.zeros((2, 80), np.float32), unit(xy)
        return EyeReading(
            features, gaze, lids, valid, gaze, gaze, told_gaze=gaze, told_lids=lids, side=valid
        )

    def step(self, eyes: np.ndarray, framing: None) -> tuple[EyeReading, None]:
        return self(eyes), framing


told = Told()


def written(gaze: np.ndarray, lids: np.ndarray) -> np.ndarray:
    """Pictures [T, 2, 400, 400] that `told` reads."""
    eyes = np.zeros((len(gaze), 2, 400, 400), np.uint8)
    eyes[:, :, 0, :2] = np.rint(gaze[..., :2] * 256 + 128)
    eyes[:, :, 0, 2] = np.rint(lids * 255)
    eyes[:, :, 0, 3] = (7, 9)
    return eyes


def clip(bias: float = 0.0) -> EyeClip:
    rng = np.random.default_rng(0)
    xy = np.repeat(rng.uniform(-0.2, 0.2, (FRAMES // 10, 1, 2)), 10, 0)
    gaze = unit(xy + np.array([[-0.032, 0], [0.032, 0]]))  # at something a metre away
    lids = np.ones((FRAMES, 2), np.float32)
    lids[20:26] = lids[60:64] = 0
    routine = tuple(
        (
            target,
            written(
                unit(np.tile(target.direction[:2] + bias, (14, 2, 1))),
                np.full((14, 2), float(target.name != "close")),
            ),
        )
        for target in ROUTINE
    )
    seen = unit(gaze[..., :2] + bias)
    seen[lids == 0] = unit(np.float32([0.4, -0.3]))  # what shut eyes seem to show is not judged
    return EyeClip(
        np.zeros((FRAMES, 1600), np.float32), written(seen, lids),
        np.zeros((FRAMES, 53), np.float32), gaze, lids, routine,
    )  # fmt: skip


def test_metrics_of_a_perfect_and_of_a_biased_encoder() -> None:
    perfect = encoder_metrics(told, [clip()])  # type: ignore[arg-type]
    assert perfect["gaze_error_deg_median"] < 0.3 and perfect["lid_error_mean"] < 0.01
    assert perfect["blinks"] == 4 and perfect["blink_f1"] == 1
    assert perfect["gaze_error_deg_p95"] < 0.3
    low = encoder_metrics(Told(0.8), [clip()])  # type: ignore[arg-type]
    assert low["lid_error_mean"] == pytest.approx(0.2 * clip().lids.mean(), abs=0.01)
    biased = encoder_metrics(told, [clip(0.08)])  # type: ignore[arg-type]
    assert biased["gaze_error_deg_median"] > 4
    assert biased["gaze_error_calibrated_deg_median"] < 1
    assert calibrated(told, clip(0.08)).shift[0][0] == pytest.approx(-0.08, abs=0.02)  # type: ignore[arg-type]


def test_flags_that_fall_and_flags_that_stay() -> None:
    metrics = fault_metrics(told, [clip()], seed=0)  # type: ignore[arg-type]
    assert metrics["flag_falls_black"] == metrics["flag_falls_swapped"] == 1
    broken = fault_metrics(
        lambda eyes: told(eyes)._replace(lids=np.full(2, np.nan, np.float32)),  # type: ignore[arg-type]
        [clip()], seed=0,
    )  # fmt: skip
    assert broken["flag_falls_black"] == 0  # what is not finite has failed


def test_blinding_touches_one_eye_of_one_frame() -> None:
    frames = clip().frames()
    after = blinded(frames[3], (1,))
    assert after.eyes_valid.tolist() == [True, False] and frames[3].eyes_valid.all()
    assert clip().frames(silent=True)[5].audio.max() == 0


class FakeMesh:
    """A head whose codes' first number is its lids' blink, the second what its face shows."""

    def upper_face(self, codes: np.ndarray) -> np.ndarray:
        return np.repeat(codes[:, 1:2, None], 3, -1)

    lips = upper_face

    def blink(self, codes: np.ndarray) -> np.ndarray:
        return codes[:, 0]


def metrics_of_a_late_head(monkeypatch: pytest.MonkeyPatch, late: int, half: bool) -> Metrics:
    """A head that blinks with the clip's eyes, later the louder it is, and half blinks or not."""
    seen = replace(clip(), audio=np.ones((FRAMES, 1600), np.float32))
    seen.lids[40:43] = 0.4  # turns round on its way
    lids = seen.lids.mean(1) if half else clip().lids.mean(1)
    audio = np.full((FRAMES, 256), 2, np.float32)

    def drive(driver: str, frames: list, seed: int) -> tuple[np.ndarray, None]:
        codes = np.zeros((FRAMES, 256), np.float32)
        codes[:, 0] = 1 - np.roll(lids, late * bool(frames[0].audio.any()))
        return codes if driver == "eyes" else audio, None

    monkeypatch.setattr("encoder.offline.drive_clip", drive)
    monkeypatch.setattr(eye_metrics, "told", lambda *_: audio / 2)
    monkeypatch.setattr("encoder.evaluation.metrics.upper_face_deviation_mm", lambda *_: 0.0)

    def encode(rig: np.ndarray) -> np.ndarray:
        return np.zeros((len(rig), 256), np.float32)

    return eye_metrics.head_metrics("eyes", "audio", [seen], FakeMesh(), encode, seed=0)  # type: ignore[arg-type]


def test_the_head_blinks_when_the_eyes_do(monkeypatch: pytest.MonkeyPatch) -> None:
    for late, on_time in ((0, 1.0), (1, 1.0), (-1, 1.0), (2, 0.0)):
        metrics = metrics_of_a_late_head(monkeypatch, late, half=True)
        for sound, share in (("speech", on_time), ("silence", 1)):
            assert metrics[f"avatar_closes_on_time_{sound}"] == share
            assert metrics[f"avatar_blinks_on_time_{sound}"] == share
    metrics = metrics_of_a_late_head(monkeypatch, 0, half=False)
    assert metrics["avatar_closes_on_time_silence"] == 1
    assert metrics["avatar_closings"] == 2
    assert metrics["avatar_blinks_on_time_silence"] == pytest.approx(2 / 3)
    assert metrics["upper_face_mm_eyes"] == 0 < metrics["upper_face_mm_true_gaze"]
    assert metrics["upper_face_mm_synthesised"] == 2 * metrics["upper_face_mm_true_gaze"]


@pytest.mark.parametrize("jump,late", [(0.0, 0), (0.9, 0), (0.0, 12)])
def test_lost_cameras_show_as_jumps_and_late_returns(
    monkeypatch: pytest.MonkeyPatch, jump: float, late: int
) -> None:
    still = unit(np.tile(np.float32([[-0.032, 0], [0.032, 0]]), (1, 1, 1)))[0]
    graph = namedtuple("Driver", "graph")(namedtuple("Graph", "gaze")(clip().gaze[None]))

    def drive(_: object, frames: list, seed: int) -> tuple[np.ndarray, np.ndarray]:
        codes, gaze = np.zeros((len(frames), 256), np.float32), []
        codes[:, 1] = 0.1 * (np.arange(len(frames)) % 2)  # its face moves
        since = 99
        for t, frame in enumerate(frames):
            since = since + 1 if frame.eyes_valid.all() else 0
            codes[t, 1] += jump * (since == 0)
            gaze.append(unit(still[:, :2] + (jump + 0.01) * (since <= late)))
        return codes, np.stack(gaze)

    monkeypatch.setattr("encoder.offline.drive_clip", drive)
    metrics = eye_metrics.loss_metrics(graph, [clip()], FakeMesh(), seed=0)  # type: ignore[arg-type]
    assert metrics["losses_tried"] == 4
    assert (metrics["loss_gaze_jump_over_normal"] > 1) == (jump > 0)
    assert (metrics["loss_face_jump_over_normal"] > 1) == (jump > 0)
    assert metrics["recovery_ms_worst"] == pytest.approx(late * 1000 / 30, abs=1)


def test_thresholds_are_those_of_the_metrics_there_are() -> None:
    thresholds = {
        bar["name"]: bar["ok"] for bar in make_thresholds({"blink_f1": 0.9, "eyes_cpu_ms": 1.4})
    }
    assert thresholds == {"blink_f1": False, "eyes_cpu_ms": True}


def test_shipped_walk_has_the_statistics_of_its_source(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.eval.eyes.evaluate.WALK_MINUTES", 30.0)
    metrics = walk_metrics(seed=3)
    assert metrics["walk_worst_off"] < 0.15 and metrics["walk_jump_over_source"] <= 1.01


def test_a_sheet_has_room_for_every_picture(tmp_path: Path) -> None:
    frame = np.full((400, 400), 150, np.uint8)
    ahead = (np.float32([0.1, 0, 1]), 0.5, 0.9)
    sheet([frame] * 7, [ahead] * 7, tmp_path / "s" / "p.png")
    assert Image.open(tmp_path / "s" / "p.png").size == (1200, 400)
