"""Smooth noise as a function of (seed, purpose, time): any frame can be computed alone."""

from functools import lru_cache

from encoder.nn import philox

_STREAM = 5  # of Philox counters: 0 is the denoiser's noise, 2 the gaze walk


@lru_cache(maxsize=256)  # the knots of a frame are those of the one before, nearly always
def uniform(seed: int, kind: int, index: int, count: int = 1) -> tuple[float, ...]:
    """`count` numbers of -1..1 of one index."""
    generator = philox.generator(seed, kind, 0, _STREAM, index)
    return tuple((2 * generator.random(count) - 1).tolist())


def wander(seed: int, kind: int, frame: int, frames_a_knot: int) -> float:
    """A smooth curve of -1..1 through a random value at every knot."""
    knot, rest = divmod(frame, frames_a_knot)
    share = rest / frames_a_knot
    share = share * share * (3 - 2 * share)
    (a,), (b,) = uniform(seed, kind, knot), uniform(seed, kind, knot + 1)
    return a + share * (b - a)
