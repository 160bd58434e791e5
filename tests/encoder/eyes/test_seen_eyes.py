"""Eyes that are seen: passed on, put right for the person, never faster than eyes turn."""

from __future__ import annotations

import numpy as np
from eye_material import looks
from tracker_material import BOTH, ENCODER, both_of, follow, gaze_of, readings, tracker

from encoder.eyes.calibration import EyeCalibration
from encoder.eyes.format import unit
from encoder.eyes.gaze_statistics import step_deg
from encoder.eyes.tracker import NO_EYE_FRAMES, OWN, WALK


def test_good_eyes_are_passed_through() -> None:
    rows = readings(60)
    seen, states = follow(list(rows), np.ones((60, 2), bool))
    assert np.array_equal(gaze_of(seen), both_of(rows))
    assert all(np.array_equal(s.features, r.features) for s, r in zip(seen, rows, strict=True))
    assert states[-1].source == (OWN, OWN)


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


def test_recentred_gaze_leaves_the_lids_to_what_the_session_learns() -> None:
    """Red before: as they were known then, for the rest of the run."""
    track, row = tracker(), readings(1)[0]
    row = row._replace(lids=np.full(2, 0.6, np.float32))  # an open lid of this wearer
    _, state = track.step(row, BOTH, track.init_state())
    both = [state, track.recentred(state)]
    for _ in range(200):
        shown, both = zip(*(track.step(row, BOTH, one) for one in both), strict=True)
    assert np.abs(shown[0].lids - shown[1].lids).max() < 1e-5
    mine = EyeCalibration(shut=(0.1, 0.1), open=(0.9, 0.9))
    _, state = track.step(row, BOTH, track.init_state(mine))
    seen, _ = track.step(row, BOTH, track.recentred(state))
    assert np.abs(seen.lids - (0.6 - 0.1) / 0.8).max() < 1e-5  # a person's own stay
