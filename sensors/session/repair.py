"""Repair of a session whose recording was killed: keep what is whole, say what was lost.

Flow: Recording (open) -> repair, when session.json lacks its `closed` marker.
The media are written before their timeline line, so only lines without media have to go: the
picture per eye that the container still held, and perhaps half a line at the end.
"""

import sys
from pathlib import Path
from typing import Any, BinaryIO

from sensors import files
from sensors.session import format as fmt
from sensors.session.eye_video import count_pictures
from sensors.session.timeline import AudioEntry, Entry, EyeEntry, entry_line, read_timeline
from sensors.session.wav import repair_header
from sensors.types import EYE_NAMES, InputError

HELD = 1 << 40  # byte of the timeline that is locked on Windows, where nobody can read what is


def repair(folder: Path, card: dict[str, Any]) -> dict[str, Any]:
    """Mend the files of an interrupted recording and return its new, closed card."""
    timeline, audio = folder / fmt.TIMELINE_FILE, folder / fmt.AUDIO_FILE
    for path in (timeline, audio):
        if not files.check_regular(path).exists():
            raise InputError(f"{path}: expected a file of the session, got none; restore it")
    try:
        with files.open_regular(timeline, update=True) as file:
            if not lock(file):
                raise InputError(
                    f"{folder}: expected a finished session, got one that is being recorded; "
                    "stop the recording first"
                )
            if sys.platform == "win32":
                file.close()  # what is open there cannot be replaced
            return _mend(folder, card)
    except PermissionError as error:
        raise InputError(
            f"{folder}: expected to repair an interrupted recording, got no permission to write "
            f"({error.filename}); make the folder writable"
        ) from None


def lock(timeline: BinaryIO | Any) -> bool:
    """Hold the session for as long as `timeline` is open; False if another process holds it."""
    try:
        if sys.platform == "win32":
            import msvcrt

            timeline.seek(HELD)
            msvcrt.locking(timeline.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(timeline.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):  # of Linux and macOS, and of Windows
        return False
    return True


def _mend(folder: Path, card: dict[str, Any]) -> dict[str, Any]:
    entries = read_timeline(folder, closed=False)
    num_samples = repair_header(folder / fmt.AUDIO_FILE)
    counts = {"audio": num_samples}
    pictures = [0, 0]
    for eye, name in enumerate(fmt.EYE_FILES):
        if files.check_regular(folder / name).exists():
            pictures[eye] = count_pictures(folder / name)
            counts[f"eye_{EYE_NAMES[eye]}"] = pictures[eye]
    kept: list[Entry] = []
    for entry in entries:
        if isinstance(entry, AudioEntry):
            whole = entry.offset + entry.num_samples <= num_samples
        elif isinstance(entry, EyeEntry):
            whole = entry.picture < pictures[entry.eye]
        else:
            whole = True
        if whole:
            kept.append(entry)
    lines = b"".join(map(entry_line, kept))
    files.write_bytes(folder / fmt.TIMELINE_FILE, lines, private=True)
    lost = {"packets_lost_in_repair": len(entries) - len(kept)}
    card = card | {"counts": counts, "closed": True, "repaired": True} | lost
    fmt.write_card(folder, card)
    return card
