"""What tyro says of words that it cannot use, as one line: what, expected, got, what to type.

Its boxes speak of Python's types, and of None, which nobody can type.
"""

import re
from collections.abc import Sequence
from itertools import pairwise

from sensors.types import InputError

NUMBERS = {
    r"invalid literal for int\(\) with base 10: (.*)": "expected a whole number, got {}",
    r"could not convert string to float: (.*)": "expected a number, got {}",
}


def check_empty(words: Sequence[str]) -> None:
    """Raise InputError for an empty value, a script's empty variable: as a path it would be the
    current folder."""
    for before, word in pairwise(words):
        option = word[:-1] if re.fullmatch(r"--[\w-]+=", word) else ""
        if word == "" or option:
            name = option or (before if before.startswith("--") else "")
            what, rest = (f"{name}: ", f" {name}") if name else ("", " it")
            raise InputError(f"{what}expected a value, got an empty word; leave{rest} away")


def one_line(
    box: str,  # as tyro prints it
    command: str,  # that was typed, without options: avatar show; or empty
) -> str:
    """Without the next command, but for the name of an option that is nearly what was typed."""
    place = f"{command}: " if command else ""
    lines = [line.strip("│ ") for line in box.splitlines()[1:]]  # without its title
    parts = re.split(r"(?:^|\n)[─╰╯-]+(?:\n|$)", "\n".join(lines))
    said = [" ".join(part.split()) for part in parts if part.strip()]
    first, *others = said or ["expected other words"]
    other = " ".join(others)
    if found := re.match(r"Error parsing (\S+): (.*)", first):
        return f"{found[1]}: {_value(found[2])}"
    if found := re.match(
        r"invalid choice '(.*)' for argument '(.*)'\. Expected one of (.*)", first
    ):
        choices = sorted({*re.findall(r"'(.*?)'", found[3])} - {"None"})
        return f"{found[2]}: expected {', '.join(choices)}, got {found[1]!r}"
    if found := re.match(r"Missing value for argument '(.*)'\.", first):
        if found[1].startswith("-"):
            return f"{found[1]}: expected a value after it, got none"
        return f"{place}expected {found[1].removeprefix('command.')}, got none"
    if found := re.match(r"Expected one of \{(.*)\}", first):
        return f"{place}expected {found[1]}, got none"
    if found := re.match(r"Missing from [\w -]+: (.*)", first):
        needed = [_needed(part) for part in found[1].split("(required)") if part.strip()]
        got = re.search(r"Unrecognized options: (.*?)( For full|$)", other)
        return f"{place}expected {' and '.join(needed)}, got {got[1] if got else 'none'}"
    if first.startswith("Unrecognized"):
        return f"{place}{_unknown(first, other, _near(box, command))}"
    return first


def _value(why: str) -> str:
    """Of several reasons the last that is not about None."""
    for reason in re.split(r" ?- <class '[\w.]+'>: ", why):
        if "choices ('None',)" not in reason:
            why = reason
    for pattern, words in NUMBERS.items():
        if found := re.fullmatch(pattern, why):
            return words.format(found[1])
    return why


def _needed(part: str) -> str:
    """An option as it is typed; of a word without a name what it is."""
    first, _, rest = part.strip().partition(" ")
    if first.startswith("-"):
        return f"{first} {rest.partition(' ')[0]}"
    return (rest[:1].lower() + rest[1:]).rstrip(". ")


def _near(box: str, command: str) -> str:
    """The option of this command that is nearly what was typed; tyro looks at all commands'."""
    option = ""
    for line in box.splitlines():
        if line[1:].startswith("     --"):  # the box has a side of its own, or on ASCII a space
            option = line.strip("│ ").split()[0]
        elif line.strip("│ ") == f"in livedrive {command} --help":
            return option
    return ""


def _unknown(first: str, other: str, near: str) -> str:
    got = " ".join(re.findall(r"(\S+) \(applied to", first) or first.split(": ")[1].split(", "))
    if near and near not in got.split():
        return f"expected an option that it has, got {got}; did you mean {near}?"
    choices = re.search(r"Available subcommands: ([\w, -]+?)( [A-Z]|$)", other)
    return f"expected {choices[1] if choices else 'an option that it has'}, got {got}"
