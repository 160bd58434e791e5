"""Why a camera cannot be had, in plain words, and the command that tells which there are."""

import errno
import socket

from sensors.picture import CameraLostError

LIST, LIST_NETWORK = "livedrive devices", "livedrive devices --network"
GONE, TAKEN, FORBIDDEN = "it is not there", "another program has it", "no permission to use it"
NO_WAY = "no way leads to that address"
WORDS = {
    errno.ENOENT: GONE,
    errno.ENODEV: GONE,
    errno.ENXIO: GONE,
    errno.EBUSY: TAKEN,
    errno.EAGAIN: TAKEN,  # an exclusive serial port
    errno.EACCES: FORBIDDEN,
    errno.EPERM: FORBIDDEN,
    errno.ENOTTY: "it is no camera",
    errno.EIO: "it does not answer",
    errno.ECONNREFUSED: "nothing answers at that port",
    errno.EHOSTUNREACH: NO_WAY,
    errno.ENETUNREACH: NO_WAY,
}


def lost(
    error: BaseException, command: str = LIST, otherwise: str = "it cannot be opened"
) -> CameraLostError:
    """What to raise where a camera has failed like this; `otherwise`: words for what has none."""
    if isinstance(error, socket.gaierror):
        words = "nobody knows a machine of that name"
    elif isinstance(error, TimeoutError):
        words = "no answer"
    else:
        words = WORDS.get(getattr(error, "errno", None) or 0, " ".join(otherwise.split()))
    return CameraLostError(f"{words}; see: {command}")
