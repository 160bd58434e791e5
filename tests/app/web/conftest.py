"""What the tests of the page share: a headless Chromium, and a server."""

from collections.abc import Iterator
from typing import Any

import pytest
from browser import chromium
from web_client import Talker, serving

from render.decoder.decoder import Decoder


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as made:
        yield made


@pytest.fixture(scope="session")
def talker(decoder: Decoder) -> Iterator[Talker]:
    """For tests that leave its head and its settings as they are; what needs another one, or lets
    a browser talk to it, has its own."""
    with serving(decoder, microphone=True, sound=True) as made:
        made.tick(30)
        yield made
