"""Avatars whose colours take one step, at few places: how sharp they are is judged in
tests/render/avatars/test_detail.py."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from render.avatars import blends, detail


@contextmanager
def quick_colors() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(detail, "STEPS", 1)
        patch.setattr(blends, "DENSITY", 0.3)
        patch.setattr(blends, "_known", {})
        yield
