"""Where the eye lies in a camera's picture, and that part of it as the eye network knows eyes.

Cameras show the eye off-centre, half out, turned, small or filling the picture. A small network
(the finder) says where it lies. A camera hardly moves on a head, so the frame is the mean of what
the finder said lately: it settles within a second and then follows the headset's slips. A framed
picture is upright, with the eye in its middle, FRAME_MM across; beyond a picture's rim it goes on.

Where: SensorFrame.eyes -> EyeFraming -> framed pictures [2, 100, 100] -> eye network.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encoder.eyes.format import SIDE, normalised, pixels

Array = NDArray[np.float32]
Picture = NDArray[np.uint8]
FRAME_MM = 45.0  # across a framed picture, at the pupil
FINDER_SIDE = SIDE // 2
MEMORY = 40.0  # looks at an eye that its frame is the mean of: 10 s
SETTLED = 15.0  # looks; until then at every other tick, afterwards at every eighth
SURE = 0.5  # chance of an eye from which on the finder is believed
CHANCE_SHARE = 0.5  # of the last look in the chance of an eye
STRAYED, STRAYED_LOOKS = 0.6, 4  # half widths off for 1 s: the camera was moved
TOLERANCE = 0.004  # half widths, log size or radians by which a frame may lag its mean
# Frames up to here are those of the pictures that the features were learned of: left as they are.
USUAL = np.array([0.2, 0.2, 0.32, 0.14], np.float32)
LEAVES = 1.15  # times as far, and the picture is framed; so that it does not go to and fro
LOWEST = np.array([-1.2, -1.2, -1.4, -0.85], np.float32)  # of a frame
HIGHEST = np.array([1.2, 1.2, 1.6, 0.85], np.float32)


@dataclass(frozen=True, eq=False)
class FramingState:
    """A value. Frames are of left-like pictures: the middle's x (right) and y (down) in half widths
    of the picture, log of the framed part's width over the picture's, turn in radians."""

    frames: Array  # [2, 4] in use
    means: Array  # [2, 4] of what the finder said
    looks: Array  # [2] that the means are of
    strayed: Array  # [2] looks since the eye was last seen near its frame
    chance: Array  # [2] of an eye in the whole picture, over the last looks
    tick: int = 0


def new_framing() -> FramingState:
    """Before the first picture: the picture as it is."""
    zeros = np.zeros(2, np.float32)
    as_it_is = np.zeros((2, 4), np.float32)
    return FramingState(as_it_is, as_it_is, zeros, zeros, zeros)


class Framed(NamedTuple):
    """A pair of pictures before the networks read it."""

    pictures: Picture  # [2, 100, 100] framed, left-like
    small: Array  # [2, 1, 100, 100] the same, see `normalised`
    spreads: Array  # [2] grey levels
    framing: FramingState  # after them


class EyeFraming:
    """Holds the finder's weights only."""

    def __init__(self, weights: dict[str, Array]) -> None:
        from encoder.eyes.graph import finder_model
        from encoder.nn.onnx_session import session

        self._session = session(finder_model(weights))

    def framed(self, eyes: Picture, state: FramingState) -> Framed:
        """The same, and what the networks want to know of it."""
        pictures, after = self.step(eyes, state)
        return Framed(pictures, *normalised(pictures), after)

    def step(
        self,
        eyes: Picture,  # [2, 400, 400], or smaller by whole steps of 100
        state: FramingState,
    ) -> tuple[Picture, FramingState]:  # framed, left-like [2, 100, 100]
        small = pixels(eyes)
        state = replace(state, tick=state.tick + 1)
        for eye in (0, 1):
            every = 2 if state.looks[eye] < SETTLED else 8
            if state.tick == 1 or (state.tick + eye) % every == 0:
                state = self._looked(halved(small[eye]), eye, state)
        framed = np.stack([self._framed(eyes, small, eye, state.frames[eye]) for eye in (0, 1)])
        return framed, state

    def _looked(self, picture: Picture, eye: int, state: FramingState) -> FramingState:
        """One look of the finder [50, 50] goes into the mean."""
        seen = self._session.run(None, {"pixels": normalised(picture[None])[0]})[0][0]
        chance = float(1 / (1 + np.exp(-np.clip(seen[0], -30, 30))))
        chances = state.chance.copy()
        chances[eye] += (1 if state.tick == 1 else CHANCE_SHARE) * (chance - chances[eye])
        state = replace(state, chance=chances)
        if chance < SURE:
            return state
        found = np.array([*seen[1:4], np.arctan2(seen[5], seen[4])], np.float32)
        found = np.clip(found, LOWEST, HIGHEST)
        frames, means, looks, strayed = (
            a.copy() for a in (state.frames, state.means, state.looks, state.strayed)
        )
        away = looks[eye] > 0 and np.abs(found - means[eye]).max() > STRAYED
        strayed[eye] = strayed[eye] + 1 if away else 0
        if strayed[eye] > STRAYED_LOOKS:
            looks[eye] = strayed[eye] = 0
        if not away or looks[eye] == 0:
            looks[eye] = min(looks[eye] + chance, MEMORY)
            means[eye] += min(chance / looks[eye], 1) * (found - means[eye])
            reach = USUAL if frames[eye].any() else LEAVES * USUAL
            usual = (np.abs(means[eye]) <= reach).all()
            wanted = np.zeros(4, np.float32) if usual else means[eye]
            if np.abs(wanted - frames[eye]).max() > TOLERANCE:
                frames[eye] = wanted
        return replace(state, frames=frames, means=means, looks=looks, strayed=strayed)

    def _framed(self, eyes: Picture, small: Picture, eye: int, frame: Array) -> Picture:
        if not frame.any():
            return small[eye]
        size = float(np.exp(frame[2]))
        view = small[eye]
        if size < 0.7 and eyes.shape[1] >= 2 * SIDE:  # a small eye: from the finer picture
            fine = eyes[eye] if eye == 0 else eyes[eye, :, ::-1]
            while fine.shape[0] > 2 * SIDE:
                fine = halved(fine)
            view = fine
        while size * len(view) / SIDE > 1.5:  # a large one: means, not single pixels
            view = halved(view)
        return cut(view, frame)


def halved(picture: Picture) -> Picture:
    """Means of 2 x 2 pixels."""
    total = picture[::2].astype(np.uint16)
    total += picture[1::2]
    return ((total[:, ::2] + total[:, 1::2] + 2) >> 2).astype(np.uint8)


_AXIS = (np.arange(SIDE, dtype=np.float32) + 0.5) * (2 / SIDE) - 1  # middles of pixels, -1..1


def cut(view: Picture, frame: Array) -> Picture:
    """[n, n] -> [100, 100]: turned, scaled, between pixels; beyond its rim the rim goes on."""
    places, weights = _map(tuple(frame.tolist()), len(view))
    four = np.take(view.ravel(), places).astype(np.float32)
    mixed = np.einsum("kn,kn->n", four, weights)
    return (mixed + 0.5).astype(np.uint8).reshape(SIDE, SIDE)


@lru_cache(maxsize=32)  # frames hardly change, and to work this out costs more than to use it
def _map(frame: tuple[float, ...], n: int) -> tuple[NDArray[np.int32], Array]:
    """Of each pixel [10000] the four around its place in a view of n x n, and their shares."""
    right, below, log_size, turn = frame
    size = float(np.exp(log_size))
    across, down = size * np.cos(turn) * _AXIS, size * np.sin(turn) * _AXIS
    x = (across[None] - down[:, None] + (right + 1)) * (n / 2) - 0.5
    y = (down[None] + across[:, None] + (below + 1)) * (n / 2) - 0.5
    x, y = (np.clip(v, 0, n - 1.001).ravel() for v in (x, y))
    column, row = x.astype(np.int32), y.astype(np.int32)
    x, y, first = x - column, y - row, row * n + column
    places = np.stack([first, first + 1, first + n, first + n + 1])
    weights = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])
    return places, weights.astype(np.float32)
