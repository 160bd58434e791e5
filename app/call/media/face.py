"""A partner's face, from ticks to the pose that belongs to what is heard now.

Between two ticks the pose is between them. A tick that is late holds the last one for 200 ms, then
the face eases to rest; a partner of whom nothing comes at all fades out, and back in.
"""

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.call.media.opus import LOOK_AHEAD
from app.call.media.timeline import Timeline
from app.call.wire.packet import Tick
from sensors.types import FPS, NS, SAMPLE_RATE, SAMPLES_PER_FRAME

HOLD_NS = 200_000_000
EASE_NS = 400_000_000  # from the last pose to rest
RETURN_NS = 100_000_000  # and back
GONE_NS = 1_500_000_000
FADE_NS = 500_000_000
BEHIND = 192  # samples that a pose may lag behind the sound before it lies between two ticks
KEPT = 30  # ticks
BRIDGED = 4  # ticks apart, that a pose may lie between
LATELY = 0.05  # weight of the newest pose
FAR = 10 * SAMPLE_RATE  # samples
AHEAD = np.array([[0, 0, 1], [0, 0, 1]], np.float32)


@dataclass
class FaceCounts:
    """How a partner's ticks came, however often somebody draws them."""

    due: int = 0  # ticks
    held: int = 0  # of those: not there when they were to be shown
    _counted: int | None = None  # index up to which these go

    def count(self, newest: int, come: Container[int]) -> None:
        """Ticks up to `newest` are to be shown by now, and those in `come` are there."""
        if self._counted is None:
            self._counted = newest if newest in come else None
            return
        for index in range(max(self._counted + 1, newest - KEPT + 1), newest + 1):
            self.due += 1
            self.held += index not in come
        self._counted = max(newest, self._counted)


@dataclass(frozen=True, eq=False)
class Shown:
    """The pose to draw."""

    tick: Tick
    presence: float  # 0 gone .. 1 here


def note(timeline: Timeline, ticks: Sequence[int], offset: int, now_ns: int) -> None:
    """Tell the timeline of the `ticks` of one message, newest first, that were not known before."""
    for index in ticks:
        timeline.arrived("face", end_of(index, offset), now_ns)
    if ticks:
        timeline.arrived("next face", end_of(ticks[0] - 1, offset) + BEHIND, now_ns)


def end_of(index: int, offset: int) -> int:
    """Media at which tick `index` is due: the END of its samples, as the codec delays them."""
    return (index + 1) * SAMPLES_PER_FRAME + offset + LOOK_AHEAD


def due_by(media: float, offset: int) -> int:
    """Index of the newest tick that is due at `media`."""
    return int((media - end_of(-1, offset)) // SAMPLES_PER_FRAME) - 1


class FaceTrack:
    """Push ticks as they come, ask for the pose whenever something is drawn."""

    def __init__(self) -> None:
        self.behind_ms = 0.0  # smoothed lag of the shown pose behind the sound
        self._ticks: dict[int, tuple[int, Tick]] = {}  # index -> media where it is due
        self._rest = 0.0  # 0: as the ticks say .. 1: at rest
        self._presence = 0.0
        self._pushed_ns = self._asked_ns = 0

    def push(self, tick: Tick, end: int, now_ns: int) -> bool:
        """False: known already, or too old or too new to be true."""
        newest = max(self._ticks, default=tick.index)
        is_back = now_ns - self._pushed_ns > GONE_NS
        if (
            tick.index in self._ticks
            or not is_back
            and abs(tick.index - newest) > FAR // SAMPLES_PER_FRAME
        ):
            return False
        if is_back:
            self._ticks.clear()
        elif tick.index <= newest - KEPT:
            return False
        self._pushed_ns = now_ns
        self._ticks[tick.index] = (end, tick)
        while len(self._ticks) > KEPT:
            del self._ticks[min(self._ticks)]
        return True

    def pose(self, media: float, now_ns: int) -> Shown | None:
        """The pose at `media`; None before the first tick is due."""
        step_ns, self._asked_ns = now_ns - (self._asked_ns or now_ns), now_ns
        gone = now_ns - self._pushed_ns > GONE_NS
        self._presence = _towards(self._presence, not gone, step_ns / FADE_NS)
        before = max((i for i, (end, _) in self._ticks.items() if end <= media), default=None)
        if before is None:
            return None
        end, tick = self._ticks[before]
        after = min((i for i in self._ticks if i > before), default=None)
        late_ns = (media - end) * NS / SAMPLE_RATE
        if after is not None and after - before <= BRIDGED:
            next_end, following = self._ticks[after]
            tick = between(tick, following, (media - end) / max(next_end - end, 1))
            late_ns = 0
        held = late_ns > HOLD_NS + NS / FPS
        if not held:
            self.behind_ms += LATELY * (late_ns / 1e6 - self.behind_ms)
        self._rest = _towards(self._rest, held, step_ns / (EASE_NS if held else RETURN_NS))
        return Shown(at_rest(tick, _smooth(self._rest)), self._presence)


def between(a: Tick, b: Tick, share: float) -> Tick:
    """The pose `share` of the way from a to b."""
    sign = 1.0 if float(a.head_wxyz @ b.head_wxyz) >= 0 else -1.0
    return replace(
        a,
        expression=_mix(a.expression, b.expression, share),
        gaze=_unit(_mix(a.gaze, b.gaze, share)),
        head_mm=_mix(a.head_mm, b.head_mm, share),
        head_wxyz=_unit(_mix(a.head_wxyz, sign * b.head_wxyz, share)),
        breath=a.breath + share * (b.breath - a.breath),
    )


def at_rest(tick: Tick, share: float) -> Tick:
    if share <= 0:
        return tick
    rest = Tick(index=tick.index, expression=np.zeros_like(tick.expression), gaze=AHEAD)
    return between(tick, rest, share)


def _mix(a: NDArray[np.float32], b: NDArray[np.float32], share: float) -> NDArray[np.float32]:
    return (a + np.float32(share) * (b - a)).astype(np.float32)


def _unit(v: NDArray[np.float32]) -> NDArray[np.float32]:
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-6)


def _towards(value: float, goal: bool, step: float) -> float:
    return min(value + step, 1.0) if goal else max(value - step, 0.0)


def _smooth(share: float) -> float:
    return share * share * (3 - 2 * share)
