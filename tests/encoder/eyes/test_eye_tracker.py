"""Lost eyes: hold, the other eye, synthesised gaze, and back; finite and without a jump."""

from __future__ import annotations

import numpy as np
import pytest
from eye_material import encoder, graph, looks

from encoder.eyes.calibration import EyeCalibration
from encoder.eyes.conjugate import joined
from encoder.eyes.encoder import EyeReading
from encoder.eyes.fading import FADE_FRAMES, ShownEyes
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
    EyeState,
    EyeTracker,
)

ENCODER, GRAPH = encoder(), graph()
BOTH = np.ones(2, bool)


def tracker() -> EyeTracker:
    return EyeTracker(ENCODER, GazeWalk(GRAPH, 7))


def readings(frames: int, seed: int = 1) -> list[EyeReading]:
    """Consistent ones: features are what the encoder's own map says of the gaze."""
    lids, score = np.ones(2, np.float32), np.ones(2, np.float32)
    return [
        EyeReading(ENCODER.synthesise(gaze, lids), gaze, lids, score, gaze, gaze)
        for gaze in looks(frames, seed)
    ]


def follow(
    rows: list[EyeReading | None], good: np.ndarray, state: EyeState | None = None
) -> tuple[list[ShownEyes], list[EyeState]]:
    track = tracker()
    state, seen, states = state or track.init_state(EyeCalibration()), [], []
    for reading, fresh in zip(rows, good, strict=True):
        shown, state = track.step(reading, fresh, state)
        assert all(np.isfinite(array).all() for array in shown)
        assert np.abs(np.linalg.norm(shown.gaze, axis=1) - 1).max() < 1e-5
        assert shown.gaze.dtype == shown.features.dtype == shown.lids.dtype == np.float32
        seen.append(shown)
        states.append(state)
    return seen, states


def both_of(rows: list[EyeReading]) -> np.ndarray:
    """Where both eyes look while both are seen [T, 2, 3]."""
    return np.array([joined(r.told(), r.lids, r.score) for r in rows])


def gaze_of(seen: list[ShownEyes]) -> np.ndarray:
    return np.array([s.gaze for s in seen])


def test_good_eyes_are_passed_through() -> None:
    rows = readings(60)
    seen, states = follow(list(rows), np.ones((60, 2), bool))
    assert np.array_equal(gaze_of(seen), both_of(rows))
    assert all(np.array_equal(s.features, r.features) for s, r in zip(seen, rows, strict=True))
    assert states[-1].source == (OWN, OWN)


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


def test_a_doubtful_eye_is_shown_and_a_flat_picture_is_not() -> None:
    rows = readings(90)
    shut, doubt = np.full(2, 0.1, np.float32), np.full(2, 0.4, np.float32)
    rows[20:80] = [r._replace(score=doubt, lids=shut) for r in rows[20:80]]
    seen, states = follow(list(rows), np.ones((90, 2), bool))
    assert all(state.lost == (0, 0) for state in states)
    assert max(s.lids.max() for s in seen[20:80]) < 0.2
    flat = [r._replace(score=np.zeros(2, np.float32)) for r in rows[20:80]]
    seen, states = follow(rows[:20] + flat, np.ones((80, 2), bool))
    assert states[20].lost == (1, 1) and states[20].source == (OWN, OWN)
    assert states[20 + NO_EYE_FRAMES].source == (WALK, WALK)
    assert np.array_equal(seen[20 + NO_EYE_FRAMES - 1].gaze, seen[19].gaze)


def test_synthesised_eyes_do_not_blink_while_a_camera_delivers() -> None:
    blinking = np.where(np.arange(2000) % 50 < 5, 0.1, 1.0).astype(np.float32)
    track = EyeTracker(ENCODER, GazeWalk(build(looks(2000), blinking, threshold=4.0), 7))
    state, nothing = track.init_state(), readings(1)[0]._replace(score=np.zeros(2, np.float32))
    for _ in range(200):
        seen, state = track.step(nothing, BOTH, state)
        assert state.source == (WALK, WALK) and np.array_equal(seen.lids, np.ones(2))


def test_gaze_rests_while_the_lids_are_shut() -> None:
    rows = readings(30)
    for t in range(10, 14):
        junk = looks(100, seed=t)[5 * t]
        rows[t] = rows[t]._replace(gaze=junk, together=junk, lids=np.zeros(2, np.float32))
    seen, _ = follow(list(rows), np.ones((30, 2), bool))
    gaze = gaze_of(seen)
    assert np.array_equal(gaze[10:14], np.repeat(gaze[9:10], 4, 0))
    assert np.array_equal([s.lids for s in seen[10:14]], np.zeros((4, 2)))


def test_a_misreading_turns_no_eye_faster_than_eyes_turn() -> None:
    rows = readings(30)
    wild = unit(np.float32([[0.6, 0.1], [0.65, 0.1]]))
    rows[15:] = [r._replace(gaze=wild, together=wild) for r in rows[15:]]
    seen, _ = follow(list(rows), np.ones((30, 2), bool))
    assert 15 < step_deg(gaze_of(seen)).max() < 18.5
    assert np.array_equal(gaze_of(seen)[20:], both_of(rows)[20:])  # it gets there all the same


def test_state_is_a_value() -> None:
    rows, good = readings(200), np.ones((200, 2), bool)
    good[50:120] = False
    whole, states = follow(list(rows), good)
    rest, _ = follow(list(rows)[77:], good[77:], states[76])
    again, _ = follow(list(rows)[77:], good[77:], states[76])
    assert np.array_equal(gaze_of(rest), gaze_of(whole[77:]))
    assert np.array_equal(gaze_of(again), gaze_of(rest))


def test_calibration_moves_gaze_and_features() -> None:
    shifted = EyeCalibration(shift=((0.1, 0.0), (0.1, 0.0)))
    reading = readings(1)[0]
    track = tracker()
    seen, _ = track.step(reading, BOTH, track.init_state(shifted))
    assert np.abs(seen.gaze[:, 0] - both_of([reading])[0, :, 0] - 0.1).max() < 1e-5
    expected = ENCODER.synthesise(
        shifted.apply(reading.gaze, reading.relative, reading.lids)[0], seen.lids
    )
    assert np.abs(seen.features - expected).max() < 1e-4
    full = reading._replace(features=np.where(reading.features < 0, -1, 1).astype(np.float32))
    seen, _ = track.step(full, BOTH, track.init_state(shifted))
    assert np.abs(seen.features).max() <= 1 and (seen.features != full.features).any()


def test_what_is_personal_differs_from_eye_to_eye() -> None:
    """Each eye is put right before both are joined: then a wink changes nothing."""
    wrong = EyeCalibration(shift=((0.1, 0.02), (-0.06, -0.1)))
    right = EyeCalibration(shift=((-0.1, -0.02), (0.06, 0.1)))
    reading, lids = readings(1)[0], np.float32([1, 0.2])
    off = wrong.apply(reading.gaze, reading.gaze, reading.lids)[0]
    bent = reading._replace(gaze=off, together=off)
    for row in (bent, bent._replace(lids=lids)):
        track = tracker()
        seen, _ = track.step(row, BOTH, track.init_state(right))
        assert np.abs(seen.gaze - both_of([reading])[0]).max() < 2e-3


def test_recentring_makes_now_straight_ahead() -> None:
    track, row = tracker(), readings(1)[0]
    _, state = track.step(row, BOTH, track.init_state())
    assert abs(row.gaze.mean(0)[:2]).max() > 0.02
    seen, state = track.step(row, BOTH, track.recentred(state))
    assert np.abs(seen.gaze.mean(0)[:2]).max() < 1e-4
    blind = np.zeros(2, bool)
    for _ in range(20):
        _, state = track.step(None, blind, state)
    assert track.recentred(state) is state  # nothing was seen: nothing changes
