"""Threads that share a picture: every part once, errors handed on, the same picture by one."""

import threading

import numpy as np
import pytest
from scenes import head_scene

from render.cameras import portrait
from render.threads import Threads


def test_every_part_is_done_once_whoever_does_it():
    threads, done = Threads(), np.zeros(64, int)

    def work(part: int) -> None:
        done[part] += 1

    threads.share(work, 64)
    threads.share(work, 3)
    assert (done == 1 + (np.arange(64) < 3)).all()
    threads.close()
    threads.close()


def test_an_error_is_handed_on_and_nobody_is_left_at_work():
    threads, others = Threads(), set()

    def work(part: int) -> None:
        others.add(threading.current_thread())
        raise ValueError(part)

    for _ in range(3):
        with pytest.raises(ValueError, match=r"\d"):
            threads.share(work, 16)
    threads.close()
    for other in others - {threading.current_thread()}:
        other.join(5)
        assert not other.is_alive()


def test_one_thread_draws_what_all_draw(tiles, monkeypatch):
    scene, camera = head_scene(2000), portrait(203, 131, yaw_deg=20.0)
    tiles.draw(scene, camera)
    picture = tiles.read_rgba().copy()
    monkeypatch.setattr(tiles._threads, "count", 1)
    tiles.draw(scene, camera)
    assert (tiles.read_rgba() == picture).all()


def test_nobody_waits_for_a_helper_that_is_late():
    threads, busy = Threads(), threading.Event()
    threads.count = 2
    threads._call(busy.wait)  # its CPU is busy
    done: list[int] = []
    threads.share(done.append, 5)
    assert done == [0, 1, 2, 3, 4]
    busy.set()
    threads.share(done.append, 5)
    assert sorted(done[5:]) == [0, 1, 2, 3, 4]
    threads.close()
