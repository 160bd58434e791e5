"""What teeth, gums and lips pass on to each other."""

import numpy as np
import pytest

from render.teeth_light import TeethLight, scattered

POINTS = np.array(
    [[0, -28, 100], [0, -20, 100], [0, -28, 80], [0, -38, 100], [0, -46, 100], [0, -30, 90]],
    np.float32,
)  # upper edge, upper gum, upper molar, lower edge, lower gum; gums
TEETH, GUMS = np.arange(5, dtype=np.int32), np.arange(6) == 5


@pytest.fixture
def light() -> TeethLight:
    return TeethLight.of(TEETH, GUMS, POINTS, -34.0)


def shares(upper: float, lower: float) -> np.ndarray:  # [4, 6]
    return np.tile(np.float32([upper] * 3 + [lower] * 2 + [0.2]), (4, 1))


def test_upper_teeth_take_light_from_lower_ones_by_their_edges(light):
    seen = shares(0.02, 0.2)
    light.fill(seen, 3.0)
    edge, gum, molar, lower, _, gums = seen[0]
    assert edge > 0.9 * lower and 0.3 * edge < gum < 0.5 * edge
    assert molar == scattered(np.full((1, 2), 0.02, np.float32))[0, 0] and gums > 0.4
    assert (seen[2:] == shares(0.02, 0.2)[2:]).all()  # of the rims none


def test_lower_teeth_sink_behind_a_lip_as_the_mouth_opens(light):
    near, far = shares(0.3, 0.5), shares(0.3, 0.5)
    light.fill(near, 4.0)
    light.fill(far, 20.0)
    assert far[0, 3] < 0.75 * near[0, 3] and far[0, 4] < 0.5 * far[0, 3]
    assert (far[0, :3] == near[0, :3]).all() and far[0, 0] > far[0, 3]


def test_shut_lips_let_no_light_in(light):
    seen = shares(0.0, 0.0)
    light.fill(seen, 0.1)
    assert (seen[:, :5] == 0).all()


def test_scattered_light_is_never_less():
    seen = np.linspace(0, 1, 40, dtype=np.float32).reshape(20, 2)
    out = scattered(seen)
    assert out.shape == seen.shape and (out >= seen).all() and out[4, 0] > 2 * seen[4, 0]
