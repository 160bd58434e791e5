"""Files that a stopped run finds whole or not at all."""

from collections.abc import Callable
from pathlib import Path


def write(path: Path, save: Callable[[Path], object]) -> None:
    """`save` writes a draft beside `path`; only a finished one takes its name."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(".part" + path.suffix)
    save(draft)
    draft.replace(path)
