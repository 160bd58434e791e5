"""`livedrive train`: every stage and variant of the debug preset, where its files go, bad input."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from app.commands.train import Train
from app.face.losses import face
from app.face.mesh import face_mesh
from app.train.settings import DEBUG_MINUTES, TrainSettings
from app.train.stages import VARIANTS
from encoder.capture import dataset
from encoder.capture.motion.channels import JAW_OPEN, RIG_INDEX, RIG_NAMES
from encoder.training.mouth import Mouth
from sensors.types import InputError

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pack of two clips, with all stages trained on it into `data`/weights."""
    folder, clips = tmp_path_factory.mktemp("pack"), []
    for truth in ("rules", "rest"):
        level = np.clip(np.sin(np.arange(40) * 0.5), 0, 1) * (truth == "rules")
        sound = np.repeat(level, 1600) * np.sin(np.arange(40 * 1600) * 0.05) * 0.3
        rig = np.zeros((40, len(RIG_NAMES)))
        rig[:, JAW_OPEN] = 0.4 * level
        gaze = np.tile([0.0, 0.0, 1.0], (40, 2, 1))
        clips.append(dataset.make_clip(sound, rig, gaze, np.zeros(40), truth=truth, voice="tone"))
    shard = dataset.write_shard(folder / "shard_000.npz", clips)
    dataset.write_manifest(folder, [shard], {"tones": "made by rules"})
    for stage in ("audio", "diffusion", "distill", "contact", "regression"):
        train(folder, stage)
    return folder


def train(data: Path, stage: str, **more: object) -> None:
    settings = {"preset": "debug", "data": data, "out": data / "weights"}
    if stage not in ("audio", "prior", "listen"):
        settings["stream_minutes"] = 0.1
    Train(stage=stage, **settings | more).run()  # type: ignore[arg-type]


def card(path: Path) -> dict[str, object]:
    return json.loads(path.with_suffix(".json").read_text())


def test_weights_go_out_and_the_rest_stays_in_the_data(data):
    assert {p.stem for p in (data / "weights").iterdir()} == {"audio", "student"}
    made = {p.name for p in data.iterdir() if p.is_file()}
    assert {"teacher.json", "regression.json", "streams.npz", "distill_state.safetensors"} <= made
    assert card(data / "weights" / "student")["command"] == (
        "livedrive train distill --preset debug --stream-minutes 0.1"
    )


def test_every_variant_trains_in_its_own_folder(data):
    before = card(data / "teacher")["sha256"]
    for variant, stages in VARIANTS.items():
        for stage in stages:
            if not (variant == "centred" and stage == "regression"):
                train(data, stage, variant=variant, steps=1)
    assert card(data / "offline" / "teacher")["config"]["causal"] is False
    assert card(data / "no-jitter" / "teacher")["jitter_weight"] == 0
    assert card(data / "plain-jitter" / "teacher")["jitter_normalised"] is False
    assert card(data / "lookahead" / "regression")["lookahead"] == 5
    centred = card(data / "centred" / "audio")
    assert centred["kind"] == "centred"
    assert card(data / "centred" / "student")["audio_sha256"] == centred["sha256"]
    assert (data / "no-dmd" / "student.json").is_file()
    assert card(data / "teacher")["sha256"] == before


def test_the_student_gets_a_head_and_loses_it_where_it_learns_on(data, tmp_path):
    own = shutil.copytree(data / "weights", tmp_path / "weights")
    for suffix in (".json", ".safetensors"):
        shutil.copy((own / "student").with_suffix(suffix), (own / "regression").with_suffix(suffix))
    assert card(own / "student")["config"]["contact"] == 32
    train(data, "distill", start=own, out=own)
    train(data, "regression", start=own, out=own)
    for path in (own / "student", data / "regression"):
        assert card(path)["config"]["contact"] == 0


def test_a_variant_of_a_stage_that_does_not_differ_is_an_error(data):
    with pytest.raises(InputError, match="train them without --variant"):
        train(data, "audio", variant="no-jitter")
    with pytest.raises(InputError, match="expected one of the stages .*, got prior"):
        train(data, "prior", variant="plain")  # red before: trained without it


@pytest.mark.parametrize(
    ("stage", "option"),
    [
        ("prior", {"steps": 7}),
        ("prior", {"start": Path("x")}),
        ("prior", {"stream_minutes": 1.0}),
        ("audio", {"name": "talkshow"}),
        ("audio", {"leave_out": ("anna",)}),
        ("distill", {"phones": Path("x")}),  # red before
        ("distill", {"teacher": Path("x")}),  # red before
    ],
)
def test_what_a_stage_does_not_take_is_an_error(data, stage, option):
    """Red before: it trained without a word."""
    name = f"--{next(iter(option)).replace('_', '-')}"
    with pytest.raises(InputError, match=f"{name}: expected one of the stages .*, got {stage}"):
        train(data, stage, **{"stream_minutes": None} | option)


def test_starting_from_other_shapes_is_an_error(data):
    with pytest.raises(InputError, match="--start"):
        train(data, "diffusion", start=data, preset="default", steps=1)


def test_listen_refuses_half_a_chain_before_it_trains(data, tmp_path):
    """Red before: after the training, with half of the new chain written."""
    with pytest.raises(InputError, match="student_eyes: .* `livedrive train multimodal`"):
        train(data, "listen", start=data / "weights", phones=data / "weights", out=tmp_path)
    assert not list(tmp_path.iterdir()) and not (data / "spoken.npz").exists()


def test_debug_hears_little_where_nothing_else_is_asked():
    """Red before: 500 minutes of streams, which took more of them, and 8 GB."""
    debug, default = (TrainSettings(stage="diffusion", preset=p) for p in ("debug", "default"))
    assert (debug.minutes(500), default.minutes(500)) == (DEBUG_MINUTES, 500)
    assert replace(debug, stream_minutes=7).minutes(500) == 7


def test_streams_that_are_cut_are_made_anew(data):
    """Red before: a traceback, after a full disk or a kill, until somebody removed the file."""
    made = data / "streams.npz"
    made.write_bytes(made.read_bytes()[:2000])
    train(data, "regression")
    assert card(data / "regression")["steps"] == 2 and made.stat().st_size > 2000


@pytest.mark.parametrize(
    ("option", "told"),
    [({"seed": 5}, "a run with --seed 5 "), ({"stream_minutes": 0.7}, "the streams of that run")],
)
def test_resuming_otherwise_leaves_the_streams_of_the_run(data, option, told):
    """Red before: they were made anew, which took up to half an hour, then it was refused."""
    train(data, "regression")
    before = (data / "streams.npz").read_bytes()
    with pytest.raises(InputError, match=f"--resume: expected .*{told}"):
        train(data, "regression", resume=True, **option)
    assert (data / "streams.npz").read_bytes() == before


def test_the_losses_see_the_decoder(data):
    decoder = face()
    rig = np.zeros((1, 2, len(RIG_NAMES)), np.float32)
    rig[0, 1, JAW_OPEN] = 0.5
    moved = decoder.vertices(torch.tensor(decoder.rig_to_code(rig)))
    assert moved.shape[:2] == (1, 2) and moved.shape[2] == len(decoder.weights)
    assert moved[0, 0].abs().max() < 0.1 and moved[0, 1].norm(dim=-1).max() > 5
    assert float(decoder.weights.mean()) == pytest.approx(1, abs=1e-5)
    blinking = rig.copy()
    blinking[..., RIG_INDEX["eyeBlink_L"]] = 1.0
    jaw, both = (torch.tensor(decoder.rig_to_code(x)) for x in (rig, blinking))
    torch.testing.assert_close(decoder.mouth(both), jaw, atol=1e-3, rtol=0)


def test_lip_sync_is_the_mean_error_of_the_spans():
    decoder, mesh = face(), face_mesh("ben")
    rig = np.random.default_rng(0).uniform(0, 0.5, (2, 20, len(RIG_NAMES)))
    shown, truth = decoder.rig_to_code(rig)
    spans = (decoder.spans(torch.tensor(x)[None]) for x in (shown, truth))
    error = float((next(spans) - next(spans)).abs().sum(-1).mean())
    judged = mesh.marks.sync_error_mm(mesh.lips(shown), mesh.lips(truth))
    assert error == pytest.approx(judged, rel=1e-4) and judged > 1


def test_an_open_jaw_is_not_lips_that_part_over_shut_teeth():
    mouth = Mouth.of(face())
    rig = np.zeros((2, len(RIG_NAMES)), np.float32)
    rig[0, JAW_OPEN] = 1
    rig[1, [RIG_INDEX["mouthLowerDown_L"], RIG_INDEX["mouthLowerDown_R"]]] = 1
    made = torch.from_numpy(mouth.face.rig_to_code(rig) @ mouth.read)
    made = made / mouth.gap(made)[:, None]  # open by the same
    apart, whole = (mouth.vertices(x).square().sum() for x in (made[0] - made[1], made[0]))
    assert apart > 0.4 * whole
