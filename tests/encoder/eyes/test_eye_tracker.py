"""Lost eyes: hold, the other eye, synthesised gaze, and back; finite and without a jump."""

from __future__ import annotations

import numpy as np
import pytest
from eye_material import looks
from tracker_material import BOTH, ENCODER, GRAPH, both_of, follow, gaze_of, readings

from encoder.eyes.fading import FADE_FRAMES
from encoder.eyes.format import unit
from encoder.eyes.gaze_graph import build
from encoder.eyes.gaze_statistics import step_deg
from encoder.eyes.gaze_walk import GazeWalk
from encoder.eyes.tracker import (
    HOLD_FRAMES,
    NO_EYE_FRAMES,
    OTHER,
    OWN,
    WALK,
    EyeTracker,
)


@pytest.mark.parametrize("eye", [0, 1])
def test_one_lost_eye_holds_and_then_follows_the_other(eye: int) -> None:
    rows, good = readings(120), np.ones((120, 2), bool)
    good[40:80, eye] = False
    seen, states = follow(list(rows), good)
    gaze = gaze_of(seen)
    held = gaze[40 : 40 + HOLD_FRAMES, eye]
    assert np.array_equal(held, np.repeat(gaze[39:40, eye], HOLD_FRAMES, 0))
    settled = 40 + HOLD_FRAMES + FADE_FRAMES + 1
    assert states[settled].source[eye] == OTHER
    assert np.array_equal(gaze[settled:80, eye], gaze[settled:80, 1 - eye])
    back = 80 + FADE_FRAMES
    assert back - 80 <= 9  # 300 ms
    assert np.array_equal(gaze[back:], both_of(rows)[back:])
    seen_eye = np.array([r.gaze[1 - eye] for r in rows])
    assert np.abs(gaze[settled:80, 1 - eye] - seen_eye[settled:80]).max() < 1e-3  # itself alone
    assert step_deg(gaze).max() <= step_deg(both_of(rows)).max()


def test_borrowed_features_are_those_of_the_lost_eye() -> None:
    rows, good = readings(60), np.ones((60, 2), bool)
    good[10:, 0] = False
    seen, _ = follow(list(rows), good)
    gaze = np.repeat(seen[-1].gaze[1:], 2, 0)
    expected = ENCODER.synthesise(gaze, np.ones(2, np.float32))[0]
    assert np.abs(seen[-1].features[0] - expected).max() < 1e-4
    assert np.abs(seen[-1].features[0] - seen[-1].features[1]).max() > 1e-3


def test_both_lost_walk_and_come_back() -> None:
    rows, good = readings(300), np.ones((300, 2), bool)
    good[60:200] = False
    seen, states = follow(list(rows), good)
    gaze = gaze_of(seen)
    assert states[60 + HOLD_FRAMES - 1].source == (OWN, OWN)
    assert states[60 + HOLD_FRAMES].source == states[199].source == (WALK, WALK)
    assert step_deg(gaze[90:200]).max() > 1  # eyes that wander, not a stare
    assert gaze[:, :, 2].min() > 0.8  # and never in a corner
    back = 200 + FADE_FRAMES
    assert np.array_equal(gaze[back:], both_of(rows)[back:])
    largest = max(step_deg(both_of(rows)).max(), step_deg(GRAPH.gaze[0]).max())
    assert step_deg(gaze).max() <= largest


def test_one_after_the_other_lost() -> None:
    rows, good = readings(120), np.ones((120, 2), bool)
    good[30:, 0] = False
    good[60:, 1] = False
    _, states = follow(list(rows), good)
    assert states[59].source == (OTHER, OWN)
    assert states[60 + HOLD_FRAMES - 1].source == (OWN, OWN)  # both wait
    assert states[60 + HOLD_FRAMES].source == (WALK, WALK)


@pytest.mark.slow
def test_no_jump_whenever_an_eye_is_lost() -> None:
    """Lost and found at random: no larger step than eyes make by themselves."""
    rng = np.random.default_rng(4)
    rows = readings(3000)
    good = np.repeat(rng.random((300, 2)) < 0.6, 10, axis=0)
    seen, _ = follow(list(rows), good)
    largest = max(
        step_deg(both_of(rows)).max(), step_deg(GRAPH.gaze.reshape(-1, 2, 3)[:2000]).max()
    )
    assert step_deg(gaze_of(seen)).max() <= largest
    features = np.array([s.features for s in seen])
    jumps = np.abs(np.diff(features, axis=0)).max()
    assert jumps <= 1.2 * np.abs(np.diff([r.features for r in rows], axis=0)).max()


def test_without_cameras_it_walks_from_the_first_frame() -> None:
    seen, states = follow([None] * 200, np.zeros((200, 2), bool))
    assert states[0].source == (WALK, WALK)
    walk = GazeWalk(GRAPH, 7)
    state, expected = walk.init_state(), []
    for _ in range(200):
        gaze, _, state = walk.step(state)
        expected.append(gaze)
    assert np.array_equal(gaze_of(seen), np.array(expected))


def test_synthesised_eyes_blink() -> None:
    blinking = np.where(np.arange(2000) % 50 < 5, 0.1, 1.0).astype(np.float32)
    track = EyeTracker(ENCODER, GazeWalk(build(looks(2000), blinking, threshold=4.0), 7))
    state, lids = track.init_state(), []
    for _ in range(200):
        seen, state = track.step(None, np.zeros(2, bool), state)
        expected = ENCODER.synthesise(seen.gaze, seen.lids)
        assert np.abs(seen.features - expected).max() < 1e-5
        lids.append(seen.lids)
    assert np.min(lids) < 0.2 and np.max(lids) > 0.9


def test_a_low_score_is_a_lost_eye() -> None:
    """Not at once: an eye that was there is given time, and then a second of its hold."""
    rows = readings(120)
    rows[20:] = [r._replace(score=np.array([0.2, 0.9], np.float32)) for r in rows[20:]]
    _, states = follow(list(rows), np.ones((120, 2), bool))
    assert states[19].source == (OWN, OWN) and states[-1].source == (OTHER, OWN)
    lost = [state.lost[0] for state in states]
    first = lost.index(1)
    assert 24 < first < 40 and all(state.lost[1] == 0 for state in states)
    assert states[first + NO_EYE_FRAMES - 1].source == (OWN, OWN)
    assert states[first + NO_EYE_FRAMES].source == (OTHER, OWN)


def test_an_eye_that_comes_back_from_its_hold_fades() -> None:
    rows, good = readings(60), np.ones((60, 2), bool)
    good[28:34, 0] = False  # while the eyes turn
    seen, states = follow(list(rows), good)
    gaze = gaze_of(seen)
    assert states[33].source == (OWN, OWN)
    way = np.linalg.norm(gaze[40, 0] - gaze[33, 0])
    assert way > 0.05 and np.linalg.norm(np.diff(gaze[33:41, 0], axis=0), axis=-1).max() < way / 2
    assert np.array_equal(gaze[40:], both_of(rows)[40:])


@pytest.mark.parametrize("lost", [(0,), (1,), (0, 1)])
def test_once_the_fade_is_over_nothing_is_left_of_a_lost_camera(lost: tuple[int, ...]) -> None:
    """Red before: the way back was calmed, too, and took twice as long."""
    rows = readings(80, seed=3)[:1] * 80
    rng = np.random.default_rng(0)
    for t in range(80):  # a look that wanders by less than is doubted
        away = unit(rows[0].gaze[:, :2] + 0.01 * np.sin(t / 9) + rng.normal(0, 0.001, (2, 2)))
        rows[t] = rows[t]._replace(gaze=away, together=away, doubt=np.full(2, 2.5, np.float32))
    seen = np.ones((80, 2), bool)
    whole = gaze_of(follow(list(rows), seen)[0])
    seen[20:50, list(lost)] = False
    back = gaze_of(follow(list(rows), seen)[0])
    off = np.degrees(np.linalg.norm(back - whole, axis=-1).max(1))
    assert off[40] > 0.3 and off[50 + FADE_FRAMES + 4 :].max() < 0.06


def test_the_seen_eye_fades_too_when_the_other_is_lost_and_found() -> None:
    """Its gaze is of both eyes while both are seen, and its own while one is."""
    row = readings(1)[0]
    apart = unit(row.gaze[:, :2] + np.float32([[0.1, 0.1], [0, 0]]))
    rows, good = [row._replace(gaze=apart, together=apart)] * 40, np.ones((40, 2), bool)
    good[10:20, 1] = False
    gaze = gaze_of(follow(list(rows), good)[0])[:, 0]
    way = np.linalg.norm(gaze[19] - gaze[9])
    assert way > 0.05 and np.linalg.norm(np.diff(gaze, axis=0), axis=-1).max() < way / 2
    assert np.array_equal(gaze[-1], gaze[9])


def test_synthesised_eyes_do_not_blink_while_a_camera_delivers() -> None:
    blinking = np.where(np.arange(2000) % 50 < 5, 0.1, 1.0).astype(np.float32)
    track = EyeTracker(ENCODER, GazeWalk(build(looks(2000), blinking, threshold=4.0), 7))
    state, nothing = track.init_state(), readings(1)[0]._replace(score=np.zeros(2, np.float32))
    for _ in range(200):
        seen, state = track.step(nothing, BOTH, state)
        assert state.source == (WALK, WALK) and np.array_equal(seen.lids, np.ones(2))


def test_state_is_a_value() -> None:
    rows, good = readings(200), np.ones((200, 2), bool)
    good[50:120] = False
    whole, states = follow(list(rows), good)
    rest, _ = follow(list(rows)[77:], good[77:], states[76])
    again, _ = follow(list(rows)[77:], good[77:], states[76])
    assert np.array_equal(gaze_of(rest), gaze_of(whole[77:]))
    assert np.array_equal(gaze_of(again), gaze_of(rest))
