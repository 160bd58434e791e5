"""One row a scheme of `--eyes`: what is known is opened by its own row, the rest is refused."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from sensors.cameras import spec as specs
from sensors.cameras.spec import CameraSpec, cameras, parse
from sensors.cameras.table import EXAMPLES, HELP, SCHEMES
from sensors.cameras.views import Views
from sensors.clock import ManualClock
from sensors.types import InputError


@pytest.mark.parametrize("text", ["gopher:0", "UVC:0", "uvc", "uvc:", ":0", "https://host:81/"])
def test_an_unknown_scheme_is_refused_naming_the_known(text: str) -> None:
    with pytest.raises(InputError) as error:
        cameras([text], ManualClock())
    assert EXAMPLES in str(error.value)


def test_nothing_falls_through_to_another_scheme(tmp_path: Path) -> None:
    """It was once opened as a session."""
    with pytest.raises(KeyError):
        specs._connect(CameraSpec("gopher", str(tmp_path), Views()), ManualClock(), None)  # noqa: SLF001


@pytest.mark.parametrize("name", SCHEMES)
def test_every_example_reaches_its_own_row(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def opened(target: object, clock: object) -> str:  # stands for the row's own
        return name

    monkeypatch.setitem(SCHEMES, name, replace(SCHEMES[name], open=opened))
    example = SCHEMES[name].example
    assert specs._connect(parse(example), ManualClock(), None) == name  # noqa: SLF001
    assert example in EXAMPLES and example in HELP


def test_readme_names_cameras_that_there_are_and_where_all_are_listed() -> None:
    readme = (Path(__file__).parents[3] / "README.md").read_text()
    (cameras_part,) = re.findall(r"^One `--eyes` shows .*?after a `#`", readme, re.M | re.S)
    named = re.findall(r"`(\w+):", cameras_part)
    assert len(named) >= 5 and set(named) <= set(SCHEMES)
    assert "all: `livedrive run -h`" in cameras_part  # which prints HELP
