"""Eye pictures with known truth, for training: people in headsets, rendered in parallel.

Composes motion of a finished data set with render/near_eye. Files eyes_NNN.npz hold small pictures
of pairs (`encoder.training.streams.eye_pictures` reads them); finished ones are not made again.
"""

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.capture.rendering import rendered
from sensors import files

if TYPE_CHECKING:
    from encoder.capture.dataset import Clip
    from render.near_eye.look import Look

Floats = NDArray[np.float32]
SIZE_PX = 200  # four times as many as at 400, and the encoder sees means of 100 x 100
# Many people in as many headsets: what an encoder has to learn is where the camera of somebody new
# sits, which tells the gaze's height; more moments of one person teach it little.
PEOPLE_A_FILE, PAIRS_A_PERSON = 40, 6
FREE_SHARE = 0.4  # of moments that are drawn anew: rare gazes, winks, brows
# Of moments amid a blink. Clips hold so few that a lid on its way was read .1 too open (measured).
BLINK_SHARE = 0.17
DARK_SHARE = 0.15  # of people with thick dark lashes, behind which a lid's edge is hard to see


def draw_pairs(folder: Path, count: int, seed: int, processes: int) -> dict[str, Any]:
    """Make files until `count` pairs exist; returns how many there are and what a pair cost."""
    from encoder.capture import dataset

    per_file = PEOPLE_A_FILE * PAIRS_A_PERSON
    number = -(-count // per_file)
    shards = [s["file"] for s in dataset.read_manifest(folder)["shards"]]
    spoken = [s for s in shards if s.startswith(("made", "grid", "own"))] or shards
    jobs = [(folder, k, spoken, (seed, k)) for k in range(number)]
    todo = [job for job in jobs if not _path(folder, job[1]).exists()]
    costs = rendered(_file, todo, processes, "eyes")
    result: dict[str, Any] = {"eye_pairs": number * per_file}
    if costs:
        result["eye_pairs_per_s_on_2_cores"] = round(2 * per_file / float(np.mean(costs)), 1)
    return result


def _path(folder: Path, number: int) -> Path:
    return folder / f"eyes_{number:03d}.npz"


_renderer: Any = None  # one GL context a process


def _file(job: tuple[Path, int, list[str], tuple[int, int]]) -> float:
    """Render one file; returns its CPU seconds, without the start of the process."""
    global _renderer
    from encoder.capture import dataset
    from encoder.eyes.format import pixels
    from render.decoder import identity
    from render.decoder.decoder import Decoder
    from render.decoder.learned import avatar_files
    from render.near_eye.camera import NearEye
    from render.near_eye.look import Look, varied

    folder, number, shards, seed = job
    rng = np.random.default_rng(seed)
    _renderer = _renderer or NearEye(Decoder.load(), size_px=SIZE_PX)
    people = [identity.load(name) for name in avatar_files.shipped()]
    before = _cpu_s()
    rows: dict[str, list[Any]] = {k: [] for k in ("pictures", "gaze", "lids", "rig", "subject")}
    clips = list(dataset.read_shard(folder / shards[rng.integers(len(shards))]))
    for person in range(PEOPLE_A_FILE):
        look = Look.draw(rng)
        look = dark_lashed(look, rng) if rng.random() < DARK_SHARE else look
        wearer = _renderer.wear(varied(people, rng), look, rng)
        for _ in range(PAIRS_A_PERSON):
            rig, gaze = _moment(clips[rng.integers(len(clips))], rng)
            pair = _renderer.draw(wearer, rig, gaze, rng)
            rows["pictures"].append(pixels(pair.pictures))
            rows["gaze"].append(gaze)
            rows["lids"].append(np.minimum(pair.lids, 1))
            rows["rig"].append(upper_face(rig))
            rows["subject"].append(number * PEOPLE_A_FILE + person)
    _save(_path(folder, number), rows)
    return _cpu_s() - before


def _cpu_s() -> float:
    """CPU seconds of this process, with the threads of the GL driver."""
    times = os.times()
    return times.user + times.system


def _save(path: Path, rows: dict[str, list[Any]]) -> None:
    from encoder.training.streams.eye_pictures import save_pairs

    arrays = {name: np.stack(values) for name, values in rows.items()}
    with files.replacing(path) as draft:
        save_pairs(draft, **arrays)


def upper_face(rig: Floats) -> Floats:  # [53] -> [2, 7]
    from encoder.capture.motion.channels import RIG_INDEX
    from encoder.eyes.format import RIG

    return np.array([[rig[RIG_INDEX[f"{name}_{s}"]] for name in RIG] for s in "LR"], np.float32)


def dark_lashed(look: "Look", rng: np.random.Generator) -> "Look":
    return replace(
        look,
        lash_shade=rng.uniform(0.02, 0.06),
        lash_length=rng.uniform(7.5, 10.5),
        lash_width=rng.uniform(0.17, 0.24),
        lashes=int(rng.integers(90, 130)),
    )


def _moment(clip: "Clip", rng: np.random.Generator) -> tuple[Floats, Floats]:
    """A frame of a clip, perhaps amid a blink, or a face whose eyes do anything.

    Returns rig [53], gaze [2, 3].
    """
    t, kind = int(rng.integers(clip.num_frames)), rng.random()
    rig, gaze = clip.rig[t].astype(np.float32), clip.gaze[t].astype(np.float32)
    if kind < FREE_SHARE:
        gaze = any_eyes(rig, rng)
    elif kind < FREE_SHARE + BLINK_SHARE:
        blink(rig, min(rng.uniform(0.15, 1.25), 1))
    return rig, gaze


def blink(rig: Floats, lid: float) -> None:
    """Shut the eyes of `rig` [53] by `lid` 0..1, with what the rules of motion move beside it."""
    from encoder.capture.motion.channels import RIG_INDEX

    for side in "LR":
        shut = RIG_INDEX[f"eyeBlink_{side}"]
        rig[shut] = max(rig[shut], lid)
        for name, share in (("eyeSquint", 0.25), ("browDown", 0.2)):
            column = RIG_INDEX[f"{name}_{side}"]
            rig[column] = min(rig[column] + share * lid, 1)


def any_eyes(rig: Floats, rng: np.random.Generator) -> Floats:
    """Fill the upper face of `rig` at random; returns a gaze [2, 3] up to 35 degrees off."""
    from encoder.capture.motion.channels import RIG_INDEX
    from encoder.capture.motion.upper_face import directions

    ranges = {"eyeSquint": 0.7, "eyeWide": 0.6, "browDown": 0.8, "browInnerUp": 0.8}
    ranges |= {"browOuterUp": 0.8, "cheekSquint": 0.8}
    lid = float(rng.choice([0.0, rng.uniform(0, 1), 1.0], p=[0.5, 0.35, 0.15]))
    values = {name: high * max(0.0, rng.uniform(-1, 1)) for name, high in ranges.items()}
    values["eyeBlink"] = lid
    values["eyeWide"] *= 1 - lid
    for name, value in values.items():
        for side in "LR":
            rig[RIG_INDEX[f"{name}_{side}"]] = np.clip(value * rng.uniform(0.85, 1.15), 0, 1)
    if rng.random() < 0.08:  # a wink
        rig[RIG_INDEX[f"eyeBlink_{rng.choice(['L', 'R'])}"]] = rng.uniform(0, 1)
    yaw, pitch = rng.uniform(-35, 35), rng.uniform(-28, 24)
    fixation = np.array([[0.0, yaw, pitch, rng.uniform(350, 3000)]])
    return directions(np.array([[yaw, pitch]]), fixation, 1)[0]
