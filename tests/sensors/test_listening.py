"""An address where nothing can listen is told with what to choose anew."""

import errno
import os
import socket

import pytest

from sensors.listening import cannot_listen


def failure(number: int) -> OSError:
    return OSError(number, os.strerror(number))


@pytest.mark.parametrize(
    ("error", "cure"),
    [
        (failure(errno.EADDRINUSE), "choose another port"),
        (failure(errno.EACCES), "choose another port"),
        (OverflowError("bind(): port must be 0-65535."), "choose another port"),
        (failure(errno.EADDRNOTAVAIL), "choose an address of this machine"),
        (socket.gaierror(-2, "Name or service not known"), "choose an address of this machine"),
        (TypeError("encoding of hostname failed"), "choose an address of this machine"),
    ],
)
def test_what_to_choose_anew_follows_from_the_error(error: Exception, cure: str) -> None:
    said = str(cannot_listen("--head", "10.0.0.1", 80, error))
    assert said.startswith("--head: expected to listen at 10.0.0.1:80, got: ") and cure in said
    assert "None" not in said


def test_the_address_is_told_once_and_the_option_is_named() -> None:
    """Red before: "got: error while attempting to bind on address ('0.0.0.0', 80): ..."."""
    long = "error while attempting to bind on address ('0.0.0.0', 80): address already in use"
    error = OSError(errno.EADDRINUSE, long)
    said = str(cannot_listen("call host", "0.0.0.0", 80, error, "--port"))
    assert said.count("0.0.0.0") == 1
    assert said.endswith("Address already in use; choose another port with --port")
