"""When a partner's media is played: one clock for voice and face, led by the audio.

A unit of media (a packet of voice, a tick) has a lag: our clock when it could be played minus its
media time, whatever brought it: itself, the error correction of the next packet, a repeated tick.
The delay is a high quantile of the lags of the last seconds plus a margin: more for the voice, as
a gap in it is heard at once. The partner's clock is never needed: its offset and its drift are part
of every lag.

Streams: "voice" and "face", each when it is due, and "next face": a tick as it is needed one tick
earlier, so that most poses can lie between two of them instead of up to a tick behind.
"""

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from sensors.types import NS, SAMPLE_RATE

LOOK_NS = 100_000_000  # between two looks at the lags
Lags = tuple[deque[int], deque[float]]  # our clock in ns, lag in ms; of as many units


@dataclass(frozen=True, kw_only=True)
class DelaySettings:
    """How long to wait for late media."""

    most_ms: float = 200.0  # beyond the fastest unit of the last second
    quantiles: Mapping[str, float] = field(
        default_factory=lambda: {"voice": 0.998, "face": 0.998, "next face": 0.8}
    )
    margins_ms: Mapping[str, float] = field(
        default_factory=lambda: {"voice": 7.0, "face": 3.0, "next face": 3.0}
    )
    window_s: float = 6.0
    first_s: float = 0.4  # of lags, before anything is played
    settle_s: float = 1.0  # in which an error of the delay is played away ...
    rate: float = 0.02  # ... by playing at most so much faster or slower
    jump_ms: float = 120.0  # a larger error is jumped over


class Timeline:
    """Maps our clock to a partner's media time, in samples of 48 kHz since its start."""

    def __init__(self, settings: DelaySettings | None = None) -> None:
        self.settings = settings or DelaySettings()
        self._lags: dict[str, Lags] = {}
        self._first_ns: int | None = None
        self._target_ms: float | None = None
        self._next_look_ns = 0
        self._at = (0, 0.0, 1.0)  # our clock, media there, media samples a sample of ours

    @property
    def started(self) -> bool:
        return self._target_ms is not None and self._at[0] > 0

    def arrived(self, stream: str, media: float, now_ns: int) -> None:
        """From now on the unit of `stream` that is due at `media` could be played."""
        if self._first_ns is None:
            self._first_ns = now_ns
        times, lags = self._lags.setdefault(stream, (deque(), deque()))
        times.append(now_ns)
        lags.append(now_ns / 1e6 - media * 1e3 / SAMPLE_RATE)
        old_ns = now_ns - round(self.settings.window_s * NS)
        if now_ns - self._first_ns > 3 * self.settings.first_s * NS:  # what began is slow at first
            old_ns = max(old_ns, self._first_ns + round(self.settings.first_s * NS))
        while times[0] < old_ns:
            times.popleft()
            lags.popleft()

    def target(self, now_ns: int) -> float | None:
        """The media that should be heard now; None while too little is known."""
        if self._first_ns is None or now_ns - self._first_ns < self.settings.first_s * NS:
            return None
        if now_ns >= self._next_look_ns:
            self._target_ms, self._next_look_ns = self._wanted_ms(now_ns), now_ns + LOOK_NS
        assert self._target_ms is not None
        return (now_ns / 1e6 - self._target_ms) * SAMPLE_RATE / 1e3

    def rate(self, media: float, target: float) -> float | None:
        """How fast to play on from `media` where `target` should be heard; None: too far off, jump
        to it."""
        error_s = (target - media) / SAMPLE_RATE
        if abs(error_s) * 1e3 > self.settings.jump_ms:
            return None
        limit = self.settings.rate
        return 1 + min(max(error_s / self.settings.settle_s, -limit), limit)

    def played(self, media: float, now_ns: int, rate: float) -> None:
        """What is heard at `now_ns`, and how it goes on: the face follows."""
        self._at = (now_ns, media, rate)

    def media_at(self, now_ns: int) -> float:
        """The media heard at `now_ns`, by the newest word of the player."""
        then_ns, media, rate = self._at
        return media + (now_ns - then_ns) * 1e-9 * SAMPLE_RATE * rate

    @property
    def anchor(self) -> tuple[int, float, float]:
        """(our clock in ns, media in samples, rate): all that `media_at` depends on."""
        return self._at

    def _wanted_ms(self, now_ns: int) -> float:
        s, needed, fastest = self.settings, -math.inf, -math.inf
        newest_ns = max(times[-1] for times, _ in self._lags.values())
        silent_ns = min(newest_ns, now_ns - round(s.window_s * NS))  # of who is muted
        for stream, (times, lags) in self._lags.items():
            if times[-1] < silent_ns:
                continue
            ordered = np.sort(np.fromiter(lags, float, len(lags)))
            last = ordered[math.ceil(s.quantiles[stream] * (len(ordered) - 1))]
            needed = max(needed, last + s.margins_ms[stream])
            # Of the last second: a partner whose clock stood still is that much later for good.
            lately = len(times) - bisect_left(times, times[-1] - NS)
            fastest = max(fastest, min(islice(reversed(lags), lately)))
        return float(min(max(needed, fastest), fastest + s.most_ms))
