"""Types of options without a default: their help would read `{None}|PATH (default: None)`."""

from pathlib import Path
from typing import Annotated

import tyro


def optional(metavar: str, text: str | None = None) -> object:
    """An option without a default value: its help names none."""
    return tyro.conf.arg(metavar=metavar, help=text, help_behavior_hint="")


File = Annotated[Path | None, optional("PATH")]
Number = Annotated[int | None, optional("N")]
Amount = Annotated[float | None, optional("N")]
Name = Annotated[str | None, optional("NAME")]
Port = Annotated[int | None, optional("PORT")]


def _at_least(least: int) -> tyro.constructors.PrimitiveConstructorSpec[int]:
    def read(words: list[str]) -> int:
        number = int(words[0])
        if number < least:
            raise ValueError(f"expected {least} or more, got {number}")
        return number

    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="INT",
        instance_from_str=read,
        is_instance=lambda value: isinstance(value, int),
        str_from_instance=lambda value: [str(value)],
    )


Seed = Annotated[int, _at_least(0)]
Count = Annotated[int, _at_least(1)]
