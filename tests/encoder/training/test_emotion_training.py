"""The emotion stage: what its losses ask for, its streams, two steps and a resume to four."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from driver_material import models
from mouth_material import lip_geometry

from encoder.audio.config import PRESETS as AUDIO
from encoder.audio.encoder import AudioEncoder
from encoder.capture import dataset
from encoder.capture.motion.channels import JAW_OPEN, MOUTH_CLOSE, RIG_INDEX, RIG_NAMES
from encoder.capture.motion.contacts import SLOPE_MM
from encoder.denoiser.config import ZeroConvConfig
from encoder.denoiser.zero_conv import ZeroConvs
from encoder.emotion.control import load_emotions
from encoder.emotion.labels import EMOTIONS, LABELS
from encoder.nn import checkpoint
from encoder.training import loop
from encoder.training.checkpoints import load_denoiser
from encoder.training.geometry import TrainingFace
from encoder.training.stages import emotion
from encoder.training.streams import emotion as emotion_streams
from encoder.training.streams import streams
from sensors.types import InputError

pytestmark = pytest.mark.slow

FULL = np.linalg.qr(np.random.default_rng(0).standard_normal((256, 55)))[0].T.astype(np.float32)
BASIS = FULL[:53]  # without the tongue
TO_RIG = torch.tensor(BASIS.T)


def face(channels: list[int]) -> TrainingFace:
    """Each vertex is moved by one channel, 10 mm a unit."""
    pick = torch.zeros(53, len(channels), 3)
    for vertex, channel in enumerate(channels):
        pick[channel, vertex, 1] = 10.0

    def vertices(codes: torch.Tensor) -> torch.Tensor:
        return torch.einsum("...c,cvk->...vk", codes @ TO_RIG, pick)

    def rig_to_code(rig: np.ndarray) -> np.ndarray:
        return (rig @ FULL[: rig.shape[-1]]).astype(np.float32)

    def spans(codes: torch.Tensor) -> torch.Tensor:
        return vertices(codes)[..., :2, 1]

    weights = torch.ones(len(channels))
    return TrainingFace(
        rig_to_code, vertices, weights, vertices, spans, lambda codes: codes,
        lambda codes: codes[..., :2],
    )  # fmt: skip


SMILE = RIG_INDEX["mouthSmile_L"]
FACE = replace(face(list(range(53))), gaps=face([JAW_OPEN]).vertices)


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A neutral and an acted clip of tones, an audio encoder and a student."""
    folder, clips = tmp_path_factory.mktemp("emotions"), []
    for label in ("neutral", "happy"):
        sound = 0.1 * np.sin(np.arange(90 * 1600) * 0.05)
        rig = np.zeros((90, len(RIG_NAMES)))
        rig[:, JAW_OPEN] = 0.2 + 0.2 * np.sin(np.arange(90))
        rig[:, SMILE] = 0.5 * (label == "happy")
        truth = "rules" if label == "neutral" else "emotional"
        gaze = np.tile([0.0, 0.0, 1.0], (90, 2, 1))
        labels = {"truth": truth, "voice": label, "emotion": label}
        clips.append(dataset.make_clip(sound, rig, gaze, np.zeros(90), **labels))
    shard = dataset.write_shard(folder / "subject", clips)
    dataset.write_manifest(folder, [shard], {"tones": "made by rules"})
    encoder, student = AudioEncoder(AUDIO["debug"]), models()[1]
    cards = ({"kind": "audio", "config": vars(encoder.config)},
             {"kind": "student", "config": vars(student.config)})  # fmt: skip
    checkpoint.save(folder / "audio", encoder.state_dict(), cards[0])
    checkpoint.save(folder / "student", student.state_dict(), cards[1])
    made = emotion_streams.EmotionStreamConfig(
        pack=folder, audio=folder / "audio", output=folder / "streams.npz",
        minutes=0.2, stream_frames=60, versions=3,
    )  # fmt: skip
    assert not streams.are_made(made)
    emotion_streams.run(made, lip_geometry())
    assert streams.are_made(made) and not streams.are_made(replace(made, seed=1))
    return folder


def test_streams_hold_acted_takes_and_emotions_laid_over_neutral_ones(pack: Path) -> None:
    streams = emotion_streams.EmotionStreams.load(pack / "streams.npz")
    assert streams.rig.shape[1:] == (3, 60, 53) and streams.mixture.shape[1:] == (3, len(LABELS))
    acted = (streams.rig[:, 0] == streams.rig[:, 1]).all((1, 2))
    happy = LABELS.index("happy")
    for row in streams.mixture[acted]:
        assert np.allclose(row[:, happy], 0.72 * 0.9) and np.allclose(row.sum(1), 0.72 * 0.9)
    assert not acted.all()
    for rig, mixture in zip(streams.rig[~acted], streams.mixture[~acted], strict=True):
        assert (np.count_nonzero(mixture, axis=1) == 1).all()
        for curves, label in zip(rig, mixture.argmax(1), strict=True):
            named = next(iter(EMOTIONS[LABELS[label]].channels))
            channel = RIG_INDEX.get(named, RIG_INDEX.get(f"{named}_L", 0))
            assert curves[:, channel].max() > 0.04
    codes, audio, gaze, mixture = streams.draw(4, 20, FACE, np.random.default_rng(0))
    assert codes.shape == (4, 20, 256) and audio.shape == (4, 20, 512)
    assert gaze.shape == (4, 20, 6) and mixture.shape == (4, len(LABELS))


@pytest.mark.parametrize("label", LABELS)
def test_an_emotion_laid_over_shut_lips_leaves_them_shut(label: str) -> None:
    lips, rig = lip_geometry(), np.zeros((40, 53), np.float32)
    rig[:, JAW_OPEN] = 0.3
    rig[10:20, MOUTH_CLOSE] = 0.3 * 29 / SLOPE_MM
    assert lips.gap_mm(rig)[10:20].max() < 0.01 < 8 < lips.gap_mm(rig)[:10].min()
    made = emotion_streams.with_emotion(rig, label, 1.0, lips, np.random.default_rng(0))
    assert lips.gap_mm(made)[10:20].max() < 0.1
    assert lips.gap_mm(made)[:10].min() > 4


def test_l_face_asks_for_the_truth_of_the_whole_face() -> None:
    rig = np.zeros((1, 20, 53), np.float32)
    calm = FACE.vertices(torch.tensor(rig @ BASIS))
    rig[..., SMILE] += 0.5
    smiling = FACE.vertices(torch.tensor(rig @ BASIS))
    assert emotion.face_loss(smiling, smiling, FACE.weights) == 0
    assert emotion.face_loss(calm, smiling, FACE.weights) == pytest.approx(25 / 53, rel=1e-3)


def gaps(*shut: int) -> torch.Tensor:  # [1, 40, 1, 3] mm
    """Lips 6 mm apart, but for these frames."""
    result = torch.zeros(1, 40, 1, 3)
    result[..., 1] = 6
    result[:, list(shut)] = 0
    return result


def lip_loss(ours: torch.Tensor, neutral: torch.Tensor, truth: torch.Tensor) -> float:
    """Of lips that only open and shut: their gap is the span of the centres."""
    corners = torch.full((1, 40), 50.0)
    shown, true = (torch.stack([corners, x[..., 0, 1]], -1) for x in (ours, truth))
    return float(emotion.lip_loss(shown, true, ours, neutral, truth))


def test_l_lip_is_the_error_of_both_spans() -> None:
    never, once = gaps(), gaps(20)
    for neutral in (never, once, gaps(5)):
        assert lip_loss(once, neutral, once) == 0
    assert lip_loss(never + 1, never, never) == pytest.approx(1, rel=1e-3)
    assert lip_loss(once, never, never) == pytest.approx(6 / 40, rel=1e-3)  # a false closure
    broad = torch.tensor([52.0, 7.0]).expand(1, 40, 2)
    true = torch.tensor([50.0, 6.0]).expand(1, 40, 2)
    assert emotion.lip_loss(broad, true, never, never, never) == pytest.approx(3)


def test_a_closure_that_the_neutral_model_has_right_weighs_most() -> None:
    never, once, late = gaps(), gaps(20), gaps(22)
    missed, lost = (lip_loss(never, neutral, once) for neutral in (never, once))
    assert lost > 3 * missed
    late_lost = lip_loss(late, once, once) - lip_loss(late, gaps(5), once)
    assert late_lost < 0.6 * (lost - missed)  # two frames late is most of one
    assert lip_loss(never, gaps(5), once) == missed  # what it has wrong is not asked for
    assert lip_loss(never, gaps(5), never) == 0


def test_what_an_emotion_adds_above_the_mouth_is_calm_and_a_face() -> None:
    calm, jumps = emotion.Calm.of(FACE), np.zeros((1, 12, 53), np.float32)
    costs = []
    for channel in ("browDown_L", "jawOpen"):
        jumps[:] = 0
        jumps[:, 6:, RIG_INDEX[channel]] = 0.5
        costs.append(float(emotion.calm_loss(torch.tensor(jumps @ BASIS), calm)))
    assert costs == pytest.approx([0.25 / 11, 0], abs=1e-5)
    lids = RIG_INDEX["eyeBlink_L"], RIG_INDEX["eyeBlink_R"]
    for channels, cost in (([RIG_INDEX["browDown_L"]], 0), (lids, 0), (lids[:1], 1)):
        held = torch.tensor(FULL[list(channels)].sum(0))[None, None].repeat(1, 12, 1)
        assert float(emotion.calm_loss(held, calm)) == pytest.approx(cost, abs=1e-5)
    assert float(emotion.calm_loss(torch.randn(1, 12, 256), calm)) > 150


def test_only_the_zero_convolutions_learn() -> None:
    _, student = models()
    student.requires_grad_(False)
    zero = ZeroConvs(ZeroConvConfig(labels=LABELS, places=student.config.places))
    optimizer, curve = torch.optim.AdamW(zero.parameters(), 3e-3), list[float]()
    rig = np.zeros((2, 12, 53), np.float32)
    rig[..., SMILE] = 1.0
    codes = torch.tensor(rig @ BASIS * 3)
    batch = (codes, torch.randn(2, 12, 512), torch.randn(2, 12, 6), torch.eye(len(LABELS))[:2])
    names = ("streams", "student", "output")
    run = loop.RunSettings(state=Path("state"))
    plain = emotion.preset("debug", run=run, lip_weight=0.0, **dict.fromkeys(names, Path()))
    calm = emotion.Calm.of(FACE)
    for _ in range(60):
        torch.manual_seed(0)  # the same noise: one batch must be learned
        result = emotion.losses(student, zero, student, batch, FACE, plain, calm)
        optimizer.zero_grad()
        result["total"].backward()
        optimizer.step()
        curve.append(float(result["face"].detach()))
    assert curve[-1] < 0.7 * curve[0]


@pytest.mark.parametrize("fine_tune", [False, True])
def test_it_trains_and_resumes(pack: Path, tmp_path: Path, fine_tune: bool) -> None:
    settings = {"streams": pack / "streams.npz", "student": pack / "student", "output": tmp_path}
    run = loop.RunSettings(state=tmp_path / "state")
    config = emotion.preset("debug", run=run, fine_tune=fine_tune, **settings)
    emotion.run(config, FACE)
    emotion.run(replace(config, steps=4, run=replace(run, resume=True)), FACE)
    student = tmp_path / "student" if fine_tune else pack / "student"
    _, card = load_denoiser(student, "student")
    felt = load_emotions(tmp_path, card["sha256"])
    assert felt is not None and felt.labels == LABELS and np.abs(felt.table).max() > 0
    _, card = checkpoint.load(tmp_path / "emotion", "emotion")
    assert card["steps"] == 4 and card["metrics"]["face"] > 0
    assert "lip" in card["metrics"]
    frozen, tuned = (
        load_denoiser(pack / "student", "student")[0],
        load_denoiser(student, "student")[0],
    )
    same = torch.equal(frozen.blocks[0].up.weight, tuned.blocks[0].up.weight)
    assert same != fine_tune
    if not fine_tune:  # and goes on from convolutions of any student, at a rate of nothing
        again = replace(config, start=tmp_path / "emotion", output=tmp_path / "again", rate=0.0)
        emotion.run(again, FACE)
        more = load_emotions(tmp_path / "again", card["student_sha256"])
        assert more is not None and np.array_equal(more.table, felt.table)
        _, later = checkpoint.load(tmp_path / "again" / "emotion", "emotion")
        assert later["started_from"] == card["sha256"] and "started_from" not in card


def test_convolutions_of_another_shape_are_refused(tmp_path: Path) -> None:
    sizes = ZeroConvConfig(labels=LABELS, places=(8, 8, 256))
    card = {"kind": "emotion", "config": vars(sizes)}
    checkpoint.save(tmp_path / "emotion", ZeroConvs(sizes).state_dict(), card)
    assert emotion.start_from(tmp_path / "emotion", sizes)[0].config == sizes
    with pytest.raises(InputError, match="--start"):
        emotion.start_from(tmp_path / "emotion", replace(sizes, places=(8, 256)))
