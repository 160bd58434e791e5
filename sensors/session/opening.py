"""Opening sound and films of others through PyAV, and what is told where that fails."""

from pathlib import Path
from typing import Any

from sensors.types import InputError

# Seconds by which a stream may begin later than its file: with less it begins with it, and with
# more the times are no times.
LEAST_LATE_S, MOST_LATE_S = 0.04, 60.0


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


def start_s(container: Any, stream: Any) -> float:
    """How much later a stream begins than the first one of its file."""
    if stream.start_time is None or container.start_time is None:
        return 0.0
    late = float(stream.start_time * stream.time_base) - container.start_time / 1e6
    return late if LEAST_LATE_S < late < MOST_LATE_S else 0.0
