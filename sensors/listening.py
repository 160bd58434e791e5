"""What is said of an address where nothing can listen."""

import errno
import os
import socket
import sys

from sensors.types import LOOPBACK, InputError

_TAKEN = (errno.EADDRINUSE, errno.EACCES)  # by somebody else, or for those with more rights


def cannot_listen(
    what: str, host: str, port: int, error: Exception, option: str = ""
) -> InputError:
    """`what`, an option or a command, met `error` when it was to listen at `host`:`port`; `option`:
    the one that sets the port, where `what` is not it."""
    cure = f"choose an address of this machine, e.g. {LOOPBACK} or 0.0.0.0"
    if isinstance(error, OverflowError) or getattr(error, "errno", 0) in _TAKEN:
        cure = "choose another port" + (f" with {option}" if option else "")
    said = f"{what}: expected to listen at {host}:{port}, got: {_why(error)}; {cure}"
    return InputError(said)


def _why(error: Exception) -> object:
    """In the system's words: Python's servers add the address, which is told already."""
    if isinstance(error, OSError) and sys.platform != "win32":
        number = 0 if isinstance(error, socket.gaierror) else error.errno  # whose are others
        if number in errno.errorcode:
            return os.strerror(number or 0)
    return getattr(error, "strerror", None) or error
