"""The metrics of `livedrive eval prior`: people, contact, universality, a scan, the cost."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from render.evaluation.judge import Judge, Subject
    from render.types import Density

VIEW_YAW_DEG, VIEW_PITCH_DEG = 30.0, 15.0
NUM_CODES, NUM_AVATARS = 200, 8
NUM_GAZES = 5  # of each person
# Endings of the names of metrics, and what is drawn for them: at 512 pixels, at 1024.
THINNER: tuple[tuple[str, "Density"], ...] = (("_32k", "32k"), ("_16k", "16k"))
LARGE: tuple[tuple[str, "Density"], ...] = (("_1024", "65k"), ("_1024_32k", "32k"))
TIMED_FRAMES = 60


def held_out(
    judge: "Judge",
    table: Path | None,  # real expressions
    num_people: int,
    num_expressions: int,  # of each
    seed: int,
) -> tuple[dict[str, float], list[Any]]:
    """Errors of vertices and pictures over people, expressions and views that training never saw.

    Returns metrics by name, and for each picture truth, Gaussians and four times the difference
    [512, 1536, 3] uint8.
    """
    from tqdm import tqdm

    from render import cameras
    from render.evaluation import metrics as prior_metrics
    from render.training.data import expressions, people

    face, used = judge.assembly.face, judge.decoder.surface.used
    take = expressions.real_take(table, face.rig_names, held_out=True)
    found: dict[str, list[float]] = {}
    rows: list[Any] = []
    for index in tqdm(range(num_people), desc="people", disable=None):
        number = people.HELD_OUT + index
        person = people.draw(face, number)
        skin, eye = judge.wardrobe.texture(person), judge.wardrobe.eye(person.eye)
        who = judge.subject(people.neutral(face, person), skin, eye)
        rng = np.random.default_rng((seed, number))
        for _ in range(num_expressions):
            rig, gaze = expressions.draw(rng, judge.assembly.names, take)
            rig[: len(person.gains)] *= person.gains
            truth = judge.true_vertices(who, rig, gaze)
            light = judge.true_light(truth)
            yaw = float(rng.uniform(-VIEW_YAW_DEG, VIEW_YAW_DEG))
            pitch = float(rng.uniform(-VIEW_PITCH_DEG, VIEW_PITCH_DEG))
            camera, large = (cameras.portrait(px, px, yaw, pitch) for px in (512, 1024))
            reference = judge.true_picture(who, rig, truth, light, camera)
            mask = judge.face_mask(who, truth, camera)
            code = judge.encode(who, truth, light)
            vertices, picture = judge.picture(who, code, gaze, camera)
            _, matte = judge.picture(who, code, gaze, camera, matte=True)
            small_face = reference, mask
            large_mask = judge.face_mask(who, truth, large)
            large_face = judge.true_picture(who, rig, truth, light, large), large_mask
            error = prior_metrics.distances(vertices, truth)
            values = {
                "vertex_error_mean_mm": error[used].mean(),
                "vertex_error_lips_mm": error[face.regions["lips"]].mean(),
                "vertex_error_eyelids_mm": error[face.regions["eyelids"]].mean(),
                "face_psnr_without_lobe_db": prior_metrics.psnr_db(matte, *small_face),
            }
            thinner = {of: judge.picture(who, code, gaze, camera, d)[1] for of, d in THINNER}
            for of, shown in {"": picture, **thinner}.items():
                values[f"face_psnr{of}_db"] = prior_metrics.psnr_db(shown, *small_face)
                values[f"face_ssim{of}"] = prior_metrics.ssim(shown, *small_face)
                values[f"face_sharpness{of}"] = prior_metrics.sharpness(shown, *small_face)
            for of, density in LARGE:
                shown = judge.picture(who, code, gaze, large, density)[1]
                values[f"face_psnr{of}_db"] = prior_metrics.psnr_db(shown, *large_face)
                values[f"face_sharpness{of}"] = prior_metrics.sharpness(shown, *large_face)
            for name, value in values.items():
                found.setdefault(name, []).append(float(value))
            difference = 4 * np.abs(picture.astype(int) - reference) * mask[..., None]
            rows.append(
                np.concatenate([reference, picture, difference.clip(0, 255).astype("u1")], 1)
            )
        for _ in range(NUM_GAZES):
            yaw, pitch = rng.uniform(-20, 20), rng.uniform(-12, 12)
            found.setdefault("gaze_error", []).append(judge.gaze_error_deg(who, yaw, pitch))
    metrics = {name: float(np.mean(values)) for name, values in found.items() if "_error_" in name}
    metrics |= {name: float(np.mean(found[name])) for name in found if name.startswith("face_")}
    metrics["face_psnr_worst_db"] = min(found["face_psnr_db"])
    metrics["face_ssim_worst"] = min(found["face_ssim"])
    metrics["gaze_error_worst_deg"] = max(found["gaze_error"])
    metrics["pictures"] = len(rows)
    return metrics, rows


def contact(judge: "Judge", seed: int) -> dict[str, float]:
    """Gaps of shut lids and lips, and how often lips cross, on held-out people."""
    from render.evaluation.metrics import LipCrossing
    from render.training.data import expressions, people
    from render.types import AHEAD

    face, decoder, names = judge.assembly.face, judge.decoder, judge.assembly.names
    still = expressions.real_take(None, face.rig_names, held_out=True)
    through_code = decoder.coding.to_code @ decoder.coding.to_rig
    lid_gaps, lip_gaps, crossed, frames = list[float](), list[float](), 0, 0
    for index in range(24):
        person = people.draw(face, people.HELD_OUT + 500 + index)
        rest = decoder.posing.rest(people.neutral(face, person))
        blink = np.zeros(len(names), np.float32)
        blink[list(decoder.posing.blinks)] = 1
        shut = decoder.posing.pose((blink @ through_code).astype(np.float32), AHEAD, rest)
        lid_gaps.append(max(float(line.gaps(shut).max()) for line in decoder.posing.lid_lines))
        lip_gaps.append(float(decoder.posing.mouth.gaps(rest.geometry).max()))
        upper, lower = face.regions["lips_upper"], face.regions["lips_lower"]
        crossing = LipCrossing(rest.geometry, upper, lower)
        rng = np.random.default_rng((seed, index))
        for _ in range(50):
            rig, gaze = expressions.draw(rng, names, still)
            posed = decoder.posing.pose((rig @ through_code).astype(np.float32), gaze, rest)
            crossed += crossing.depth_mm(posed) > 0.3
            frames += 1
    return {
        "blink_gap_worst_mm": max(lid_gaps),
        "lips_rest_gap_worst_mm": max(lip_gaps),
        "lip_crossing_frames_percent": 100.0 * crossed / frames,
    }


def universality(judge: "Judge", seed: int) -> dict[str, float]:
    """Whether the same codes give the same expression on several avatars."""
    from render import arkit
    from render.decoder import identity
    from render.decoder.learned import avatar_files
    from render.evaluation import metrics as prior_metrics
    from render.evaluation import pupils
    from render.training.data import expressions
    from render.types import AHEAD

    decoder = judge.decoder
    rng = np.random.default_rng((seed, 5))
    still = np.zeros((1, len(decoder.rig_names)), np.float32)
    drawn = [expressions.draw(rng, judge.assembly.names, still)[0] for _ in range(NUM_CODES)]
    codes = [rig @ decoder.coding.to_code for rig in drawn]
    rows, basis = judge.rig_basis
    weights: list[NDArray[np.float32]] = []
    names = avatar_files.names(judge.weights)
    for name in names[:NUM_AVATARS]:
        who = identity.load(name, judge.weights)
        moved = [decoder.vertices(code, AHEAD, who)[rows] - who.geometry[rows] for code in codes]
        rig = prior_metrics.recovered_rig(np.array(moved, np.float32), basis)
        weights.append(arkit.from_rig(rig[:, : len(decoder.rig_names)], decoder.rig_names))
    people = [identity.load(name, judge.weights) for name in names]
    off = [pupils.error_deg(decoder, judge.splats, who) for who in people]
    return {
        "drawn_pupil_worst_deg": max(off),
        "universality_r_mean": prior_metrics.agreement(np.array(weights)),
        "universality_avatars": len(weights),
    }


def scan(judge: "Judge") -> dict[str, float]:
    """An avatar of the LPS scan, which training never saw: time, vertices, pictures."""
    from render import cameras
    from render.evaluation import metrics as prior_metrics
    from render.types import AHEAD

    face = judge.assembly.face
    geometry = face.scan()
    skin = face.image("albedo/lps_leeperrysmith.jpg")[..., :3]
    eye = judge.wardrobe.eye("brown")
    start = time.perf_counter()
    who: Subject = judge.subject(geometry, skin, eye)
    seconds = time.perf_counter() - start
    still = np.zeros(len(judge.assembly.names), np.float32)
    truth = judge.true_vertices(who, still, AHEAD)
    light, psnr = judge.true_light(truth), list[float]()
    vertices = geometry
    for yaw in (-30.0, -15.0, 0.0, 15.0, 30.0):
        camera = cameras.portrait(512, 512, yaw)
        reference = judge.true_picture(who, still, truth, light, camera)
        mask = judge.face_mask(who, truth, camera)
        vertices, picture = judge.picture(who, np.zeros(256, np.float32), AHEAD, camera)
        psnr.append(prior_metrics.psnr_db(picture, reference, mask))
    used = judge.decoder.surface.used
    error = prior_metrics.distances(vertices, geometry)[used]
    return {
        "scan_seconds": seconds,
        "scan_vertex_error_mm": float(error.mean()),
        "scan_psnr_db": float(np.mean(psnr)),
    }


def cost(judge: "Judge") -> dict[str, float]:
    """Median CPU time of a decode, ms; size of the weights, MB.

    As the tick decodes, into the arrays of the last frame; `fresh`: into new ones.
    """
    from render.decoder import identity
    from render.decoder.learned import avatar_files
    from render.types import AHEAD

    who = identity.load(avatar_files.names(judge.weights)[0], judge.weights)
    metrics = {"weights_mb": (judge.weights / "prior.safetensors").stat().st_size / 1e6}
    for name, decoder, reuse in (
        ("decode_cpu_ms", judge.decoder, True),
        ("decode_fresh_cpu_ms", judge.decoder, False),
        ("decode_16k_cpu_ms", judge.decoder_of("16k"), True),
    ):
        rng = np.random.default_rng(0)
        times: list[float] = []
        for _ in range(TIMED_FRAMES):
            code = judge.decoder.sample(rng)
            start = time.process_time()
            decoder.decode(code, AHEAD, who, reuse=reuse)
            times.append(1e3 * (time.process_time() - start))
        metrics[name] = float(np.median(times))
    return metrics


def round_trip(judge: "Judge", take: Path) -> float:
    """Mean absolute error of a real take's ARKit weights after a round trip through the code,
    over the shapes that the face data has."""
    from render import arkit

    decoder = judge.decoder
    weights = arkit.read_live_link(take)
    codes = decoder.encode(arkit.to_rig(weights, decoder.rig_names))
    back = arkit.from_rig(decoder.rig(codes), decoder.rig_names)
    known = arkit.matrix(decoder.rig_names).any(1)
    return float(np.abs(back - weights)[:, known].mean())
