"""`livedrive eval head`: motion of the head, brows, blinks and breath over a session, compared with
published figures for people who talk.

Published: while talking, the head's angles have a standard deviation of 1.5 to 4 degrees, and it
moves nine tenths of the time (Hadar et al. 1983; Busso et al. 2007); nods at accents (Graf et al.
2002); 10 to 20 brow flashes a minute; 26 blinks a minute (Bentivoglio et al. 1997); 12 to 18
breaths a minute. The targets are ranges for one session, not a test of realism.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.eval.settings import EvalSettings
from app.terminal import figures
from app.terminal.arguments import File
from app.terminal.thresholds import at_least, at_most, finish
from sensors.types import FPS, InputError

PLOT_S = 10.0
FLASH, BLINK = 0.25, 0.5  # ARKit weight from which a rise counts
MOVING_DEG = 2.0  # degrees a second; slower counts as still
NOD_DEG, NOD_BACK_S = 1.2, 0.5


@dataclass(frozen=True, kw_only=True)
class HeadSettings(EvalSettings):
    """Measure motion of the head, brows, blinks and breath over a session."""

    session: Path = Path("recordings/demo")
    """Folder of the session."""
    plot: File = None
    """Write a plot of ten seconds, e.g. head.png."""


def evaluate(settings: HeadSettings) -> None:
    """Print the table; exit with status 1 where a threshold is missed."""
    frames = driven(settings)
    if settings.plot:
        draw(frames, settings.plot)
    metrics = measure(frames)
    thresholds = [
        at_least("head_deviation_deg", metrics["head_deviation_deg"], 1.5),
        at_most("head_deviation_deg", metrics["head_deviation_deg"], 4.0),
        at_least("brow_flashes_per_min", metrics["brow_flashes_per_min"], 8.0),
        at_most("brow_flashes_per_min", metrics["brow_flashes_per_min"], 22.0),
        at_least("breaths_per_min", metrics["breaths_per_min"], 12.0),
        at_most("breaths_per_min", metrics["breaths_per_min"], 18.0),
        at_most("head_speed_max_deg_s", metrics["head_speed_max_deg_s"], 120.0),
    ]
    for name, value in metrics.items():
        print(f"{name:40s} {value:.3f}")
    finish({"metrics": metrics, "bars": thresholds, "seed": settings.seed}, settings.report)


def driven(settings: HeadSettings) -> dict[str, NDArray[np.float64]]:
    """Angles [T, 3] deg, brows, blinks and breath [T] (0..1), driven as `livedrive replay` does."""
    from tempfile import TemporaryDirectory

    from app.compose.replay import replay
    from app.compose.settings import DriveSettings, FileSettings
    from sensors import rotation

    with TemporaryDirectory() as folder:
        motion = Path(folder) / "motion.npz"
        replay(
            settings.session,
            DriveSettings(
                avatar=settings.avatar, seed=settings.seed, files=FileSettings(motion=motion)
            ),
        )
        with np.load(motion) as kept:
            if len(kept["t_ns"]) < FPS:
                raise InputError(
                    f"eval head: expected 1 s or more, got {settings.session} with less"
                )
            names = kept["arkit_names"].tolist()
            shapes = kept["arkit"].astype(np.float64)
            quats, breath = kept["head_quat"].tolist(), kept["breath"].astype(np.float64)
    return {
        "angles": np.degrees([rotation.to_angles(tuple(q)) for q in quats]),
        "brows": shapes[:, names.index("browInnerUp")],
        "blinks": shapes[:, names.index("eyeBlinkLeft")],
        "breath": breath,
    }


def measure(frames: dict[str, NDArray[np.float64]]) -> dict[str, float]:
    """Metrics by name; names carry their units."""
    angles, minutes = frames["angles"], len(frames["breath"]) / FPS / 60
    speeds = np.linalg.norm(np.diff(angles, axis=0), axis=1) * FPS
    deviations = angles.std(0)
    breath = frames["breath"] - frames["breath"].mean()
    metrics = {
        "head_deviation_deg": float(np.linalg.norm(deviations)),
        **{f"{axis}_deviation_deg": float(v) for axis, v in zip(AXES, deviations, strict=True)},
        **{f"{axis}_range_deg": float(v) for axis, v in zip(AXES, np.ptp(angles, 0), strict=True)},
        "head_speed_mean_deg_s": float(speeds.mean()),
        "head_speed_p95_deg_s": float(np.percentile(speeds, 95)),
        "head_speed_max_deg_s": float(speeds.max()),
        "moving_share": float((speeds > MOVING_DEG).mean()),
        "nods_per_min": nods(angles[:, 0]) / minutes,
        "brow_flashes_per_min": rises(frames["brows"], FLASH) / minutes,
        "blinks_per_min": rises(frames["blinks"], BLINK) / minutes,
        "breaths_per_min": rises(breath, 0.0) / minutes,
    }
    return {name: round(value, 3) for name, value in metrics.items()}


AXES = ("pitch", "yaw", "roll")


def rises(values: NDArray[np.float64], over: float) -> int:
    """How often a curve [T] crosses a level upwards."""
    return int(((values[1:] > over) & (values[:-1] <= over)).sum())


def nods(pitch: NDArray[np.float64]) -> int:  # [T] deg, down
    """Number of peaks that rise NOD_DEG above the lowest angle within NOD_BACK_S on either side."""
    back = int(NOD_BACK_S * FPS)
    count, last = 0, -back
    for k in range(back, len(pitch) - back):
        window = pitch[k - back : k + back + 1]
        lows = window[:back].min(), window[back + 1 :].min()
        if pitch[k] == window.max() and pitch[k] - max(lows) > NOD_DEG and k - last > back // 2:
            count, last = count + 1, k
    return count


def draw(frames: dict[str, NDArray[np.float64]], path: Path) -> None:
    """Plot the first PLOT_S seconds."""
    figure = figures.figure(10, 6)
    upper, lower = figure.subplots(2, 1, sharex=True)
    count = int(PLOT_S * FPS)
    times = np.arange(min(count, len(frames["breath"]))) / FPS
    for axis, curve in zip(AXES, frames["angles"][:count].T, strict=True):
        upper.plot(times, curve, label=axis)
    for name in ("brows", "blinks", "breath"):
        lower.plot(times, frames[name][:count], label=name)
    upper.set(ylabel="degrees")
    lower.set(xlabel="seconds", ylabel="0..1")
    for part in (upper, lower):
        part.legend(loc="upper right")
    figures.save(figure, path)
