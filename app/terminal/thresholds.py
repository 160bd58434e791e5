"""Metrics against their thresholds, as `eval` and `bench` report and print them.

In a report `metrics` maps names to values, `bars` is the list of thresholds.
"""

import json
from collections.abc import Iterable, Mapping
from math import isfinite
from pathlib import Path
from typing import Any

from sensors import files


def at_least(name: str, value: float, limit: float) -> dict[str, Any]:
    return {"name": name, "value": round(value, 3), "bar": f">= {limit}", "ok": value >= limit}


def at_most(name: str, value: float, limit: float) -> dict[str, Any]:
    return {"name": name, "value": round(value, 3), "bar": f"<= {limit}", "ok": value <= limit}


def print_metrics(metrics: Mapping[str, float], missing: Iterable[str]) -> None:
    """The metrics that stand in no table (their names have no "/"), and the rows left out."""
    for name, value in metrics.items():
        if "/" not in name:
            print(f"{name:40s} {value:.3f}")
    for name in missing:
        print(f"not trained, row left out: {name}")


def write(report: dict[str, Any], path: Path | None) -> None:
    """Write the report to `path`, where there is one; what could not be measured as null."""
    if path:
        files.write_text(path, json.dumps(_measured(report), indent=2, allow_nan=False) + "\n")


def _measured(value: Any) -> Any:
    """The same, with None for numbers that JSON has not."""
    if isinstance(value, dict):
        return {key: _measured(part) for key, part in value.items()}  # pyright: ignore
    if isinstance(value, list | tuple):
        return [_measured(part) for part in value]  # pyright: ignore
    return None if isinstance(value, float) and not isfinite(value) else value


def finish(report: dict[str, Any], path: Path | None) -> None:
    """Write the report to `path`, where there is one, and print its thresholds as a table; exit
    with status 1 where one is missed."""
    from app.terminal.console import console, numbers

    write(report, path)
    table = numbers("metric", "value", "threshold", "")
    for row in report["bars"]:
        table.add_row(
            row["name"], f"{row['value']:.3f}", row["bar"], "ok" if row["ok"] else "FAILED"
        )
    if table.row_count:
        console().print(table)
    if not all(row["ok"] for row in report["bars"]):
        raise SystemExit(1)
