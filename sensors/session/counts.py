"""What the card of a session counts, and whether its timeline holds as much.

Flow: RecordingWriter -> count -> session.json; Recording -> check_counts.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from sensors.session import format as fmt
from sensors.session.format import AudioEntry, EmotionEntry, EyeEntry, HeadEntry, RequestEntry
from sensors.types import EYE_NAMES, InputError

NAMES = {EmotionEntry: "emotion", RequestEntry: "request", HeadEntry: "head"}
KINDS = {
    "audio": "samples of sound",
    "emotion": "emotions",
    "request": "requests",
    "head": "poses of the head",
}


def count(counts: dict[str, int], entry: fmt.Entry) -> None:
    """Add one line, of sound its samples, under the names of the card."""
    if isinstance(entry, AudioEntry):
        name, number = "audio", entry.num_samples
    elif isinstance(entry, EyeEntry):
        name, number = f"eye_{EYE_NAMES[entry.eye]}", 1
    else:
        name, number = NAMES[type(entry)], 1
    counts[name] = counts.get(name, 0) + number


def check_counts(folder: Path, card: Mapping[str, Any], entries: Iterable[fmt.Entry]) -> None:
    """Raises InputError where the timeline holds other than the card counted when it was closed.

    A repaired card counts the media, which may hold more than the lines that were saved.
    """
    if card.get("repaired"):
        return
    found: dict[str, int] = {}
    for entry in entries:
        count(found, entry)
    for name, expected in card.get("counts", {}).items():
        if found.get(name, 0) != expected:
            what = KINDS.get(name, f"pictures of {name}")
            raise InputError(
                f"{folder / fmt.TIMELINE_FILE}: expected {expected} {what}, as {fmt.CARD_FILE} "
                f"counts, got {found.get(name, 0)}; restore the file"
            )
