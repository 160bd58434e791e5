"""`livedrive eval emotion DATA`: does the face show what was asked, do the lips still speak?

Truth is made by rules. Which emotion a face shows is decided without a classifier: by the truth,
among those of all ten emotions for the same words and eyes, that its vertices are nearest to.
Lips are judged twice: by the lip sync of the paper's tables, and by what the words make of them.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tyro.conf import Positional

Figures = dict[str, float]
# rows: trained models, and the neutral one's lips in the rules' style (see laid_over)
FINE_TUNED, SHIPPED, RULES = "fine-tuned", "zero convolutions", "rules over neutral"


@dataclass(kw_only=True)
class EvalEmotion:
    """Judge emotions on held-out subjects: recognised, in sync, smooth."""

    data: Positional[Path]
    """Data that `livedrive capture` made; the ablations are looked for in it."""
    weights: Path | None = None
    """Folder with audio, student and emotion; default: the shipped ones."""
    segments: int = 40
    """Most neutral takes (of each the first 200 frames) and 100-frame segments of real voices."""
    samples: int = 2
    """Draws of each."""
    avatar: str = "ben"
    seed: int = 0
    report: Path | None = None
    """Write the figures as JSON."""
    pictures: Path | None = None
    """Folder for pictures: emotions x frames, confusion tables."""

    def run(self) -> None:
        from tqdm import tqdm

        from app import emotion_figures, emotion_pictures
        from app.bars import finish

        judged = emotion_figures.Judgement(self)
        tables: dict[str, dict[str, Figures]] = {}
        confusions: dict[str, Any] = {}
        for kind, told in tqdm(judged.sets().items(), unit="set", disable=None):
            rows = judged.figures(told)
            tables[kind] = {name: row.figures for name, row in rows.items()}
            confusions[kind] = rows[SHIPPED].seen
            show({kind: tables[kind]})
        metrics = judged.live_figures() | {
            f"{kind}/{row}/{name}": value
            for kind, rows in tables.items()
            for row, figures in rows.items()
            for name, value in figures.items()
        }
        for name, value in metrics.items():
            if "/" not in name:
                print(f"{name:40s} {value:.3f}")
        for name in judged.missing:
            print(f"not trained, row left out: {name}")
        if self.pictures:
            for path in emotion_pictures.save(self.pictures, judged, confusions):
                print(f"wrote {path}")
        bars = make_bars(metrics, list(tables))
        if self.report:
            report = {"metrics": metrics, "bars": bars, "seed": self.seed, "avatar": self.avatar}
            report |= {"test_set": str(self.data), "truth": "made by rules"}
            self.report.write_text(json.dumps(report, indent=2) + "\n")
        finish(bars)


# of the paper's tables, in mm; and without the emotion's style (emotion_evaluation.lip_figures)
LIP_MEASURES = {"lip sync": "lip_sync_mm", "lip motion": "lip_motion_error"}
COLUMNS = (
    ("face", "accuracy_face"), ("upper", "accuracy_upper"), ("lower", "accuracy_lower"),
    ("lip sync", "lip_sync_mm"), ("neutral's", "neutral_lip_sync_mm"),
    ("on its own", "neutral_own_lip_sync_mm"),
    ("motion", "lip_motion_error"), ("neutral's", "neutral_lip_motion_error"),
    ("on its own", "neutral_own_lip_motion_error"),
    ("r", "lip_motion_r"), ("on its own", "neutral_own_lip_motion_r"),
    ("closures", "closure_recall"), ("on its own", "neutral_own_closure_recall"),
)  # fmt: skip


def show(tables: dict[str, dict[str, Figures]]) -> None:
    """One table for each set of takes."""
    from rich.console import Console
    from rich.table import Table

    for kind, rows in tables.items():
        table = Table(title=kind, title_justify="left")
        table.add_column("row", no_wrap=True)
        for title, _ in COLUMNS:
            table.add_column(title)
        for row, figures in rows.items():
            table.add_row(row, *(f"{figures[c]:.3f}" if c in figures else "-" for _, c in COLUMNS))
        Console(width=170).print(table)


def make_bars(metrics: Figures, kinds: list[str]) -> list[dict[str, Any]]:
    """The issue's bars, for every figure that was measured."""
    from app.bars import at_least, at_most

    bars: list[dict[str, Any]] = []
    for kind in kinds:
        ours = f"{kind}/{SHIPPED}"
        bars.append(at_least(f"{kind} accuracy", metrics[f"{ours}/accuracy_face"], 0.8))
        for words, name in LIP_MEASURES.items():
            for rival, under in (
                ("neutral's on emotional truth", f"{ours}/neutral_{name}"),
                ("neutral's on its own truth", f"{ours}/neutral_own_{name}"),
                # what can be asked of the neutral model's lips, see laid_over
                ("neutral's in the rules' style", f"{kind}/{RULES}/{name}"),
            ):
                ratio = metrics[f"{ours}/{name}"] / metrics[under]
                bars.append(at_most(f"{kind} {words} over {rival}", ratio, 1.05))
        for truth, neutral in (("emotional", "neutral"), ("its own", "neutral_own")):
            lost = f"{ours}/{neutral}_closures_lost"
            if lost in metrics:
                error, number = metrics[f"{lost}_error"], metrics[f"{ours}/closures"]
                name = f"{kind} closures lost, {truth} truth (of {number:.0f}, +-{error:.3f})"
                bars.append(at_most(name, metrics[lost], 0.03))
        rival = f"{kind}/{FINE_TUNED}"
        if f"{rival}/lip_sync_mm" in metrics:
            short = metrics[f"{ours}/accuracy_face"] - metrics[f"{rival}/accuracy_face"]
            bars.append(at_most(f"{kind} accuracy that fine-tuning lacks", abs(short), 0.05))
            for words, name in LIP_MEASURES.items():
                ratio = metrics[f"{ours}/{name}"] / metrics[f"{rival}/{name}"]
                bars.append(at_most(f"{kind} {words} over fine-tuned", ratio, 1.0))
    limits: dict[str, tuple[Callable[..., Any], float]] = {
        "intensity_0_difference": (at_most, 0.0),
        "intensity_monotone_share": (at_least, 1.0),
        "switching_jump_over_normal": (at_most, 1.0),
        "switching_jump_over_steady": (at_most, 1.0),
        "emotion_cpu_ms_a_tick": (at_most, 0.3),
    }
    return bars + [bar(name, metrics[name], limit) for name, (bar, limit) in limits.items()]
