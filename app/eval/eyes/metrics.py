"""Metrics of `livedrive eval eyes` on rendered clips: encoder, calibration and driven head."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sensors.types import SensorFrame

if TYPE_CHECKING:
    from app.eval.eyes.clips import EyeClip
    from encoder.driver import Driver
    from encoder.evaluation.judging import FaceMesh
    from encoder.eyes.calibration import EyeCalibration
    from encoder.eyes.encoder import EncoderState, EyeEncoder, EyeReading

Metrics = dict[str, float]
Floats = NDArray[np.float32]
OPEN_ENOUGH = 0.25  # lid opening from which gaze is visible and counts


def calibrated(encoder: "EyeEncoder", clip: "EyeClip") -> "EyeCalibration":
    """Calibration of a clip's wearer, fitted to the pictures of the routine."""
    from encoder.eyes.encoder import new_encoder_state
    from encoder.eyes.routine import SETTLE, TargetSamples, fit

    takes: list[TargetSamples] = []
    state = new_encoder_state()
    for target, pictures in clip.routine:
        rows, state = read(encoder, pictures, state)
        gaze = np.stack([r.told() for r in rows])
        relative, lids = (
            np.stack([getattr(r, name) for r in rows]) for name in ("relative", "lids")
        )
        unseen = np.zeros((SETTLE, 2), np.bool_)  # frames in which the eyes still move
        good = np.concatenate([unseen, np.stack([r.score for r in rows]) > 0.5])
        before = np.repeat(gaze[:1], SETTLE, 0)
        gaze, relative = (np.concatenate([before, rows]) for rows in (gaze, relative))
        lids = np.concatenate([unseen.astype(np.float32), lids])
        takes.append(TargetSamples(target, gaze, relative, lids, good))
    return fit(takes)[0]


def read(
    encoder: "EyeEncoder", pairs: NDArray[np.uint8], state: "EncoderState"
) -> "tuple[list[EyeReading], EncoderState]":
    """Run the encoder over pairs of pictures [T, 2, 400, 400]; returns readings and last state."""
    rows: list[EyeReading] = []
    for pair in pairs:
        reading, state = encoder.step(pair, state)
        rows.append(reading)
    return rows, state


def encoder_metrics(encoder: "EyeEncoder", clips: "Sequence[EyeClip]") -> Metrics:
    """Gaze, lids, blinks and validity on clips of held-out wearers."""
    from encoder.evaluation.eye_metrics import NO_BLINKS, angle_deg, compare_blinks, shut_frames
    from encoder.eyes.conjugate import joined
    from encoder.eyes.encoder import new_encoder_state

    plain, own = list[NDArray[np.float64]](), list[NDArray[np.float64]]()
    lid_errors, valid = list[Floats](), list[NDArray[np.bool_]]()
    blinks = NO_BLINKS
    for clip in clips:
        rows, _ = read(encoder, clip.eyes, new_encoder_state())
        lids, calibration = np.stack([r.lids for r in rows]), calibrated(encoder, clip)
        gaze = np.stack([joined(r.told(), r.lids, r.score) for r in rows])
        moved = np.stack(
            [
                joined(calibration.apply(r.told(), r.relative, r.lids)[0], r.lids, r.score)
                for r in rows
            ]
        )
        seen = clip.lids > OPEN_ENOUGH
        plain.append(angle_deg(gaze, clip.gaze)[seen])
        own.append(angle_deg(moved, clip.gaze)[seen])
        lid_errors.append(np.abs(lids - np.clip(clip.lids, 0, 1)).ravel())
        valid.append(np.stack([r.score for r in rows]).ravel() > 0.5)
        for eye in (0, 1):
            blinks += compare_blinks(shut_frames(lids[:, eye]), shut_frames(clip.lids[:, eye]))
    return {
        "gaze_error_deg_median": float(np.median(np.concatenate(plain))),
        "gaze_error_deg_p95": float(np.percentile(np.concatenate(plain), 95)),
        "gaze_error_calibrated_deg_median": float(np.median(np.concatenate(own))),
        "lid_error_mean": float(np.concatenate(lid_errors).mean()),
        "blinks": blinks.hits + blinks.missed,
        "blink_precision": blinks.precision,
        "blink_recall": blinks.recall,
        "blink_f1": blinks.f1,
        "blink_delay_frames_median": float(np.median(blinks.latencies or [0])),
        "blink_delay_frames_worst": float(np.max(blinks.latencies or [0])),
        "valid_share": float(np.concatenate(valid).mean()),
    }


def fault_metrics(encoder: "EyeEncoder", clips: "Sequence[EyeClip]", seed: int) -> Metrics:
    """Share of broken pictures whose valid flag falls; 0 where an output is not finite."""
    rng = np.random.default_rng(seed)
    rows = np.concatenate([clip.eyes[::15] for clip in clips])
    shape: tuple[int, ...] = rows[0].shape
    faults: dict[str, Callable[[NDArray[np.uint8]], NDArray[Any]]] = {
        "black": lambda eyes: np.zeros(shape),
        "saturated": lambda eyes: np.full(shape, 255),
        "noise": lambda eyes: rng.integers(0, 256, shape),
        "covered": lambda eyes: 6 + rng.normal(0, 2, shape).clip(-6, 6),
        "swapped": lambda eyes: eyes[::-1],
    }
    result: Metrics = {}
    for name, spoil in faults.items():
        readings: list[EyeReading] = [encoder(spoil(eyes).astype(np.uint8)) for eyes in rows]
        finite = all(np.isfinite(array).all() for reading in readings for array in reading)
        # swapped pictures do show eyes: what falls is the score of their side
        flag = "side" if name == "swapped" else "score"
        fallen = np.stack([getattr(reading, flag) for reading in readings]) < 0.5
        result[f"flag_falls_{name}"] = float(fallen.mean()) if finite else 0.0
    return result


def head_metrics(
    eyes: "Driver",
    audio: "Driver",
    clips: "Sequence[EyeClip]",
    mesh: "FaceMesh",
    encode: Callable[[Floats], Floats],  # rig [T, 53] -> codes [T, 256]
    seed: int,
) -> Metrics:
    """Upper face, lips and blinks of the head driven by synthesised gaze, by the true gaze, and by
    eye features."""
    from encoder.evaluation import metrics
    from encoder.evaluation.eye_metrics import (
        NO_BLINKS,
        closing_frames,
        compare_blinks,
        shut_frames,
    )
    from encoder.offline import drive_clip

    rows: dict[str, list[list[float]]] = {}
    blinks, closings = ({"speech": NO_BLINKS, "silence": NO_BLINKS} for _ in range(2))
    for clip in clips:
        codes = encode(clip.rig)
        real_upper, real_lips = mesh.upper_face(codes), mesh.lips(codes)
        driven = {
            "synthesised": drive_clip(audio, clip.frames(), seed)[0],
            "true_gaze": told(audio, clip, seed),
            "eyes": drive_clip(eyes, clip.frames(), seed)[0],
        }
        for name, made in driven.items():
            upper = mesh.upper_face(made)
            error = float(np.linalg.norm(upper - real_upper, axis=-1).mean())
            deviation = metrics.upper_face_deviation_mm(upper, real_upper)
            lve = metrics.lip_vertex_error_mm(mesh.lips(made), real_lips)
            rows.setdefault(name, []).append([error, deviation, lve])
        lids = clip.lids.mean(1)
        silent = drive_clip(eyes, clip.frames(silent=True), seed)[0]
        for name, made in (("speech", driven["eyes"]), ("silence", silent)):
            shut = shut_frames(1 - mesh.blink(made))
            blinks[name] += compare_blinks(shut, shut_frames(lids))
            closings[name] += compare_blinks(shut, closing_frames(lids))
    result: Metrics = {}
    for name, values in rows.items():
        means = np.mean(values, 0)
        for figure, value in zip(("upper_face_mm", "fdd_mm", "lve_mm"), means, strict=True):
            result[f"{figure}_{name}"] = float(value)
    result["avatar_closings"] = closings["speech"].hits + closings["speech"].missed
    for name, found in blinks.items():
        result[f"avatar_closes_on_time_{name}"] = closings[name].on_time
        result[f"avatar_blinks_on_time_{name}"] = found.on_time  # half blinks included
        result[f"avatar_blink_f1_{name}"] = found.f1
    return result


def told(driver: "Driver", clip: "EyeClip", seed: int) -> Floats:
    """Codes [T, 256] of the audio model given the true gaze."""
    from encoder.driver import frame_noise

    state, codes = driver.backend.init_state(), list[Floats]()
    for t, audio in enumerate(clip.audio):
        features, state = driver.backend.audio(audio, state)
        noise = frame_noise(seed, t, driver.config.expression_dim)
        code, state = driver.backend.denoise(noise, features, clip.gaze[t].reshape(-1), state)
        codes.append(code * driver.std + driver.mean)
    return np.stack(codes)


def loss_metrics(
    driver: "Driver",
    clips: "Sequence[EyeClip]",
    mesh: "FaceMesh",
    seed: int,
    tried: int = 6,  # clips in which cameras are lost; normal movement is taken from all clips
    every: int = 13,
) -> Metrics:
    """Lose one camera or both, at many frames: largest jump relative to normal movement, time to
    recover."""
    from encoder.eyes.conjugate import OPEN
    from encoder.eyes.gaze_graph import STRIDE
    from encoder.eyes.gaze_statistics import step_deg
    from encoder.offline import drive_clip

    jumps, faces, recovery = list[float](), list[float](), list[int]()
    source = driver.graph.gaze[:, :STRIDE].reshape(-1, 2, 3)
    whole = [drive_clip(driver, clip.frames(), seed) for clip in clips]
    # a clip of seconds may hold no large saccade, so the walk's source counts as normal, too
    looks = [source, *(gaze for _, gaze in whole), *(clip.gaze for clip in clips)]
    normal_turn = max(step_deg(gaze).max() for gaze in looks)
    normal_move = max(moves(mesh, codes).max() for codes, _ in whole)
    for clip, (_, gaze) in zip(clips[:tried], whole, strict=False):
        frames = clip.frames()
        for number, start in enumerate(range(10, len(frames) - 40, every)):
            lost = ((0,), (1,), (0, 1))[number % 3]
            stop = start + 25
            broken = [blinded(f, lost) if start <= f.index < stop else f for f in frames]
            cut = slice(0, stop + 15)
            hurt, hurt_gaze = drive_clip(driver, broken[cut], seed)
            jumps.append(step_deg(hurt_gaze).max())
            faces.append(moves(mesh, hurt).max())
            same = np.abs(hurt_gaze - gaze[cut])[stop:].max((1, 2)) < 1e-3
            # while an eye is shut there is no gaze to recover
            same = same[clip.lids[cut][stop:].min(1) > OPEN]
            recovery.append(int(np.argmax(same)) if same.any() else len(same))
            assert np.isfinite(hurt).all()
    return {
        "loss_gaze_jump_over_normal": float(np.max(jumps) / normal_turn),
        "loss_face_jump_over_normal": float(np.max(faces) / normal_move),
        "recovery_ms_worst": float(np.max(recovery) * 1000 / 30),
        "losses_tried": len(jumps),
    }


def moves(mesh: "FaceMesh", codes: Floats) -> NDArray[np.float64]:
    """Largest movement of any upper-face vertex between frames [T - 1], mm."""
    return np.linalg.norm(np.diff(mesh.upper_face(codes), axis=0), axis=-1).max(-1)


def blinded(frame: SensorFrame, eyes: tuple[int, ...]) -> SensorFrame:
    valid = frame.eyes_valid.copy()
    valid[list(eyes)] = False
    return replace(frame, eyes_valid=valid)
