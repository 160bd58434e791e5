"""Runs the fuzz: chunks of inputs in processes of their own, kept as they end.

A chunk is drawn from (seed, target, number), so it can be done again alone, in any process. With a
folder, what is done is kept there (`chunks.jsonl`, and each input that escaped), and the same
command goes on where it was stopped.
"""

import json
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from app.bench.fuzz.chunk import HANG_S, Chunk, Done, run_chunk
from app.bench.fuzz.targets import TARGETS
from app.process import child
from app.terminal.thresholds import at_most
from sensors import files
from sensors.types import InputError

KEPT = "chunks.jsonl"
MAX_GROWTH_MB = 100.0
MAX_SHOWN = 20


def measure_fuzz(
    num: int, seed: int, processes: int = 1, folder: Path | None = None
) -> dict[str, Any]:
    """`num` inputs, shared out as TARGETS says; the report holds metrics and thresholds."""
    from tqdm import tqdm

    if num < 1 or processes < 1:
        raise InputError(
            f"bench fuzz: expected --num and --processes of 1 or more, got {num} and {processes}; "
            "try bench fuzz --num 100000 --processes 2"
        )
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
    done = _kept(folder, seed)
    left = [chunk for chunk in _chunks(num, seed) if chunk not in done]
    before = sum(chunk.count for chunk in done)
    with tqdm(total=num, initial=min(before, num), unit=" inputs", disable=None) as bar:
        died = ""
        try:
            for result in _run(left, processes, folder):
                done[result.chunk] = result
                bar.update(result.chunk.count)
        except BrokenProcessPool as error:
            died = f"a process died in one of these: {error}"
    return _report(list(done.values()), died)


def _chunks(num: int, seed: int) -> Iterator[Chunk]:
    """All targets side by side, so that a run that was stopped has seen each of them."""
    rows = [
        [
            Chunk(name, number, min(target.chunk, count - number * target.chunk), seed)
            for number in range(-(-count // target.chunk))
        ]
        for name, target in TARGETS.items()
        for count in [max(round(num * target.share), 1)]
    ]
    ends = [(k / len(row), row[k]) for row in rows for k in range(len(row))]
    return (chunk for _, chunk in sorted(ends, key=lambda end: end[0]))


def _run(chunks: list[Chunk], processes: int, folder: Path | None) -> Iterator[Done]:
    waiting = iter(chunks)
    with ProcessPoolExecutor(processes, get_context("spawn"), child.begin_worker) as pool:
        running: dict[Future[Done], Chunk] = {}
        while True:
            for chunk in islice(waiting, processes - len(running)):
                running[pool.submit(run_chunk, chunk, folder)] = chunk
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                try:
                    result = future.result()
                except BrokenProcessPool:
                    names = ", ".join(f"{c.target} {c.number}" for c in running.values())
                    raise BrokenProcessPool(names) from None
                del running[future]
                _keep(folder, result)
                yield result


def _keep(folder: Path | None, result: Done) -> None:
    if folder:
        with files.check_regular(folder / KEPT).open("a") as file:
            file.write(result.to_json() + "\n")


def _kept(folder: Path | None, seed: int) -> dict[Chunk, Done]:
    """What was done before with this seed."""
    path = folder / KEPT if folder else None
    if path is None or not path.exists():
        return {}
    try:
        found = [Done.from_json(line) for line in files.read_text(path).splitlines()]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path}: expected the chunks of an earlier run, got {error}; name another folder"
        ) from None
    return {done.chunk: done for done in found if done.chunk.seed == seed}


def _report(done: list[Done], died: str) -> dict[str, Any]:
    metrics: dict[str, Any] = {"inputs": sum(d.chunk.count for d in done)}
    for name in TARGETS:
        metrics[f"{name}_inputs"] = sum(d.chunk.count for d in done if d.chunk.target == name)
    metrics["slowest_cpu_ms"] = max((d.slowest_ms for d in done), default=0.0)
    escaped = [line for d in done for line in d.escaped]
    hangs = [line for d in done for line in d.hangs]
    metrics["escaped"], metrics["hangs"] = escaped[:MAX_SHOWN], hangs[:MAX_SHOWN]
    metrics["died"] = died
    for line in [*escaped[:5], *hangs[:5], *([died] if died else [])]:
        print(line)
    growth = max((d.growth_mb for d in done), default=0.0)
    thresholds = [
        at_most("escaped_exceptions", len(escaped), 0),
        at_most(f"hangs_over_{HANG_S:.0f}_s", len(hangs), 0),
        at_most("processes_died", int(bool(died)), 0),
        at_most("memory_growth_mb", growth, MAX_GROWTH_MB),
    ]
    return {"metrics": json.loads(json.dumps(metrics)), "bars": thresholds}
