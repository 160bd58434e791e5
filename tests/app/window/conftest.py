"""What the tests of the window share: a virtual screen."""

from collections.abc import Iterator

import pytest
from desktop import Desktop, open_desktop

from app.window.state.layout import SIZE


@pytest.fixture(scope="module")
def desktop() -> Iterator[Desktop]:
    with open_desktop(*SIZE) as made:
        yield made
