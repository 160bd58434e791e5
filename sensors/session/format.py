"""The session folder, format version 1: names, session.json and timeline.jsonl.

session.json    version, created, devices, codecs, calibration and the `closed` marker
audio.wav       48 kHz mono, exactly the samples that arrived (lost sound is only in the timeline)
eye_left.mkv    one picture a packet, 400 x 400; eye_right.mkv likewise; both optional
timeline.jsonl  the truth: one line a packet in order of arrival, times in integer nanoseconds;
                head poses, emotions and requests are in it whole
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from sensors import files, rotation
from sensors.rotation import Vector
from sensors.types import (
    EYE_NAMES,
    EYE_SIZE,
    NS,
    REQUESTS,
    SAMPLE_RATE,
    HeadPose,
    InputError,
    Request,
    check_face,
)

FORMAT = "livedrive-session"
VERSION = 1
CARD_FILE = "session.json"
AUDIO_FILE = "audio.wav"
EYE_FILES = ("eye_left.mkv", "eye_right.mkv")
TIMELINE_FILE = "timeline.jsonl"
MOTION_FILE = "motion.npz"  # of made sessions: the true motion, or that of a phone
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


def end_ns(entry: Entry) -> int:
    """When all of the packet existed: the end of its sound, the time of its picture."""
    if isinstance(entry, AudioEntry):
        return entry.t_ns + entry.num_samples * NS // SAMPLE_RATE
    return entry.t_ns


def new_card(
    created: str,
    devices: Mapping[str, str],
    calibration: Mapping[str, Any],
    eye_codec: str,
    audio_format: str,
) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "version": VERSION,
        "created": created,
        "devices": dict(devices),
        "sample_rate": SAMPLE_RATE,
        "audio_format": audio_format,
        "eye_size": EYE_SIZE,
        "eye_codec": eye_codec,
        "calibration": dict(calibration),
        "closed": False,
    }


def write_card(folder: Path, card: Mapping[str, Any]) -> None:
    """Replace session.json in one step: a kill leaves the old or the new one, never half."""
    files.write_text(folder / CARD_FILE, json.dumps(card, indent=2) + "\n", private=True)


def check_apart(folder: Path, out: Path) -> None:
    """Raises InputError where `out` is the session's folder, or a file of it that is replaced."""
    names = (CARD_FILE, AUDIO_FILE, *EYE_FILES, TIMELINE_FILE, MOTION_FILE)
    if out.resolve() in (folder.resolve(), *(folder.resolve() / name for name in names)):
        raise InputError(
            f"{out}: expected another place than the session's own, got that; choose another name"
        )


def _instead(folder: Path) -> str:
    if folder.is_dir():
        return "a folder without it"
    return "a file" if folder.exists() else "no such folder"


def read_card(folder: Path) -> dict[str, Any]:
    path = folder / CARD_FILE
    if not folder.is_dir() or not files.check_regular(path).exists():
        raise InputError(
            f"{folder} is not a session: expected a folder with {CARD_FILE}, got "
            f"{_instead(folder)}; "
            "make one with: livedrive session create DIR --audio x.wav"
        )
    try:
        found = files.read_json(path)
    except ValueError as error:
        raise InputError(f"{path}: expected JSON, got {error}; restore the file") from None
    card = cast(dict[str, Any], found) if isinstance(found, dict) else {}
    if card.get("format") != FORMAT:
        raise InputError(f'{path}: expected "format": "{FORMAT}", got another file; restore it')
    version = card.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise InputError(f"{path}: expected a whole number as version, got {version!r}; restore it")
    if version > VERSION:
        raise InputError(
            f"{path}: expected session format version {VERSION}, got the newer {version}; "
            "update livedrive to read it"
        )
    for name in ("devices", "calibration", "counts"):
        if not isinstance(card.get(name, {}), dict):
            raise InputError(f"{path}: expected an object as {name}, got another value; restore it")
    return card


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
        stream, counter = f"eye_{EYE_NAMES[entry.eye]}", entry.counter
        fields = {"stream": stream, "t_ns": entry.t_ns, "counter": counter}
        fields["picture"] = entry.picture
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
    picture = _whole(fields["picture"])
    return EyeEntry(_whole(fields["t_ns"]), eye, _whole(fields["counter"]), picture)


def _whole(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"{value!r} is not a whole number")
    if abs(value) > MAX_NUMBER:
        raise ValueError(f"{value} is larger than a time or a count can be")
    return value
