"""`livedrive eval prior`: the universal avatar against the reference renderer.

Truth is rule-made: virtual people and expressions that training never saw, drawn by our own mesh
renderer. Every bar of the issue is one line of the table.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(kw_only=True)
class EvalPrior:
    """Judge decoder and identity encoder on held-out people, expressions and views."""

    face: Path = Path("face")
    """Folder of the face data."""
    take: Path | None = None
    """A Live Link Face table: real expressions and the round trip of weights."""
    people: int = 8
    expressions: int = 3
    """Expressions of each person, one view each."""
    seed: int = 0
    picture: Path | None = None
    """Write the errors on the face as PNG: truth, Gaussians, four times the difference."""
    report: Path | None = None
    """Write the figures as JSON."""

    def run(self) -> None:
        from app import prior_figures
        from app.bars import finish
        from render.contexts import create_context
        from render.judge import Judge

        context = create_context()
        judge = Judge(self.face, context)
        metrics, rows = prior_figures.held_out(judge, self)
        metrics |= prior_figures.contact(judge, self.seed)
        metrics |= prior_figures.universality(judge, self.seed)
        metrics |= prior_figures.scan(judge)
        metrics |= prior_figures.cost(judge)
        if self.take:
            metrics["live_link_round_trip_mae"] = prior_figures.round_trip(judge, self.take)
        bars = [bar(name, metrics[name], limit) for name, limit in BARS if name in metrics]
        if self.picture:
            from PIL import Image

            Image.fromarray(np.concatenate(rows[:6])).save(self.picture)
        if self.report:
            report = {"metrics": metrics, "bars": bars, "seed": self.seed, "people": self.people}
            self.report.write_text(json.dumps(report, indent=2) + "\n")
        for name, value in metrics.items():
            print(f"{name:40s} {value:.4f}")
        finish(bars)


# A negative limit means "at least".
BARS: tuple[tuple[str, float], ...] = (
    ("vertex_error_mean_mm", 0.5),
    ("vertex_error_lips_mm", 0.6),
    ("vertex_error_eyelids_mm", 0.6),
    ("face_psnr_db", -31.0),
    ("face_ssim", -0.94),
    ("gaze_error_worst_deg", 1.0),
    ("blink_gap_worst_mm", 0.5),
    ("lips_rest_gap_worst_mm", 0.5),
    ("lip_crossing_frames_percent", 0.5),
    ("universality_r_mean", -0.95),
    ("scan_seconds", 60.0),
    ("scan_vertex_error_mm", 1.0),
    ("scan_psnr_db", -28.0),
    ("decode_cpu_ms", 5.0),
    ("decode_gpu_ms", 0.5),
    ("weights_mb", 16.0),
    ("live_link_round_trip_mae", 0.03),
)


def bar(name: str, value: float, limit: float) -> dict[str, Any]:
    from app.bars import at_least, at_most

    return at_least(name, value, -limit) if limit < 0 else at_most(name, value, limit)
