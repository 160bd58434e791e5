"""One chunk of the fuzz, in the process that runs it: exceptions, hangs and memory are noted.

Allowed outcomes of an input are a result or its border's own error; a warning that would be written
to the user's terminal is none. On Windows hangs are not noted,
elsewhere than on Linux a peak of memory that is over before the chunk ends.
"""

import faulthandler
import json
import os
import signal
import sys
import time
import warnings
from collections.abc import Generator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from app.bench.fuzz.fuzzer import Fuzzer
from app.bench.fuzz.targets import TARGETS
from sensors import files

HANG_S = 1.0  # CPU time of one input
DEAD_S = 900.0  # of a chunk, by the clock: native code that never comes back ends the process


@dataclass(frozen=True)
class Chunk:
    """`count` inputs of one target, drawn from the seed and these numbers."""

    target: str
    number: int
    count: int
    seed: int


@dataclass
class Done:
    """What became of a chunk."""

    chunk: Chunk
    escaped: list[str] = field(default_factory=list[str])
    hangs: list[str] = field(default_factory=list[str])
    slowest_ms: float = 0.0  # CPU time of one input
    growth_mb: float = 0.0  # at the highest

    def to_json(self) -> str:
        return json.dumps(asdict(self))

    @staticmethod
    def from_json(line: str) -> "Done":
        words = json.loads(line)
        return Done(**words | {"chunk": Chunk(**words["chunk"])})


class HangError(BaseException):
    """No input may take so long; nothing that catches exceptions catches this one."""


def run_chunk(chunk: Chunk, kept: Path | None = None) -> Done:
    """Feed it; inputs that escaped or hung are written into the folder `kept`."""
    import psutil

    faulthandler.dump_traceback_later(DEAD_S, exit=True)
    place, target = list(TARGETS).index(chunk.target), TARGETS[chunk.target]
    process, done = psutil.Process(os.getpid()), Done(chunk)
    with TemporaryDirectory() as folder, _watched(), warnings.catch_warnings():
        warnings.simplefilter("error")
        fuzzer = Fuzzer(chunk.seed, place, chunk.number)
        feed = target.make(fuzzer, Path(folder))
        with _caught(done, "first", fuzzer, kept):
            feed()
        start_mb = process.memory_info().rss / 2**20
        _forget_peak()
        for k in range(chunk.count):
            begin = time.thread_time_ns()
            with _caught(done, str(k), fuzzer, kept):
                feed()
            done.slowest_ms = max(done.slowest_ms, (time.thread_time_ns() - begin) / 1e6)
        done.growth_mb = max(process.memory_info().rss / 2**20, _peak_mb()) - start_mb
    faulthandler.cancel_dump_traceback_later()
    return done


@contextmanager
def _caught(done: Done, name: str, fuzzer: Fuzzer, kept: Path | None) -> Generator[None]:
    _allow(HANG_S)
    try:
        yield
    except Exception as error:  # what this command looks for
        done.escaped.append(f"{done.chunk.target} {done.chunk.number}:{name}: {error!r:.300}")
    except HangError:
        done.hangs.append(f"{done.chunk.target} {done.chunk.number}:{name}")
    else:
        return
    finally:
        _allow(0)
    if kept:
        path = kept / f"{done.chunk.target}-{done.chunk.number}-{name}.bin"
        files.write_bytes(path, fuzzer.last)


@contextmanager
def _watched() -> Generator[None]:
    """Inside, CPU time beyond what `_allow` gave raises HangError."""

    def hang(number: int, frame: object) -> None:
        raise HangError

    if sys.platform == "win32":
        yield
        return
    before = signal.signal(signal.SIGPROF, hang)
    try:
        yield
    finally:
        signal.signal(signal.SIGPROF, before)


def _allow(seconds: float) -> None:
    if sys.platform != "win32":
        signal.setitimer(signal.ITIMER_PROF, seconds)


def _forget_peak() -> None:
    with suppress(OSError), open("/proc/self/clear_refs", "w") as file:
        file.write("5")


def _peak_mb() -> float:
    """The most memory since `_forget_peak`."""
    with suppress(OSError), open("/proc/self/status") as file:
        for line in file:
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return 0.0
