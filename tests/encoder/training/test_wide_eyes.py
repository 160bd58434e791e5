"""The stage "wide-eyes": windows and frames fit each other, and it learns what it is asked."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from eye_material import drawn_eye, net

from encoder.eyes.encoder import load_eye_encoder
from encoder.eyes.format import normalised
from encoder.eyes.framing import FRAME_MM, cut
from encoder.nn import checkpoint
from encoder.training import loop
from encoder.training.stages import wide_eyes
from encoder.training.streams import camera_windows as cameras
from encoder.training.streams.eye_pictures import standard
from encoder.training.streams.strange_light import strange
from encoder.training.streams.wide_eyes import BatchCounts, WideBatch, WidePictures, draw
from sensors.types import InputError

COUNTS = BatchCounts(6, 6, 2, 2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Drawn eyes 60 mm across; the first half of the people in usual headsets."""
    made, rng, count = tmp_path_factory.mktemp("wide"), np.random.default_rng(0), 48
    gaze = rng.uniform(-0.3, 0.3, (count, 2)).astype(np.float32)
    lids = rng.uniform(0.4, 1, count).astype(np.float32)
    pictures = [drawn_eye(*g, lid)[::4, ::4] for g, lid in zip(gaze, lids, strict=True)]
    np.savez(
        made / "wide_000.npz", pictures=np.array(pictures), gaze=gaze, lids=lids,
        rig=rng.random((count, 7), np.float32), subject=np.arange(count, dtype=np.int32) // 4,
        frame=np.tile(np.float32([0.5, 0.5, 60, 0]), (count, 1)),
        pupil=0.5 + 0.5 * gaze * np.float32([1, -1]), wide=np.arange(count) >= count // 2,
    )  # fmt: skip
    np.savez(made / "no_eyes.npz", pictures=rng.integers(0, 256, (5, 100, 100), dtype=np.uint8))
    return made


def test_missing_pictures_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--wide-eyes"):
        WidePictures.load(tmp_path)
    np.savez(tmp_path / "no_eyes.npz", pictures=np.zeros(1))
    np.savez(tmp_path / "wide_000.npz", pictures=np.zeros(1))
    with pytest.raises(InputError, match="capture again"):
        WidePictures.load(tmp_path)


def test_a_window_knows_where_its_eye_lies() -> None:
    """A bright spot where the eye is: seen by any camera, it lies where the window says."""
    torch.manual_seed(0)
    pictures, count = torch.zeros(64, 101, 101), 64
    pictures[:, 59:62, 39:42] = 255
    frame = torch.tensor([[40.5 / 101, 60.5 / 101, 60, 5]]).repeat(count, 1)
    windows = cameras.drawn(frame)
    assert torch.allclose(windows.place(frame[:, :2]), windows.eye, atol=1e-5)
    framed, _ = cameras.seen(pictures, windows, 50, windows.eye, windows.size, windows.roll)
    shown = windows.shows_eye & (windows.size < 2)
    assert shown.sum() > 30
    bright = framed[shown].flatten(1).argmax(1)
    rows, columns = bright // 50, bright % 50
    assert (rows - 24.5).abs().max() < 4 and (columns - 24.5).abs().max() < 4


def test_framed_as_at_run_time() -> None:
    """What training cuts out of a whole picture is what EyeFraming does."""
    view = np.random.default_rng(0).integers(0, 256, (25, 25)).repeat(4, 0).repeat(4, 1)
    frame = torch.tensor([[0.55, 0.4, 70.0, 12.0]])
    windows = cameras.whole(frame)
    x, _ = cameras.seen(
        torch.from_numpy(view).float()[None], windows, 100, windows.eye, windows.size, windows.roll
    )
    values = [0.1, -0.2, np.log(FRAME_MM / 70), np.radians(12)]
    expected = cut(view.astype(np.uint8), np.array(values, np.float32))
    assert np.abs(x[0].numpy() - expected).mean() < 2


def test_skin_is_beside_the_eye() -> None:
    frame = torch.tensor([[0.5, 0.5, 100, 0]]).repeat(100, 1)
    windows, told = cameras.beside(frame)
    assert told.any() and (windows.place(frame[:, :2]).norm(dim=1) > 1.5).all()


def test_any_light_leaves_a_picture() -> None:
    torch.manual_seed(0)
    place = cameras.seen(torch.zeros(40, 50, 50), cameras.drawn(torch.ones(40, 4)), 50)[1]
    x = strange(torch.full((40, 50, 50), 100.0), place)
    assert x.isfinite().all() and x.min() >= 0 and x.max() <= 255
    assert x.flatten(1).mean(1).std() > 10


def test_both_ways_to_normalise_are_one() -> None:
    small = np.random.default_rng(0).integers(0, 256, (3, 100, 100), dtype=np.uint8)
    small[0, :30] = 255
    for picture in (small, small[:, ::2, ::2]):
        expected, _ = normalised(picture)
        actual = standard(torch.from_numpy(picture.copy()).float()).numpy()
        assert np.abs(actual - expected).max() < 1e-4


def test_a_batch_holds_what_it_says(folder: Path) -> None:
    torch.manual_seed(0)
    data = WidePictures.load(folder)
    assert not (data.subject[data.chosen("all")] == 11).any()  # held out
    batch = draw(data, COUNTS, np.random.default_rng(0))
    assert batch.x.shape == (16, 1, 100, 100) and batch.whole.shape == (16, 1, 50, 50)
    assert batch.shows.tolist() == [1] * 12 + [0] * 4
    assert not data.wide[batch.index[:6]].any() and data.wide[batch.index[6:]].all()
    assert all(t.isfinite().all() for t in (batch.x, batch.whole, batch.pupil, batch.found))


def test_every_loss_sees_its_target(folder: Path) -> None:
    data, made = WidePictures.load(folder), net().train()
    torch.manual_seed(1)
    batch = draw(data, COUNTS, np.random.default_rng(1))

    def rows(of: WidePictures, drawn: WideBatch) -> dict[str, float]:
        return {k: float(v) for k, v in wide_eyes.losses(made, of, drawn).items()}

    before = rows(data, batch)
    after = rows(replace(data, gaze=data.gaze + 0.5, lids=data.lids - 0.4), batch)
    for name in ("measured_gaze", "measured_lid"):
        assert after[name] != pytest.approx(before[name]), name
    odd = batch._replace(shows=1 - batch.shows, pupil=batch.pupil + 1, found=batch.found + 1)
    after = rows(data, odd)
    for name in ("present", "pupil", "found", "place", "size", "turn"):
        assert after[name] != pytest.approx(before[name]), name
    wide_eyes.losses(made, data, batch)["total"].backward()
    learned = {n.split(".")[0] for n, p in made.named_parameters() if p.grad is not None}
    assert learned == {"finder", "meter"}


@pytest.mark.slow
def test_the_stage_changes_nothing_that_students_know(folder: Path, tmp_path: Path) -> None:
    made = net()
    card = {"kind": "eyes", "config": asdict(made.config)}
    checkpoint.save(tmp_path / "eyes", made.state_dict(), card)
    before, start = checkpoint.load(tmp_path / "eyes", "eyes")
    config = wide_eyes.preset(
        "debug", pictures=folder, start=tmp_path / "eyes", output=tmp_path / "wide" / "eyes",
        run=loop.RunSettings(state=tmp_path / "state"),
    )  # fmt: skip
    wide_eyes.run(config)
    after, written = checkpoint.load(tmp_path / "wide" / "eyes", "eyes")
    assert written["features_of"] == start["sha256"] and written["wide"]["steps"] == 2
    changed = {n.split(".")[0] for n in after if np.abs(after[n] - before[n]).max() > 2e-3}
    assert changed <= {"finder", "meter"} and changed
    reading = load_eye_encoder(tmp_path / "wide")(np.zeros((2, 400, 400), np.uint8))
    assert all(np.isfinite(array).all() for array in reading)
