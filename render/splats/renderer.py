"""One door to all splat renderers: `create_renderer(backend, method)`."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from render.gl.contexts import ContextLostError, GLContext, create_context
from render.splats.reference import ReferenceRenderer
from render.types import Camera, Gaussians, Renderer
from sensors.types import InputError

METHODS = ("auto", "tiles", "quads", "reference")


def create_renderer(backend: str = "auto", method: str = "auto") -> Renderer:
    """Open a renderer that owns its GL context.

    "auto" takes instanced quads on a GPU and, where the CPU would draw these, compiled loops over
    tiles; "reference" is the slow numpy oracle and needs no GL at all.
    """
    if method not in METHODS:
        raise InputError(
            f"render method: expected one of {', '.join(METHODS)}, got {method!r}; try auto"
        )
    if method == "reference":
        return ReferenceRenderer()
    return SteadyRenderer(lambda: wrap_context(create_context(backend), method))


class SteadyRenderer:
    """Survives the loss of its context: opens another and draws the last picture again."""

    def __init__(self, make: Callable[[], Renderer]) -> None:
        self._make, self._inner = make, make()
        self._last: tuple[Gaussians, Camera] | None = None
        self.recoveries = 0

    @property
    def name(self) -> str:
        """What draws."""
        return self._inner.name

    @property
    def dropped(self) -> int:
        """Gaussians of the last draw that are NaN, infinite, without size or transparent."""
        return self._inner.dropped

    def draw(self, gaussians: Gaussians, camera: Camera) -> None:
        """Draw one picture; its size is that of the camera."""
        self._last = gaussians, camera
        self._inner.draw(gaussians, camera)

    def read_rgba(self) -> NDArray[np.uint8]:
        """The last picture [H, W, 4]; alpha is coverage, the colours lie over the background."""
        try:
            return self._inner.read_rgba()
        except ContextLostError:
            if self._last is None:
                raise
            self._inner.close()
            self._inner = self._make()
            self.recoveries += 1
            self._inner.draw(*self._last)
            return self._inner.read_rgba()

    def close(self) -> None:
        """Free everything; may be called twice."""
        self._inner.close()


def wrap_context(context: GLContext, method: str = "auto") -> Renderer:
    """A renderer on a context that is already open; closing it closes the context."""
    if method == "tiles" or (method == "auto" and context.software):
        from render.splats.tiles import TileRenderer

        return TileRenderer(context)
    from render.splats.quads import QuadRenderer

    return QuadRenderer(context)
