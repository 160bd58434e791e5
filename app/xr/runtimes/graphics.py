"""OpenGL for OpenXR: a context that the runtime can share, and its description.

EGL where the runtime takes it (Monado: no display needed), else GLX on Linux and WGL on Windows.
"""

import ctypes
import ctypes.util
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from app.xr.runtimes.calls import library
from app.xr.runtimes.protocol import NoRuntimeError
from render.gl.contexts import GLContext, create_context

if TYPE_CHECKING:
    import moderngl

OPENGL, EGL = "XR_KHR_opengl_enable", "XR_MNDX_egl_enable"
EGL_CONFIG_ID, EGL_NONE = 0x3028, 0x3038
GLX_FBCONFIG_ID = 0x8013
SRGB8_ALPHA8, RGBA8 = 0x8C43, 0x8058
Pointer = ctypes.c_void_p


def needed(have: set[str]) -> list[str]:
    """Extensions to enable; OPENGL is missing from `have` where the runtime knows no OpenGL."""
    return [OPENGL, EGL] if EGL in have and sys.platform == "linux" else [OPENGL]


def open_context(have: set[str]) -> GLContext:
    if EGL in needed(have):
        return create_context("egl")
    return create_context("system")


def binding(context: GLContext, instance: Any, system: Any) -> Any:
    """The `next` of SessionCreateInfo."""
    xr = library()
    ask = ctypes.cast(
        xr.get_instance_proc_addr(instance, "xrGetOpenGLGraphicsRequirementsKHR"),
        xr.PFN_xrGetOpenGLGraphicsRequirementsKHR,
    )
    ask(instance, system, ctypes.byref(xr.GraphicsRequirementsOpenGLKHR()))  # a session needs it
    context.activate()
    if context.backend == "egl":
        return _egl(xr)
    return _wgl(xr) if sys.platform == "win32" else _glx(xr)


def choose_format(formats: list[int]) -> int:
    """Our values are those of sRGB; a runtime takes texels of RGBA8 for linear light."""
    if SRGB8_ALPHA8 in formats:
        return SRGB8_ALPHA8
    if RGBA8 in formats:
        return RGBA8
    raise NoRuntimeError(
        f"--xr: expected a runtime with pictures of 8 bits, got formats {formats}; try another"
    )


def framebuffer(context: GLContext, texture: int, size: tuple[int, int]) -> "moderngl.Framebuffer":
    """Around a texture of the runtime."""
    context.activate()
    return context.gl.framebuffer([context.gl.external_texture(texture, size, 4, 0, "f1")])


def release(context: GLContext, framebuffers: "Sequence[moderngl.Framebuffer]") -> None:
    """Let go of framebuffers, none of which stays in use: its name would be bound again later."""
    context.activate()
    context.gl.detect_framebuffer(0).use()
    for each in framebuffers:
        each.release()


def _egl(xr: Any) -> Any:
    egl: Any = ctypes.CDLL(ctypes.util.find_library("EGL") or "libEGL.so.1")
    for name in ("eglGetCurrentDisplay", "eglGetCurrentContext"):
        getattr(egl, name).restype = Pointer
    display, context = Pointer(egl.eglGetCurrentDisplay()), Pointer(egl.eglGetCurrentContext())
    number, config, count = ctypes.c_int(), Pointer(), ctypes.c_int()
    egl.eglQueryContext(display, context, EGL_CONFIG_ID, ctypes.byref(number))
    wanted = (ctypes.c_int * 3)(EGL_CONFIG_ID, number, EGL_NONE)
    egl.eglChooseConfig(display, wanted, ctypes.byref(config), 1, ctypes.byref(count))
    found = xr.GraphicsBindingEGLMNDX()
    _fill(found, get_proc_address=ctypes.cast(egl.eglGetProcAddress, Pointer))
    _fill(found, display=display, config=config, context=context)
    return found


def _glx(xr: Any) -> Any:
    glx: Any = ctypes.CDLL(ctypes.util.find_library("GL") or "libGL.so.1")
    for name in ("glXGetCurrentDisplay", "glXGetCurrentContext", "glXChooseFBConfig"):
        getattr(glx, name).restype = Pointer
    glx.glXGetCurrentDrawable.restype = ctypes.c_ulong
    glx.glXChooseFBConfig.argtypes = [Pointer, ctypes.c_int, Pointer, Pointer]
    display, context = Pointer(glx.glXGetCurrentDisplay()), Pointer(glx.glXGetCurrentContext())
    number, count = ctypes.c_int(), ctypes.c_int()
    glx.glXQueryContext(display, context, GLX_FBCONFIG_ID, ctypes.byref(number))
    wanted = (ctypes.c_int * 3)(GLX_FBCONFIG_ID, number, 0)
    configs = glx.glXChooseFBConfig(display, 0, wanted, ctypes.byref(count))
    found = xr.GraphicsBindingOpenGLXlibKHR()
    _fill(found, x_display=display, glx_context=context)
    if configs and count.value:
        first = ctypes.cast(configs, ctypes.POINTER(Pointer))[0]
        _fill(found, glx_fbconfig=Pointer(first))
    found.glx_drawable = glx.glXGetCurrentDrawable()
    return found


def _wgl(xr: Any) -> Any:
    wgl: Any = getattr(ctypes, "windll").opengl32  # noqa: B009
    for name in ("wglGetCurrentDC", "wglGetCurrentContext"):
        getattr(wgl, name).restype = Pointer
    found = xr.GraphicsBindingOpenGLWin32KHR()
    found.h_dc, found.h_glrc = wgl.wglGetCurrentDC(), wgl.wglGetCurrentContext()
    return found


def _fill(structure: Any, **pointers: Pointer) -> None:
    """Set fields whose types are pointers of PyOpenGL's own."""
    kinds: dict[str, Any] = dict(structure._fields_)
    for name, pointer in pointers.items():
        setattr(structure, name, ctypes.cast(pointer, kinds[name]))
