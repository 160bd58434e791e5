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
