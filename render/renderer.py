"""One door to all splat renderers: `create_renderer(backend, method)`."""

from render.contexts import GLContext, create_context
from render.errors import InputError
from render.reference import ReferenceRenderer
from render.types import Renderer

METHODS = ("auto", "tiles", "quads", "reference")


def create_renderer(backend: str = "auto", method: str = "auto") -> Renderer:
    """Open a renderer that owns its GL context.

    "auto" takes compute tiles where the CPU draws and instanced quads on a GPU; "reference" is
    the slow numpy oracle and needs no GL at all.
    """
    if method not in METHODS:
        raise InputError(
            f"render method: expected one of {', '.join(METHODS)}, got {method!r}; try auto"
        )
    if method == "reference":
        return ReferenceRenderer()
    return wrap_context(create_context(backend), method)


def wrap_context(context: GLContext, method: str = "auto") -> Renderer:
    """A renderer on a context that is already open; closing it closes the context."""
    if method == "tiles" or (method == "auto" and context.software):
        from render.splat_tiles import TileRenderer

        return TileRenderer(context)
    from render.splat_quads import QuadRenderer

    return QuadRenderer(context)
