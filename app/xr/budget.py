"""Budget: how finely pictures are drawn, so that they come at the runtime's rate."""

LEVELS = (1.0, 0.84, 0.7, 0.6, 0.5)  # of width and height
SLOW, FAST = 0.9, 0.5  # of the time between two frames
PATIENCE = 30  # frames in a row that must be too slow, or fast enough for more


class Budget:
    """Goes down a level where drawing has taken too long for a while, and up where it has not."""

    def __init__(self) -> None:
        self._level = self._slow = self._fast = 0

    @property
    def share(self) -> float:
        """Of the width and the height of a full picture."""
        return LEVELS[self._level]

    def spent(self, cost_ns: int, period_ns: int) -> None:
        """What drawing a frame took, and the time there is for it; 0: all the time there is."""
        self._slow = self._slow + 1 if cost_ns > SLOW * period_ns > 0 else 0
        self._fast = self._fast + 1 if cost_ns < FAST * period_ns else 0
        if max(self._slow, self._fast) < PATIENCE:
            return
        step = 1 if self._slow else -1
        self._level = min(max(self._level + step, 0), len(LEVELS) - 1)
        self._slow = self._fast = 0
