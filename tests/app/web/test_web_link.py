"""The loop's end of the line to the web server, and the names that its certificate holds."""

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from app.process.channel import pair
from app.web import certificate
from app.web.link import PICKS, SOUND, SOUND_HEAD, ServerLink


class Line:
    """Counts who takes packets from it at once."""

    def __init__(self) -> None:
        self.inside, self.most = 0, 0

    def waiting(self) -> list[bytes]:
        self.inside += 1
        self.most = max(self.most, self.inside)
        time.sleep(1e-3)
        self.inside -= 1
        return []


def test_threads_read_one_after_the_other() -> None:
    """Red before: two that read at once took each other's bytes, and the page stood still."""
    line: Any = Line()
    link = ServerLink(line)

    def often(read: Callable[[], object]) -> None:
        for _ in range(20):
            read()

    threads = [threading.Thread(target=often, args=[read]) for read in (link.read, link.picks)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert line.most == 1


def test_what_somebody_picks_is_not_lost_behind_sound() -> None:
    """Red before: a mute at the page was shown as set and never reached the run."""
    ours, theirs = pair()
    link = ServerLink(ours)
    with suppress(BlockingIOError):
        while True:
            theirs.send(SOUND_HEAD.pack(SOUND, 1, 0, 0) + bytes(1920))
    theirs.insist(PICKS + b'{"muted": true}')
    picks = link.picks()
    with suppress(BlockingIOError):
        theirs.recv()  # what waits goes on its way
    assert {**picks, **link.picks()} == {"muted": True}
    link.close()
    theirs.close()


def test_a_computer_may_have_any_name(tmp_path: Path) -> None:
    """Red before: with an umlaut the server did not start."""
    hosts = ["127.0.0.1", "jörgs-pc", "a_b", "x" * 64, "a..b"]
    paths = certificate.ensure(tmp_path, hosts, 1.8e9)
    kept = [path.read_bytes() for path in paths]
    assert certificate.ensure(tmp_path, hosts, 1.8e9) == paths
    assert [path.read_bytes() for path in paths] == kept
