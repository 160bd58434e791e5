"""`train peers` and `eval speech --peers` together, on a made pack and debug sizes."""

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import av
import numpy as np
import pytest
import torch

from app.commands.eval import EvalSpeech
from app.commands.train import Train
from app.eval.speech import films
from app.eval.speech.baselines import fed_causally_row, peer_row
from app.eval.speech.settings import SpeechSettings
from app.train.settings import Baseline
from encoder.capture import dataset
from encoder.capture.motion.channels import JAW_OPEN, RIG_NAMES
from encoder.evaluation import rows
from encoder.training.peers.kinds import load_peer
from encoder.training.peers.parts import PeerName
from sensors.types import InputError

pytestmark = pytest.mark.slow
FRAMES = 30  # of a segment


def clip(split: str, kind: str, frames: int) -> dataset.Clip:
    level = np.clip(np.sin(np.arange(frames) * 0.5), 0, 1)
    sound = np.repeat(level, 1600) * np.sin(np.arange(frames * 1600) * 0.05) * 0.3
    rig = np.zeros((frames, len(RIG_NAMES)))
    rig[:, JAW_OPEN] = 0.4 * level
    gaze = np.tile([0.0, 0.0, 1.0], (frames, 2, 1))
    return dataset.make_clip(
        sound, rig, gaze, level > 0.5, truth="rules", voice=split, split=split, kind=kind
    )


@pytest.fixture(scope="module", autouse=True)
def _short_segments() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dataset, "SEGMENT_FRAMES", FRAMES)
        patch.setattr(rows, "SEGMENT_FRAMES", FRAMES)
        yield


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pack with an encoder, a student and all twins, of debug sizes."""
    folder = tmp_path_factory.mktemp("pack")
    clips = [
        clip("train", "freeform", 60),
        *(clip("test", kind, 2 * FRAMES + 3) for kind in ("freeform", "sentence")),
    ]  # fmt: skip
    shard = dataset.write_shard(folder / "shard_000.npz", clips)
    dataset.write_manifest(folder, [shard], {"tones": "made by rules"})
    for stage in ("audio", "diffusion", "distill"):
        train(folder, stage)
        train(folder, stage, variant="causal")
        train(folder, stage, variant="centred")
    for name in get_args(Baseline):
        train(folder, "peers", name=name)
    train(folder, "distill", variant="plain")
    train(folder, "regression")
    train(folder, "diffusion", variant="no-velocity")
    return folder


def train(data: Path, stage: str, **more: object) -> None:
    settings = {"preset": "debug", "data": data, "out": data / "weights"}
    if stage != "audio":
        settings["stream_minutes"] = 0.1
    Train(stage=stage, **settings | more).run()  # type: ignore[arg-type]


def evaluate(data: Path, *, report: Path | None = None, **more: Any) -> None:
    weights = data / "weights"
    given = {"samples": 2, "segments": 2, **more}
    settings = SpeechSettings(weights=weights, report=report, **given)
    with contextlib.suppress(SystemExit):  # with weights of two steps, ours need not be first
        EvalSpeech(data=data, settings=settings).run()


def test_names_are_those_of_the_networks():
    assert get_args(Baseline) == get_args(PeerName)


def test_the_twins_stand_beside_ours(data, tmp_path):
    evaluate(data, peers=data / "peers", report=tmp_path / "report.json")
    report = json.loads((tmp_path / "report.json").read_text())
    for kind in ("freeform", "sentence"):
        for row in (
            "synthesised gaze/student", "live/TalkSHOW-face, fed causally",
            "offline/TalkSHOW-face", "offline/Audio2Photoreal-face",
            "offline/DiffPoseTalk without style", "offline/DiffPoseTalk with style (hypothetical)",
        ):  # fmt: skip
            for metric in ("lve_mm", "fdd_mm", "lip_sync_mm"):
                assert report["metrics"][f"{kind}/{row}/{metric}"] > 0
    assert report["peers"]["talkshow"]["budget"]["steps"] == 2
    assert report["peers"]["talkshow"]["command"] == (
        "livedrive train peers --preset debug --name talkshow --stream-minutes 0.1"
    )
    assert report["not_trained"] == []
    names = {bar["name"] for bar in report["bars"]}
    assert names == {
        f"{kind} {name} over the best twin's"
        for kind in ("freeform", "sentence") for name in ("lve_mm", "lip_sync_mm")
    }  # fmt: skip


def test_films_are_pairs_to_vote_on(data, tmp_path, monkeypatch):
    monkeypatch.setattr(films, "SIZE_PX", 96)
    evaluate(data, peers=data / "peers", films=tmp_path, segments=1)
    pages = {path.name for path in tmp_path.glob("*.html")}
    assert pages == {"talkshow.html", "audio2photoreal.html", "diffposetalk.html"}
    assert (tmp_path / "talkshow.html").read_text().count("data:video/mp4") == 4  # one of each kind
    with av.open(str(tmp_path / "ours" / "clip_00.mp4")) as video:
        assert video.streams.video[0].frames == FRAMES and video.streams.video[0].width == 96
        assert abs(float(video.duration) / av.time_base - FRAMES / 30) < 0.1
        loudest = max(float(np.abs(sound.to_ndarray()).max()) for sound in video.decode(audio=0))
        assert loudest > 0.1


def test_films_of_no_clips_are_an_error(data, tmp_path, monkeypatch):
    """Red before: an IndexError."""
    monkeypatch.setattr(rows, "held_out_segments", lambda *_: {})
    with pytest.raises(InputError, match="--films: expected held-out clips .* livedrive capture"):
        evaluate(data, peers=data / "peers", films=tmp_path)


def test_a_folder_without_twins_is_an_error(data, tmp_path):
    with pytest.raises(InputError, match="--peers .*train peers --name"):
        evaluate(data, peers=tmp_path)


def test_ablations_that_were_trained_are_rows_and_the_others_are_named(data, tmp_path):
    evaluate(data, ablations=True, report=tmp_path / "report.json", plots=tmp_path)
    report = json.loads((tmp_path / "report.json").read_text())
    rows = {name.rsplit("/", 1)[0] for name in report["metrics"]}
    for kind in ("freeform", "sentence"):
        assert {row.removeprefix(f"{kind}/") for row in rows if row.startswith(kind)} == {
            "recorded gaze/diffusion", "recorded gaze/diffusion without L_vel",
            "recorded gaze/regression", "recorded gaze/distilled",
            "live/non-causal encoder, no outpainting", "live/causal encoder, no outpainting",
            "live/causal encoder, outpainted",
        }  # fmt: skip
    assert report["rows"]["distilled"]["steps"] == 2
    command = report["rows"]["diffusion without L_vel"]["command"]
    assert command.endswith("--preset debug --variant no-velocity --stream-minutes 0.1")
    assert report["rows"]["non-causal encoder, itself"]["steps"] == 2
    assert (tmp_path / "geometry_losses.png").stat().st_size > 10_000
    assert set(report["not_trained"]) == {
        "diffusion without L_jitter", "diffusion, L_jitter not normalised",
        "distilled without L_DMD",
    }  # fmt: skip
    assert "freeform, lve_mm: recorded gaze/distilled over recorded gaze/regression" in {
        bar["name"] for bar in report["bars"]
    }


def test_a_stopped_evaluation_leaves_what_it_measured(data, tmp_path, monkeypatch):
    from app.eval.speech.ablations import AblationEvaluation

    measured = AblationEvaluation._table
    tables = iter([measured])

    def stopped(self: AblationEvaluation, segments: Any) -> Any:
        for table in tables:
            return table(self, segments)
        raise KeyboardInterrupt

    monkeypatch.setattr(AblationEvaluation, "_table", stopped)
    with pytest.raises(KeyboardInterrupt):
        evaluate(data, ablations=True, report=tmp_path / "report.json")
    report = json.loads((tmp_path / "report.json").read_text())
    assert len({name.split("/")[0] for name in report["metrics"]}) == 1


@torch.no_grad()
def test_who_is_fed_causally_hears_nothing_ahead(data):
    peer, _ = load_peer(data / "peers" / "talkshow")
    audio = torch.randn(2, 9, peer.config.audio_dim, generator=torch.Generator().manual_seed(0))
    broken = audio.clone()
    broken[:, 6:] = torch.nan
    whole, cut = (fed_causally_row(peer, sound)(0) for sound in (audio, broken))
    assert np.isfinite(whole).all() and np.array_equal(whole[:, :6], cut[:, :6])
    np.testing.assert_allclose(whole[:, -1], peer_row(peer, audio, None)(0)[:, -1], atol=1e-5)
    assert not np.allclose(whole[:, 0], peer_row(peer, audio, None)(0)[:, 0])


def test_twins_of_another_encoder_are_an_error(data, tmp_path):
    card = json.loads((data / "peers" / "talkshow.json").read_text())
    other = tmp_path / "talkshow"
    other.with_suffix(".json").write_text(json.dumps(card | {"audio_sha256": "another"}))
    weights = (data / "peers" / "talkshow.safetensors").read_bytes()
    other.with_suffix(".safetensors").write_bytes(weights)
    with pytest.raises(InputError, match="expected .*talkshow to hear by the audio encoder"):
        evaluate(data, peers=tmp_path)


@pytest.mark.parametrize(
    ("stage", "name", "words"),
    [
        ("peers", None, "expected --name and one of talkshow"),
        ("audio", "talkshow", "leave it away"),
    ],
)
def test_a_name_belongs_to_the_stage_peers(data, stage, name, words):
    with pytest.raises(InputError, match=words):
        train(data, stage, name=name)


def test_a_preset_without_twins_is_told_before_anything_is_read(tmp_path):
    with pytest.raises(InputError, match="expected --preset debug, default, got paper"):
        train(tmp_path, "peers", name="talkshow", preset="paper")
