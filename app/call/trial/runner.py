"""Runs both ends of a call over each line and sets up the table of `call test`."""

import asyncio
import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from app.call.media.voice import PULL
from app.call.trial import judge
from app.call.trial.end import WARM_UP_S, EndSettings
from app.call.trial.material import Material
from app.call.trial.relay import Leg, LossyLine, open_line
from app.terminal.thresholds import at_most
from sensors.types import SAMPLE_RATE

PATIENCE_S = 60.0  # beyond the call itself, for a busy machine


@dataclass(frozen=True, kw_only=True)
class Limits:
    delay_ms: float
    concealed: float
    held: float
    lips_ms: float


BARS = {
    "clean": Limits(delay_ms=45, concealed=0, held=0, lips_ms=5),
    "20+-5 ms, 1 % loss": Limits(delay_ms=75, concealed=0.005, held=0.005, lips_ms=10),
    "40+-20 ms, 5 % loss": Limits(delay_ms=130, concealed=0.01, held=0.01, lips_ms=20),
    "10 % loss in bursts": Limits(delay_ms=160, concealed=0.12, held=0.10, lips_ms=20),
}
KBPS, CPU_SHARE, LIPS_MM = 160.0, 0.15, 0.05


def run_ends(
    line: LossyLine, material: Material, seconds: float, seed: int
) -> tuple[judge.Found, judge.Found, float]:
    """Both ends talk over `line` for so long; what each found, and kb/s of the busier."""
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / name for name in ("material.npz", "ann.npz", "ben.npz")]
        material.save(files[0])
        legs = asyncio.run(_run(line, files, seconds, seed, len(material.expression)))
        ann, ben = judge.load_found(files[1]), judge.load_found(files[2])
    kbps = max(leg.bytes for leg in legs) * 8 / (seconds + WARM_UP_S) / 1e3
    return ann, ben, kbps


def run_line(line: LossyLine, material: Material, seconds: float, seed: int) -> dict[str, float]:
    """What became of a call over `line`, the worse end of two."""
    ann, ben, kbps = run_ends(line, material, seconds, seed)
    rows = [_judge(*pair, material) for pair in ((ann, ben), (ben, ann))]
    return {name: max(row[name] for row in rows) for name in rows[0]} | {"kbps": kbps}


def metrics_of(
    line: LossyLine, found: dict[str, float]
) -> tuple[dict[str, float], list[dict[str, Any]]]:
    """The report's `metrics` and `bars` of one line."""
    bar = BARS[line.name]
    limits = {
        "delay_p50_ms": bar.delay_ms,
        "concealed": bar.concealed,
        "held": bar.held,
        "lips_ms": bar.lips_ms,
        "kbps": KBPS,
        "cpu_share": CPU_SHARE,
        "lips_error_mm": LIPS_MM,
    }
    metrics = {f"{line.name}: {name}": round(value, 4) for name, value in found.items()}
    bars = [at_most(f"{line.name}: {name}", found[name], limit) for name, limit in limits.items()]
    return metrics, bars


def note_of(line: LossyLine, found: dict[str, float]) -> str:
    """What is no merit or fault of the call, in a line."""
    return (
        f"{line.name}: the trial's own person and sound card took {found['trial_cpu_share']:.3f} "
        f"of a core; {found['starved_packets']:.0f} packets were late with a sound card that the "
        f"machine starved; lips were not judged in {found['seconds_not_judged']:.0f} seconds"
    )


def _judge(here: judge.Found, there: judge.Found, material: Material) -> dict[str, float]:
    delays = judge.delays_ms(here, there, material)
    lips = judge.lips_ms(here, there, material, delays)
    nothing = float("inf")  # heard or seen: no bar holds
    report, (concealed, starved) = here.report, judge.concealed_share(here, there)
    return {
        "delay_p50_ms": float(np.median(delays[:, 1])) if len(delays) else nothing,
        "delay_spread_ms": float(np.ptp(delays[:, 1])) if len(delays) else nothing,
        "concealed": concealed if report["partner"] else nothing,
        "starved_packets": starved,
        "held": report["held"] / report["due"] if report["due"] else nothing,
        "lips_ms": float(np.abs(lips).max()) if len(lips) else nothing,
        "lips_p50_ms": float(np.median(lips)) if len(lips) else nothing,
        "seconds_not_judged": len(here.heard) / SAMPLE_RATE - len(lips),
        "stalled_ms": len(report["stalls_ns"]) * PULL * 1e3 / SAMPLE_RATE,
        "cpu_share": report["cpu_share"],
        "trial_cpu_share": report["trial_cpu_share"],
        "lips_error_mm": judge.lips_error_mm(here, there, material),
    }


async def _run(
    line: LossyLine, files: Sequence[Path], seconds: float, seed: int, ticks: int
) -> tuple[Leg, Leg]:
    legs = await open_line(line, seed)
    material, ann, ben = map(str, files)
    first = EndSettings(name="Ann", out=ann, leg=legs[0].port, material=material, seconds=seconds)
    host = await _start(first)
    ends = [host]
    try:
        async with asyncio.timeout(seconds + WARM_UP_S + PATIENCE_S):
            invite = json.loads(await _line(host))["invite"]
            second = replace(
                first, name="Ben", out=ben, leg=legs[1].port, invite=invite, start=ticks // 3
            )
            ends.append(await _start(second))
            told = await asyncio.gather(*(end.communicate() for end in ends))
        for end, (_, errors) in zip(ends, told, strict=True):
            if end.returncode:
                raise OSError(f"call test: an end failed: {errors.decode()[-300:]}")
    finally:
        for end in ends:
            if end.returncode is None:
                end.kill()
        for leg in legs:
            leg.close()
    return legs


async def _start(settings: EndSettings) -> asyncio.subprocess.Process:
    command = [sys.executable, "-m", "app.call.trial.end", json.dumps(asdict(settings))]
    pipe = asyncio.subprocess.PIPE
    return await asyncio.create_subprocess_exec(*command, stdout=pipe, stderr=pipe)


async def _line(end: asyncio.subprocess.Process) -> bytes:
    assert end.stdout is not None
    line = await end.stdout.readline()
    if not line:
        assert end.stderr is not None
        errors = (await end.stderr.read()).decode()
        raise OSError(f"call test: an end failed to start: {errors[-300:]}")
    return line
