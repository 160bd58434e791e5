"""One line when numba compiles on a machine's first run; what it made is kept for later ones."""

from collections.abc import Callable
from functools import cache
from typing import Any

WORDS = "compiling a few loops for this machine, once: up to a minute"


@cache
def announce(tell: Callable[[str], None]) -> None:
    """From now on `tell` gets the line before the first loop that no earlier run has compiled;
    asked again with the same `tell`, nothing changes."""
    from numba.core import event as numba_event

    event: Any = numba_event  # which has no types

    class Listener(event.Listener):
        def on_start(self, compiling: Any) -> None:
            if not announced:
                announced.append(True)
                tell(WORDS)

        def on_end(self, compiling: Any) -> None: ...

    announced: list[bool] = []
    events: Any = event  # its functions have no types
    events.register("numba:compile", Listener())
