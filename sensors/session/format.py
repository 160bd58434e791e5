"""The session folder, format version 1: its files, and session.json.

session.json    version, created, devices, codecs, calibration and the `closed` marker
audio.wav       48 kHz mono, exactly the samples that arrived (lost sound is only in the timeline)
eye_left.mkv    one picture a packet, 400 x 400; eye_right.mkv likewise; both optional
timeline.jsonl  the truth: one line a packet in order of arrival, times in integer nanoseconds;
                head poses, emotions and requests are in it whole
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from sensors import files
from sensors.types import EYE_SIZE, SAMPLE_RATE, InputError

FORMAT = "livedrive-session"
VERSION = 1
CARD_FILE = "session.json"
AUDIO_FILE = "audio.wav"
EYE_FILES = ("eye_left.mkv", "eye_right.mkv")
TIMELINE_FILE = "timeline.jsonl"
MOTION_FILE = "motion.npz"  # of made sessions: the true motion, or that of a phone


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


def write_card(folder: Path, card: Mapping[str, Any], *, durable: bool = True) -> None:
    """Replace session.json in one step: a kill leaves the old or the new one, never half. Without
    `durable` it is not waited for."""
    text = json.dumps(card, indent=2) + "\n"
    files.write_text(folder / CARD_FILE, text, private=True, durable=durable)


def free_beside(folder: Path) -> Path:
    """FOLDER-001, or the first number after it that is not taken."""
    number = 1
    while (free := folder.with_name(f"{folder.name}-{number:03d}")).exists():
        number += 1
    return free


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
            f"{_instead(folder)}; make one with: livedrive session create DIR --audio x.wav"
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
