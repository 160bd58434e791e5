"""Opening sound and films of others through PyAV, and what is told where that fails."""

from pathlib import Path
from typing import Any

from sensors.types import InputError


def check_there(path: Path, what: str) -> None:
    """Raises InputError unless it is a file; `what` it is to be, e.g. "a sound file"."""
    if not path.is_file():
        got = "a folder" if path.is_dir() else "no such file"
        raise InputError(f"{path}: expected {what}, got {got}; check the name")


def opened(path: Path, what: str, give: str) -> Any:
    """A container to read; raises InputError, which tells to `give` another, where it is none."""
    import av
    from av import error as av_error

    try:
        return av.open(str(path), metadata_errors="replace")
    except (av_error.FFmpegError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error).splitlines()[0]
        raise InputError(
            f"{path}: expected {what}, got something else, or one that is cut off ({reason}); "
            f"give {give}"
        ) from None
