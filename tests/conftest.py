"""Options of the whole suite."""

import pytest
from hypothesis import settings

settings.register_profile("suite", deadline=None)  # a busy machine is slow
settings.load_profile("suite")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden",
        action="store_true",
        help="write tests/golden anew from what is drawn now; refuses a dirty tree",
    )
