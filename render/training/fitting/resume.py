"""Files that a stopped run finds whole or not at all."""

from collections.abc import Callable
from pathlib import Path

from sensors import files


def write(path: Path, save: Callable[[Path], object]) -> None:
    """`save` writes a draft beside `path`; only a finished one takes its place."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with files.replacing(path) as draft:
        save(draft)
