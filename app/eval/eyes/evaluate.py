"""`livedrive eval eyes`: eye encoder, gaze walk and the head they drive, on held-out eyes.

Clips are rendered here, with wearers and headsets that training never saw, rule-made motion and a
voice. Real videos, where a folder is given, go through the whole Driver.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.eval.settings import EvalSettings
from app.terminal.arguments import File
from sensors.types import InputError

if TYPE_CHECKING:
    from app.eval.eyes.clips import EyeClip
    from app.eval.eyes.metrics import Metrics
    from encoder.eyes.encoder import EyeEncoder

WALK_MINUTES = 60.0


@dataclass(frozen=True, kw_only=True)
class EyesSettings(EvalSettings):
    """Evaluate gaze, lids, blinks, lost cameras and the upper face."""

    clips: int = 24
    """Rendered clips, each with its own wearer (with few clips one odd eye moves the medians);
    0: real videos only."""
    seconds: float = 3.0
    """Length of a rendered clip."""
    real: File = None
    """Folder of real near-eye videos with a labels.json or the file names of the shipped one."""
    sheet: File = None
    """Folder for sheets of eye pictures with predicted gaze and lid."""
    weights: File = None
    """Folder with weights; default: the shipped ones."""


def evaluate(settings: EyesSettings) -> None:
    """Print every metric; exit with status 1 where a threshold is missed."""
    if settings.clips < (0 if settings.real else 1) or not 1 <= settings.seconds < inf:
        raise InputError(
            "eval eyes: expected clips of 1 s or more, or --real FOLDER, got "
            f"--clips {settings.clips} --seconds {settings.seconds:g}"
        )
    from app.terminal.thresholds import finish
    from encoder.eyes.encoder import load_eye_encoder
    from encoder.inference import WEIGHTS

    encoder = load_eye_encoder(settings.weights or WEIGHTS)
    clips = rendered(settings.clips, settings.seconds) if settings.clips else []
    metrics: dict[str, float] = {}
    if clips:
        metrics |= walk_metrics(settings.seed) | _on_clips(encoder, clips, settings)
    if settings.real:
        metrics |= _on_real(settings.real, settings)
    if settings.sheet and clips:
        _draw_sheets(encoder, clips, settings.sheet)
    thresholds = make_thresholds(metrics)
    for name, value in metrics.items():
        print(f"{name:40s} {value:.3f}")
    facts = {"seed": settings.seed, "avatar": settings.avatar}
    facts["test_set"] = f"{settings.clips} rendered clips of {settings.seconds} s"
    finish({"metrics": metrics, "bars": thresholds, **facts}, settings.report)


def _on_clips(
    encoder: "EyeEncoder", clips: "Sequence[EyeClip]", settings: EyesSettings
) -> "Metrics":
    from app.eval.eyes import metrics as eye_metrics
    from app.face.mesh import face_mesh
    from encoder.inference import load_driver
    from render.decoder.decoder import Decoder

    metrics = eye_metrics.encoder_metrics(encoder, clips)
    metrics |= eye_metrics.fault_metrics(encoder, clips, settings.seed)
    metrics["eyes_cpu_ms"] = cpu_ms(encoder, clips)
    eyes, audio = (load_driver(settings.weights, "cpu", condition=c) for c in ("eyes", "gaze"))
    mesh, decoder = face_mesh(settings.avatar), Decoder.load()
    metrics |= eye_metrics.head_metrics(eyes, audio, clips, mesh, decoder.encode, settings.seed)
    metrics |= eye_metrics.loss_metrics(eyes, clips, mesh, settings.seed)
    upper = metrics["upper_face_mm_eyes"]
    metrics["upper_face_gain_over_synthesised"] = 1 - upper / metrics["upper_face_mm_synthesised"]
    metrics["upper_face_gain_over_true_gaze"] = 1 - upper / metrics["upper_face_mm_true_gaze"]
    metrics["lve_over_audio_model"] = metrics["lve_mm_eyes"] / metrics["lve_mm_synthesised"]
    return metrics


def _on_real(folder: Path, settings: EyesSettings) -> "Metrics":
    from app.eval.eyes.labels import load_labels
    from app.eval.eyes.real import real_metrics, show
    from app.eval.eyes.sheets import clip_sheet
    from app.face.mesh import face_mesh
    from encoder.inference import load_driver

    labels, mesh = load_labels(folder), face_mesh(settings.avatar)
    driver = load_driver(settings.weights, "cpu", condition="eyes")
    clips = [show(label, driver, mesh.blink, settings.seed) for label in labels]
    if settings.sheet:
        for clip in clips:
            clip_sheet(clip, settings.sheet / f"real_{clip.label.name}.png")
    return real_metrics(clips)


def _draw_sheets(encoder: "EyeEncoder", clips: "Sequence[EyeClip]", folder: Path) -> None:
    from app.eval.eyes.sheets import sheet
    from encoder.eyes.conjugate import joined

    pictures, rows = list[Any](), list[Any]()
    for clip in clips:
        for t in np.linspace(0, len(clip.eyes) - 1, 6).astype(int):
            reading = encoder(clip.eyes[t])
            gaze = joined(reading.told(), reading.lids, reading.score)
            for eye in (0, 1):
                pictures.append(clip.eyes[t, eye])
                score = float(reading.score[eye])
                rows.append((gaze[eye], float(reading.lids[eye]), score))
    sheet(pictures, rows, folder / "rendered.png", columns=12)


def rendered(count: int, seconds: float) -> "list[EyeClip]":
    from tqdm import tqdm

    from app.eval.eyes.clips import make_clip
    from render.decoder.decoder import Decoder
    from render.near_eye.camera import NearEye

    camera = NearEye(Decoder.load())
    try:
        numbers = tqdm(range(count), desc="rendering eyes", unit="clip", disable=None)
        return [make_clip(camera, number, seconds) for number in numbers]
    finally:
        camera.close()


def walk_metrics(seed: int) -> "Metrics":
    """Statistics of the gaze walk relative to those of its source; time and smoothness of its
    steps."""
    import time

    from encoder.eyes.gaze_graph import STRIDE, GazeGraph
    from encoder.eyes.gaze_statistics import compare, gaze_statistics, step_deg
    from encoder.eyes.gaze_walk import GazeWalk

    graph = GazeGraph.load()
    source = graph.gaze[:, :STRIDE].reshape(-1, 2, 3)  # nodes follow each other as in the source
    walk = GazeWalk(graph, seed)
    state, rows, times = walk.init_state(), list[Any](), list[int]()
    for _ in range(int(WALK_MINUTES * 1800)):
        begin = time.process_time_ns()
        gaze, _, state = walk.step(state)
        times.append(time.process_time_ns() - begin)
        rows.append(gaze)
    gaze = np.stack(rows)
    gaps = compare(gaze_statistics(gaze), gaze_statistics(source))
    result = {f"walk_{name}_off": gap for name, gap in gaps.items()}
    result["walk_worst_off"] = max(abs(gap) for gap in gaps.values())
    result["walk_step_cpu_ms_p999"] = float(np.percentile(times, 99.9)) / 1e6
    result["walk_jump_over_source"] = float(step_deg(gaze).max() / step_deg(source).max())
    return result


def cpu_ms(encoder: "EyeEncoder", clips: "Sequence[EyeClip]") -> float:
    """Mean CPU time of a pair of pictures, ms, one after another without a pause."""
    import time

    from encoder.eyes.encoder import new_encoder_state

    pairs = [pair for clip in clips for pair in clip.eyes[:50]]
    _, state = encoder.step(pairs[0], new_encoder_state())
    begin = time.process_time_ns()
    for pair in pairs:
        _, state = encoder.step(pair, state)
    return (time.process_time_ns() - begin) / len(pairs) / 1e6


def make_thresholds(metrics: "Metrics") -> list[dict[str, Any]]:
    """Thresholds of all metrics that were measured; those of real videos only where given."""
    from app.terminal.thresholds import at_least, at_most

    highest = {
        "gaze_error_deg_median": 1.7, "gaze_error_calibrated_deg_median": 0.8,
        "lid_error_mean": 0.05, "blink_delay_frames_median": 0.0, "eyes_cpu_ms": 1.5,
        "lve_over_audio_model": 1.0, "loss_gaze_jump_over_normal": 1.0,
        "loss_face_jump_over_normal": 1.0, "recovery_ms_worst": 300.0, "walk_worst_off": 0.1,
        "walk_step_cpu_ms_p999": 2.0, "walk_jump_over_source": 1.01,
        "real_blinks_missed": 0.0, "real_blinks_false_per_minute": 1.0,
        "real_onset_delay_frames_worst": 2.0, "real_jitter_deg_worst": 0.5,
    }  # fmt: skip
    lowest = {
        "blink_f1": 0.97, "flag_falls_black": 1.0, "flag_falls_saturated": 1.0,
        "flag_falls_noise": 1.0, "flag_falls_covered": 1.0, "flag_falls_swapped": 0.9,
        "upper_face_gain_over_synthesised": 0.4, "upper_face_gain_over_true_gaze": 0.2,
        "avatar_closes_on_time_speech": 1.0, "avatar_closes_on_time_silence": 1.0,
        "avatar_blinks_on_time_speech": 1.0, "avatar_blinks_on_time_silence": 1.0,
        "real_accepted_share_worst": 0.95, "real_gaze_r_x_worst": 0.9, "real_gaze_r_y_worst": 0.75,
    }  # fmt: skip
    thresholds = [
        at_most(name, metrics[name], bar) for name, bar in highest.items() if name in metrics
    ]
    return thresholds + [
        at_least(name, metrics[name], bar) for name, bar in lowest.items() if name in metrics
    ]
