"""The voices of a call at the page: what the call plays is heard there, late by a little."""

from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest
from browser import open_page
from web_client import Talker, play, socket_to, wait_until

from app.commands.meet.call import Join
from app.web.link import SOUND, TICK
from sensors.types import InputError

pytestmark = pytest.mark.slow

BLOCK = (16_000 * np.sin(2 * np.pi * 10 * np.arange(480) / 480)).astype("<i2").tobytes()


def test_blocks_reach_every_listener_as_they_are(talker: Talker) -> None:
    assert len(SOUND + BLOCK) != TICK.itemsize  # how the server tells them apart

    async def work() -> None:
        async with socket_to(talker, "sound") as one, socket_to(talker, "sound") as other:
            talker.link.hear(BLOCK)
            assert await one.receive_bytes() == await other.receive_bytes() == BLOCK

    play(work)


def test_the_page_plays_them(browser: Any, talker: Talker) -> None:
    page = open_page(browser, talker.address, 900, 300)
    page.wait_for_selector("#sound:not([hidden])")
    page.click("#sound")
    end = monotonic() + 60

    def heard() -> bool:
        for _ in range(20):
            talker.link.hear(BLOCK)
            sleep(0.01)
        return page.evaluate("livedrive.sound.level") > 0.4

    while not heard():
        assert monotonic() < end, "nothing was heard"
    page.click("#sound")
    wait_until(lambda: page.get_attribute("#sound", "aria-pressed") == "false")
    assert page.problems == []
    page.close()


def test_without_a_page_it_is_one_line() -> None:
    with pytest.raises(InputError, match="add --web 8443"):
        Join(invite="livedrive://127.0.0.1:1/#x", speaker="web", headless=True).run()
