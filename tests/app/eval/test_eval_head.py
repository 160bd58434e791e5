"""Measures of a living head, on curves whose measures are known."""

import numpy as np
import pytest

from app.eval.head import measure, nods, rises

TIMES = np.arange(60 * 30) / 30


def test_known_curves_have_known_measures() -> None:
    pitch = np.where(TIMES % 4 < 0.5, 3 * np.sin(np.pi * (TIMES % 4) / 0.5), 0.0)  # 15 nods
    angles = np.stack([pitch, 2 * np.sin(TIMES), 0 * TIMES], 1)
    brows = (TIMES % 5 < 0.4).astype(float)
    breath = 0.5 - 0.5 * np.cos(2 * np.pi * 0.25 * TIMES)
    got = measure({"angles": angles, "brows": brows, "blinks": 0 * brows, "breath": breath})
    assert got["nods_per_min"] == pytest.approx(15, abs=1)
    assert got["brow_flashes_per_min"] == pytest.approx(12, abs=1)
    assert got["breaths_per_min"] == pytest.approx(15, abs=1)
    assert got["blinks_per_min"] == 0 and got["roll_range_deg"] == 0
    assert got["yaw_deviation_deg"] == pytest.approx(2**0.5, rel=0.05)


def test_a_still_head_has_no_nods() -> None:
    assert nods(np.zeros(300)) == 0 and rises(np.zeros(300), 0.0) == 0
