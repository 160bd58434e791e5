"""The terminal: words may come from outside, so they are shown as they are, never as markup."""

from typing import Any


def one_line(text: str) -> str:
    """Words from anywhere as one line that steers no terminal: what is not printable is escaped."""
    line = " ".join(text.split())
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)


def console(width: int | None = None) -> Any:
    """A rich Console that reads no markup: a server's "[/bold]" is a word like any other."""
    from rich.console import Console

    return Console(width=width, markup=False, emoji=False, highlight=False)


def numbers(*headings: str) -> Any:
    """A rich Table: names on the left, numbers on the right of their columns."""
    from rich.table import Column, Table

    first, *others = headings
    return Table(Column(first), *(Column(heading, justify="right") for heading in others))
