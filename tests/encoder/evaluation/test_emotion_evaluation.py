"""Judging emotions: truths that differ in the emotion alone, the nearest one, lips and jumps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from mouth_material import lip_geometry

from encoder.capture import dataset
from encoder.capture.judging.emotion_truth import with_each_emotion
from encoder.capture.motion.channels import JAW_OPEN, RIG_INDEX, RIG_NAMES
from encoder.capture.motion.style import Style
from encoder.capture.speech.phones import PHONE_INDEX, Phone, pack_phones
from encoder.denoiser.config import PRESETS, ZeroConvConfig
from encoder.denoiser.model import Denoiser
from encoder.denoiser.zero_conv import ZeroConvs
from encoder.emotion.labels import EMOTIONS, LABELS
from encoder.evaluation import emotion as judging
from encoder.evaluation import emotion_sets
from encoder.evaluation.judging import FaceMesh
from encoder.evaluation.metrics import LipMarks

UPPER = [RIG_INDEX[name] for name in RIG_NAMES if name.startswith(("brow", "eye"))]


def clip(emotion: str, frames: int = 230) -> dataset.Clip:
    """A voice that says "mama" again and again."""
    phones = [Phone(("m", "aa")[k % 2], 0.2 * k, 0.2 * k + 0.2) for k in range(frames // 6)]
    sound = 0.3 * np.sin(np.arange(frames * 1600) * 0.05)
    rig, gaze = np.zeros((frames, len(RIG_NAMES))), np.tile([0.0, 0.0, 1.0], (frames, 2, 1))
    labels = np.array([PHONE_INDEX[("m", "aa")[int(t / 6) % 2]] for t in range(frames)])
    truth = "rules" if emotion == "neutral" else "emotional"
    return dataset.make_clip(
        sound, rig, gaze, labels, spans=pack_phones(phones), truth=truth, voice="x", split="test",
        kind="freeform", emotion=emotion,
    )  # fmt: skip


def test_takes_are_told_again_with_nothing_changed_but_the_emotion() -> None:
    motions = with_each_emotion(clip("neutral"), Style(), None, 1.0, 7)
    assert len(motions) == 1 + len(LABELS)
    calm = motions[0]
    for label, motion in zip(LABELS, motions[1:], strict=True):
        assert np.array_equal(motion.gaze, calm.gaze)
        added = (motion.rig - calm.rig).mean(0)
        for name, weight in EMOTIONS[label].channels.items():
            channel = RIG_INDEX.get(name, RIG_INDEX.get(f"{name}_L", 0))
            if channel in UPPER and weight > 0.3:
                assert added[channel] > 0.1, (label, name)
    again = with_each_emotion(clip("neutral"), Style(), None, 1.0, 7)
    assert np.array_equal(again[3].rig, motions[3].rig)


def test_held_out_sets(tmp_path: Path) -> None:
    clips = [clip("neutral"), clip("sad"), clip("happy")]
    shard = dataset.write_shard(tmp_path / "made_0000", clips, seed=[0, 0, 0])
    other = dataset.write_shard(tmp_path / "grid", [clip("neutral")])
    dataset.write_manifest(tmp_path, [shard, other], {})
    acted = emotion_sets.acted(tmp_path, None, 0)  # type: ignore[arg-type]
    assert [LABELS[told.label] for told in acted] == ["sad", "sad", "happy", "happy"]
    neutral = emotion_sets.neutral(tmp_path, None, 5, 0)  # type: ignore[arg-type]
    assert [told.label for told in neutral] == [-1, -1]
    assert neutral[0].rigs.shape == (1 + len(LABELS), 100, 53)
    assert neutral[0].segment.gaze.shape == (100, 6)
    assert emotion_sets.tracked(tmp_path, None, 5, 0) == []  # type: ignore[arg-type]


def test_real_voices_are_judged_over_as_many_frames_as_the_shortest_has(tmp_path: Path) -> None:
    clips = [
        replace(clip("neutral", frames), truth="tracked", voice=voice)
        for frames, voice in ((230, "facegood"), (89, "grid-s1"), (90, "grid-s1"))
    ]
    shard = dataset.write_shard(tmp_path / "real", clips)
    dataset.write_manifest(tmp_path, [shard], {})
    told = emotion_sets.tracked(tmp_path, lip_geometry(), 5, 0)
    assert [t.rigs.shape for t in told] == [(1 + len(LABELS), 89, 53)] * 4
    assert [len(t.segment.gaze) for t in told] == [89] * 4
    smiles = [t.rigs[1:] for t in told]  # over the same motion, each drawn anew
    assert all(np.abs(one - smiles[0]).max() > 0.01 for one in smiles[1:])
    again = emotion_sets.tracked(tmp_path, lip_geometry(), 5, 0)
    assert np.array_equal(again[3].rigs, told[3].rigs)


def region(codes: np.ndarray) -> np.ndarray:
    return codes[..., :30].reshape(*codes.shape[:-1], 10, 3)


def test_the_nearest_truth_wins_and_confusions_add_up() -> None:
    rng = np.random.default_rng(0)
    truths = rng.standard_normal((10, 20, 256)).astype(np.float32)
    said = np.stack([truths[3] + 0.1, truths[4], truths[7] + 0.1])
    table = judging.confusion(said, np.stack([truths] * 3), [3, 3, 7], region)
    assert table[3, 3] == table[3, 4] == 0.5 and table[7, 7] == 1
    assert table.sum() == 2


def test_codes_share_their_noise_and_differ_by_the_emotion() -> None:
    torch.manual_seed(0)
    model = Denoiser(PRESETS["debug"]).eval()
    zero = ZeroConvs(ZeroConvConfig(labels=LABELS, places=model.config.places))
    audio, gaze = torch.randn(2, 8, 512), torch.randn(2, 8, 6)
    plain = judging.codes(model, None, audio, gaze, [1, 2], 0.0, 0)
    assert np.array_equal(judging.codes(model, zero, audio, gaze, [1, 2], 1.0, 0), plain)
    torch.nn.init.normal_(zero.shifts[-1].weight)  # type: ignore[arg-type]
    felt = judging.codes(model, zero, audio, gaze, [1, 2], 1.0, 0)
    other = judging.codes(model, zero, audio, gaze, [1, 3], 1.0, 0)
    assert np.array_equal(felt[0], other[0]) and not np.array_equal(felt[1], other[1])
    assert not np.array_equal(felt, plain)
    assert np.array_equal(judging.codes(model, zero, audio, gaze, [1, 2], 0.0, 0), plain)


def mouth(codes: np.ndarray) -> np.ndarray:
    """Two corners and two centres; code 0 opens the lips, code 1 draws the corners apart."""
    lips = np.zeros((*codes.shape[:-1], 4, 3), np.float32)
    lips[..., 2, 1], lips[..., 3, 1] = codes[..., 0], 0
    lips[..., 0, 0], lips[..., 1, 0] = 20 + codes[..., 1], -20
    return lips


MESH = FaceMesh(mouth, region, lambda c: c[..., 0], LipMarks((0, 1), (2, 3), np.array([[2, 3]])))


def speech() -> tuple[np.ndarray, list[np.ndarray]]:
    """Codes [1, 100, 256] of lips that open at 3 Hz and shut once, for an m; phones."""
    truth = np.zeros((1, 100, 256), np.float32)
    truth[..., 0] = 5 + 2 * np.sin(np.arange(100) * 2 * np.pi * 3 / 30)
    truth[:, 40:44, 0] = 0
    phones = np.zeros(100, np.int64)
    phones[40:44] = PHONE_INDEX["m"]
    return truth, [phones]


def test_lips_are_judged_by_sync_motion_and_closures() -> None:
    truth, phones = speech()
    figures, closures = judging.lip_metrics([truth], truth, phones, MESH)
    assert figures["lip_sync_mm"] == figures["lip_motion_error"] == 0
    assert figures["lip_motion_r"] == pytest.approx(1)
    assert closures.recall == 1 and closures.of.tolist() == [1]
    ajar, smiling = truth + 2 * (np.arange(256) == 0), truth + 3 * (np.arange(256) == 1)
    figures, closures = judging.lip_metrics([ajar.astype(np.float32)], truth, phones, MESH)
    assert figures["lip_sync_mm"] == pytest.approx(2) and closures.recall == 0
    figures, closures = judging.lip_metrics([smiling.astype(np.float32)], truth, phones, MESH)
    assert figures["lip_sync_mm"] == pytest.approx(3) and closures.recall == 1


def test_a_style_is_no_error_of_motion_but_stillness_and_lateness_are() -> None:
    truth, phones = speech()
    for size in (1.0, 2.0):
        real = size * truth
        smiling = (real + 3 * (np.arange(256) == 1)).astype(np.float32)
        still = np.broadcast_to(real.mean(1, keepdims=True), real.shape)
        late = np.roll(real, 3, 1)
        error = {
            name: judging.lip_metrics([said], real, phones, MESH)[0]["lip_motion_error"]
            for name, said in (("smiling", smiling), ("still", still), ("late", late))
        }
        assert error["smiling"] < 1e-4 and error["late"] > 0.8
        assert error["still"] == pytest.approx(1, abs=1e-4)


def test_closures_lost_come_with_their_error() -> None:
    half = judging.Closures(np.full(8, 2.0), np.tile([2.0, 0.0], 4))
    fewer = judging.Closures(np.full(8, 2.0), np.tile([1.0, 0.0], 4))
    takes = [0, 0, 1, 1, 2, 2, 3, 3]
    lost = judging.closures_lost(fewer, half, takes, "neutral")
    assert lost["neutral_closures_lost"] == pytest.approx(0.25)
    assert lost["neutral_closures_lost_error"] == pytest.approx(0)  # every take loses alike
    assert (lost["closure_recall"], lost["closures"]) == (0.25, 16)
    uneven = judging.Closures(np.full(8, 2.0), np.array([2.0, 0, 0, 0, 0, 0, 2, 0]))
    lost = judging.closures_lost(uneven, half, takes, "neutral")
    assert lost["neutral_closures_lost_error"] == pytest.approx(np.sqrt(4 / 3 * 4 / 256))
    none = judging.Closures(np.zeros(8), np.zeros(8))
    assert judging.closures_lost(none, none, takes, "neutral") == {}


def test_the_rules_lie_over_the_neutral_lips_in_their_mean_style() -> None:
    rig = np.zeros((2, 30, len(RIG_NAMES)), np.float32)
    rig[..., JAW_OPEN] = 0.3
    happy, bored = LABELS.index("happy"), LABELS.index("bored")
    laid = judging.laid_over(rig, [happy, bored], 1.0, lip_geometry())
    smile = RIG_INDEX["mouthSmile_L"]
    assert 0.4 < laid[0, 5, smile] < 0.6 and np.ptp(laid[0, :, smile]) < 1e-6
    assert laid[1, 5, JAW_OPEN] == pytest.approx(0.3 * EMOTIONS["bored"].mouth, rel=1e-4)


def test_a_jump_is_seen() -> None:
    codes = np.zeros((10, 256), np.float32)
    codes[6:, 4] = 3
    moves = judging.largest_moves(codes, region)
    assert moves.argmax() == 5 and moves.max() == pytest.approx(3)
