"""What a page sends while it is switched on: begun once, and again after a loss."""

from collections.abc import Iterator
from typing import Any

import pytest
from browser import open_page
from web_client import Talker, serving, wait_until

from render.decoder.decoder import Decoder

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def talker(decoder: Decoder) -> Iterator[Talker]:
    with serving(decoder, microphone=True, gaussians="16k") as made:
        yield made


# A microphone whose permission takes a while, and a list of all that were asked for.
MICROPHONE = """
globalThis.asked = [];
navigator.mediaDevices.getUserMedia = async () => {
  const context = new AudioContext(), out = context.createMediaStreamDestination();
  const tone = new OscillatorNode(context);
  tone.connect(out);
  tone.start();
  asked.push(out.stream.getTracks()[0]);
  await new Promise((done) => setTimeout(done, 300));
  return out.stream;
};
"""


def chunks(talker: Talker) -> int:
    return (talker.count("microphone") or {"chunks": 0})["chunks"]  # type: ignore[index, return-value]


def test_a_microphone_is_there_again_when_livedrive_is(browser: Any, decoder: Decoder) -> None:
    """Red before: after a moment without a network somebody had to press the button."""
    with serving(decoder, microphone=True, gaussians="16k") as first:
        port = int(first.address.rsplit(":", 1)[1].strip("/"))
        page = open_page(browser, first.address, 300, 200, MICROPHONE)
        page.wait_for_selector("#microphone:not([hidden])")
        page.click("#microphone")
        wait_until(lambda: chunks(first) > 200)
    with serving(decoder, port=port, microphone=True, gaussians="16k") as second:
        wait_until(lambda: chunks(second) > 10)
        assert page.text_content("#microphone") == "Microphone on"
        page.click("#microphone")
        wait_until(lambda: page.evaluate("asked.every((t) => t.readyState === 'ended')"))
        page.close()


def test_an_impatient_person_gets_one_microphone(browser: Any, talker: Talker) -> None:
    """Red before: the first of two stayed on, and nobody could switch it off."""
    page, before = open_page(browser, talker.address, 300, 200, MICROPHONE), chunks(talker)
    page.wait_for_selector("#microphone:not([hidden])")
    page.evaluate("for (let k = 0; k < 3; k++) document.getElementById('microphone').click()")
    wait_until(lambda: chunks(talker) > before + 10)
    assert page.evaluate("asked.length") == 1
    page.close()


def test_a_microphone_that_cannot_be_used_is_let_go(browser: Any, talker: Talker) -> None:
    """Red before: it stayed on without a word, and the button did nothing any more."""
    page = open_page(browser, talker.address, 300, 200, MICROPHONE)
    page.wait_for_selector("#microphone:not([hidden])")
    page.evaluate(
        "void (AudioWorklet.prototype.addModule = async () => { throw Error('no sound') })"
    )
    page.click("#microphone")
    wait_until(lambda: page.text_content("#state") == "microphone: no sound")
    assert page.evaluate("asked.map((track) => track.readyState)") == ["ended"]
    assert page.text_content("#microphone") == "Use this microphone"
    page.close()
