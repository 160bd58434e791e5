"""Plots of an evaluation: loss curves of every card, and the lips' error over a constant shift.

A model that would need future sound has its smallest error where its motion is compared with
earlier truth: the minimum of the second plot is the model's delay.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from app.terminal import figures

SHIFTS = range(-6, 7)  # frames
COLUMNS = 4  # of loss curves


def shift_errors(guess: Sequence[np.ndarray], truth: Sequence[np.ndarray]) -> list[float]:
    """Mean absolute error of lip openings [T], mm, for each of SHIFTS (> 0: the guess is late)."""
    result: list[float] = []
    for shift in SHIFTS:
        pairs = [
            (g[max(0, shift) : len(g) + min(0, shift)], t[max(0, -shift) : len(t) + min(0, -shift)])
            for g, t in zip(guess, truth, strict=True)
        ]
        result.append(float(np.mean([np.abs(g - t).mean() for g, t in pairs])))
    return result


def curves_of(cards: Sequence[Path]) -> dict[str, dict[str, list[float]]]:
    """Loss curves of those cards that hold one: "folder/name" -> column -> values."""
    found: dict[str, dict[str, list[float]]] = {}
    for path in cards:
        card: dict[str, Any] = json.loads(path.read_text()) if path.is_file() else {}
        if card.get("curve", {}).get("step"):
            found[f"{path.parent.name}/{path.stem}"] = card["curve"]
    return found


def save_ratios(
    path: Path, title: str, rows: Sequence[str], panels: Mapping[str, Sequence[Sequence[float]]]
) -> Path:
    """Write a figure of ratios to `path` and return it.

    panels: title -> for each row its value in each kind of clip, over that of the first row: dots,
    and their mean as a line.
    """
    figure = figures.figure(4 * len(panels), 4)
    axes = figure.subplots(1, len(panels), squeeze=False)
    for panel, (name, values) in zip(axes.flat, panels.items(), strict=True):
        for index, kinds in enumerate(values):
            panel.plot([index] * len(kinds), kinds, ".", color="gray")
            panel.plot(index, np.mean(kinds), "_", color=f"C{index}", markersize=40, mew=3)
        panel.axhline(1, color="gray", linestyle="--", linewidth=0.8)
        panel.set(title=name, xlim=(-0.6, len(values) - 0.4))
        panel.set_xticks(range(len(rows)), rows, rotation=20, ha="right")
    figure.suptitle(title)
    return figures.save(figure, path)


def save_classes(
    path: Path, classes: Sequence[str], panels: Mapping[str, Sequence[np.ndarray]]
) -> Path:
    """Write a figure of classes of phones to `path` and return it.

    panels: title -> for each class [2, 2]: mean and 95th percentile, shown and tracked. Bars are
    means, ticks the percentiles.
    """
    figure = figures.figure(9, 2.1 * len(panels))
    axes = figure.subplots(len(panels), 1, squeeze=False, sharex=True)
    places = np.arange(len(classes))
    for panel, (title, rows) in zip(axes.flat, panels.items(), strict=True):
        for side, (name, colour) in enumerate((("shown", "C0"), ("tracked", "0.6"))):
            at, values = places + 0.4 * side - 0.2, np.array([row[:, side] for row in rows])
            panel.bar(at, values[:, 0], 0.36, label=name, color=colour)
            panel.plot(at, values[:, 1], "_", color=colour, markersize=11, mew=2)
        panel.axhline(0, color="gray", linewidth=0.5)
        panel.set(ylabel=title)
        panel.set_xticks(places, classes)
    axes.flat[0].legend(fontsize="small")
    return figures.save(figure, path)


def save(
    folder: Path, shifts: Mapping[str, list[float]], curves: Mapping[str, dict[str, list[float]]]
) -> list[Path]:
    """Write shift.png and, where there are curves, losses.png; returns their paths."""
    figure = figures.figure(8, 4.5)
    axes = figure.subplots()
    for name, errors in sorted(shifts.items(), key=lambda item: item[0].startswith("language")):
        style = {"color": "lightgray", "zorder": 1} if name.startswith("language") else {}
        axes.plot([1000 / 30 * s for s in SHIFTS], errors, marker=".", label=name, **style)
    axes.axvline(0, color="gray", linewidth=0.5)
    axes.set(xlabel="shift of the predicted motion (ms)", ylabel="error of lip opening (mm)")
    figure.legend(loc="outside right upper", fontsize="small")
    paths = [figures.save(figure, folder / "shift.png")]
    if curves:
        columns = min(COLUMNS, len(curves))
        rows = -(-len(curves) // columns)
        figure = figures.figure(4 * columns, 3.6 * rows)
        grid = figure.subplots(rows, columns, squeeze=False)
        for panel in grid.flat[len(curves) :]:
            panel.set_axis_off()
        for panel, (name, curve) in zip(grid.flat, curves.items(), strict=False):
            for key, values in curve.items():
                if key != "step":
                    panel.plot(curve["step"], values, label=key)
            panel.set(title=name, xlabel="step", yscale="log")
            below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.2)}
            panel.legend(fontsize="x-small", ncols=3, **below)
        paths.append(figures.save(figure, folder / "losses.png"))
    return paths
