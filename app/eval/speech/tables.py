"""Tables and thresholds of `livedrive eval speech`; metrics are named kind/setting/row/metric."""

from typing import Any

Metrics = dict[str, float]
COLUMNS = (
    ("LVE", "lve_mm"), ("FDD", "fdd_mm"), ("lip sync", "lip_sync_mm"),
    ("lip vel", "lip_velocity_mm"), ("LVE best", "lve_best_mm"),
    ("sync best", "lip_sync_best_mm"), ("r", "opening_r"), ("jaw r", "jaw_r"),
    ("shift", "opening_shift_frames"),
    ("closures", "closure_recall"), ("energy dist", "energy_distance_mm"),
    ("power", "syllable_power_ratio"), ("blinks/min", "blinks_per_minute"),
)  # fmt: skip
GT, SYNTHESISED, LIVE = "recorded gaze", "synthesised gaze", "live"
OFFLINE = "offline"  # hears the whole clip at once


def show(tables: dict[str, dict[str, dict[str, Metrics]]]) -> None:
    """One table for each kind of clip and setting."""
    from rich.table import Table

    from app.terminal.console import console

    for kind, settings in tables.items():
        for setting, rows in settings.items():
            table = Table(title=f"{kind}, {setting}", title_justify="left")
            table.add_column("row")
            for title, _ in COLUMNS:
                table.add_column(title, justify="right")
            for row, metrics in rows.items():
                cells = [f"{metrics[c]:.3f}" if c in metrics else "-" for _, c in COLUMNS]
                table.add_row(row, *cells)
            console(width=150).print(table)


def make_thresholds(metrics: Metrics) -> list[dict[str, Any]]:
    """Thresholds of all metrics that were measured."""
    from app.terminal.thresholds import at_least, at_most

    thresholds = [
        at_most(name, metrics[name], 1.0) for name in metrics if name.endswith("_60s_movement_mm")
    ]
    if "lip_envelope_r_mean" in metrics:
        thresholds.append(at_least("lip_envelope_r_mean", metrics["lip_envelope_r_mean"], 0.35))

    def ratio(name: str, over: str, under: str, limit: float) -> None:
        if over in metrics and under in metrics:
            thresholds.append(at_most(name, metrics[over] / max(metrics[under], 1e-9), limit))

    for kind in ("freeform", "sentence"):
        for column in ("lip_sync", "lve"):
            for baseline in ("mean face", "energy to jaw"):
                under = f"{kind}/{GT}/{baseline}/{column}_mm"
                name = f"{kind} {column} over {baseline}"
                student = f"{kind}/{GT}/student/{column}"
                ratio(name, f"{student}_mm", under, 0.9)
                ratio(f"{name}, best", f"{student}_best_mm", under, 0.75)
        energy = "energy_distance_mm"
        ratio(
            f"{kind} energy distance over regression",
            f"{kind}/{GT}/student/{energy}", f"{kind}/{GT}/regression/{energy}", 0.6,
        )  # fmt: skip
        ratio(
            f"{kind} live lip sync over teacher",
            f"{kind}/{LIVE}/student/lip_sync_mm", f"{kind}/{GT}/teacher, 40 steps/lip_sync_mm", 1.1,
        )  # fmt: skip
        power, teacher = "syllable_power_ratio", f"{kind}/{GT}/teacher, 40 steps"
        if f"{teacher}/{power}" in metrics:
            gap = metrics[f"{kind}/{GT}/student/{power}"] / metrics[f"{teacher}/{power}"] - 1
            thresholds.append(
                at_most(f"{kind} 2-7 Hz power, student against teacher", abs(gap), 0.1)
            )
        for baseline in ("no outpainting", "non-causal encoder, no outpainting"):
            velocity = "lip_velocity_mm"
            ratio(
                f"{kind} lip velocity over {baseline}",
                f"{kind}/{LIVE}/student/{velocity}", f"{kind}/{LIVE}/{baseline}/{velocity}", 1.0,
            )  # fmt: skip
    kinds = sorted({name.split("/")[0] for name in metrics if "/" in name})
    for kind in kinds:
        row = f"{kind}/{GT}/student"
        seen = kind in ("grid-s1", "facegood")  # other clips of the speaker were trained on
        if not seen and not kind.startswith("grid"):
            continue
        limit = 0.85 if seen else 0.7
        thresholds.append(
            at_least(f"{kind} opening against jaw, r", metrics[f"{row}/jaw_r"], limit)
        )
        shift = abs(metrics[f"{row}/opening_shift_frames"])
        thresholds.append(at_most(f"{kind} opening shift, frames", shift, 1.0))
        if seen:
            fast = metrics[f"{row}/jaw_fast_r"]
            thresholds.append(at_least(f"{kind} opening against jaw above 0.5 Hz, r", fast, 0.75))
            ratio(
                f"{kind} lip sync over mean face",
                f"{row}/lip_sync_mm", f"{kind}/{GT}/mean face/lip_sync_mm", 0.75,
            )  # fmt: skip
    for kind in ("freeform", "sentence", "grid-s1", "grid-s30"):
        row = f"{kind}/{GT}/student"
        recall = "closure_recall"
        ratio(
            f"{kind} closure recall of 167 ms ahead over the student's",
            f"{kind}/{GT}/regression, 167 ms ahead/{recall}", f"{row}/{recall}", 1.25,
        )  # fmt: skip
        if f"{row}/closure_recall" in metrics:
            thresholds.append(
                at_least(f"{kind} closure recall", metrics[f"{row}/closure_recall"], 0.5)
            )
        if f"{row}/false_closures" in metrics:
            thresholds.append(
                at_most(f"{kind} false closures", metrics[f"{row}/false_closures"], 0.15)
            )
    ratio(
        "lip sync of minute 10 over 1", "tenth_minute_lip_sync_mm", "first_minute_lip_sync_mm", 1.05
    )
    return thresholds
