"""OpenXrRuntime: instance, system and graphics context of a real runtime."""

import contextlib
from typing import TYPE_CHECKING, Any

from app.xr.runtimes import graphics
from app.xr.runtimes.calls import START, extensions, library, of_system, told
from app.xr.runtimes.face import FACE, Face, sees_faces
from app.xr.runtimes.gaze import GAZE, Gaze
from app.xr.runtimes.protocol import NoRuntimeError
from app.xr.runtimes.session import OpenXrSession
from app.xr.runtimes.times import TIMES, XrNow
from sensors.types import Clock

if TYPE_CHECKING:
    from render.gl.contexts import GLContext

HEADLESS = "XR_MND_headless"
API = (1, 0, 34)  # what every runtime of today speaks


class OpenXrRuntime:
    """Keeps the graphics context from session to session."""

    def __init__(self, headless: bool, clock: Clock) -> None:
        self._headless, self._clock = headless, clock
        self._context: GLContext | None = None

    def open(self) -> OpenXrSession:
        xr, have = library(), extensions()
        needed = [HEADLESS] if self._headless else graphics.needed(have)
        missing = [name for name in needed if name not in have]
        if missing:
            other = "--xr auto" if self._headless else "--xr headless"
            raise NoRuntimeError(
                f"--xr: expected a runtime with {' and '.join(missing)}, got one without; "
                f"try {other}, or another runtime"
            )
        names = needed + [name for name in (*TIMES, GAZE, FACE) if name in have]
        instance = _instance(names)
        try:
            with told():
                system = xr.get_system(
                    instance, xr.SystemGetInfo(xr.FormFactor.HEAD_MOUNTED_DISPLAY)
                )
                binding: Any = None
                if not self._headless:
                    self._context = self._context or graphics.open_context(have)
                    binding = graphics.binding(self._context, instance, system)
                gaze = Gaze(instance) if GAZE in have and _sees_eyes(instance, system) else None
                face = Face(instance) if FACE in have and sees_faces(instance, system) else None
                now = XrNow(instance, names, self._clock)
                return OpenXrSession(instance, system, self._context, binding, now, gaze, face)
        except BaseException:
            with contextlib.suppress(xr.exception.XrException):
                xr.destroy_instance(instance)
            raise


def describe() -> str:
    """Name and version of the runtime that is here. Raises NoRuntimeError."""
    xr = library()
    extensions()
    instance = _instance([])
    try:
        found = xr.get_instance_properties(instance)
        return f"{found.runtime_name.decode()} {xr.Version(found.runtime_version)}"
    finally:
        xr.destroy_instance(instance)


def _instance(names: list[str]) -> Any:
    xr = library()
    application = xr.ApplicationInfo("livedrive", 1, "livedrive", 1, xr.Version(*API))
    try:
        return xr.create_instance(
            xr.InstanceCreateInfo(enabled_extension_names=names, application_info=application)
        )
    except xr.exception.XrException as error:
        raise NoRuntimeError(
            f"--xr: expected an OpenXR runtime that answers, got: {error}; {START}"
        ) from None


def _sees_eyes(instance: Any, system: Any) -> bool:
    """Whether the headset that is here tracks eyes."""
    eyes = of_system(instance, system, library().SystemEyeGazeInteractionPropertiesEXT())
    return bool(eyes.supports_eye_gaze_interaction)
