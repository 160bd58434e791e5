"""Options of the whole suite, and what tests of more than one package share."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from render.decoder.decoder import Decoder

# Before torch is there, and for the programs that tests start: tests run side by side, and threads
# that wait for a core spin: a test of training took six times as much of the processor.
os.environ.setdefault("OMP_NUM_THREADS", "1")
settings.register_profile("suite", deadline=None)  # a busy machine is slow
settings.load_profile("suite")
# What a shell ignores for us (SIGINT of what runs beside it, SIGHUP under nohup), the programs that
# tests start would ignore, too, and those that tests stop would go on for ever.
for _name, _usual in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    _number = getattr(signal, _name, None)  # Windows has no SIGHUP
    if _number and signal.getsignal(_number) == signal.SIG_IGN:
        signal.signal(_number, _usual)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden",
        action="store_true",
        help="write tests/golden anew from what is drawn now; refuses a dirty tree",
    )


@pytest.fixture(scope="session")
def decoder() -> Decoder:
    """The shipped decoder; loading it takes a second, so a process loads it once."""
    from render.decoder.decoder import Decoder

    return Decoder.load()
