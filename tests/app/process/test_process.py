"""What crosses between processes: packets whole and in order, memory by either way."""

import io
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.process import child, memory
from app.process.channel import MAX_PACKET, Channel, pair
from sensors import files
from sensors.types import InputError

ROOT = Path(__file__).parents[3]


def write_slowly(path: Path) -> None:
    with files.replacing(path) as draft:
        draft.with_name("begun").touch()
        time.sleep(60)


def received(end: Channel, count: int) -> list[bytes]:
    found: list[bytes] = []
    while len(found) < count:
        try:
            found.append(end.recv())
        except BlockingIOError:
            continue
    return found


def test_packets_arrive_whole_and_in_order_whatever_their_size() -> None:
    ours, theirs = pair()
    sizes = [1, 3, 0, MAX_PACKET, 17, 1]
    sent = [bytes([k]) * size for k, size in enumerate(sizes)]
    for packet in sent:
        ours.send(packet)
    assert received(theirs, len(sent)) == sent
    ours.close()
    assert received(theirs, 1) == [b""]
    theirs.close()


def test_a_slow_reader_costs_whole_packets_and_never_a_part_of_one() -> None:
    ours, theirs = pair()
    kept, dropped = 0, 0
    for k in range(20_000):
        try:
            ours.send(k.to_bytes(4, "little") * 250)
            kept += 1
        except BlockingIOError:
            dropped += 1
            if dropped == 100:
                break
    assert dropped == 100 and kept > 10
    numbers = []
    reader = threading.Thread(target=lambda: numbers.extend(received(theirs, kept)))
    reader.start()
    ours.finish()
    reader.join(30)
    assert numbers == [k.to_bytes(4, "little") * 250 for k in range(kept)]
    assert received(theirs, 1) == [b""]
    for end in (ours, theirs):
        end.close()


def test_what_is_insisted_on_comes_before_all_later_packets() -> None:
    """Red before: a mute was lost while the other end was slow, and shown as set."""
    ours, theirs = pair()
    with suppress(BlockingIOError):
        while True:
            ours.send(bytes(40_000))
    for word in (b"mute", b"unmute"):
        ours.insist(word)
    with pytest.raises(BlockingIOError):
        ours.send(b"late")
    seen: list[bytes] = []
    while b"after" not in seen:
        seen += theirs.waiting()
        with suppress(BlockingIOError):
            ours.send(b"after")
    words = [packet for packet in seen if len(packet) < 9]
    assert words[:3] == [b"mute", b"unmute", b"after"]
    theirs.close()
    with pytest.raises(ConnectionError):
        ours.insist(b"gone")
    ours.close()
    with pytest.raises(ConnectionError):  # red before: it waited, and the next close failed
        ours.insist(b"closed")
    ours.close()


def test_an_end_that_is_gone_amid_a_packet_is_not_merely_slow() -> None:
    """Red before: BlockingIOError for ever, so that nobody noticed."""
    ours, theirs = pair()
    theirs.send(b"last words")
    while True:
        try:
            ours.send(bytes(40_000))
        except BlockingIOError:
            break
    theirs.socket.close()
    with pytest.raises(ConnectionError):
        ours.send(b"next")
    assert [*ours.waiting()] == [b"last words", b""]
    ours.close()


def test_nothing_to_read_does_not_wait_and_a_dead_end_says_so() -> None:
    ours, theirs = pair()
    with pytest.raises(BlockingIOError):
        theirs.recv()
    ours.socket.send(b"\x05\x00\x00\x00ab")  # dies within a packet
    ours.socket.close()
    assert theirs.recv() == b""
    theirs.close()


def test_all_that_waits_is_read_and_the_end_comes_last() -> None:
    ours, theirs = pair()
    assert [*theirs.waiting()] == []
    ours.send(b"a")
    ours.send(b"b")
    assert [*theirs.waiting()] == [b"a", b"b"]
    ours.send(b"c")
    ours.close()
    assert [*theirs.waiting()] == [b"c", b""]
    theirs.close()
    assert [*theirs.waiting()] == [b""]


def test_too_long_a_packet_is_an_error_of_ours() -> None:
    ours, theirs = pair()
    with pytest.raises(ValueError, match="65536 bytes at most, got 65537"):
        ours.send(bytes(MAX_PACKET + 1))
    for end in (ours, theirs):
        end.close()


@dataclass
class Info:
    value: int


CHILD = """
import numpy as np
from app.process import child, memory
given = child.begin()
assert given.parent_lives()
for handle in given.memories:
    np.frombuffer(memory.attach(handle, 64).buffer, np.int64)[0] += given.info["value"]
given.end.send(b"done")
given.end.close()
"""


def test_a_child_opens_memory_of_both_kinds_and_takes_the_channel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a_child.py").write_text(CHILD)
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{tmp_path}")
    blocks = [memory.create(64), memory.NamedBlock(None, 64)]
    arrays = [np.frombuffer(block.buffer, np.int64, 8) for block in blocks]
    ours, theirs = pair()
    process = child.start("a_child", Info(7), [block.handle for block in blocks], theirs)
    theirs.close()
    assert process.wait(60) == 0, capfd.readouterr().err
    assert received(ours, 2) == [b"done", b""]
    assert [int(array[0]) for array in arrays] == [7, 7]  # the named one outlives its reader
    for block in blocks:
        block.close()
    ours.close()
    assert int(arrays[1][0]) == 7
    assert capfd.readouterr().err == ""


def test_a_child_whose_parent_ended_before_it_began_knows() -> None:
    """Red before: it took whoever had adopted it for its parent, and a window stayed for ever."""
    assert child.Given({}, [], None, os.getppid()).parent_lives()
    assert not child.Given({}, [], None, parent=os.getpid()).parent_lives()


def test_windows_shares_with_the_python_behind_a_virtual_environment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Red before: with its redirector, which is none of ours. Seen here as far as Linux can."""
    started: list[tuple[list[str], dict[str, str]]] = []

    def popen(command: list[str], stdin: int, env: dict[str, str]) -> SimpleNamespace:
        started.append((command, env))
        return SimpleNamespace(pid=7, stdin=io.BytesIO())

    shared: list[int] = []
    end: Any = SimpleNamespace(socket=SimpleNamespace(share=lambda pid: shared.append(pid) or b""))
    with monkeypatch.context() as patch:
        patch.setattr(sys, "platform", "win32")
        patch.setattr(sys, "executable", "venv/python.exe")
        patch.setattr(sys, "_base_executable", "base/python.exe")
        patch.setattr(subprocess, "Popen", popen)
        child.start("app.web", Info(7), end=end)
    ((command, env),) = started
    assert command == ["base/python.exe", "-m", "app.web"] and shared == [7]
    assert env["__PYVENV_LAUNCHER__"] == "venv/python.exe"


def test_memory_that_is_gone_is_named() -> None:
    block = memory.NamedBlock(None, 64)
    block.close()
    with pytest.raises(InputError, match="got none; the run that made it has ended"):
        memory.attach(block.handle, 64)
    with pytest.raises(InputError, match="expected fd:NUMBER or name:NAME"):
        memory.attach("psm_1", 64)


def test_named_memory_leaves_no_word_at_the_end_of_a_process() -> None:
    code = (
        "import numpy as np; from app.process.memory import NamedBlock; "
        "b = NamedBlock(None, 64); a = np.frombuffer(b.buffer, np.int64); b.close(); print(a[0])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "0\n", "")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a niceness is a process's")
def test_threads_of_libraries_go_after_the_tick_too() -> None:
    script = (
        "import os, threading; from app.process.child import lower_priority\n"
        "threading.Thread(target=threading.Event().wait, daemon=True).start()\n"
        "lower_priority(3)\n"
        "ids = [int(thread) for thread in os.listdir('/proc/self/task')]\n"
        "print(*(os.getpriority(os.PRIO_PROCESS, number) for number in ids))\n"
    )
    before = os.getpriority(os.PRIO_PROCESS, 0)
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True)
    threads = done.stdout.split()
    assert len(threads) > 1 and set(threads) == {str(min(before + 3, 19))}, done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="a kill there cannot be caught")
def test_a_pool_ends_without_a_word_and_without_drafts(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """As on Ctrl-C, which a terminal sends to all. Red before: tracebacks, and drafts of what was
    being written."""
    context = multiprocessing.get_context("spawn")
    with context.Pool(1, child.begin_worker) as pool:
        pool.apply_async(write_slowly, (tmp_path / "eyes.npz",))
        while not (tmp_path / "begun").exists():
            time.sleep(0.01)
        (worker,) = multiprocessing.active_children()
        assert worker.pid
        os.kill(worker.pid, signal.SIGINT)
    pool.join()
    assert [path.name for path in tmp_path.iterdir()] == ["begun"]
    assert capfd.readouterr().err == ""
