"""`livedrive eval emotion DATA`: is the emotion recognised, and are the lips still in sync?

Truth is rule-made. Which emotion a face shows is decided without a classifier: for the same words
and eyes there is a truth in each of the ten emotions, and the nearest one (by vertices) counts.
Lips are evaluated twice: by the lip sync of the paper's tables, and by the part of their motion
that comes from the words alone.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from app.eval.emotion.settings import FINE_TUNED, RULES, SHIPPED, EmotionSettings

Metrics = dict[str, float]


def evaluate(data: Path, settings: EmotionSettings) -> None:
    """Print tables and thresholds; exit with status 1 where one fails.

    data: folder made by `livedrive capture`; models of the ablations are expected in it.
    """
    from tqdm import tqdm

    from app.eval.emotion import live as emotion_live
    from app.eval.emotion import metrics as emotion_metrics
    from app.eval.emotion import pictures as emotion_pictures
    from app.terminal.thresholds import finish, print_metrics

    evaluated = emotion_metrics.EmotionEvaluation(data, settings)
    tables: dict[str, dict[str, Metrics]] = {}
    confusions: dict[str, Any] = {}
    for kind, truths in tqdm(evaluated.sets().items(), unit="set", disable=None):
        rows = evaluated.metrics(truths)
        tables[kind] = {name: row.metrics for name, row in rows.items()}
        confusions[kind] = rows[SHIPPED].seen
        show({kind: tables[kind]})
    metrics = emotion_live.live_metrics(evaluated) | {
        f"{kind}/{row}/{name}": value
        for kind, rows in tables.items()
        for row, metrics in rows.items()
        for name, value in metrics.items()
    }
    print_metrics(metrics, evaluated.missing)
    if settings.pictures:
        for path in emotion_pictures.save(settings.pictures, evaluated, confusions):
            print(f"wrote {path}")
    thresholds = make_thresholds(metrics, list(tables))
    facts = {"seed": settings.seed, "avatar": settings.avatar}
    facts |= {"test_set": data.name, "truth": "made by rules"}
    finish({"metrics": metrics, "bars": thresholds, **facts}, settings.report)


# as in the paper's tables, mm; and without the emotion's style (lip_metrics in
# encoder/evaluation/emotion.py)
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


def show(tables: dict[str, dict[str, Metrics]]) -> None:
    """One table for each set of takes."""
    from rich.table import Table

    from app.terminal.console import console

    for kind, rows in tables.items():
        table = Table(title=kind, title_justify="left")
        table.add_column("row", no_wrap=True)
        for title, _ in COLUMNS:
            table.add_column(title)
        for row, metrics in rows.items():
            table.add_row(row, *(f"{metrics[c]:.3f}" if c in metrics else "-" for _, c in COLUMNS))
        console(width=170).print(table)


def make_thresholds(metrics: Metrics, kinds: list[str]) -> list[dict[str, Any]]:
    """The thresholds of every metric that was measured."""
    from app.terminal.thresholds import at_least, at_most

    thresholds: list[dict[str, Any]] = []
    for kind in kinds:
        ours = f"{kind}/{SHIPPED}"
        thresholds.append(at_least(f"{kind} accuracy", metrics[f"{ours}/accuracy_face"], 0.8))
        for words, name in LIP_MEASURES.items():
            for baseline, under in (
                ("neutral's on emotional truth", f"{ours}/neutral_{name}"),
                ("neutral's on its own truth", f"{ours}/neutral_own_{name}"),
                # the best that the neutral model's lips can reach, see laid_over
                ("neutral's in the rules' style", f"{kind}/{RULES}/{name}"),
            ):
                ratio = metrics[f"{ours}/{name}"] / metrics[under]
                thresholds.append(at_most(f"{kind} {words} over {baseline}", ratio, 1.05))
        for truth, neutral in (("emotional", "neutral"), ("its own", "neutral_own")):
            lost = f"{ours}/{neutral}_closures_lost"
            if lost in metrics:
                error, number = metrics[f"{lost}_error"], metrics[f"{ours}/closures"]
                name = f"{kind} closures lost, {truth} truth (of {number:.0f}, +-{error:.3f})"
                thresholds.append(at_most(name, metrics[lost], 0.03))
        baseline = f"{kind}/{FINE_TUNED}"
        if f"{baseline}/lip_sync_mm" in metrics:
            short = metrics[f"{ours}/accuracy_face"] - metrics[f"{baseline}/accuracy_face"]
            thresholds.append(at_most(f"{kind} accuracy that fine-tuning lacks", abs(short), 0.05))
            for words, name in LIP_MEASURES.items():
                ratio = metrics[f"{ours}/{name}"] / metrics[f"{baseline}/{name}"]
                thresholds.append(at_most(f"{kind} {words} over fine-tuned", ratio, 1.0))
    limits: dict[str, tuple[Callable[..., Any], float]] = {
        "intensity_0_difference": (at_most, 0.0),
        "intensity_monotone_share": (at_least, 1.0),
        "lids_apart_p95": (at_most, 0.1),
        "switching_jump_over_normal": (at_most, 1.0),
        "switching_jump_over_steady": (at_most, 1.0),
        "emotion_cpu_ms_a_tick": (at_most, 0.3),
    }
    return thresholds + [bar(name, metrics[name], limit) for name, (bar, limit) in limits.items()]
