"""Plots: figures that need no display, written whole or not at all."""

from pathlib import Path
from typing import Any

from sensors import files


def figure(width: float, height: float) -> Any:
    """An empty matplotlib figure of so many inches, whose parts keep out of each other's way."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def save(drawn: Any, path: Path, dpi: int = 110) -> Path:
    """Write a figure as PNG, with its folder; returns the path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with files.replacing(path) as draft:
        drawn.savefig(draft, dpi=dpi)
    return path
