"""The window's context draws what EGL draws, for both methods."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import head_scene

from render.cameras import portrait
from render.splats.renderer import wrap_context

ROOT = Path(__file__).parents[3]
SCRIPT = """
import sys
import numpy as np
from render.cameras import portrait
from render.gl.contexts import create_context
from render.splats.renderer import wrap_context
from scenes import head_scene

context = create_context("window")
for method in ("tiles", "quads"):
    renderer = wrap_context(context, method)
    renderer.draw(head_scene(3000), portrait(200, 136, yaw_deg=20.0))
    np.save(f"{sys.argv[1]}/{method}.npy", renderer.read_rgba())
context.check_errors("window")
context.close()
"""


@pytest.fixture(scope="module")
def in_window(tmp_path_factory) -> Path:
    """A folder with what a window drew: a process of its own, as contexts do not mix."""
    folder = tmp_path_factory.mktemp("window")
    command = ["xvfb-run", "-a", sys.executable, "-c", SCRIPT, str(folder)]
    path = os.pathsep.join((str(ROOT), str(Path(__file__).parents[1])))
    environment = dict(os.environ, PYTHONPATH=path)
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize("method", ["tiles", "quads"])
def test_the_window_draws_what_egl_draws(method, egl_context, in_window):
    renderer = wrap_context(egl_context, method)
    renderer.draw(head_scene(3000), portrait(200, 136, yaw_deg=20.0))
    ours, theirs = renderer.read_rgba().astype(int), np.load(in_window / f"{method}.npy")
    assert ours.std() > 20
    assert np.abs(ours - theirs).max() <= 1
