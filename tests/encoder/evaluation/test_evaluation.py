"""Rows of the paper's tables: shapes, what is drawn anew, and that each row is what it says."""

from pathlib import Path

import numpy as np
import pytest
import torch

from encoder.audio.config import PRESETS as ENCODERS
from encoder.audio.encoder import AudioEncoder
from encoder.capture import dataset
from encoder.capture.motion.channels import JAW_OPEN, RIG_NAMES
from encoder.capture.speech.phones import PHONE_INDEX
from encoder.denoiser.config import PRESETS
from encoder.denoiser.diffusion import Guidance
from encoder.denoiser.model import Denoiser
from encoder.evaluation import judging
from encoder.evaluation import rows as evaluation
from encoder.evaluation.metrics import LipMarks


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A training and a test clip of 220 frames: loud is open, m where it is quiet."""
    folder, clips = tmp_path_factory.mktemp("pack"), []
    for split in ("train", "test"):
        level = np.clip(np.sin(np.arange(220) * 0.5), 0, 1)
        sound = np.repeat(level, 1600) * np.sin(np.arange(220 * 1600) * 0.05) * 0.3
        rig = np.zeros((220, len(RIG_NAMES)))
        rig[:, JAW_OPEN] = 0.4 * level
        gaze = np.tile([0.0, 0.0, 1.0], (220, 2, 1))
        phones = np.where(level > 0.8, PHONE_INDEX["aa"], PHONE_INDEX["t"])
        phones[level == 0] = PHONE_INDEX["m"]
        clips.append(
            dataset.make_clip(sound, rig, gaze, phones, truth="rules", voice="tone", split=split)
        )
    shard = dataset.write_shard(folder / "shard_000.npz", clips)
    dataset.write_manifest(folder, [shard], {"tones": "made by rules"})
    return folder


@pytest.fixture(scope="module")
def segments(pack: Path) -> list[evaluation.Segment]:
    (kind,) = evaluation.held_out_segments(pack, 5).values()
    return kind


@pytest.fixture
def model() -> Denoiser:
    torch.manual_seed(0)
    model = Denoiser(PRESETS["debug"]).eval()
    for block in model.blocks:
        torch.nn.init.normal_(block.modulate.weight, std=0.1)
    return model


@pytest.fixture
def audio(segments: list[evaluation.Segment]) -> torch.Tensor:
    torch.manual_seed(0)
    encoder = AudioEncoder(ENCODERS["debug"]).eval()
    return evaluation.features(segments, evaluation.whole(encoder))


def mesh() -> judging.FaceMesh:
    """Two lips and two corners; code 0 opens them by 10 mm a unit."""
    rest = np.array([[20, 0, 0], [-20, 0, 0], [0, 0, 0], [0, 0, 0]], np.float32)

    def lips(codes: np.ndarray) -> np.ndarray:
        moved = np.repeat(rest[None], len(codes), 0)
        moved[:, 3, 1] -= 10 * codes[:, 0]
        return moved

    marks = LipMarks.find(rest, np.array([2]), np.array([3]))
    return judging.FaceMesh(lips, lips, lambda codes: codes[:, 1], marks)


def test_segments_are_whole_and_from_the_test_split(segments):
    assert [s.frames for s in segments] == [slice(0, 100), slice(100, 200)]
    assert all(s.clip.split == "test" and s.audio.shape == (80_000,) for s in segments)


def test_features_hear_the_clip_before_the_segment(segments, audio):
    assert audio.shape[:2] == (2, 100)
    assert not torch.allclose(audio[0, 0], audio[1, 0])


def test_student_and_teacher_draw_anew_with_each_seed(model, audio):
    gaze = torch.zeros(2, 100, 6)
    for row in (
        evaluation.student_row(model, audio, gaze),
        evaluation.student_row(model, audio, None),
        evaluation.teacher_row(model, audio[:, :8], gaze[:, :8], Guidance(weight=1.5)),
    ):
        first, again, other = row(0), row(0), row(1)
        assert first.shape[2] == 256 and np.array_equal(first, again)
        assert not np.allclose(first, other)


def test_without_outpainting_the_past_is_drawn_anew(model, audio):
    """Same condition at every frame: kept noise moves less than noise that is drawn anew."""
    still, gaze = torch.zeros_like(audio), torch.zeros(2, 100, 6)
    row = evaluation.without_outpainting_row(model, still, gaze)
    assert row(0).shape == (2, 100, 256)
    assert not np.allclose(row(0), evaluation.student_row(model, still, gaze)(0))


def test_energy_to_jaw_learns_that_loud_is_open(pack, segments):
    fit = evaluation.fit_energy_to_jaw(pack, JAW_OPEN)
    rig = evaluation.energy_to_jaw_rig(segments, fit, JAW_OPEN)
    truth = np.stack([segment.rig for segment in segments])
    assert np.corrcoef(rig[..., JAW_OPEN].ravel(), truth[..., JAW_OPEN].ravel())[0, 1] > 0.9
    assert np.delete(rig, JAW_OPEN, -1).max() == 0


def test_judge_of_the_truth_itself_and_of_a_shut_mouth(segments):
    codes = np.zeros((2, 100, 256), np.float32)
    codes[..., 0] = np.stack([segment.rig[:, JAW_OPEN] for segment in segments])
    codes[:, 10:20, 1] = 1
    truth = judging.TruthMeshes.of(segments, codes, mesh())
    perfect = judging.judge([codes, codes], truth, mesh())
    assert perfect["lve_mm"] == perfect["lip_sync_mm"] == perfect["fdd_mm"] == 0
    assert perfect["closure_recall"] == 1 and perfect["false_closures"] == 0
    assert perfect["syllable_power_ratio"] == pytest.approx(1)
    assert perfect["jaw_r"] == pytest.approx(1) and perfect["jaw_fast_r"] == pytest.approx(1)
    assert perfect["blinks_per_minute"] == pytest.approx(18)
    shut = judging.judge([np.zeros_like(codes)], truth, mesh())
    assert shut["lve_mm"] > 0.5 and shut["false_closures"] == 1
    assert shut["syllable_power_ratio"] == 0 and shut["energy_distance_mm"] > 1


def test_best_of_several_draws_is_better_than_their_mean(segments):
    codes = np.zeros((2, 100, 256), np.float32)
    truth = judging.TruthMeshes.of(segments, codes, mesh())
    off = codes.copy()
    off[..., 0] = 0.2
    figures = judging.judge([codes, off], truth, mesh())
    assert figures["lve_best_mm"] == 0 and figures["lve_mm"] == pytest.approx(1)


def test_short_sentences_are_joined_by_language(tmp_path):
    clips = [
        dataset.make_clip(
            np.zeros(70 * 1600), np.full((70, len(RIG_NAMES)), 0.1 * k), np.zeros((70, 2, 3)),
            np.zeros(70), truth="rules", voice=voice, kind="language", split="test",
        )
        for k, voice in enumerate(("espeak-de+m5", "espeak-de+f4", "espeak-fr+f1", "espeak-fr+m2"))
    ]  # fmt: skip
    shard = dataset.write_shard(tmp_path / "shard", clips)
    dataset.write_manifest(tmp_path, [shard], {})
    groups = evaluation.held_out_segments(tmp_path, 5)
    assert list(groups) == ["language de", "language fr"]
    (segment,) = groups["language de"]
    assert segment.rig[:70].max() == 0 and segment.rig[70:].min() == pytest.approx(0.1, abs=1e-3)


def test_short_real_recordings_are_segments_of_their_own(tmp_path):
    clips = [
        dataset.make_clip(
            np.zeros(count * 1600), np.full((count, len(RIG_NAMES)), 0.1 * k),
            np.zeros((count, 2, 3)), np.zeros(count), truth="tracked", voice="grid-s1",
            split="test",
        )
        for k, count in enumerate((89, 90, 91))
    ]  # fmt: skip
    shard = dataset.write_shard(tmp_path / "shard", clips)
    dataset.write_manifest(tmp_path, [shard], {})
    segments = evaluation.held_out_segments(tmp_path, 5)["grid-s1"]
    assert [s.frames for s in segments] == [slice(0, 89)] * 3
    assert [float(np.ptp(s.rig)) for s in segments] == [0, 0, 0]
