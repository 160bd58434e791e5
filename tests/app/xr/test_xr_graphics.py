"""Framebuffers around a runtime's textures, which come and go with its sessions."""

from collections.abc import Iterator

import pytest

from app.xr.runtimes import graphics
from render.gl.contexts import GLContext, create_context

SIZE = (16, 8)


@pytest.fixture
def context() -> Iterator[GLContext]:
    made = create_context()
    yield made
    made.close()


def test_the_next_session_starts_without_an_error_of_the_last(context: GLContext) -> None:
    textures = [context.gl.texture(SIZE, 4) for _ in range(3)]
    for _ in range(2):
        targets = [graphics.framebuffer(context, texture.glo, SIZE) for texture in textures]
        assert context.gl.error == "GL_NO_ERROR"
        targets[-1].use()
        graphics.release(context, targets)
        assert context.gl.error == "GL_NO_ERROR"
