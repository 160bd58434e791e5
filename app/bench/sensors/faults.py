"""`livedrive bench faults`: each way in which a sensor can fail, many times at random moments.

Recovery is from the end of a fault to the first good data that was captured after it.
"""

import random
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from app.bench.sensors import fault_kinds as kinds
from app.bench.sensors.fault_watch import HANG_S, Fault
from app.terminal.thresholds import at_most


def measure_faults(times: int) -> dict[str, Any]:
    """Run all groups side by side; the report holds the table and the thresholds."""
    rows: list[Fault] = []
    crashes: list[BaseException] = []
    groups = (kinds.microphone, kinds.http, kinds.serial, kinds.usb, kinds.stopped)
    threads = [
        threading.Thread(target=_guarded, args=(group, times, seed, rows, crashes))
        for seed, group in enumerate(groups)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    table = {row.name: _summary(row) for row in rows}
    recovery = [s for row in rows for s in row.recovery_s]
    p95 = max(entry["recovery_p95_s"] for entry in table.values())
    thresholds = [
        at_most("crashes", len(crashes), 0),
        at_most("hangs", sum(row.hangs for row in rows), 0),
        at_most("recovery_p95_s_of_the_worst", p95, 2.0),
    ]
    show(table)
    metrics: dict[str, float | str] = {
        "faults": len(recovery),
        "crashes": len(crashes),
        "recovery_p95_s": p95,
    }
    if crashes:
        metrics["first_crash"] = repr(crashes[0])
    return {"metrics": metrics, "table": table, "bars": thresholds}


def show(table: dict[str, dict[str, float]]) -> None:
    from app.terminal.console import console, numbers

    out = numbers("fault", "times", "hangs", "p50 s", "p95 s", "worst s")
    for name, v in table.items():
        recovery = (f"{v[f'recovery_{k}_s']:.2f}" for k in ("p50", "p95", "max"))
        out.add_row(name, f"{v['times']:.0f}", f"{v['hangs']:.0f}", *recovery)
    console().print(out)


def _summary(row: Fault) -> dict[str, float]:
    values = row.recovery_s or [HANG_S]
    p50, p95, worst = (round(float(np.percentile(values, q)), 3) for q in (50, 95, 100))
    return {
        "times": len(row.recovery_s) + row.hangs,
        "hangs": row.hangs,
        "recovery_p50_s": p50,
        "recovery_p95_s": p95,
        "recovery_max_s": worst,
    }


def _guarded(
    group: Callable[[int, random.Random, list[Fault]], None],
    times: int,
    seed: int,
    rows: list[Fault],
    crashes: list[BaseException],
) -> None:
    try:
        group(times, random.Random(seed), rows)
    except BaseException as error:  # shown as a crash in the table's thresholds
        crashes.append(error)
