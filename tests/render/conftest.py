"""OpenGL for the tests. No GL is a failure, never a skip."""

import pytest

from render.splats.renderer import wrap_context


@pytest.fixture(scope="session")
def egl_context():
    from render.gl.contexts import create_context

    context = create_context("egl")
    yield context
    context.close()


@pytest.fixture(params=["tiles", "quads"])
def gl_renderer(request, egl_context):
    """Each GL method; the context outlives the test, and GL errors before or after fail it."""
    egl_context.check_errors("before the test")
    yield wrap_context(egl_context, request.param)
    egl_context.check_errors("after the test")


@pytest.fixture
def tiles(egl_context):
    yield wrap_context(egl_context, "tiles")
    egl_context.check_errors("after the test")
