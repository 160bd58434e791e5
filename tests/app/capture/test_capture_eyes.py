"""Moments and people that eye pictures are drawn of."""

import numpy as np

from app.capture import eyes as capture_eyes
from encoder.capture.dataset import Clip
from encoder.capture.motion.channels import RIG_INDEX, RIG_NAMES
from render.near_eye.look import Look

BLINKS = [RIG_INDEX[f"eyeBlink_{side}"] for side in "LR"]


def open_eyes() -> Clip:
    frames = 4
    return Clip(
        audio=np.zeros(800 * frames, np.int16),
        rig=np.full((frames, len(RIG_NAMES)), 0.05, np.float16),
        gaze=np.tile(np.array([0, 0, 1], np.float16), (frames, 2, 1)),
        phones=np.full(frames, -1, np.int8),
        tongue=np.zeros((frames, 3), np.float16),
        truth="rules",
        voice="nobody",
    )


def test_moments_are_told_amid_blinks_or_free() -> None:
    rng, clip = np.random.default_rng(0), open_eyes()
    kinds = {"told": 0, "blink": 0, "free": 0}
    for _ in range(600):
        rig, gaze = capture_eyes._moment(clip, rng)
        assert rig.min() >= 0 and rig.max() <= 1
        if (gaze != clip.gaze[0]).any():
            kinds["free"] += 1
            continue
        lid = rig[BLINKS]
        assert lid[0] == lid[1]
        kinds["blink" if lid[0] > 0.1 else "told"] += 1
        if lid[0] > 0.1:  # the cheek and the brow go with it, as in the rules of motion
            moved = rig[[RIG_INDEX["eyeSquint_L"], RIG_INDEX["browDown_R"]]] - clip.rig[0, 0]
            np.testing.assert_allclose(moved, lid[0] * np.array([0.25, 0.2]), atol=1e-3)
    shares = np.array(list(kinds.values())) / 600
    free, blink = capture_eyes.FREE_SHARE, capture_eyes.BLINK_SHARE
    np.testing.assert_allclose(shares, [1 - free - blink, blink, free], atol=0.06)


def test_blinks_shut_what_is_more_open_and_open_nothing() -> None:
    rig = open_eyes().rig[0].astype(np.float32)
    rig[BLINKS[0]] = 0.7
    capture_eyes.blink(rig, 0.4)
    np.testing.assert_allclose(rig[BLINKS], [0.7, 0.4])


def test_dark_lashes_are_darker_and_thicker_than_usual() -> None:
    rng = np.random.default_rng(0)
    usual = [Look.draw(rng) for _ in range(200)]
    dark = [capture_eyes.dark_lashed(look, rng) for look in usual]
    for name, sign in (("lash_shade", -1), ("lash_length", 1), ("lash_width", 1), ("lashes", 1)):
        before, after = (np.array([getattr(look, name) for look in rows]) for rows in (usual, dark))
        assert sign * (after.mean() - np.median(before)) > 0
        assert before.min() * 0.9 < after.min() and after.max() < before.max() * 1.1
    assert all(a.pupil == b.pupil for a, b in zip(usual, dark, strict=True))
