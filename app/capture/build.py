"""Build a data set: subjects in parallel processes, each a session folder with its motion.

Composes encoder/capture (numbers) with the decoder's lips and the session format. Resumable: a
subject whose folder is finished is not made again.
"""

import json
import multiprocessing
import os
import shutil
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.process import child
from sensors import files

if TYPE_CHECKING:
    from encoder.capture.made import Take
    from encoder.capture.motion.contacts import LipGeometry
    from encoder.capture.subjects.plans import Config, Plan

_lips: "LipGeometry | None" = None  # of a process that makes subjects


def build(folder: Path, config: "Config", processes: int) -> dict[str, Any]:
    """Make or finish a set in `folder`; returns its manifest's counts and what it cost."""
    from tqdm import tqdm

    from app.face.geometry import lips
    from encoder.capture import dataset
    from encoder.capture.subjects import plans as capture
    from sensors.types import InputError

    plans = capture.plans(config)
    recipe = {k: str(v) if isinstance(v, Path) else v for k, v in asdict(config).items()}
    folder.mkdir(parents=True, exist_ok=True)
    _same_recipe(folder, recipe, [folder / plan.name for plan in plans], InputError)
    todo = [plan for plan in plans if dataset.finished(folder / plan.name) is None]
    todo.sort(key=lambda plan: plan.kind == "made")  # real ones take longest: first
    os.environ["OMP_NUM_THREADS"] = "1"
    # a fork starts at once, but only Linux' libraries survive one
    context = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")
    # one task a child: espeak-ng keeps a state, so that its sound would depend on what it said
    before = children_s()
    with context.Pool(processes, _begin, (lips(),), maxtasksperchild=1) as pool:
        work = pool.imap_unordered(_make, [(folder / plan.name, plan) for plan in todo])
        for _ in tqdm(work, total=len(todo), desc="capture", unit="subject", mininterval=2):
            pass
        pool.close()
        pool.join()  # so that the children's time is counted
    entries = [entry for plan in plans if (entry := dataset.finished(folder / plan.name))]
    entries = [entry for entry in entries if entry["clips"]]
    dataset.write_manifest(folder, entries, capture.sources(plans), **recipe)
    result = dataset.counts(entries)
    hours = sum(
        sum(clip["frames"] for clip in entry["clips"]) / 108_000
        for entry in entries
        if entry["file"] in {plan.name for plan in todo}
    )
    if hours:
        result["audio_hours_per_cpu_hour"] = round(3600 * hours / (children_s() - before), 1)
    return result


def children_s() -> float:
    """CPU seconds of all ended child processes."""
    times = os.times()
    return times.children_user + times.children_system


def _same_recipe(
    folder: Path, recipe: dict[str, Any], subjects: list[Path], error: type[Exception]
) -> None:
    """A folder holds one recipe: raise when it was begun with another one, or when it has none and
    what stands where a subject goes is not ours to replace."""
    path = folder / "recipe.json"
    text = json.dumps(recipe, indent=1)
    if not path.is_file() and (taken := [path for path in subjects if path.exists()]):
        raise error(
            f"{folder}: expected a new folder or one that capture began, got a {taken[0].name} "
            "of another; choose another folder"
        )
    if path.is_file() and path.read_text() != text:
        raise error(
            f"{folder}: expected the settings it was begun with ({path}), got others; "
            "choose another folder or repeat the first settings"
        )
    files.write_text(path, text)


def _begin(lips: "LipGeometry") -> None:
    """What every child process knows."""
    global _lips
    child.begin_worker()
    _lips = lips


def _make(job: "tuple[Path, Plan]") -> str:
    from encoder.capture import dataset
    from encoder.capture.subjects import plans as capture

    folder, plan = job
    if folder.exists():
        shutil.rmtree(folder)  # was not finished
    takes = list(capture.takes(plan, _lips))
    if takes:
        write_session(folder, takes, plan.name)
        dataset.write_shard(folder, [t.clip for t in takes], subject=plan.name, seed=plan.seed)
    return plan.name


def write_session(folder: Path, takes: "list[Take]", name: str) -> None:
    """The takes' sound end to end, as a session without eyes."""
    from sensors.session.recording import RecordingWriter

    devices = {"audio": f"capture stage, {name}"}
    with RecordingWriter(folder, created="", devices=devices, audio_format="pcm16") as writer:
        for packet in _packets(takes):
            writer.append(packet)


def _packets(takes: "list[Take]") -> Iterator[Any]:
    from sensors.types import NS, SAMPLE_RATE, AudioPacket

    first = 0
    for take in takes:
        for start in range(0, len(take.audio), SAMPLE_RATE):
            samples = take.audio[start : start + SAMPLE_RATE]
            yield AudioPacket(first * NS // SAMPLE_RATE, first, samples)
            first += len(samples)
