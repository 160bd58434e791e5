"""Lashes of the shipped people: they turn with their lids."""

import numpy as np
import pytest

from render.avatars import lashes
from render.decoder import identity
from render.strands import axes
from render.types import AHEAD


@pytest.mark.parametrize("name", ["ada", "kofi"])
def test_upper_lashes_turn_down_with_a_lid_that_shuts(decoder, name: str) -> None:
    """Red before: they stood on skin that hardly turns, and pointed up on shut lids."""
    rest = identity.load(name).rest
    beard = lashes.grow(decoder.posing, rest)
    upper = np.isin(
        beard.corners[:, :2], np.concatenate([e.upper for e in decoder.posing.lid_lines])
    )
    tips = np.flatnonzero(upper.all(1))[lashes.PIECES - 1 :: lashes.PIECES]
    rises = []
    for blink in (0.0, 1.0):
        vertices = decoder.posing.pose(blink * decoder.posing.full_blink(), AHEAD, rest)
        means, quats = (np.empty((len(beard), k), np.float32) for k in (3, 4))
        beard.attach(vertices, means, quats)
        rises.append(np.degrees(np.arcsin(axes(quats)[tips, 1])))
    assert np.median(rises[0]) > 30 and np.median(rises[1]) < 20
    assert np.median(rises[0] - rises[1]) > 20
