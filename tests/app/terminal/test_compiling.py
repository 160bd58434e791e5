"""A newcomer's first run says why nothing moves yet."""

import subprocess
import sys
from pathlib import Path

import pytest

from app.terminal.compiling import WORDS

LOOPS = """
import numba
@numba.njit(cache=True)
def twice(x):
    return 2 * x
@numba.njit(cache=True)
def thrice(x):
    return 3 * x
"""
RUN = """
from app.terminal import compiling
compiling.announce(print)
compiling.announce(print)
import loops
print(loops.twice(2), loops.thrice(3))
"""


@pytest.mark.slow
def test_it_is_told_once_and_only_on_the_first_run(tmp_path: Path) -> None:
    (tmp_path / "loops.py").write_text(LOOPS)
    root = Path(__file__).parents[3]
    environment = {"PYTHONPATH": f"{root}:{tmp_path}", "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    said: list[list[str]] = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", RUN], env=environment, capture_output=True, text=True, check=True
        )
        said.append(done.stdout.splitlines())
    assert said == [[WORDS, "4 9"], ["4 9"]]
