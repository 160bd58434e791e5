"""`livedrive capture statistics | calibrate DIR`: judge a data set and keep the metrics beside it.

The metrics go to statistics.json or calibration.json in DIR and onto the screen; a bar that fails
ends the command with status 1.
"""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.terminal import figures
from sensors import files
from sensors.types import InputError

if TYPE_CHECKING:
    from encoder.capture.dataset import Clip
    from encoder.capture.judging.statistics import Range, Tally

MAX_CLIPS = 1500  # about six hours
CHECKED_FRAMES = 200


def statistics(folder: Path, picture: Path | None, report: Path | None) -> None:
    """The page of published ranges, and how far styles are apart."""
    from app.face.geometry import gaps_on_vertices, lips, teeth
    from encoder.capture.judging import statistics as judge

    clips = _spread(folder, MAX_CLIPS)
    geometry, incisors = lips(), teeth()
    rows, tally = judge.page(clips, geometry.gap_mm, incisors.distance_mm)
    rigs = np.concatenate([clip.rig for clip in clips if clip.truth == "rules"]).astype(np.float32)
    rng = np.random.default_rng(0)
    sample = rigs[rng.choice(len(rigs), min(CHECKED_FRAMES, len(rigs)), replace=False)]
    off, shut = gaps_on_vertices(geometry, sample)
    rows.append(judge.Range("lip_gap_against_vertices_mm", off, 0, 0.05, "same vertices"))
    rows.append(judge.Range("shut_lips_on_vertices_mm", shut, 0, 0.3, "contact"))
    rows.append(judge.Range("style_ratio", judge.style_ratio(), 1.5, np.inf, "people differ"))
    if picture:
        _spectrum_picture(tally, picture)
    _finish(rows, folder / "statistics.json", report)


def calibrate(
    folder: Path, real: Path | None, seed: int, picture: Path | None, report: Path | None
) -> None:
    """Train the same small causal network on real and on made motion, and compare."""
    import torch

    from encoder.capture.judging import lookahead as judge
    from encoder.capture.judging.statistics import Range
    from encoder.capture.subjects import mocap

    if real is None or not (real / "grid_s1").is_dir():
        raise InputError(
            "calibrate: expected a folder of real motion with grid_s1, "
            f"got {real}; pass --mocap FOLDER"
        )
    torch.set_num_threads(1)
    tracked = [t.clip for t in mocap.grid_takes(real / "grid_s1", "s1", None, (0,))]
    made = [c for c in _spread(folder, 900) if c.kind in ("freeform", "sentence")]
    rng = np.random.default_rng(seed)
    held = rng.random(len(made)) < 0.1
    kept = [
        judge.source([c for c, out in zip(made, held, strict=True) if out == k]) for k in (0, 1)
    ]
    both = [judge.source([c for c in tracked if c.split == split]) for split in ("train", "test")]
    found = judge.compare((both[0], both[1]), (kept[0], kept[1]))
    lag = found["made_jaw_lag_frames"] - found["real_jaw_lag_frames"]
    rows = [
        Range("real_jaw_r2_kept_without_lookahead", found["real_jaw_r2_kept"], 0.9, 1.1, "0.98"),
        Range("made_jaw_r2_kept_without_lookahead", found["made_jaw_r2_kept"], 0.9, 1.1, "as real"),
        Range("jaw_lag_difference_frames", lag, -1, 1, "0"),
        Range("real_predicts_made_r", found["real_predicts_made_r"], 0.6, 1, "-"),
        Range("made_predicts_real_r", found["made_predicts_real_r"], 0.6, 1, "-"),
    ]
    _lookahead_picture(found, picture or folder / "calibration.png")
    _finish(rows, folder / "calibration.json", report, found)


def _spread(folder: Path, count: int) -> "list[Clip]":
    """Up to `count` rule-made English clips, evenly from all subjects."""
    from encoder.capture import dataset

    kept: list[Clip] = []
    shards = dataset.read_manifest(folder)["shards"]
    share = max(2, count // max(sum(s["file"].startswith("made") for s in shards), 1))
    for shard in shards:
        if shard["file"].startswith(("made", "aligned")):
            clips = [c for c in dataset.read_shard(folder / shard["file"]) if c.truth == "rules"]
            step = max(1, len(clips) // share)
            kept += clips[::step]
    if not kept:
        raise InputError(f"{folder}: expected rule-made subjects, found none; capture some")
    return kept


def _finish(
    rows: "list[Range]",
    kept: Path,
    report: Path | None,
    more: dict[str, float] | None = None,
) -> None:
    from rich.table import Column, Table

    from app.terminal.console import console

    table = Table(Column("metric", no_wrap=True), "value", "from", "to", "published", "")
    thresholds: list[dict[str, Any]] = []
    for row in rows:
        values = [f"{v:.3g}" for v in (row.value, row.low, row.high)]
        table.add_row(row.name, *values, row.published, "ok" if row.ok else "FAILS")
        thresholds.append({"name": row.name, "value": row.value, "bar": values[1:], "ok": row.ok})
    console().print(table)
    metrics = {row.name: row.value for row in rows} | (more or {})
    text = json.dumps({"metrics": metrics, "bars": thresholds}, indent=1)
    for path in (kept, report):
        if path:
            files.write_text(path, text)
    if not all(row.ok for row in rows):
        raise SystemExit(1)


def _spectrum_picture(tally: "Tally", path: Path) -> None:
    figure = figures.figure(11, 3.6)
    left, right = figure.subplots(1, 2)
    hz = np.linspace(0, 15, len(tally.spectrum))
    left.plot(hz, tally.spectrum / tally.spectrum.sum(), label="jaw")
    speed = tally.spectrum * hz**2
    left.plot(hz, speed / speed.sum(), label="its speed")
    left.axvspan(3, 6, alpha=0.15)
    left.set(xlabel="Hz", title="Jaw opening while speaking")
    left.legend()
    right.hist(tally.dwells_s, np.linspace(0, 3, 40).tolist())
    right.set(xlabel="s", title="Dwell of the gaze")
    figures.save(figure, path)


def _lookahead_picture(report: dict[str, float], path: Path) -> None:
    from encoder.capture.judging.lookahead import LOOKAHEADS_MS

    figure = figures.figure(5.5, 3.6)
    axis = figure.subplots()
    for name, label in (("real", "real (GRID s1, tracked)"), ("made", "rule-made subjects")):
        scores = [report[f"{name}_jaw_r2_{ms}ms"] for ms in LOOKAHEADS_MS]
        axis.plot(LOOKAHEADS_MS, scores, "o-", label=label)
    axis.set(xlabel="lookahead, ms", ylabel="R2 of the jaw", ylim=(0, 1), title="Anticipation")
    axis.legend()
    figures.save(figure, path)
