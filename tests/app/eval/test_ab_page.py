"""The page of `eval ab` in a browser, without a network: votes are kept, each study's its own."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import chromium
from PIL import Image

from app.eval.ab import make_page, tally
from app.sinks.video import film

pytestmark = pytest.mark.slow


def study(folder: Path, kind: str, *levels: int) -> str:
    """The address of a page with pictures or films of two grey levels a pair."""
    for side, level in zip("ab", levels, strict=True):
        (folder / side).mkdir(parents=True)
        for pair in range(2):
            grey = np.full((64, 64, 3), level + pair, np.uint8)
            if kind == "png":
                Image.fromarray(grey).save(folder / side / f"{pair}.png")
            else:
                sound = np.zeros(16000, np.int16)
                film(folder / side / f"{pair}.mp4", [grey] * 30, sound, 16000)
    make_page(folder / "a", folder / "b", folder / "ab.html", seed=0)
    return (folder / "ab.html").as_uri()


@pytest.fixture
def visitor() -> Iterator[Any]:
    with chromium() as browser:
        yield browser.new_context(offline=True, accept_downloads=True).new_page()


def test_votes_survive_a_reload_and_are_saved_to_be_counted(tmp_path: Path, visitor: Any) -> None:
    visitor.goto(study(tmp_path, "png", 50, 200))
    back = visitor.get_by_role("button", name="Back")
    assert back.is_disabled()
    visitor.get_by_role("button", name="Right").click()
    back.click()  # a slip is taken back
    visitor.get_by_role("button", name="Left").press("Enter")
    visitor.locator("#count", has_text="2 of 2").wait_for()  # a busy browser answers later
    visitor.reload()
    assert visitor.inner_text("#count") == "2 of 2"
    visitor.get_by_role("button", name="Right").click()
    assert visitor.inner_text("#count") == "Done. Thank you!"
    # Red before: the question of films, two empty ones and a button that plays them.
    assert visitor.locator("video:visible, img:visible, #question:visible").count() == 0
    buttons = visitor.locator("button:visible").all_inner_texts()
    assert buttons == ["Back", "Save votes"]
    with visitor.expect_download() as download:
        visitor.get_by_role("button", name="Save votes").click()
    download.value.save_as(tmp_path / "votes.json")
    votes = json.loads((tmp_path / "votes.json").read_text())["votes"]
    assert sorted(vote["name"] for vote in votes) == ["0.png", "1.png"]
    assert [vote["side"] for vote in votes] == ["left", "right"]
    assert "A's share" in tally((tmp_path / "votes.json",))[0]


def test_another_study_of_the_same_names_begins_anew(tmp_path: Path, visitor: Any) -> None:
    """Red before: it was over at once, with the votes of the first."""
    visitor.goto(study(tmp_path / "one", "png", 50, 200))
    visitor.get_by_role("button", name="Left").click()
    visitor.goto(study(tmp_path / "two", "png", 50, 100))
    assert visitor.inner_text("#count") == "1 of 2"


def test_films_play_in_turn_however_often_that_is_asked_for(tmp_path: Path, visitor: Any) -> None:
    """Red before: asked during the second film, both played at once."""
    visitor.goto(study(tmp_path, "mp4", 50, 200))
    visitor.get_by_role("button", name="Play both").click()
    visitor.wait_for_function("right.currentTime > 0.1 && !right.paused")
    visitor.get_by_role("button", name="Play both").click()
    visitor.wait_for_function("left.currentTime > 0.1")
    assert visitor.evaluate("[left.paused, right.paused]") == [False, True]
