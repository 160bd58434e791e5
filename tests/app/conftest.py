"""What many tests of the app share: one person, a renderer."""

from collections.abc import Iterator

import pytest
from web_client import AVATAR

from render.decoder import identity
from render.decoder.identity import Identity
from render.splats.renderer import create_renderer
from render.types import Renderer


@pytest.fixture(scope="session")
def who() -> Identity:
    return identity.load(AVATAR)


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    made = create_renderer()
    yield made
    made.close()
