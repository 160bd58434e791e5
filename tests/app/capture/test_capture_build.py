"""`livedrive capture`: the same seed gives the same bytes, stopped builds go on, bad words end."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import tyro

from app.capture.build import build
from app.commands.capture import Capture
from encoder.capture import dataset
from encoder.capture.judging.statistics import style_ratio
from encoder.capture.subjects.plans import Config
from sensors.session.recording import Recording
from sensors.types import InputError

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (shutil.which("flite") and shutil.which("espeak-ng")), reason="no speech engines here"
    ),
]
CONFIG = Config(subjects=2, hours=0.006, languages=1, seed=3)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("set")
    build(folder, CONFIG, 2)
    return folder


def arrays(folder: Path) -> dict[str, bytes]:
    found = {}
    for shard in dataset.read_manifest(folder)["shards"]:
        path = folder / shard["file"]
        with np.load(path / "motion.npz", allow_pickle=False) as data:
            found |= {f"{path.name} {name}": data[name].tobytes() for name in data}
        found[f"{path.name} audio"] = (path / "audio.wav").read_bytes()
    return found


def test_the_same_seed_gives_the_same_bytes(made, tmp_path):
    build(tmp_path, CONFIG, 1)
    assert arrays(tmp_path) == arrays(made)


def test_a_stopped_build_goes_on(made, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(made, folder)
    before = arrays(folder)
    (folder / "manifest.json").unlink()
    (folder / "made_0001" / "subject.json").unlink()  # killed before its last write
    kept = (folder / "made_0000" / "subject.json").stat().st_mtime_ns
    build(folder, CONFIG, 1)
    assert arrays(folder) == before
    assert (folder / "made_0000" / "subject.json").stat().st_mtime_ns == kept
    with pytest.raises(InputError, match="settings it was begun with"):
        build(folder, Config(subjects=3, hours=0.006, languages=1), 1)


def test_what_capture_did_not_make_is_not_replaced(tmp_path):
    """Red before: it was removed."""
    notes = tmp_path / "made_0000" / "notes.txt"
    notes.parent.mkdir()
    notes.write_text("mine")
    with pytest.raises(InputError, match="a made_0000 of another; choose another folder"):
        build(tmp_path, CONFIG, 1)
    assert notes.read_text() == "mine" and not (tmp_path / "recipe.json").exists()


def test_subjects_are_sessions_with_manifest_and_splits(made):
    manifest = dataset.read_manifest(made)
    # two who speak English, and one of other languages for each side of the split
    assert manifest["counts"]["subjects"] == 4 and "espeak" in manifest["sources"]
    clips = dataset.read_pack(made)
    voices = {
        s: {c.voice for c in clips if c.split == s and c.kind != "rest"} for s in ("train", "test")
    }
    texts = {s: {c.text for c in clips if c.split == s and c.text} for s in ("train", "test")}
    assert voices["train"] and voices["test"] and not voices["train"] & voices["test"]
    assert not texts["train"] & texts["test"]
    with Recording(made / "made_0000") as recording:
        frames = sum(c.num_frames for c in dataset.read_shard(made / "made_0000"))
        assert recording.duration_ns == frames * 1_000_000_000 // 30


def test_contacts_hold_on_the_vertices_of_every_avatar(made):
    from app.face.geometry import gaps_on_vertices, lips, teeth
    from encoder.capture.judging import statistics

    geometry = lips()
    clips = [c for c in dataset.iter_pack(made) if c.truth == "rules"]
    rows, tally = statistics.page(clips, geometry.gap_mm, teeth().distance_mm)
    by_name = {row.name: row for row in rows}
    assert len(tally.gaps_mm) > 5
    for name in ("closure_gap_worst_mm", "teeth_contact_worst_mm", "stuck_channels"):
        assert by_name[name].ok, by_name[name]
    for name in ("jaw_speed_per_s", "lip_speed_mm_per_s", "lid_speed_per_s"):
        assert by_name[name].ok, by_name[name]
    rig = clips[0].rig.astype(np.float32)
    shut = geometry.gap_mm(rig) < -0.1
    off, widest = gaps_on_vertices(geometry, np.concatenate([rig[shut][:4], rig[~shut][10:60:10]]))
    assert shut.any() and off < 0.05 and widest < 0.3


def test_people_differ_more_than_repeats():
    assert style_ratio(4) > 2


def test_bad_words_end_in_one_line(made, tmp_path):
    with pytest.raises(InputError, match="one folder"):
        Capture(words=("inspect",)).run()
    with pytest.raises(InputError, match="--speech: expected a folder"):
        Capture(words=(str(tmp_path / "x"),), speech=tmp_path / "none").run()
    with pytest.raises(InputError, match="at least 1 subject"):
        Capture(words=(str(tmp_path / "x"),), subjects=0).run()
    with pytest.raises(InputError, match="such as made_0000"):
        Capture(words=("inspect", str(made)), subject="made_9999").run()
    with pytest.raises(InputError, match="expected a clip 0-"):
        Capture(words=("inspect", str(made)), clip=999).run()
    with pytest.raises(InputError, match="--mocap"):
        Capture(words=("calibrate", str(made))).run()
    with pytest.raises(InputError, match="manifest"):
        Capture(words=("statistics", str(tmp_path))).run()


@pytest.mark.parametrize(
    ("words", "given", "told"),
    [
        (
            (),
            {"subjects": 0, "picture": Path("p.png")},
            "--picture: expected .* inspect, statistics, .*got build",
        ),
        (
            (),
            {"subjects": 0, "text": ("Hello.",)},
            "--text: expected one of the actions session, got build",
        ),
        (("inspect",), {"wide_eyes": 5}, "--wide-eyes: expected .* build, got inspect; leave it"),
    ],
)
def test_what_an_action_does_not_take_is_an_error(words, given, told, tmp_path):
    """Red before: it went unheard, at the end of an hour."""
    with pytest.raises(InputError, match=told):
        Capture(words=(*words, str(tmp_path / "x")), **given).run()


def test_fewer_pictures_than_none_are_refused(capsys, tmp_path):
    """Red before: nothing was drawn, without a word, after the set was made."""
    with pytest.raises(SystemExit):
        tyro.cli(Capture, args=[str(tmp_path / "x"), "--subjects", "0", "--eyes", "-5"])
    assert "expected 0 or more, got -5" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"avatar": "nobody"}, "avatar: expected one of ada"),  # red before: half a session stayed
        ({"seconds": -1.0}, "--seconds: expected a frame or more, got -1 s"),  # one of no length
        ({"seconds": float("nan")}, "--seconds: .* got nan s; try --seconds 10"),  # a traceback
    ],
)
def test_a_session_that_cannot_be_made_leaves_no_folder(given, told, tmp_path):
    with pytest.raises(InputError, match=told):
        Capture(words=("session", str(tmp_path / "s")), text=("Hello.",), **given).run()
    assert not (tmp_path / "s").exists()


def test_inspect_draws_a_clip(made, tmp_path):
    from PIL import Image

    Capture(words=("inspect", str(made)), picture=tmp_path / "p.png").run()
    with Image.open(tmp_path / "p.png") as picture:
        assert picture.size == (1280, 1040)
        assert np.asarray(picture.convert("L")).std() > 30


def test_eye_pairs_are_drawn_with_their_truth(made, monkeypatch):
    from app.capture import eyes as capture_eyes
    from encoder.training.streams.eye_pictures import EyePictures

    for name, value in (("PEOPLE_A_FILE", 1), ("PAIRS_A_PERSON", 6)):
        monkeypatch.setattr(capture_eyes, name, value)
    shards = [s["file"] for s in dataset.read_manifest(made)["shards"]]
    monkeypatch.setattr(capture_eyes, "_renderer", None)
    capture_eyes._file((made, 0, shards, (0, 0)))
    capture_eyes._renderer.close()
    data = EyePictures.load(made)
    assert data.pictures.shape == (12, 100, 100) and data.pictures.std() > 10
    assert np.abs(data.gaze).max() < 0.75 and data.lids.min() >= 0 and data.lids.max() <= 1
    assert json.loads((made / "manifest.json").read_text())["version"] == 2
