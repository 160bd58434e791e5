"""What is said of an address where nothing can listen."""

import errno

from sensors.types import LOOPBACK, InputError

_TAKEN = (errno.EADDRINUSE, errno.EACCES)  # by somebody else, or for those with more rights


def cannot_listen(what: str, host: str, port: int, error: Exception) -> InputError:
    """`what`, an option or a command, met `error` when it was to listen at `host`:`port`."""
    why = getattr(error, "strerror", None) or error
    cure = f"choose an address of this machine, e.g. {LOOPBACK} or 0.0.0.0"
    if isinstance(error, OverflowError) or getattr(error, "errno", 0) in _TAKEN:
        cure = "choose another port"
    return InputError(f"{what}: expected to listen at {host}:{port}, got: {why}; {cure}")
