"""What makes people differ from the face data: age, lips at rest and rounded, deep skin."""

import numpy as np
import pytest

from render.training.data import age, people, rounding
from render.training.look import complexion
from render.training.look.places import Places
from render.training.look.relief import Relief
from render.types import Floats, Ints

X, Y = (m.astype(np.float32) for m in np.meshgrid(np.arange(-80, 81, 4), np.arange(-100, 101, 4)))
LIPS = np.exp(-((X / 22) ** 4) - ((Y + 34) / 7) ** 4)


def mean_face() -> tuple[Floats, Ints]:
    """A curved sheet of skin, and landmarks whose lids and lips lie where a face has them."""
    face = np.stack([X, Y, 110 - X**2 / 120], -1).reshape(-1, 3).astype(np.float32)
    marks = np.zeros((68, 2))
    for side, first in ((-1, 36), (1, 42)):
        around = np.linspace(0, 2 * np.pi, 6, endpoint=False)
        ring = np.stack([32 + 13 * np.cos(around), 35 + 5 * np.sin(around)], 1) * (side, 1)
        marks[first : first + 6] = ring
    for first in (48, 60):
        marks[first : first + 8, 1] = -34
    marks[[48, 60], 0], marks[[54, 64], 0] = -24, 24
    marks[[61, 67], 0], marks[[63, 65], 0] = -10, 10
    away = np.linalg.norm(face[None, :, :2] - marks[:, None], axis=-1)
    return face, away.argmin(1).astype(np.int32)


def test_age_hollows_temples_drops_the_jaw_and_leaves_the_lids() -> None:
    face, marks = mean_face()
    np.testing.assert_array_equal(age.aged(face, marks, face, 0), face)
    moved = age.aged(face, marks, face, 1) - face

    def at(x: float, y: float) -> Floats:
        return moved[np.hypot(face[:, 0] - x, face[:, 1] - y).argmin()]

    assert at(64, 50)[0] < -0.5 and at(-64, 50)[0] > 0.5
    assert at(44, -56)[1] < -1
    assert np.abs(moved[marks[36:48]]).max() < 0.1


def test_lips_of_the_old_are_thinner() -> None:
    face, marks = mean_face()
    old = age.aged(face, marks, face, 1).reshape(*X.shape, 3)
    column = X[0].tolist().index(0)
    upper, lower = (int(np.abs(Y[:, 0] - y).argmin()) for y in (-28, -40))
    assert old[upper, column, 1] - old[lower, column, 1] < 0.75 * 12


@pytest.mark.parametrize("hang", [-2.0, 1.0])
def test_corners_of_a_mouth_at_rest_do_not_hang(hang: float) -> None:
    face, marks = mean_face()
    face[marks[people.CORNERS], 1] = face[marks[people.MIDDLE], 1].mean() + hang
    level = people.levelled(marks, face)[:, 1]
    height = level[marks[people.CORNERS]].mean() - level[marks[people.MIDDLE]].mean()
    assert height == pytest.approx(max(hang, people.LEVEL_MM), abs=0.35)


def test_funnelled_lips_part_more_between_the_middle_and_the_corners() -> None:
    face, marks = mean_face()
    face[:, 1] -= 0.5  # no vertex on the line between the lips
    lips = np.flatnonzero(LIPS.ravel() > 0.4).astype(np.int32)
    above = face[lips, 1] > -34
    regions = {"lips_upper": lips[above], "lips_lower": lips[~above]}
    regions["inner_mouth_lip_roll"] = lips[:1]
    names = ["mouthFunnel", "mouthPucker"]
    rig = np.zeros((2, *face.shape), np.float32)
    out = rounding.rounded(rig, names, face, len(face), regions, marks)[..., 1]
    beside = np.abs(np.abs(face[:, 0]) - 16) < 1
    for rows, way in ((regions["lips_upper"], 1), (regions["lips_lower"], -1)):
        near = rows[beside[rows]]
        assert (way * out[0, near] > 0.5).all() and (way * out[1, near] < -0.3).all()
    assert np.abs(out[:, np.abs(face[:, 0]) > 28]).max() == 0


def places_and_relief() -> tuple[Places, Relief]:
    none = np.zeros_like(X)
    points = np.stack([X, Y, np.full_like(X, 100)], -1)
    return (
        Places(points, LIPS, lids=none, brows=none, face=none + 1, roll=none, off_eyes=none + 20),
        Relief(*[none] * 7),
    )


def test_deep_skin_is_darker_around_the_eyes_and_its_lips_have_two_colours() -> None:
    places, relief = places_and_relief()
    skin = np.full((*X.shape, 3), (0.13, 0.066, 0.042), np.float32)
    np.testing.assert_array_equal(complexion.deep(skin, 0, places, relief), skin)
    out = complexion.deep(skin, 1, places, relief)

    def at(x: float, y: float) -> Floats:
        return out[int(np.abs(Y[:, 0] - y).argmin()), int(np.abs(X[0] - x).argmin())]

    assert at(32, 32).sum() < 0.9 * at(36, 4).sum()
    assert at(0, -28)[0] < 0.9 * at(0, -40)[0]


def test_old_skin_is_duller_and_keeps_its_brightness_by_and_large() -> None:
    places, relief = places_and_relief()
    skin = np.full((*X.shape, 3), (0.65, 0.36, 0.23), np.float32)
    out = complexion.old(skin, 1, places, relief)
    assert (np.ptp(out, axis=-1) < np.ptp(skin, axis=-1)).mean() > 0.9
    assert 0.85 < out.mean() / skin.mean() < 1.02
