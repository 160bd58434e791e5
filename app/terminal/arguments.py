"""Types of options: without a default, or whole numbers of a range."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

import tyro

from sensors.types import LOOPBACK, InputError


def optional(metavar: str, text: str | None = None) -> object:
    """An option without a default value: its help names none, not `{None}|PATH (default: None)`."""
    return tyro.conf.arg(metavar=metavar, help=text, help_behavior_hint="")


File = Annotated[Path | None, optional("PATH")]
Number = Annotated[int | None, optional("N")]
Amount = Annotated[float | None, optional("N")]
Name = Annotated[str | None, optional("NAME")]
Port = Annotated[int | None, optional("PORT")]


def _whole(
    least: int, most: float = float("inf")
) -> tyro.constructors.PrimitiveConstructorSpec[int]:
    def read(words: list[str]) -> int:
        number = int(words[0])
        if not least <= number <= most:
            wanted = f"{least} or more" if most == float("inf") else f"{least}..{most}"
            raise ValueError(f"expected {wanted}, got {number}")
        return number

    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="INT",
        instance_from_str=read,
        is_instance=lambda value: isinstance(value, int),
        str_from_instance=lambda value: [str(value)],
    )


Whole = Annotated[int, _whole(0)]
Seed = Whole
Count = Annotated[int, _whole(1)]
Listening = Annotated[int, _whole(0, 65535)]


def check_taken(
    given: Any, taken_by: Mapping[str, Sequence[str]], action: str, actions: str
) -> None:
    """Raise InputError for an option of the dataclass `given` that this action does not take.

    taken_by: option -> the actions that take it; actions: what they are called."""
    for field in fields(given):
        takers = taken_by.get(field.name, (action,))
        if action not in takers and getattr(given, field.name) != field.default:
            raise InputError(
                f"--{field.name.replace('_', '-')}: expected one of the {actions} "
                f"{', '.join(takers)}, got {action}; leave it away"
            )


def check_host(host: str, web: int | None) -> None:
    """Raise InputError for no address, or one without a page that would listen there."""
    if not host.strip("[] "):  # a script's empty variable; it would mean every address
        raise InputError(f"--host: expected an address, got {host!r}; try --host {LOOPBACK}")
    if host != LOOPBACK and web is None:
        raise InputError(
            f"--host {host}: expected a page that listens there, got no --web; add --web 8443"
        )
