"""Eye calibrations on disk: the user's profile for live runs, the session for its replay."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from sensors import files, folders
from sensors.session.format import CARD_FILE
from sensors.types import InputError

if TYPE_CHECKING:
    from encoder.driver import Driver
    from encoder.eyes.calibration import EyeCalibration
    from sensors.session.recording import Recording


def profile_path() -> Path:
    """The user's file."""
    return folders.config() / "eyes.json"


def of_user(path: Path | None = None) -> "EyeCalibration | None":
    """What `livedrive calibrate` saved; None where there is nothing."""
    from encoder.eyes.calibration import EyeCalibration

    path = path or profile_path()
    return EyeCalibration.load(path) if path.is_file() else None


def check_writable(path: Path) -> None:
    """Before the work that makes a calibration. Raises InputError where `path` cannot be one."""
    files.check_folder(path.parent, "calibrate", "choose a file with --out FILE")
    files.check_regular(path)


def keep(calibration: "EyeCalibration", path: Path) -> None:
    """Write the user's file; what it held is kept beside it, for `undo`."""
    before = _before(path)
    before.unlink(missing_ok=True)
    if path.is_file():
        files.write_bytes(before, files.read_bytes(path), private=True)
    calibration.save(path)


def undo(path: Path) -> bool:
    """What was before the last `keep`, or `undo`; False where that is no calibration at all."""
    before = _before(path)
    if not path.is_file() and not before.is_file():
        raise InputError(
            f"calibrate --undo: expected a calibration in {path}, got none; "
            "make one with livedrive calibrate --eyes SPEC"
        )
    found, spare = before.is_file(), path.with_name(f"{path.stem}.undone{path.suffix}")
    if path.is_file():
        path.replace(spare)
    if found:
        before.replace(path)
    if spare.is_file():
        spare.replace(before)
    return found


def _before(path: Path) -> Path:
    return path.with_name(f"{path.stem}.before{path.suffix}")


def of_session(recording: "Recording") -> "EyeCalibration | None":
    """What the session was recorded with, so that its replay sees the same eyes."""
    from encoder.eyes.calibration import EyeCalibration

    kept: Any = recording.card.get("calibration")
    words: Any = kept.get("eyes") if isinstance(kept, dict) else None  # pyright: ignore
    if not isinstance(words, dict):
        return None
    cure = f"restore {CARD_FILE}, or take its calibration of eyes out, to replay without"
    return EyeCalibration.from_json(words, f"of {recording.folder}", cure)  # pyright: ignore


def in_session(driver: "Driver") -> dict[str, Any]:
    """For the session's card."""
    return {"eyes": driver.calibration.to_json()} if driver.calibration else {}
