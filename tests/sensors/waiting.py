"""Waiting for real devices without betting on a machine's speed."""

import time
from collections.abc import Callable

PATIENCE_S = 40.0


def wait_until(done: Callable[[], bool], what: str, step_s: float = 0.01) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not done():
        assert time.monotonic() < deadline, f"gave up waiting: {what}"
        time.sleep(step_s)
