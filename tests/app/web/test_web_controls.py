"""What a person at the page may change (avatar, emotion, mute): checked, shared, told the loop."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from browser import open_page
from web_client import Talker, play, serving, socket_to, wait_until

from app.web.cloud import CloudReader
from app.web.messages import Picks
from render.decoder.decoder import Decoder

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def talker(decoder: Decoder) -> Iterator[Talker]:
    with serving(decoder, gaussians="16k") as made:
        made.link.say(emotions=["happy", "sad"])
        made.tick(3)
        yield made


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"[]",
        b"[" * 1000,
        b'{"closed": true}',
        b'{"muted": 1}',
        b'{"avatar": "../../etc/passwd"}',
        b'{"avatar": ["ben"]}',
        b'{"emotion": "furious"}',
        b'{"emotion": "happy:2"}',
        b'{"emotion": "happy:nan"}',
        b'{"emotion": "happy:"}',  # red before: it ended the run
        b'{"emotion": {"happy": 1}}',
    ],
)
def test_what_cannot_be_picked_is_refused(data: bytes) -> None:
    picks = Picks("ben", ["ada", "ben"])
    picks.emotions = ["happy"]
    with pytest.raises(ValueError):
        picks.read(data)
    assert picks.read(b'{"emotion": "happy:0.5"}') == {"emotion": "happy:0.5"}


def test_a_page_sees_no_folder_of_this_machine() -> None:
    """Red before: whoever opened it read where the driver's own avatar lies."""
    mine = "/home/anna/avatars/avatar_me.safetensors"
    picks = Picks(mine, ["ada", "ben"])
    assert picks.offers["avatars"] == ["ada", "ben", "me"] and picks.offers["avatar"] == "me"
    assert picks.read(b'{"avatar": "me"}') == {"avatar": mine}
    with pytest.raises(ValueError):
        picks.read(json.dumps({"avatar": mine}).encode())
    ours = Picks("/x/avatar_ben.safetensors", ["ada", "ben"])
    assert ours.offers["avatars"] == ["ada", "ben", "ben (a file)"]


def test_picks_reach_the_loop_and_every_page(talker: Talker) -> None:
    asked: dict[str, Any] = {"emotion": "sad:0.5", "muted": True}

    async def work() -> None:
        async with (
            aiohttp.ClientSession() as session,
            socket_to(talker, "head", max_msg_size=0) as ws,
        ):
            address, before = f"{talker.address}controls", await ws.receive_bytes()
            now = (await (await session.get(f"{talker.address}offers")).json())["controls"]
            asked["avatar"] = next(name for name in now["avatars"] if name != now["avatar"])
            assert (await session.post(address, json=asked)).status == 200
            while (data := await ws.receive_bytes())[0] != before[0]:
                pass  # ticks of the head that was shown before
            CloudReader().read(data)
            assert data != before
            told = (await (await session.get(f"{talker.address}offers")).json())["controls"]
            assert {k: told[k] for k in asked} == asked and told["emotions"] == ["happy", "sad"]
            for body, headers, status in (
                (b'{"avatar": "nobody"}', {}, 400),
                (b" " * 5000, {}, 413),
                (b'{"muted": false}', {"Origin": "https://evil.example"}, 403),
            ):
                got = await session.post(address, data=body, headers=headers)
                assert got.status == status
            flood = [(await session.post(address, json={"muted": True})).status for _ in range(60)]
            assert 429 in flood

    play(work)
    assert talker.link.picks() == asked
    assert talker.link.picks() == {}


def test_a_person_picks_at_the_page(browser: Any, talker: Talker, tmp_path: Path) -> None:
    page = open_page(browser, talker.address, 900, 400)
    page.wait_for_selector("#mute:not([hidden])")
    talker.link.picks()
    page.select_option("#emotion", "happy")
    wait_until(lambda: talker.link.picks().get("emotion", "").startswith("happy:"))
    page.fill("#intensity", "0.25")
    wait_until(lambda: talker.link.picks() == {"emotion": "happy:0.25"})
    pressed = page.get_attribute("#mute", "aria-pressed") == "true"
    page.click("#mute")
    wait_until(lambda: talker.link.picks() == {"muted": not pressed})
    page.select_option("#avatar", "kofi")
    wait_until(lambda: talker.link.picks() == {"avatar": "kofi"})
    assert page.is_visible("#intensity") and page.problems == []
    page.screenshot(path=tmp_path / "page.png")
    page.close()


def test_a_page_shows_what_was_changed_elsewhere(browser: Any, talker: Talker) -> None:
    """Red before: it said "Muted" where the window had unmuted, and showed another avatar."""
    link, page = talker.link, open_page(browser, talker.address, 900, 400)

    def shows(avatar: str, emotion: str, muted: str) -> None:
        ids = "['avatar', 'emotion', 'mute']"
        wanted = [avatar, emotion, muted]
        read = f"{ids}.map((id) => (({{ value, textContent }}) => value || (id === 'mute' ?"
        read += " textContent : ''))(document.getElementById(id)))"
        wait_until(lambda: page.evaluate(read) == wanted)

    page.wait_for_selector("#mute:not([hidden])")
    link.say(controls={"avatar": "ada", "emotion": "sad:0.5", "muted": True})
    shows("ada", "sad", "Muted")
    link.say(controls={"avatar": "nobody"})
    link.say(controls={"emotion": "happy:0.5+sad:0.2", "muted": False})
    shows("ada", "happy:0.5+sad:0.2", "Mute")
    assert page.is_hidden("#intensity")
    link.say(controls={"emotion": "happy:0.5+sad"})  # red before: as happy alone
    shows("ada", "happy:0.5+sad", "Mute")
    link.picks()
    page.select_option("#emotion", "happy")
    wait_until(lambda: link.picks().get("emotion", "").startswith("happy:"))
    shows("ada", "happy", "Mute")
    wait_until(lambda: page.is_visible("#intensity"))  # once the page is told of its own pick
    assert page.problems == []
    page.close()


def test_what_cannot_be_changed_is_told_for_a_while(browser: Any, talker: Talker) -> None:
    """Red before: "not changed" stood there until the page was loaded anew."""
    page = open_page(browser, talker.address, 900, 400)
    page.wait_for_selector("#mute:not([hidden])")
    before = page.text_content("#mute")
    page.evaluate(
        "void (fetch = ((real) => (what, how) => real(what, how && { ...how, body: 'x' }))(fetch))"
    )
    page.click("#mute")
    wait_until(lambda: "not changed" in page.text_content("#state"))
    wait_until(lambda: page.text_content("#state").startswith("frame"))
    assert page.text_content("#mute") == before
    page.close()


def test_a_page_that_stays_open_shows_the_next_run(browser: Any, decoder: Decoder) -> None:
    """Red before: it said "Muted" of a run that was not."""
    with serving(decoder, gaussians="16k") as first:
        port = int(first.address.rsplit(":", 1)[1].strip("/"))
        page = open_page(browser, first.address, 900, 400)
        page.wait_for_selector("#mute:not([hidden])")
        page.click("#mute")
        wait_until(lambda: page.text_content("#mute") == "Muted")
    wait_until(lambda: page.text_content("#state").startswith("waiting"))
    with serving(decoder, port=port, microphone=True, gaussians="16k") as second:
        second.tick()
        wait_until(lambda: page.text_content("#mute") == "Mute")
        assert page.is_visible("#microphone")
        page.close()
