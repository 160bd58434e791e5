"""Framing: what is cut out, and where the frame settles, moves and stays."""

from __future__ import annotations

import numpy as np
import pytest
from eye_material import drawn_eye, net

from encoder.eyes.format import pixels
from encoder.eyes.framing import (
    MEMORY,
    STRAYED_LOOKS,
    TOLERANCE,
    EyeFraming,
    FramingState,
    cut,
    halved,
    new_framing,
)


class Finder:
    """Says what it is told to."""

    def __init__(self, *found: float) -> None:
        self.found, self.asked = found, 0

    def run(self, _: None, inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
        assert inputs["pixels"].shape == (1, 1, 50, 50)
        self.asked += 1
        return [np.array([self.found], np.float32)]


def framing(*found: float) -> tuple[EyeFraming, Finder]:
    made = EyeFraming({name: v.numpy() for name, v in net().state_dict().items()})
    made._session = finder = Finder(*found)
    return made, finder


def eyes() -> np.ndarray:
    return np.stack([drawn_eye(0.1, 0.05, 0.9), drawn_eye(-0.1, 0.05, 0.9)[:, ::-1]])


def followed(made: EyeFraming, ticks: int, state: FramingState | None = None) -> FramingState:
    state, shown = state or new_framing(), eyes()
    for _ in range(ticks):
        _, state = made.step(shown, state)
    return state


def test_a_picture_without_an_eye_is_taken_as_it_is() -> None:
    made, finder = framing(-5, 0.5, 0.5, 1, 0, 1)
    framed, state = made.step(eyes(), new_framing())
    assert np.array_equal(framed, pixels(eyes())) and finder.asked == 2
    state = followed(made, 20, state)
    assert not state.frames.any() and state.chance.max() < 0.01


@pytest.mark.slow
def test_the_frame_is_what_the_finder_says_and_then_the_mean() -> None:
    made, finder = framing(8, 0.2, -0.1, 0.3, np.cos(0.2), np.sin(0.2))
    _, state = made.step(eyes(), new_framing())
    assert np.allclose(state.frames, [0.2, -0.1, 0.3, 0.2], atol=1e-6)
    state = followed(made, 200, state)
    asked = finder.asked
    assert state.chance.min() > 0.99
    finder.found = (8, 0.3, -0.1, 0.3, np.cos(0.2), np.sin(0.2))
    after = followed(made, 16, state)
    assert finder.asked - asked == 4  # every eighth tick, each eye
    step = np.abs(after.frames - state.frames).max()
    assert 0 < step <= 2 * 0.1 / MEMORY + TOLERANCE
    assert np.allclose(followed(made, 900, state).frames[:, 0], 0.3, atol=0.02)


@pytest.mark.slow
def test_a_frame_that_hardly_changes_stays() -> None:
    made, finder = framing(8, 0.2, 0, 0, 1, 0)
    state = followed(made, 100)
    finder.found = (8, 0.2 + TOLERANCE / 2, 0, 0, 1, 0)
    assert np.array_equal(followed(made, 500, state).frames, state.frames)


@pytest.mark.slow
def test_usual_pictures_are_left_as_they_are_and_it_does_not_go_to_and_fro() -> None:
    """Red before: frames that drifted cost rendered eyes .2 degrees, .4 after calibration."""
    made, finder = framing(8, 0.15, -0.1, 0.25, np.cos(0.1), np.sin(0.1))
    framed, state = made.step(eyes(), new_framing())
    assert not state.frames.any() and np.array_equal(framed, pixels(eyes()))
    finder.found = (8, 0.22, 0, 0, 1, 0)  # beyond, but a little
    state = followed(made, 800, state)
    assert not state.frames.any()
    finder.found = (8, 0.28, 0, 0, 1, 0)
    state = followed(made, 800, state)
    assert np.allclose(state.frames[:, 0], 0.28, atol=0.01)
    finder.found = (8, 0.22, 0, 0, 1, 0)
    state = followed(made, 800, state)
    assert np.allclose(state.frames[:, 0], 0.22, atol=0.01)
    finder.found = (8, 0.15, 0, 0, 1, 0)
    assert not followed(made, 800, state).frames.any()


def test_a_moved_camera_is_followed_and_one_odd_look_is_not() -> None:
    made, finder = framing(8, 0.2, 0, 0, 1, 0)
    state = followed(made, 200)
    finder.found = (8, -0.7, 0.3, 0.4, 1, 0)
    assert np.array_equal(followed(made, 8, state).frames, state.frames)
    after = followed(made, 8 * (STRAYED_LOOKS + 2), state)
    assert np.allclose(after.frames[:, :3], [-0.7, 0.3, 0.4], atol=1e-5)


def test_odd_answers_are_bounded() -> None:
    made, _ = framing(8, 50, -50, 9, 0, 0)
    framed, state = made.step(eyes(), new_framing())
    assert np.isfinite(state.frames).all() and np.abs(state.frames).max() < 2
    assert framed.shape == (2, 100, 100)


@pytest.mark.parametrize("turn", [0.0, 0.4, -0.7])
def test_the_cut_turns_and_scales_about_the_eye(turn: float) -> None:
    """A bright line through the eye, turned as the frame, lies level in what is cut out."""
    rows, columns = np.mgrid[:200, :200].astype(np.float32)
    x, y = (columns - 99.5) / 100 - 0.2, (rows - 99.5) / 100 + 0.1
    line = np.abs(y * np.cos(turn) - x * np.sin(turn)) < 0.02
    view = np.where(line, 250, 10).astype(np.uint8)
    framed = cut(view, np.array([0.2, -0.1, np.log(0.5), turn], np.float32))
    bright = framed > 125
    assert bright[48:52].mean() > 0.9 and bright[:44].mean() < 0.01 and bright[56:].mean() < 0.01


def test_beyond_the_rim_the_rim_goes_on() -> None:
    view = np.full((100, 100), 50, np.uint8)
    view[:, -1] = 200
    framed = cut(view, np.array([0.8, 0, np.log(0.8), 0], np.float32))
    assert (framed[:, 70:] == 200).all() and (framed[:, :60] == 50).all()


def test_halves_are_means() -> None:
    picture = np.arange(16, dtype=np.uint8).reshape(4, 4) * 10
    assert np.array_equal(halved(picture), [[25, 45], [105, 125]])


def test_state_is_a_value() -> None:
    made, _ = framing(8, 0.2, -0.1, 0.3, 1, 0)
    state = followed(made, 9)
    first, again = (followed(made, 5, state) for _ in range(2))
    assert np.array_equal(first.frames, again.frames) and first.tick == again.tick == 14
