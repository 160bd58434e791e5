"""The timeline of a session: its entries, one a packet, their lines, and how many there are.

Flow: RecordingWriter -> entry_line, count -> timeline.jsonl, session.json -> read_timeline,
check_counts -> Recording.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sensors import files, rotation
from sensors.rotation import Vector
from sensors.session.format import CARD_FILE, TIMELINE_FILE
from sensors.types import (
    EYE_NAMES,
    NS,
    REQUESTS,
    SAMPLE_RATE,
    HeadPose,
    InputError,
    Request,
    check_face,
)

MAX_NUMBER = 1 << 62


@dataclass(frozen=True, slots=True)
class AudioEntry:
    """One audio packet: its samples are [offset, offset + num_samples) of audio.wav."""

    t_ns: int
    first_sample: int
    num_samples: int
    offset: int
    gap: bool


@dataclass(frozen=True, slots=True)
class EyeEntry:
    """One eye packet: its image is picture number `picture` of that eye's video."""

    t_ns: int
    eye: int
    counter: int
    picture: int


@dataclass(frozen=True, slots=True)
class EmotionEntry:
    """One emotion packet; all of it is in the timeline."""

    t_ns: int
    words: str


@dataclass(frozen=True, slots=True)
class RequestEntry:
    """One request packet; all of it is in the timeline."""

    t_ns: int
    wanted: Request


@dataclass(frozen=True, slots=True)
class HeadEntry:
    """One head packet; all of it is in the timeline."""

    t_ns: int
    pose: HeadPose
    valid: bool
    gaze: Vector | None = None
    face: tuple[float, ...] | None = None


Entry = AudioEntry | EyeEntry | EmotionEntry | RequestEntry | HeadEntry

COUNTED = {EmotionEntry: "emotion", RequestEntry: "request", HeadEntry: "head"}
KINDS = {
    "audio": "samples of sound",
    "emotion": "emotions",
    "request": "requests",
    "head": "poses of the head",
}


def end_ns(entry: Entry) -> int:
    """When all of the packet existed: the end of its sound, the time of its picture."""
    if isinstance(entry, AudioEntry):
        return entry.t_ns + entry.num_samples * NS // SAMPLE_RATE
    return entry.t_ns


def entry_line(entry: Entry) -> bytes:
    """The timeline line of one packet."""
    if isinstance(entry, AudioEntry):
        fields: dict[str, Any] = {
            "stream": "audio",
            "t_ns": entry.t_ns,
            "first_sample": entry.first_sample,
            "num_samples": entry.num_samples,
            "offset": entry.offset,
            "gap": entry.gap,
        }
    elif isinstance(entry, EmotionEntry):
        fields = {"stream": "emotion", "t_ns": entry.t_ns, "words": entry.words}
    elif isinstance(entry, RequestEntry):
        fields = {"stream": "request", "t_ns": entry.t_ns, "wanted": entry.wanted}
    elif isinstance(entry, HeadEntry):
        fields = {
            "stream": "head",
            "t_ns": entry.t_ns,
            "position": entry.pose.position,
            "quat": entry.pose.quat,
            "valid": entry.valid,
        }
        fields |= {} if entry.gaze is None else {"gaze": entry.gaze}
        fields |= {} if entry.face is None else {"face": entry.face}
    else:
        fields = {
            "stream": f"eye_{EYE_NAMES[entry.eye]}",
            "t_ns": entry.t_ns,
            "counter": entry.counter,
            "picture": entry.picture,
        }
    return json.dumps(fields, separators=(",", ":")).encode() + b"\n"


def read_timeline(folder: Path, *, closed: bool) -> list[Entry]:
    """All entries in order of arrival. Unless `closed`, an unfinished last line is left out."""
    path = folder / TIMELINE_FILE
    if not files.check_regular(path).exists():
        raise InputError(f"{path}: expected the session's timeline, got no file; restore it")
    entries: list[Entry] = []
    with files.open_regular(path) as lines:
        for number, line in enumerate(lines, 1):
            if not line.endswith(b"\n") and not closed:
                break
            try:
                entries.append(_entry(files.parse_json(line)))
            except (ValueError, KeyError, TypeError, OverflowError) as error:
                raise InputError(
                    f"{path}: expected one packet a line, got a bad line {number} "
                    f"({type(error).__name__}: {error}); restore the file"
                ) from None
    return entries


def count(counts: dict[str, int], entry: Entry) -> None:
    """Add one line, of sound its samples, under the names of the card."""
    if isinstance(entry, AudioEntry):
        name, number = "audio", entry.num_samples
    elif isinstance(entry, EyeEntry):
        name, number = f"eye_{EYE_NAMES[entry.eye]}", 1
    else:
        name, number = COUNTED[type(entry)], 1
    counts[name] = counts.get(name, 0) + number


def check_counts(folder: Path, card: Mapping[str, Any], entries: Iterable[Entry]) -> None:
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
                f"{folder / TIMELINE_FILE}: expected {expected} {what}, as {CARD_FILE} "
                f"counts, got {found.get(name, 0)}; restore the file"
            )


def _entry(fields: dict[str, Any]) -> Entry:
    stream = fields["stream"]
    if stream == "audio":
        first, num, offset = fields["first_sample"], fields["num_samples"], fields["offset"]
        t_ns, gap = _whole(fields["t_ns"]), bool(fields["gap"])
        entry: Entry = AudioEntry(t_ns, _whole(first), num, offset, gap)
        if _whole(num) < 0 or _whole(offset) < 0:
            raise ValueError("negative count")
        return entry
    if stream == "emotion":
        return EmotionEntry(_whole(fields["t_ns"]), str(fields["words"]))
    if stream == "request":
        return RequestEntry(_whole(fields["t_ns"]), REQUESTS[REQUESTS.index(fields["wanted"])])
    if stream == "head":
        pose = rotation.checked(fields["position"], fields["quat"])
        gaze = rotation.direction(fields["gaze"]) if "gaze" in fields else None
        face = check_face(fields["face"]) if "face" in fields else None
        return HeadEntry(_whole(fields["t_ns"]), pose, bool(fields["valid"]), gaze, face)
    eye = ("eye_left", "eye_right").index(stream)
    if (picture := _whole(fields["picture"])) < 0:
        raise ValueError("negative picture")
    return EyeEntry(_whole(fields["t_ns"]), eye, _whole(fields["counter"]), picture)


def _whole(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"{value!r} is not a whole number")
    if abs(value) > MAX_NUMBER:
        raise ValueError(f"{value} is larger than a time or a count can be")
    return value
