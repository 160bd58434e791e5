"""Asks before a file of the user's is written over, where somebody can answer."""

import sys
from collections.abc import Iterable
from pathlib import Path

from sensors.types import InputError


def overwriting(paths: Iterable[Path | None], cure: str = "choose another") -> None:
    """Ask about those that exist, folders with files in them included. Raises InputError unless the
    answer is yes; a script, which has no terminal, is not asked and writes as it was told to.
    """
    there = [p for p in paths if p and (any(p.iterdir()) if p.is_dir() else p.exists())]
    if not there or not sys.stdin.isatty() or not sys.stderr.isatty():
        return
    names = ", ".join(map(str, there))
    print(f"{names}: there already; write over it? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise InputError(f"expected a new name, got {names}, which is kept; {cure}")
