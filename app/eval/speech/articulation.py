"""Articulation of talkers left out: table, thresholds and plot of classes of phones.

The measures are in encoder/evaluation/articulation.py, the mouth in app/face/mouth.py.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.terminal.thresholds import at_least, at_most

if TYPE_CHECKING:
    from app.eval.speech.following import Followed
    from encoder.evaluation.articulation import Tokens

CONTRAST, SEEN, FALSE, TWICE = 0.8, 0.6, 0.03, 2.0  # two at least, two at most
ROW = "articulation"


def tokens_of(talkers: "Mapping[str, Sequence[Followed]]", avatar: str) -> "Tokens":
    """The phones of all talkers on an avatar."""
    from app.face.mouth import mouth_of
    from encoder.evaluation.articulation import SpokenClip, tokens

    mouth = mouth_of(avatar)
    return tokens(
        [
            SpokenClip(name, mouth(clip.shown), mouth(clip.tracked), clip.phones)
            for name, clips in talkers.items()
            for clip in clips
        ]
    )


def show(said: "Tokens") -> None:
    """A table of the classes' means, shown and tracked, mm."""
    from app.terminal.console import console, numbers
    from encoder.evaluation.articulation import CLASSES, MEASURES, class_means

    table = numbers("phones", "number", *MEASURES)
    table.title, table.title_justify = "shown / tracked, mm, mean of each class", "left"
    for name, rows in class_means(said).items():
        cells = [f"{shown:.1f} / {tracked:.1f}" for shown, tracked in rows[0].T]
        number = int(np.isin(said.names, CLASSES[name]).sum())
        table.add_row(name, str(number), *cells)
    console(width=150).print(table)


def thresholds(metrics: Mapping[str, float]) -> list[dict[str, Any]]:
    """Of the figures that could be measured; names of metrics begin with ROW."""

    def of(name: str) -> float | None:
        return metrics.get(f"{ROW}/{name}")

    found: list[dict[str, Any]] = []
    for measure in ("opening", "width", "protrusion"):
        value = of(f"{measure}_contrast")
        if value is not None:
            found.append(at_least(f"contrast of {measure}, over tracked", value, CONTRAST))
    people = of("width_over_people_shown")
    if people is not None:
        found.append(at_least("width of s i e w o u, over people's", people, CONTRAST))
    teeth = of("teeth_seen")
    if teeth is not None:
        found.append(at_least("teeth seen in s z, where tracked", teeth, SEEN))
    false = of("false_closures")
    if false is not None:
        found.append(at_most("open vowels shown shut", false, FALSE))
    shut, real = of("tongue_shut"), of("tongue_shut_tracked")
    if shut is not None and real is not None:
        found.append(at_most("t d k n s shut, over tracked", shut / max(real, 1e-2), TWICE))
    return found


def save_plot(folder: Path, said: "Tokens") -> Path:
    """articulation.png: the classes' means and 95th percentiles, shown beside tracked."""
    from app.eval.plots import save_classes
    from encoder.evaluation.articulation import MEASURES, class_means

    means = class_means(said)
    panels = {
        f"{measure} (mm)": [rows[..., column] for rows in means.values()]
        for column, measure in enumerate(MEASURES)
    }
    return save_classes(folder / "articulation.png", list(means), panels)
