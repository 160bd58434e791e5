"""Eye pictures with known truth, for training: people in headsets, rendered in parallel.

Composes motion of a finished data set with render/near_eye. Files eyes_NNN.npz hold small pictures
of pairs (`encoder.training.eye_pictures` reads them); finished ones are not made again.
"""

import multiprocessing
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from encoder.capture.dataset import Clip

Floats = NDArray[np.float32]
PEOPLE_A_FILE = 10
BURSTS, BURST_FRAMES = 3, 8  # of one person; the headset slips between bursts
FREE_SHARE = 0.4  # of bursts whose frames are each drawn anew: rare gazes, half-shut lids, brows


def draw_pairs(folder: Path, count: int, seed: int, processes: int) -> dict[str, Any]:
    """Make files until `count` pairs exist; returns how many there are and what a pair cost."""
    from tqdm import tqdm

    from encoder.capture import dataset

    per_file = PEOPLE_A_FILE * BURSTS * BURST_FRAMES
    number = -(-count // per_file)
    shards = [s["file"] for s in dataset.read_manifest(folder)["shards"]]
    spoken = [s for s in shards if s.startswith(("made", "grid", "own"))] or shards
    jobs = [(folder, k, spoken, (seed, k)) for k in range(number)]
    todo = [job for job in jobs if not _path(folder, job[1]).exists()]
    # one rasteriser thread a process: the pool keeps the cores busy
    os.environ["LP_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"
    costs: list[float] = []
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        work = pool.imap_unordered(_file, todo)
        costs += tqdm(work, total=len(todo), desc="eyes", unit="file", mininterval=2)
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
    from encoder.eye_network import pixels
    from render import identity
    from render.decoder import Decoder
    from render.near_eye import NearEye
    from render.near_eye_look import Look, varied

    folder, number, shards, seed = job
    rng = np.random.default_rng(seed)
    _renderer = _renderer or NearEye(Decoder.load())
    people = [identity.load(name) for name in identity.names()]
    before = _cpu_s()
    rows: dict[str, list[Any]] = {k: [] for k in ("pictures", "gaze", "lids", "rig", "subject")}
    for person in range(PEOPLE_A_FILE):
        look = Look.draw(rng)
        wearer = _renderer.wear(varied(people, rng), look, rng)
        clips = list(dataset.read_shard(folder / shards[rng.integers(len(shards))]))
        for _ in range(BURSTS):
            slipped = look.slipped(rng)
            rigs, gazes = _burst(clips[rng.integers(len(clips))], rng)
            for rig, gaze in zip(rigs, gazes, strict=True):
                pair = _renderer.draw(wearer, rig, gaze, rng, slipped)
                rows["pictures"].append(pixels(pair.pictures))
                rows["gaze"].append(gaze)
                rows["lids"].append(np.minimum(pair.lids, 1))
                rows["rig"].append(_upper_face(rig))
                rows["subject"].append(number * PEOPLE_A_FILE + person)
    _save(_path(folder, number), rows)
    return _cpu_s() - before


def _cpu_s() -> float:
    """CPU seconds of this process, with the threads of the GL driver."""
    times = os.times()
    return times.user + times.system


def _save(path: Path, rows: dict[str, list[Any]]) -> None:
    from encoder.training.eye_pictures import save_pairs

    unfinished = path.with_name(f"part_{path.name}")
    arrays = {name: np.stack(values) for name, values in rows.items()}
    save_pairs(unfinished, **arrays)
    unfinished.rename(path)


def _upper_face(rig: Floats) -> Floats:  # [53] -> [2, 7]
    from encoder.capture.channels import RIG_INDEX
    from encoder.eye_network import RIG

    return np.array([[rig[RIG_INDEX[f"{name}_{s}"]] for name in RIG] for s in "LR"], np.float32)


def _burst(clip: "Clip", rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Eight frames of a clip, or eight of anything: rig [8, 53], gaze [8, 2, 3]."""
    start = int(rng.integers(max(clip.num_frames - BURST_FRAMES, 1)))
    cut = slice(start, start + BURST_FRAMES)
    rigs, gazes = clip.rig[cut].astype(np.float32), clip.gaze[cut].astype(np.float32)
    if rng.random() < FREE_SHARE:
        rigs = rigs.copy()
        gazes = np.stack([_any_eyes(rig, rng) for rig in rigs])
    return rigs, gazes


def _any_eyes(rig: Floats, rng: np.random.Generator) -> Floats:
    """Fill the upper face of `rig` at random; returns a gaze [2, 3] up to 35 degrees off."""
    from encoder.capture.channels import RIG_INDEX
    from encoder.capture.upper_face import directions

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
