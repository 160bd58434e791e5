"""`livedrive eval`: tables and thresholds from known metrics, the A/B page and its votes."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from app.commands.eval import EvalAb
from app.eval import plots as eval_plots
from app.eval.ab import find_pairs, make_page, tally
from app.eval.speech import live as eval_live
from app.eval.speech.tables import make_thresholds, show
from render.decoder.learned import weights_file
from sensors.types import InputError


def videos(folder: Path, *names: str) -> Path:
    folder.mkdir()
    for name in names:
        (folder / name).write_bytes(name.encode())
    return folder


def test_bars_hold_the_issue_s_ratios():
    row = "sentence/recorded gaze/"
    metrics = {
        f"{row}student/lip_sync_mm": 0.85,
        f"{row}student/lip_sync_best_mm": 0.8,
        f"{row}mean face/lip_sync_mm": 1.0,
        f"{row}student/closure_recall": 0.6,
        f"{row}student/syllable_power_ratio": 0.4,
        f"{row}teacher, 40 steps/syllable_power_ratio": 0.5,
        "grid-s30/recorded gaze/student/jaw_r": 0.75,
        "grid-s30/recorded gaze/student/opening_shift_frames": -2.0,
        "pink_60s_movement_mm": 1.5,
    }
    thresholds = {bar["name"]: bar["ok"] for bar in make_thresholds(metrics)}
    assert thresholds == {
        "pink_60s_movement_mm": False,
        "sentence lip_sync over mean face": True,
        "sentence lip_sync over mean face, best": False,
        "sentence 2-7 Hz power, student against teacher": False,
        "grid-s30 opening against jaw, r": True,
        "grid-s30 opening shift, frames": False,
        "sentence closure recall": True,
    }


def test_settings_are_never_mixed_in_one_table(capsys):
    metrics = {"lve_mm": 1.25}
    show({"sentence": {"recorded gaze": {"student": metrics}, "live": {"student": metrics}}})
    out = capsys.readouterr().out
    assert "sentence, recorded gaze" in out and "sentence, live" in out
    assert out.count("1.250") == 2


@pytest.mark.slow
def test_noises_have_their_level_and_silence_none():
    sounds = eval_live.not_speech(0)
    assert set(sounds) == {"silence", "pink", "fan", "keyboard", "music"}
    for name, sound in sounds.items():
        assert sound.dtype == np.float32 and len(sound) == 60 * 48_000
        level = 20 * np.log10(np.sqrt((sound.astype(float) ** 2).mean()) + 1e-9)
        assert level < -150 if name == "silence" else abs(level + 30) < 0.1


def test_page_holds_each_pair_once_and_hides_who_is_who(tmp_path, capsys):
    a, b = videos(tmp_path / "a", "x.mp4", "y.mp4"), videos(tmp_path / "b", "x.mp4", "z.mp4")
    assert [pair[0].name for pair in find_pairs(a, b)] == ["x.mp4"]
    EvalAb(a=a, b=b, out=tmp_path / "ab.html").run()
    assert "with 1 pair;" in capsys.readouterr().out
    page = (tmp_path / "ab.html").read_text()
    trials = json.loads(page.split("const trials = ")[1].split(", key")[0])
    assert len(trials) == 1 and {trials[0]["left"], trials[0]["right"]} == {"A", "B"}
    assert str(a) not in page
    with pytest.raises(InputError, match="same names"):
        find_pairs(a, videos(tmp_path / "c", "q.mp4"))


@pytest.mark.slow
def test_people_of_two_folders_of_weights_are_drawn(tmp_path):
    for side in "ab":
        (tmp_path / side).mkdir()
        for stem in ("prior", "avatar_ada"):
            for kind in ("json", "safetensors"):
                name = f"{stem}.{kind}"
                shutil.copy(weights_file.FOLDER / name, tmp_path / side)
    make_page(tmp_path / "a", tmp_path / "b", tmp_path / "ab.html", seed=0, size=128)
    page = (tmp_path / "ab.html").read_text()
    trials = json.loads(page.split("const trials = ")[1].split(", key")[0])
    assert {t["name"] for t in trials} == {"ada_neutral.jpg", "ada_smile.jpg"}
    assert all(t["left_video"] == t["right_video"] for t in trials)
    assert trials[0]["left_video"] != trials[1]["left_video"]


def test_votes_are_counted(tmp_path, capsys):
    votes = [{"name": "x", "choice": c, "side": "left"} for c in "AAB"]
    (tmp_path / "v.json").write_text(json.dumps({"votes": votes}))
    EvalAb(count=(tmp_path / "v.json",)).run()  # red before: folders were wanted, too
    assert "A 2  B 1  A's share 0.667" in capsys.readouterr().out
    (tmp_path / "bad.json").write_text("[]")
    with pytest.raises(InputError, match="votes saved by the page, got other JSON"):
        tally((tmp_path / "bad.json",))
    (tmp_path / "bad.json").write_text("A")
    with pytest.raises(InputError, match="votes saved by the page, got no JSON"):
        tally((tmp_path / "bad.json",))
    for rows in ([], [{"choice": "left"}]):  # red before: a share of 0.000 +- 0.000
        (tmp_path / "bad.json").write_text(json.dumps({"votes": rows}))
        with pytest.raises(InputError, match="got other JSON, or none"):
            tally((tmp_path / "bad.json",))


def test_one_vote_proves_little(tmp_path):
    """Red before: 1.000 +- 0.000."""
    (tmp_path / "v.json").write_text(json.dumps({"votes": [{"choice": "A"}]}))
    assert tally((tmp_path / "v.json",)) == ["A 1  B 0  A's share 1.000, 0.207 to 1.000 (95 %)"]


def test_pairs_are_found_as_a_camera_names_them(tmp_path):
    """Red before: none, and two folders without a name in common where one is missing."""
    a, b = videos(tmp_path / "a", "x.MP4"), videos(tmp_path / "b", "x.MP4")
    make_page(a, b, tmp_path / "ab.html", seed=0)
    assert "data:video/mp4" in (tmp_path / "ab.html").read_text()
    with pytest.raises(InputError, match="expected a folder .*none, got none"):
        find_pairs(a, tmp_path / "none")


def test_two_folders_are_compared(tmp_path):
    with pytest.raises(InputError, match=r"two folders, or --count, got one"):
        EvalAb(a=tmp_path).run()
    with pytest.raises(InputError, match=r"two folders, got .* twice"):
        EvalAb(a=videos(tmp_path / "a", "x.mp4"), b=tmp_path / "a", out=tmp_path / "o.html").run()
    assert not (tmp_path / "o.html").exists()


def test_a_late_mouth_errs_least_when_compared_later():
    truth = np.sin(np.arange(100) * 0.3)
    errors = eval_plots.shift_errors([np.roll(truth, 2)], [truth])
    assert eval_plots.SHIFTS[int(np.argmin(errors))] == 2


@pytest.mark.slow
def test_plots_are_written(tmp_path):
    pytest.importorskip("matplotlib")
    card = {"curve": {"step": [1, 2], "total": [2.0, 1.0]}}
    (tmp_path / "student.json").write_text(json.dumps(card))
    (tmp_path / "old.json").write_text("{}")
    curves = eval_plots.curves_of(sorted(tmp_path.glob("*.json")))
    assert [name.split("/")[1] for name in curves] == ["student"]
    errors = [1.0] * len(eval_plots.SHIFTS)
    paths = eval_plots.save(tmp_path / "plots", {"grid": errors}, curves)
    assert all(path.stat().st_size > 5000 for path in paths)
