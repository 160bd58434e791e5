"""OpenGL contexts: EGL (no display needed), OSMesa (no driver needed), the system's, a window's.

One interface for all: `create_context(backend)` gives a GLContext whose `gl` is a moderngl
context. Keep to one backend in a process; OSMesa and a hardware driver do not mix well.
"""

import ctypes
import ctypes.util
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from render.gl import driver_threads
from sensors.types import InputError

if TYPE_CHECKING:
    import moderngl

BACKENDS = ("auto", "egl", "osmesa", "system", "window")
VERSION = 330  # of OpenGL and of the shaders; macOS has 4.1
SOFTWARE_NAMES = ("llvmpipe", "softpipe", "swrast", "swr")

DRIVER = "install the driver of the graphics card"
CURES = {
    "egl": "run: apt install libegl1 libgl1 libgl1-mesa-dri",
    "osmesa": "run: apt install libosmesa6",
    "system": DRIVER,
    "window": "run: apt install libgl1 libgl1-mesa-dri xvfb" if sys.platform == "linux" else DRIVER,
}


class ContextLostError(RuntimeError):
    """The driver lost the context (GPU reset, suspended laptop): open another."""


@dataclass
class GLContext:
    """A current OpenGL context; the renderers see no difference between the backends."""

    gl: "moderngl.Context"
    backend: str  # egl | osmesa | system | window
    window: Any = None  # the glfw window of osmesa (invisible) and window

    @property
    def renderer(self) -> str:
        """The driver's own name, e.g. "llvmpipe (LLVM 15.0.6, 256 bits)"."""
        return str(self.gl.info["GL_RENDERER"])

    @property
    def software(self) -> bool:
        """True if the CPU draws."""
        return any(name in self.renderer.lower() for name in SOFTWARE_NAMES)

    def activate(self) -> None:
        """Make this the current context: another one may have been opened or closed since."""
        self.gl.__enter__()

    def check_errors(self, where: str) -> None:
        """Raise if any GL call since the last check has failed; ContextLostError if all will."""
        error = self.gl.error
        if error == "GL_UNKNOWN_ERROR":  # moderngl's word for GL_CONTEXT_LOST, which it lacks
            raise ContextLostError(f"{where}: the GL context of {self.renderer} was lost")
        if error != "GL_NO_ERROR":
            raise RuntimeError(f"{where}: {error} on {self.renderer}")

    def close(self) -> None:
        """Release the context; may be called twice."""
        if self.window is None:
            self.gl.release()
        else:
            import glfw

            glfw.destroy_window(self.window)
            glfw.terminate()
            self.window = None


def free(target: "moderngl.Framebuffer") -> None:
    """Delete what was drawn into, which does not happen by itself. Another must be in use before
    the next one is made, as that binds the last in use again."""
    for part in (*target.color_attachments, target.depth_attachment, target):
        if part is not None:
            part.release()


class _GlfwLoader:
    """What moderngl asks of a foreign context: function addresses from glfw."""

    def __init__(self, window: Any) -> None:
        self._window = window

    def load_opengl_function(self, name: str) -> int:
        import glfw

        return ctypes.cast(glfw.get_proc_address(name), ctypes.c_void_p).value or 0

    def __enter__(self) -> "_GlfwLoader":
        import glfw

        glfw.make_context_current(self._window)
        return self

    def __exit__(self, *_: object) -> None: ...

    def release(self) -> None: ...


def create_context(backend: str = "auto", size: tuple[int, int] = (512, 512)) -> GLContext:
    """Open a context; `size` matters to "window" only.

    "auto" takes EGL, else OSMesa; on Windows (WGL) and macOS (CGL) that of the system. Raises
    InputError where there is none.
    """
    if backend not in BACKENDS:
        raise InputError(
            f"GL backend: expected one of {', '.join(BACKENDS)}, got {backend!r}; try auto"
        )
    others = driver_threads.running()
    context = _create(backend, size)
    if context.software:
        driver_threads.spread(driver_threads.running() - others)
    return context


def _create(backend: str, size: tuple[int, int]) -> GLContext:
    if backend == "egl":
        return _create_egl()
    if backend == "osmesa":
        return _create_osmesa()
    if backend == "window":
        return _create_window(size)
    if backend == "system" or sys.platform != "linux":
        return _standalone("system", "OpenGL", {})
    try:
        return _create_egl()
    except InputError as no_egl:
        try:
            return _create_osmesa()
        except InputError as no_osmesa:
            raise InputError(f"no OpenGL: {no_egl}; or: {no_osmesa}") from no_osmesa


def _missing(backend: str, what: str, got: object) -> InputError:
    return InputError(f"{what}: expected OpenGL 3.3, got {got}; {CURES[backend]}")


def _create_egl() -> GLContext:
    for library in ("EGL", "GL"):
        if ctypes.util.find_library(library) is None:
            raise _missing("egl", "EGL", f"no lib{library}")
    return _standalone("egl", "EGL", {"backend": "egl"})


def _standalone(backend: str, what: str, settings: dict[str, Any]) -> GLContext:
    """A context without a window of ours, with the settings of moderngl."""
    import moderngl

    try:
        gl = moderngl.create_standalone_context(require=VERSION, **settings)
    except Exception as error:  # moderngl raises bare Exception for every failure
        raise _missing(backend, what, error) from error
    return GLContext(gl, backend)


def _create_osmesa() -> GLContext:
    if ctypes.util.find_library("OSMesa") is None:
        raise _missing("osmesa", "OSMesa", "no libOSMesa")
    import glfw

    glfw.init_hint(glfw.PLATFORM, glfw.PLATFORM_NULL)
    hints = {
        glfw.CONTEXT_CREATION_API: glfw.OSMESA_CONTEXT_API,
        glfw.VISIBLE: glfw.FALSE,
    }
    return _create_glfw("osmesa", hints, (16, 16))


def _create_window(size: tuple[int, int]) -> GLContext:
    import glfw

    glfw.init_hint(glfw.PLATFORM, glfw.ANY_PLATFORM)
    hints = {
        glfw.OPENGL_FORWARD_COMPAT: glfw.TRUE,  # macOS gives no other
        glfw.RESIZABLE: glfw.TRUE,
        glfw.SCALE_TO_MONITOR: glfw.TRUE,
        glfw.TRANSPARENT_FRAMEBUFFER: glfw.TRUE,  # where the desktop can do that
    }
    return _create_glfw("window", hints, size)


def _create_glfw(backend: str, hints: dict[int, int], size: tuple[int, int]) -> GLContext:
    import glfw
    import moderngl

    glfw.ERROR_REPORTING = "ignore"  # errors are read below, not printed
    window = None
    try:
        if glfw.init():
            for hint, value in hints.items():
                glfw.window_hint(hint, value)
            glfw.window_hint(glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE)
            glfw.window_hint(glfw.CONTEXT_VERSION_MAJOR, VERSION // 100)
            glfw.window_hint(glfw.CONTEXT_VERSION_MINOR, VERSION // 10 % 10)
            window = glfw.create_window(*size, "livedrive", None, None)
        if not window:
            message = glfw.get_error()[1] or b"no window"
            text = message.decode() if isinstance(message, bytes) else message
            if backend == "window":
                text += " (without a screen, start the command under xvfb-run)"
            raise _missing(backend, f"glfw {backend}", text)
        glfw.make_context_current(window)
        gl = moderngl.create_context(require=VERSION, context=_GlfwLoader(window))  # pyright: ignore[reportArgumentType] (stub is wrong)
    except InputError:
        glfw.terminate()
        raise
    except Exception as error:  # moderngl raises bare Exception
        glfw.terminate()
        raise _missing(backend, f"glfw {backend}", error) from error
    return GLContext(gl, backend, window)
