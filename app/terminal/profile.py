"""The user's settings for `livedrive run`: a TOML file instead of a long command line.

~/.config/livedrive/run.toml holds options by their names, e.g.

    mic = "Beyond"
    eyes = ["usb:35bd:0202"]
    headless = true

What stands on the command line comes after it, and so wins.
"""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from sensors import files, folders
from sensors.types import InputError

NAME = "run.toml"
OVERRULED_BY = {"--headless": "--window", "--window": "--headless"}  # one run cannot be both


def path() -> Path:
    """The user's file."""
    return folders.config() / NAME


def words(file: Path, given: Sequence[str] = ()) -> list[str]:
    """The file as words of a command line, but for those that `given` ones overrule; none where
    there is no file. InputError where it is not TOML, or a value is of no kind that an option
    takes."""
    if not files.check_regular(file).exists():
        return []
    try:
        found = tomllib.loads(files.read_text(file).removeprefix("\ufeff"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{file}: expected TOML, got {error}; mend or remove it") from None
    made: list[str] = []
    for name, value in found.items():
        option = _option(name, value, file)
        if OVERRULED_BY.get(option[0] if option else "") not in given:
            made += option
    return made


def _option(name: str, value: Any, file: Path) -> list[str]:
    shown = str(value)[:40]
    values = cast(list[Any], value) if isinstance(value, list) else [value]
    if value is False:
        return []
    option = f"--{name.replace('_', '-')}"
    if value is True:
        return [option]
    if not values or not all(type(v) in (str, int, float) for v in values):
        raise InputError(
            f"{file}: expected {name} to be a text, a number, true, false or a list of such, got "
            f"{shown!r}; see livedrive run -h"
        )
    return [option, *(str(Path(v).expanduser() if _is_home(v) else v) for v in values)]


def _is_home(value: Any) -> bool:
    return isinstance(value, str) and value.startswith("~/")
