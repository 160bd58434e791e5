"""`livedrive eval speech DATA --leave-one-out`: real talkers that the student was not trained on.

Each talker of the motion folder is driven live by the student in DATA/leave_out that was trained
without that talker (or without several), and compared with the tracked motion of the same clip. The
audio encoder is trained on none of them. What lips and teeth do for each class of phones is
measured on the same clips (articulation.py).
"""

# pyright: reportMissingTypeStubs=false

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.eval.speech.following import (
    Change,
    Followed,
    drivers_of,
    followed,
    tracked_folder,
    tracked_takes,
)
from sensors.types import InputError

if TYPE_CHECKING:
    from app.eval.speech.settings import SpeechSettings
    from encoder.evaluation.judging import FaceMesh

RATE = 48_000
BABBLE_DB = 10.0
BABBLE_DRAWS = 4  # r differs by .01 with the voices that are drawn
TELEPHONE_HZ = 3400.0
COLUMNS = (
    "r", "r_fast", "r_best", "shift_ms", "p95_ratio", "width_r", "width_ratio", "shut_initial",
    "shut_inside",
)  # fmt: skip


def evaluate(data: Path, settings: "SpeechSettings") -> None:
    """Print tables of talkers (clean, with babble, through a telephone band), of classes of phones,
    and thresholds.

    Raises InputError where talkers or students are missing.
    """
    from app.eval.speech import articulation
    from app.face.mesh import face_mesh
    from app.terminal.thresholds import at_least, at_most, finish
    from encoder.evaluation.articulation import figures

    folder = tracked_folder(settings.mocap)
    mesh = face_mesh(settings.avatar)
    drivers = drivers_of(data, settings.weights)
    check_enough(list(drivers))
    takes = {name: list(tracked_takes(folder, name)) for name in drivers}
    sounds = {name: [take.audio for take in takes[name][:2]] for name in takes}
    below = {name: babble(everyone_but(name, sounds), settings.seed) for name in takes}
    changes: dict[str, tuple[Mapping[str, Change | None], int]] = {  # and how often each is drawn
        "": (dict.fromkeys(takes), 1),
        "babble_": (below, BABBLE_DRAWS),
        "telephone_": (dict.fromkeys(takes, telephone()), 1),
    }
    metrics: dict[str, float] = {}
    said = None
    for prefix, (change, draws) in changes.items():
        drawn = [
            {n: followed(drivers[n], takes[n], change[n]) for n in drivers} for _ in range(draws)
        ]
        rows = {n: averaged([figures_of(clips[n], mesh) for clips in drawn]) for n in drivers}
        if not prefix:
            said = articulation.tokens_of(drawn[0], settings.avatar)
        show(rows, prefix)
        for name, row in rows.items():
            metrics |= {f"{prefix}{name}/{figure}": value for figure, value in row.items()}
        for figure in COLUMNS:
            values = [row[figure] for row in rows.values() if figure in row]  # FACEGOOD: no phones
            metrics[f"{prefix}mean/{figure}"] = float(np.mean(values))
    mean = {name: metrics[f"mean/{name}"] for name in COLUMNS}
    thresholds = [
        at_least("r", mean["r"], 0.75),
        at_least("r above 0.5 Hz", mean["r_fast"], 0.67),
        at_most("best shift, ms", abs(mean["shift_ms"]), 10.0),
        at_most("p95 of the opening, off by", abs(mean["p95_ratio"] - 1), 0.15),
        at_least("width r", mean["width_r"], 0.5),
        at_least("width deviation over tracked", mean["width_ratio"], 0.7),
        at_least("closures inside words", mean["shut_inside"], 0.85),
        at_least("closures at the start", mean["shut_initial"], 0.95),
        at_most("r lost to babble at 10 dB", mean["r"] - metrics["babble_mean/r"], 0.05),
        at_most("r lost to 3.4 kHz", mean["r"] - metrics["telephone_mean/r"], 0.05),
    ]
    assert said is not None
    articulation.show(said)
    metrics |= {f"{articulation.ROW}/{name}": value for name, value in figures(said).items()}
    thresholds += articulation.thresholds(metrics)
    if settings.plots:
        print(f"wrote {articulation.save_plot(settings.plots, said)}")
    facts = {"seed": settings.seed, "avatar": settings.avatar}
    rounded = {name: round(value, 4) for name, value in metrics.items()}
    finish({"metrics": rounded, "bars": thresholds, **facts}, settings.report)


def check_enough(talkers: Sequence[str]) -> None:
    """Raise InputError unless there are others who talk beside each."""
    if len(talkers) < 2:
        raise InputError(
            "--leave-one-out: expected students of two talkers or more (others talk beside each), "
            f"got {', '.join(talkers)}; run livedrive train listen --leave-out grid-s2, and so on"
        )


def averaged(draws: Sequence[dict[str, float]]) -> dict[str, float]:
    """Mean of each figure over the draws."""
    return {name: float(np.mean([draw[name] for draw in draws])) for name in draws[0]}


def show(rows: dict[str, dict[str, float]], prefix: str) -> None:
    from rich.table import Table

    from app.terminal.console import console

    table = Table(title=f"talkers left out {prefix.rstrip('_')}", title_justify="left")
    for title in ("talker", *COLUMNS):
        table.add_column(title.replace("_", " "))
    for name, row in rows.items():
        table.add_row(name, *(f"{row[c]:.3f}" if c in row else "-" for c in COLUMNS))
    console(width=150).print(table)


def everyone_but(name: str, sounds: Mapping[str, list[np.ndarray]]) -> list[np.ndarray]:
    """Other people's sounds."""
    return [sound for other in sounds if other != name for sound in sounds[other]]


def babble(others: list[np.ndarray], seed: int) -> Change:
    """Adds four talkers at once, BABBLE_DB below the sound; others to each sound."""
    rng = np.random.default_rng(seed)

    def change(sound: np.ndarray) -> np.ndarray:
        chosen: list[int] = rng.integers(len(others), size=4).tolist()
        voices = [np.resize(others[i], len(sound)) for i in chosen]
        noise = np.sum([voice / max(float(voice.std()), 1e-4) for voice in voices], 0)
        level = float(sound.std()) * 10 ** (-BABBLE_DB / 20) / float(noise.std())
        return (sound + level * noise).astype(np.float32)

    return change


def telephone() -> Change:
    from scipy import signal

    filters: Any = signal
    band = filters.butter(6, TELEPHONE_HZ, fs=RATE, output="sos")
    return lambda sound: np.asarray(filters.sosfilt(band, sound)).astype(np.float32)


def figures_of(clips: Sequence[Followed], mesh: "FaceMesh") -> dict[str, float]:
    from encoder.evaluation import talkers

    judged = [
        talkers.TalkerClip(mesh.lips(clip.shown), mesh.lips(clip.tracked), clip.phones)
        for clip in clips
    ]
    return talkers.figures(judged, mesh.marks)
