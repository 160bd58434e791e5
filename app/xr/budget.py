"""Budget: how finely pictures are drawn, so that they come at the runtime's rate."""

LEVELS = (1.0, 0.84, 0.7, 0.6, 0.5)  # of width and height
DEAR, CHEAP = 0.9, 0.5  # of the time between two frames
PATIENCE = 30  # frames that must be dear, or cheap, one after the other


class Budget:
    """Goes down a level where drawing has taken too long for a while, and up where it has not."""

    def __init__(self) -> None:
        self._level = self._dear = self._cheap = 0

    @property
    def share(self) -> float:
        """Of the width and the height of a full picture."""
        return LEVELS[self._level]

    def spent(self, cost_ns: int, period_ns: int) -> None:
        """What drawing a frame took, and the time there is for it; 0: all the time there is."""
        self._dear = self._dear + 1 if cost_ns > DEAR * period_ns > 0 else 0
        self._cheap = self._cheap + 1 if cost_ns < CHEAP * period_ns else 0
        if max(self._dear, self._cheap) < PATIENCE:
            return
        step = 1 if self._dear else -1
        self._level = min(max(self._level + step, 0), len(LEVELS) - 1)
        self._dear = self._cheap = 0
