"""Eyes in headsets of all kinds: what is drawn is what the truth says; pictures of no eye."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.capture import eyes as usual
from app.capture import wide_eyes
from app.capture.no_eyes import no_eye
from encoder.training.streams.wide_eyes import WidePictures
from render.decoder.learned import avatar_files
from render.near_eye.look import MAX_LEDS, Look
from render.near_eye.primitives import place_in_picture
from render.near_eye.wide_look import AIM, painted, wide_look


def looks(count: int = 60) -> list[Look]:
    rng = np.random.default_rng(0)
    return [wide_look(Look.draw(rng), rng) for _ in range(count)]


def test_cameras_look_at_the_eye_from_all_sides() -> None:
    many = looks()
    assert max(look.outward_deg for look in many) > 45 and max(x.below_deg for x in many) > 40
    assert all(1 <= len(look.leds) <= MAX_LEDS for look in many)
    places = np.array([place_in_picture(look, np.float32(AIM)) for look in many])
    assert np.abs(places - 0.5).max() < 0.06
    look = many[0]
    up = place_in_picture(look, np.float32(AIM) + np.float32([0, 5, 0]))
    out = place_in_picture(look, np.float32(AIM) + np.float32([5, 0, 0]))
    assert up[1] < places[0, 1] and out[0] > places[0, 0]


def test_paint_stays_on_a_person() -> None:
    grey = np.full((96, 96), 120, np.uint8)
    drawn = [
        painted(grey, np.random.default_rng(person), np.random.default_rng(1))
        for person in (*range(12), *range(12))
    ]
    assert all(np.array_equal(a, b) for a, b in zip(drawn[:12], drawn[12:], strict=True))
    assert 0 < sum(not np.array_equal(picture, grey) for picture in drawn[:12]) < 12


def test_no_two_pictures_of_no_eye_are_alike() -> None:
    rng = np.random.default_rng(0)
    pictures = np.stack([no_eye(rng, 64) for _ in range(40)])
    assert pictures.dtype == np.uint8 and pictures.shape == (40, 64, 64)
    assert pictures.mean((1, 2)).std() > 20 and np.median(pictures.std((1, 2))) > 5


def test_faces_of_the_user_are_in_no_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Red before: avatars of this machine were drawn into pictures that others train with."""
    monkeypatch.setattr(avatar_files, "user_folder", lambda: tmp_path)
    (tmp_path / "avatar_me.safetensors").write_bytes(b"damaged")
    monkeypatch.setattr(usual, "PEOPLE_A_FILE", 0)
    monkeypatch.setattr(wide_eyes, "_renderer", object())
    monkeypatch.setattr(wide_eyes, "_write", lambda *_: None)
    wide_eyes._file((tmp_path, 0, (0, 77, 0)))  # noqa: SLF001


@pytest.mark.slow
def test_wide_pairs_are_drawn_with_their_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(usual, "PEOPLE_A_FILE", 6)
    monkeypatch.setattr(usual, "PAIRS_A_PERSON", 2)
    monkeypatch.setattr(wide_eyes, "_renderer", None)
    wide_eyes._file((tmp_path, 0, (0, 77, 0)))
    wide_eyes._renderer.close()
    np.savez(tmp_path / "no_eyes.npz", pictures=np.zeros((1, 192, 192), np.uint8))
    data = WidePictures.load(tmp_path)
    assert data.pictures.shape == (24, 192, 192) and data.wide.any()
    assert (data.subject == np.repeat(np.arange(6), 4)).all()
    assert np.abs(data.gaze).max() < 1 and data.lids.min() >= 0
    near = np.abs(data.pupil - data.frame[:, :2]) * data.frame[:, 2:3]
    assert near.max() < 15  # mm: the pupil is on the eye
