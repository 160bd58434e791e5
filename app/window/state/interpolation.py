"""Interpolation between ticks: where the head is at the moment a picture is shown.

Ticks come 30 times a second and a little early or late; displays show 60, 72 or 144 pictures. The
window therefore lags one tick behind and moves evenly between the two ticks around its moment.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from sensors.types import FPS, NS

PERIOD_NS = NS // FPS
KEPT = 8  # ticks
WINDOW = 30  # ticks over which the delay from sound to post is judged
ON_TIME = 0.9  # share of the ticks that must have come when they are needed

Code = NDArray[np.float32]
AT_REST: Code = np.array([0, 0, 0, 1, 0, 0, 0, 0], np.float32)  # mm, wxyz, breath
OTHER_SIGN: Code = np.array([1, 1, 1, -1, -1, -1, -1, 1], np.float32)  # of the same turn


class Interpolation:
    """Expression code [256], gaze [2, 3] and head [8] as continuous functions of time."""

    def __init__(self, smooth: bool = True) -> None:
        self.smooth = smooth  # False: show the newest tick at once
        self._ticks: deque[tuple[int, Code, Code, Code]] = deque(maxlen=KEPT)
        self._delays_ns: deque[int] = deque(maxlen=WINDOW)
        self._delay_ns = 0

    def push(
        self, t_ns: int, posted_ns: int, expression: Code, gaze: Code, head: Code = AT_REST
    ) -> None:
        """A new tick: frame time, when it was posted (monotonic clock), code, gaze and head."""
        if self._ticks and t_ns <= self._ticks[-1][0]:  # another run, or a looped one
            self._ticks.clear()
            self._delays_ns.clear()
        elif self._ticks and head[3:7] @ self._ticks[-1][3][3:7] < 0:
            head = head * OTHER_SIGN  # half way to the other one there is no turn at all
        self._ticks.append((t_ns, expression, gaze, head))
        self._delays_ns.append(posted_ns - t_ns)
        self._delay_ns = sorted(self._delays_ns)[int(ON_TIME * (len(self._delays_ns) - 1))]

    def at(self, now_ns: int) -> tuple[Code, Code, Code] | None:
        """Expression, gaze and head to show now; None before the first tick."""
        if not self._ticks:
            return None
        moment = now_ns - self._delay_ns - PERIOD_NS
        after = next((k for k, tick in enumerate(self._ticks) if tick[0] > moment), None)
        if not self.smooth or after is None:  # the next tick is late: hold the newest
            return self._ticks[-1][1:]
        if after == 0:
            return self._ticks[0][1:]
        (t0, code0, gaze0, head0), (t1, code1, gaze1, head1) = (
            self._ticks[after - 1],
            self._ticks[after],
        )
        share = np.float32((moment - t0) / (t1 - t0))
        gaze = gaze0 + share * (gaze1 - gaze0)
        gaze /= np.linalg.norm(gaze, axis=1, keepdims=True)
        parts = (code0 + share * (code1 - code0), head0 + share * (head1 - head0))
        code, head = (part.astype(np.float32, copy=False) for part in parts)
        return code, gaze, head
