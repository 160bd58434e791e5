"""The page of a calibration: its dot stands where the routine says, on a screen or in a headset."""

from collections.abc import Iterator
from math import radians, tan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import headset, open_page, screenshot
from web_client import Talker, serving, wait_until

from render.decoder.decoder import Decoder

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
LEFT = {"name": "look", "yaw_deg": 15, "pitch_deg": 0, "words": "look 15 degrees left"}
DOWN = {"name": "look", "yaw_deg": 0, "pitch_deg": -12, "words": "look 12 degrees down"}
SHUT = {"name": "close", "yaw_deg": 0, "pitch_deg": 0, "words": "close your eyes"}


@pytest.fixture(scope="module")
def talker(decoder: Decoder) -> Iterator[Talker]:
    with serving(decoder, targets=True, gaussians="16k") as made:
        yield made


def test_on_a_screen_it_is_where_an_eye_60_cm_away_looks(browser: Any, talker: Talker) -> None:
    page = open_page(browser, talker.address, 1400, 1200)
    page.wait_for_selector("#start:not([hidden])")
    assert not talker.count("watching")
    page.click("#start")
    wait_until(lambda: talker.count("watching") == 1)
    for target, (x, y) in ((LEFT, (-tan(radians(15)), 0)), (DOWN, (0, tan(radians(12))))):
        talker.link.say(target=target)
        wait_until(lambda words=target["words"]: page.text_content("#state") == words)
        box = page.locator("#target").bounding_box()
        found = (box["x"] + box["width"] / 2 - 700, box["y"] + box["height"] / 2 - 600)
        assert found == pytest.approx((x * 2270, y * 2270), abs=2)
    talker.link.say(target=SHUT)
    page.wait_for_selector("#target", state="hidden")
    assert page.problems == []
    page.close()
    wait_until(lambda: talker.count("watching") == 0)


def test_a_page_that_stays_open_serves_the_next_calibration(browser: Any, decoder: Decoder) -> None:
    """Red before: its button was gone, and the next one waited for ever."""
    with serving(decoder, targets=True, gaussians="16k") as first:
        port = int(first.address.rsplit(":", 1)[1].strip("/"))
        page = open_page(browser, first.address, 900, 400)
        page.wait_for_selector("#start:not([hidden])")
        page.click("#start")
        wait_until(lambda: first.count("watching") == 1)
        assert page.is_hidden("#start")
    wait_until(lambda: page.text_content("#state") == "stopped: back to the terminal")
    with serving(decoder, targets=True, port=port, gaussians="16k") as second:
        page.click("#start")
        wait_until(lambda: second.count("watching") == 1)
        page.close()


def test_in_a_headset_it_goes_with_the_head(browser: Any, talker: Talker) -> None:
    page = open_page(browser, f"{talker.address}?bare", 512, 256, headset(ROOT))
    wait_until(lambda: not page.evaluate("document.getElementById('start').hidden"))
    page.evaluate("document.getElementById('vr').click()")
    wait_until(lambda: talker.count("watching") == 1)
    page.evaluate("device.quaternion.set(0, 0.38, 0, 0.92)")  # the dot is where the eyes look
    for target in (LEFT, DOWN):
        talker.link.say(target=target)
        wait_until(lambda: bool(white(screenshot(page))))
        focal = page.evaluate("1 / Math.tan(device.fovy / 2)") * 128  # px
        x = -tan(radians(target["yaw_deg"])) * focal
        y = -tan(radians(target["pitch_deg"])) * focal
        wait_until(lambda x=x, y=y: np.allclose(white(screenshot(page)), [x, y, x, y], atol=3))
        talker.link.say(target=SHUT)
        wait_until(lambda: not white(screenshot(page)))
    page.close()


def white(picture: np.ndarray) -> list[float]:
    """The middle of what is white, from the middle of each eye's picture, in px; [] without it."""
    found: list[float] = []
    for eye in np.split(picture, 2, axis=1):
        rows, columns = np.nonzero(eye.min(2) > 240)
        if not len(rows):
            return []
        found += [columns.mean() - 127.5, rows.mean() - 127.5]
    return found
