"""The window on a virtual screen: it shows, obeys clicks and keys, and never holds up a tick."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from desktop import Desktop, wait_for
from window_hand import Hand, open_window

from app.drive.tape import Tape

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def window(desktop: Desktop, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hand]:
    with open_window(desktop, tmp_path_factory.mktemp("window")) as made:
        yield made


@pytest.fixture
def hand(window: Hand) -> Hand:
    """The window of all tests that leave it open."""
    window.begin()
    return window


def test_it_shows_the_head_and_obeys_clicks_and_keys(hand: Hand) -> None:
    from PIL import Image

    desktop, read = hand.desktop, hand.sink.read
    wait_for(lambda: hand.memory("shown") == hand.posted - 1)
    hand.settle()
    picture = desktop.screenshot().astype(int)
    forehead, corner = picture[260, 466], picture[400, 30]
    assert forehead[0] > forehead[2] + 30 and corner.max() < 60  # skin before a dark background
    assert picture[:, 940:].std() > 10  # the sidebar holds things

    assert not read().muted
    hand.click("mute")
    wait_for(lambda: read().muted)
    desktop.key("m")
    wait_for(lambda: not read().muted)
    hand.click("record")
    wait_for(lambda: read().recording)
    desktop.key("r")
    wait_for(lambda: not read().recording)
    recentred, resets = read().recentred, read().resets
    desktop.key("c")
    wait_for(lambda: read().recentred == recentred + 1)
    desktop.key("BackSpace")
    wait_for(lambda: read().resets == resets + 1)

    for key in ("F11", "F11", "Tab", "Tab", "x", "x", "b", "s"):
        desktop.key(key)
        hand.settle()  # still alive
    before = desktop.screenshot()[300:500, 300:600].astype(int)
    desktop.key("F1")
    hand.settle()
    help_page = desktop.screenshot()[300:500, 300:600]
    assert np.abs(help_page - before).mean() > 20
    desktop.key("Escape")

    desktop.key("p")
    saved = hand.folder / "livedrive-ben-001.png"
    wait_for(saved.exists)
    hand.settle()
    still = np.asarray(Image.open(saved))
    assert still.shape == (1024, 1024, 4)
    assert still[0, 0, 3] == 0 and still[500, 512, 3] == 255


def test_another_avatar_and_emotion_are_picked_from_their_lists(hand: Hand) -> None:
    assert hand.sink.read().avatar == "ben" and hand.sink.read().emotion is None
    hand.desktop.click(1000, 54)  # the lists drop down: 24 px a row
    hand.settle()
    hand.desktop.click(1000, 143)
    wait_for(lambda: hand.sink.read().avatar == "kofi")
    hand.desktop.click(1200, 54)
    hand.settle()
    hand.desktop.click(1150, 119)
    wait_for(lambda: hand.sink.read().emotion == "happy")


def test_it_shows_what_was_changed_elsewhere(hand: Hand) -> None:
    """Red before: it showed, and went on asking for, what had been picked in it before."""
    hand.settle()
    before = hand.desktop.screenshot()[40:80, 940:].astype(int)
    assert hand.sink.picks() == {}
    hand.sink.show({"avatar": "kofi", "emotion": "bored:0.7", "muted": True})
    hand.settle()
    after = hand.desktop.screenshot()[40:80, 940:]
    assert np.abs(after - before).mean() > 1 and hand.sink.picks() == {}
    hand.desktop.key("m")
    wait_for(lambda: hand.sink.picks() == {"muted": False})
    hand.sink.show({"emotion": "happy:0.5+bored:0.3"})
    hand.settle()
    assert hand.sink.picks() == {} and hand.sink.read().emotion == "happy:0.5+bored:0.3"
    hand.desktop.key("e")
    wait_for(lambda: hand.sink.picks() == {"emotion": None})


def test_dragging_turns_the_head(hand: Hand) -> None:
    before = hand.desktop.screenshot()[200:600, 200:700].astype(int)
    hand.desktop.point(400, 300)
    hand.desktop.press()
    hand.desktop.point(560, 300)
    hand.settle()
    hand.desktop.release()
    hand.settle()
    assert np.abs(hand.desktop.screenshot()[200:600, 200:700] - before).mean() > 5


def test_a_stopped_window_holds_up_no_tick(hand: Hand) -> None:
    process = hand.sink._process.pid  # noqa: SLF001
    os.kill(process, signal.SIGSTOP)
    try:
        hand.tick(3000)  # 100 s of ticks: any queue or pipe would be full long ago
    finally:
        os.kill(process, signal.SIGCONT)
    wait_for(lambda: hand.memory("shown") == hand.posted - 1)


def test_a_failed_recording_takes_the_button_back(hand: Hand) -> None:
    class Broken:
        problem = "No space left on device"

        def __init__(self, folder: Path) -> None: ...
        def append(self, packet: object) -> None: ...
        def close(self) -> None: ...

    hand.sink._tape = Tape(None, Broken)  # noqa: SLF001
    hand.click("record")
    wait_for(lambda: not hand.sink.read().recording and hand.sink._tape.sessions)  # noqa: SLF001
    hand.sink._tape.close()  # noqa: SLF001
    hand.sink._tape = None  # noqa: SLF001
