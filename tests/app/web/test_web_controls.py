"""What a person at the page may change (avatar, emotion, mute): checked, shared, told the loop."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from browser import open_page
from web_client import Talker, play, serving, socket_to, wait_until

from app.drive.controls import Controls, WithPage
from app.web.cloud import CloudReader
from app.web.messages import Picks
from render.decoder.decoder import Decoder

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def talker(decoder: Decoder) -> Iterator[Talker]:
    with serving(decoder) as made:
        made.link.say(emotions=["happy", "sad"])
        made.tick(3)
        yield made


class Panel:
    """A window in which somebody picks."""

    def __init__(self) -> None:
        self.now = Controls(avatar="ben")

    def read(self) -> Controls:
        return self.now


def test_what_was_changed_last_holds() -> None:
    panel, picks = Panel(), list[dict[str, Any]]()
    both = WithPage(panel, lambda: picks.pop() if picks else {}, "ben")
    assert both.read() == panel.now
    picks.append({"emotion": "sad", "muted": True})
    assert both.read() == Controls(avatar="ben", emotion="sad", muted=True)
    panel.now = Controls(avatar="ben", emotion="happy", recentred=1)
    assert both.read() == Controls(avatar="ben", emotion="happy", muted=True, recentred=1)
    picks.append({"emotion": None})
    assert both.read() == Controls(avatar="ben", muted=True, recentred=1)
    alone = WithPage(None, lambda: {"avatar": "ada"}, "ben")
    assert alone.read() == Controls(avatar="ada")


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
        b'{"emotion": {"happy": 1}}',
    ],
)
def test_what_cannot_be_picked_is_refused(data: bytes) -> None:
    picks = Picks("ben", ["ada", "ben"])
    picks.emotions = ["happy"]
    with pytest.raises(ValueError):
        picks.read(data)
    assert picks.read(b'{"emotion": "happy:0.5"}') == {"emotion": "happy:0.5"}


def test_picks_reach_the_loop_and_every_page(talker: Talker) -> None:
    async def work() -> None:
        async with (
            aiohttp.ClientSession() as session,
            socket_to(talker, "head", max_msg_size=0) as ws,
        ):
            address, before = f"{talker.address}controls", await ws.receive_bytes()
            asked = {"avatar": "ada", "emotion": "sad:0.5", "muted": True}
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
    assert talker.link.picks() == {"avatar": "ada", "emotion": "sad:0.5", "muted": True}
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
