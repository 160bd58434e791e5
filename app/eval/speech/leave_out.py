"""`livedrive eval speech DATA --leave-one-out`: real talkers that the student was not trained on.

Each talker of the motion folder is driven live by the student in DATA/leave_out that was trained
without that talker (or without several), and compared with the tracked motion of the same clip. The
audio encoder is trained on none of them.
"""

# pyright: reportMissingTypeStubs=false

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sensors.types import InputError

if TYPE_CHECKING:
    from app.eval.speech.settings import SpeechSettings
    from encoder.capture.made import Take
    from encoder.driver import Driver
    from encoder.evaluation.judging import FaceMesh

RATE = 48_000
LONGEST_S = 30.0
BABBLE_DB = 10.0
TELEPHONE_HZ = 3400.0
Change = Callable[[np.ndarray], np.ndarray]  # [n] at 48 kHz
COLUMNS = (
    "r", "r_fast", "r_best", "shift_ms", "p95_ratio", "width_r", "width_ratio", "shut_initial",
    "shut_inside",
)  # fmt: skip


def evaluate(data: Path, settings: "SpeechSettings") -> None:
    """Print tables of talkers (clean, with babble, through a telephone band) and thresholds.

    Raises InputError where talkers or students are missing.
    """
    from app.face.mesh import face_mesh
    from app.terminal.thresholds import at_least, at_most, finish

    if settings.mocap is None or not settings.mocap.is_dir():
        raise InputError(
            f"--leave-one-out: expected a folder of tracked faces, got {settings.mocap}; "
            "give --mocap FOLDER"
        )
    mesh = face_mesh(settings.avatar)
    drivers = drivers_of(data, settings.weights)
    takes = {name: list(tracked_takes(settings.mocap, name)) for name in drivers}
    others = [take.audio for name in takes for take in takes[name][:2]]
    changes = {"": None, "babble_": babble(others, settings.seed), "telephone_": telephone()}
    metrics: dict[str, float] = {}
    for prefix, change in changes.items():
        rows = {n: figures_of(drivers[n], takes[n], mesh, change) for n in drivers}
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
    facts = {"seed": settings.seed, "avatar": settings.avatar}
    rounded = {name: round(value, 4) for name, value in metrics.items()}
    finish({"metrics": rounded, "bars": thresholds, **facts}, settings.report)


def show(rows: dict[str, dict[str, float]], prefix: str) -> None:
    from rich.table import Table

    from app.terminal.console import console

    table = Table(title=f"talkers left out {prefix.rstrip('_')}", title_justify="left")
    for title in ("talker", *COLUMNS):
        table.add_column(title.replace("_", " "))
    for name, row in rows.items():
        table.add_row(name, *(f"{row[c]:.3f}" if c in row else "-" for c in COLUMNS))
    console(width=150).print(table)


def babble(others: list[np.ndarray], seed: int) -> Change:
    """Adds four talkers at once, BABBLE_DB below the sound."""

    def change(sound: np.ndarray) -> np.ndarray:
        rng = np.random.default_rng([seed, len(sound)])
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


def drivers_of(data: Path, weights: Path | None) -> dict[str, "Driver"]:
    """Talker -> live driver whose student was trained without that talker, and with most others."""
    from encoder import inference
    from encoder.backends import create_backend
    from encoder.driver import Driver

    folders = [path.parent for path in (data / "leave_out").glob("*/student.json")]
    folders.sort(key=lambda folder: -folder.name.count("+"))
    found = {talker: folder for folder in folders for talker in folder.name.split("+")}
    if not found:
        raise InputError(
            f"--leave-one-out: expected students in {data / 'leave_out'}, found none; run "
            "livedrive train distill --leave-out grid-s2, and so on"
        )
    networks, _ = inference.load_networks(weights)
    result: dict[str, Driver] = {}
    for talker, folder in sorted(found.items()):
        config, student, card = inference.load_student(folder, "gaze")
        if card["audio_sha256"] != networks_sha256(weights):
            raise InputError(
                f"{folder}: expected a student of the audio encoder under evaluation, got one of "
                "another; train it again"
            )
        result[talker] = Driver(
            create_backend(replace(networks, config=config, denoiser=student)),
            config,
            mean=student["expression_mean"],
            std=student["expression_std"],
        )
    return result


def networks_sha256(weights: Path | None) -> str:
    from encoder import inference

    return json.loads(((weights or inference.WEIGHTS) / "audio.json").read_text())["sha256"]


def tracked_takes(folder: Path, talker: str) -> "Iterator[Take]":
    """Takes of a talker with tracked motion only, nothing completed by rules."""
    from encoder.capture.subjects import mocap

    if talker == "facegood":
        yield from mocap.facegood_takes(folder / "facegood", (0,))
        return
    speaker = talker.removeprefix("grid-")
    for part in sorted(path.parent for path in folder.glob("*/labels.npz")):
        if speaker in mocap.grid_speakers(part):
            yield from mocap.grid_takes(part, speaker, None, (0,), completed=False)


def figures_of(
    driver: "Driver", takes: "list[Take]", mesh: "FaceMesh", change: Change | None = None
) -> dict[str, float]:
    from app.eval.speech.live import drive
    from encoder.capture.speech.phones import unpack_phones
    from encoder.evaluation import talkers
    from render.decoder.decoder import Decoder

    decoder, judged = Decoder.load(), list[talkers.TalkerClip]()
    for take in takes:
        count = min(take.clip.num_frames, int(LONGEST_S * 30))
        sound = take.audio[: count * 1600]
        shown = drive(driver, sound if change is None else change(sound), 0)
        codes = decoder.encode(take.clip.rig[:count].astype(np.float32))
        phones = unpack_phones(take.clip.spans)
        judged.append(talkers.TalkerClip(mesh.lips(shown), mesh.lips(codes), phones))
    return talkers.figures(judged, mesh.marks)
