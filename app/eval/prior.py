"""`livedrive eval prior`: the universal avatar against the reference renderer.

Truth is rule-made: virtual people and expressions that training never saw, drawn by the mesh
renderer of this project.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from app.eval.settings import ReportSettings
from app.terminal.arguments import Count, File
from sensors import files
from sensors.types import InputError


@dataclass(frozen=True, kw_only=True)
class PriorSettings(ReportSettings):
    """Evaluate decoder and identity encoder on held-out people, expressions and views."""

    face: Path = Path("face")
    """Folder of the face data."""
    weights: File = None
    """Folder by `train prior --out`; default: the shipped weights and avatars."""
    take: File = None
    """A Live Link Face CSV: adds real expressions and a round trip of its weights."""
    people: Count = 8
    """Held-out people."""
    expressions: Count = 3
    """Expressions of each person, each from one view."""
    picture: File = None
    """PNG to write: truth, Gaussians and four times the difference."""


def evaluate(settings: PriorSettings) -> None:
    """Print every metric; exit with status 1 where a threshold is missed.

    Raises InputError where weights or face data are not what they should be."""
    from app.eval import prior_metrics
    from app.terminal.thresholds import finish
    from render.decoder.learned import avatar_files, weights_file
    from render.evaluation.judge import Judge
    from render.gl.contexts import create_context

    weights = settings.weights or weights_file.FOLDER
    if not avatar_files.names(weights):  # they come last
        raise InputError(
            f"--weights: expected avatars beside the prior in {weights}, got none; let "
            "livedrive train prior --out end"
        )
    context = create_context()
    judge = Judge(settings.face, context, weights)
    metrics, rows = prior_metrics.held_out(
        judge, settings.take, settings.people, settings.expressions, settings.seed
    )
    metrics |= prior_metrics.contact(judge, settings.seed)
    metrics |= prior_metrics.universality(judge, settings.seed)
    metrics |= prior_metrics.scan(judge)
    metrics |= prior_metrics.cost(judge)
    if settings.take:
        metrics["live_link_round_trip_mae"] = prior_metrics.round_trip(judge, settings.take)
    thresholds = [bar(name, metrics[name], limit) for name, limit in THRESHOLDS if name in metrics]
    if settings.picture:
        from PIL import Image

        with files.replacing(settings.picture) as draft:
            Image.fromarray(np.concatenate(rows[:6])).save(draft)
    for name, value in metrics.items():
        print(f"{name:40s} {value:.4f}")
    facts = {"seed": settings.seed, "people": settings.people}
    finish({"metrics": metrics, "bars": thresholds, **facts}, settings.report)


# A negative limit means "at least".
THRESHOLDS: tuple[tuple[str, float], ...] = (
    ("vertex_error_mean_mm", 0.5),
    ("vertex_error_lips_mm", 0.6),
    ("vertex_error_eyelids_mm", 0.6),
    ("face_psnr_db", -31.0),
    ("face_psnr_1024_db", -29.5),
    ("face_ssim", -0.93),
    ("face_sharpness", -0.85),
    ("face_sharpness_1024", -0.70),
    ("gaze_error_worst_deg", 1.0),
    ("drawn_pupil_worst_deg", 1.0),
    ("blink_gap_worst_mm", 0.5),
    ("lips_rest_gap_worst_mm", 0.5),
    ("lip_crossing_frames_percent", 0.5),
    ("universality_r_mean", -0.95),
    ("scan_seconds", 60.0),
    ("scan_vertex_error_mm", 1.0),
    ("scan_psnr_db", -28.0),
    ("decode_cpu_ms", 2.0),
    ("weights_mb", 16.0),
    ("live_link_round_trip_mae", 0.03),
)


def bar(name: str, value: float, limit: float) -> dict[str, Any]:
    from app.terminal.thresholds import at_least, at_most

    return at_least(name, value, -limit) if limit < 0 else at_most(name, value, limit)
