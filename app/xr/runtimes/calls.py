"""What every call to OpenXR shares: the library when it is needed, and its errors in our words."""

import ctypes
import os
from collections.abc import Generator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from app.xr.runtimes.protocol import NoRuntimeError, SessionLostError

INSTALL = "pip install livedrive[xr]"
START = "start SteamVR, Monado or WiVRn and make it the active OpenXR runtime"


def library() -> Any:
    """pyopenxr. Raises NoRuntimeError where it is not installed."""
    os.environ.setdefault("XR_LOADER_DEBUG", "none")  # its errors are told by us
    try:
        return import_module("xr")
    except (ImportError, OSError) as error:
        raise NoRuntimeError(f"--xr: expected pyopenxr, got {error}; run: {INSTALL}") from None


def extensions() -> set[str]:
    """Those that the runtime has. Raises NoRuntimeError where there is none."""
    xr = library()
    try:
        found = xr.enumerate_instance_extension_properties()
    except xr.exception.XrException as error:
        raise NoRuntimeError(
            f"--xr: expected an OpenXR runtime, got none ({_words(error)}); {START}"
        ) from None
    return {each.extension_name.decode() for each in found}


def of_system(instance: Any, system: Any, properties: Any) -> Any:
    """An extension's structure of properties, filled in for the headset that is here."""
    xr = library()
    found = xr.SystemProperties(next=ctypes.cast(ctypes.pointer(properties), ctypes.c_void_p))
    xr.raw_functions.xrGetSystemProperties(instance, system, ctypes.byref(found))
    return properties


@contextmanager
def told() -> Generator[None]:
    """Errors of OpenXR as SessionLostError: whatever it was, another session may do."""
    xr = library()
    try:
        yield
    except xr.exception.FormFactorUnavailableError:
        raise SessionLostError("the headset is away or asleep") from None
    except (xr.exception.InstanceLostError, xr.exception.SessionLostError):
        raise SessionLostError("the runtime has gone") from None
    except xr.exception.XrException as error:
        raise SessionLostError(f"the runtime says: {_words(error)}") from None


def _words(error: Exception) -> str:
    return " ".join(str(error).split()).rstrip(".")
