"""A part of a run in a process of its own: started here, and what it does first there.

What the child must know crosses on its standard input, as one line of JSON: the command line of a
process can be read by other users.
"""

import asyncio
import base64
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Coroutine, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from app.process import memory
from app.process.channel import Channel

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def start(
    module: str,
    info: "DataclassInstance",
    memories: Sequence[str] = (),  # handles that the child opens
    end: Channel | None = None,  # that the child takes over
) -> "subprocess.Popen[bytes]":
    """Start `python -m module`; it calls `begin`."""
    command = [sys.executable, "-m", module]
    if sys.platform == "win32":
        # The python.exe of a virtual environment starts another one, which could take over nothing
        # from us: as multiprocessing does, start that one.
        command[0] = str(getattr(sys, "_base_executable", sys.executable))
        venv = {"__PYVENV_LAUNCHER__": sys.executable} if command[0] != sys.executable else {}
        process = subprocess.Popen(command, stdin=subprocess.PIPE, env=os.environ | venv)
        shared = base64.b64encode(end.socket.share(process.pid)).decode() if end else ""
    else:
        kept = [number for handle in memories for number in memory.inherited(handle)]
        kept += [end.fileno()] if end else []
        process = subprocess.Popen(command, stdin=subprocess.PIPE, pass_fds=kept)
        shared = str(end.fileno()) if end else ""
    assert process.stdin is not None
    given = {"info": asdict(info), "memories": list(memories), "socket": shared}
    line = json.dumps(given | {"parent": os.getpid()})
    with contextlib.suppress(BrokenPipeError), process.stdin:  # gone: its status says it
        process.stdin.write(line.encode() + b"\n")
    return process


@dataclass(frozen=True)
class Given:
    """What a child was started with."""

    info: dict[str, Any]
    memories: list[str]  # handles
    end: Channel | None
    parent: int  # the process that started it

    def parent_lives(self) -> bool:
        """At any time; it may have ended before this process began."""
        if sys.platform != "win32":
            return os.getppid() == self.parent
        import psutil  # an orphan keeps the number of its parent there

        return psutil.pid_exists(self.parent)


def begin() -> Given:
    """In the child, first of all: what `start` was given."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the loop, which then ends us
    given = json.loads(sys.stdin.readline())
    word, end = given["socket"], None
    if word and sys.platform == "win32":
        end = Channel(socket.fromshare(base64.b64decode(word)))
    elif word:
        end = Channel(socket.socket(fileno=int(word)))
    return Given(given["info"], given["memories"], end, given["parent"])


def begin_worker() -> None:
    """In a process of a pool: Ctrl-C is for the command, which then ends us, without a word and
    without drafts of files."""

    def end(*_: object) -> None:
        sys.exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, end)


def lower_priority(niceness: int) -> None:
    """Let the tick go first: all threads of this process, also those of libraries that it has
    started already. On Windows: below normal, whatever the niceness."""
    if sys.platform == "win32":
        import psutil

        psutil.Process().nice(psutil.BELOW_NORMAL_PRIORITY_CLASS)
    elif sys.platform == "linux":  # where each thread has a niceness of its own
        for thread in map(int, os.listdir("/proc/self/task")):
            with contextlib.suppress(ProcessLookupError):  # it has just ended
                before = os.getpriority(os.PRIO_PROCESS, thread)
                os.setpriority(os.PRIO_PROCESS, thread, before + niceness)
    else:
        os.nice(niceness)


def run(work: Coroutine[Any, Any, None]) -> None:
    """asyncio.run on a loop that can wait for a socket; the one that Windows prefers cannot."""
    with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
        runner.run(work)
