"""Colours whose blend, not each of them, looks like a texture.

Narrow Gaussians lie over a wide layer that closes the gaps between them, and about half of what is
seen is that layer: a picture of Gaussians that each have the texture's colour is soft. What is seen
at places on the face is linear in the colours, and the same for everyone: this solves for colours
that together show the texture, and stays near those it was given. Fewer and wider Gaussians, whose
colours are means of these, get their own in the same way: each a factor of its brightness.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from render.avatars import blends, textures
from render.avatars.blends import Blend
from render.lighting import LUMINANCE
from render.types import Doubles, Floats

STAY, STEPS = 0.11, 40  # how much a colour that stays is worth; of least squares
# Least and largest gain: a single Gaussian beyond is a grain of salt or soot on the skin.
SKIN, EYES = (0.8, 1.1), (0.3, 1.9)
# Texels of the skin and of an eye's picture: what a picture averages of them (what is darker than a
# pupil would draw the look aside); detail finer than FINE is wanted so much stronger.
SKIN_BLUR, SKIN_FINE, SKIN_GAIN = 0.65, 6.0, 1.26
EYE_BLUR, EYE_FINE, EYE_GAIN = 2.5, 6.25, 1.6
ROUNDS = 3  # of least squares: what gains at a limit may not do, others make up for
# A colour of an eye is found within so many texels, or is lighter by at most this, and by no more
# than the darkest found there: a pupil stays dark.
EYE_REACH, EYE_LIGHTER = 5, 0.15
ATLAS = np.array([0.5, 1.0], np.float32)  # the face lies in the left half


def wanted_skin(skin: Floats) -> Floats:  # [H, 2 H, 3] 0..1
    """The texture as a picture of Gaussians is to show it."""
    return textures.sharper(skin, SKIN_BLUR, SKIN_FINE, SKIN_GAIN)


def wanted_eye(eye: Floats) -> Floats:  # [H, H, 3] 0..1
    """The same of an eye's picture."""
    return textures.sharper(eye, EYE_BLUR, EYE_FINE, EYE_GAIN)


def card() -> dict[str, float]:
    """What to tell beside an avatar about how its colours were made."""
    how = {"places": blends.DENSITY, "stay": STAY, "steps": STEPS, "rounds": ROUNDS}
    return how | {"gain": SKIN_GAIN, "gain_eyes": EYE_GAIN}


def sharpened(
    albedo: Floats,  # [N, 3] 0..1 stored
    free: NDArray[np.bool_],  # [N] which may change
    of: Blend,
    wanted: Floats,  # [S, 3] what is to be seen at its places
) -> Floats:  # [N, 3]
    """Colours that show the detail: brighter or darker, in the hue that they have."""
    return np.clip(albedo * gains(albedo, free, of, wanted, SKIN)[:, None], 0, 1)


def gains(
    albedo: Floats,  # [N, 3] 0..1 stored
    free: NDArray[np.bool_],  # [N]
    of: Blend,
    wanted: Floats,  # [S, 3]
    limits: tuple[float, float],
) -> Floats:  # [N]
    """The same as factors of brightness: 1 where nothing changes."""
    bright = np.maximum(albedo @ LUMINANCE, 0.05)
    low, high = ((limit - 1) * bright for limit in limits)
    missing, change = (wanted - of.shares @ albedo) @ LUMINANCE, np.zeros_like(bright)
    moving = free
    for _ in range(ROUNDS):
        change += _solved(of.shares, moving, missing - of.shares @ change)
        change = change.clip(low, high)
        moving = free & (change > low) & (change < high)
    return (1 + change / bright).astype(np.float32)


def repainted(
    albedo: Floats,  # [N, 3] 0..1 stored
    free: NDArray[np.bool_],  # [N]
    of: Blend,
    wanted: Floats,  # [S, 3]
    bounds: tuple[Floats, Floats],  # [free, 3] each: darkest and lightest
) -> Floats:  # [N, 3]
    """Colours that show the detail in its own hues: an iris has a dark rim, and ends in white."""
    out, seen = albedo.copy(), of.shares @ albedo
    for channel in range(3):
        missing = wanted[:, channel] - seen[:, channel]
        out[:, channel] += _solved(of.shares, free, missing)
    out[free] = np.clip(out[free], *bounds)
    return out


def _solved(shares: csr_array, moving: NDArray[np.bool_], missing: Floats) -> Floats:
    """[S, N], [N], [S] -> the change [N] of colours that makes up for it, of those that may."""
    from scipy.sparse.linalg import LinearOperator, lsmr

    back, single, double = shares.T, np.float32, np.float64

    def seen(change: Doubles) -> Floats:
        return shares @ (moving * change).astype(single)

    def told(left: Doubles) -> Doubles:
        return moving * (back @ left.astype(single)).astype(double)

    some = LinearOperator(shares.shape, matvec=seen, rmatvec=told, dtype=double)  # pyright: ignore
    return lsmr(some, missing.astype(double), damp=STAY, maxiter=STEPS)[0].astype(single)
