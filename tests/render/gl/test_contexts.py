"""What a user reads when OpenGL is missing, and the window under a virtual screen."""

import ctypes.util
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import head_scene

from render.cameras import portrait
from render.gl import contexts
from render.gl.contexts import GLContext, create_context
from render.splats.renderer import create_renderer
from sensors.types import InputError

ROOT = Path(__file__).parents[3]


def hide(monkeypatch, *names: str) -> None:
    find = ctypes.util.find_library
    monkeypatch.setattr(ctypes.util, "find_library", lambda n: None if n in names else find(n))


@pytest.mark.parametrize(
    "backend,library,apt",
    [
        ("egl", "EGL", "apt install libegl1 libgl1 libgl1-mesa-dri"),
        ("osmesa", "OSMesa", "apt install libosmesa6"),
    ],
)
def test_missing_library_names_the_line_to_type(monkeypatch, backend, library, apt):
    hide(monkeypatch, library)
    with pytest.raises(InputError, match=apt):
        create_context(backend)


def test_auto_names_both_ways_out(monkeypatch):
    hide(monkeypatch, "EGL", "OSMesa")
    with pytest.raises(InputError, match="libegl1.*libosmesa6"):
        create_context("auto")


def test_unknown_names_list_the_choices():
    with pytest.raises(InputError, match="egl, osmesa, system, window, got 'vulkan'"):
        create_context("vulkan")
    with pytest.raises(InputError, match="tiles, quads, reference, got 'points'"):
        create_renderer(method="points")


OLD_GL = """
import sys
import numpy as np
from scenes import head_scene, psnr_db
from render.cameras import portrait
from render.splats.renderer import create_renderer

for method in ("auto", "quads"):
    renderer = create_renderer(sys.argv[1], method)
    renderer.draw(head_scene(3000), portrait(200, 136, yaw_deg=20.0))
    print(renderer.name.split()[0], psnr_db(renderer.read_rgba(), np.load(sys.argv[2])) > 45)
    renderer.close()
"""


@pytest.fixture(scope="module")
def oracle(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A file of what OLD_GL is to draw."""
    renderer = create_renderer(method="reference")
    renderer.draw(head_scene(3000), portrait(200, 136, yaw_deg=20.0))
    path = tmp_path_factory.mktemp("oracle") / "picture.npy"
    np.save(path, renderer.read_rgba())
    renderer.close()
    return str(path)


@pytest.mark.slow
@pytest.mark.parametrize("version", ["3.3", "4.1"])  # 4.1 is what macOS has
def test_both_methods_draw_with_an_old_opengl(version, oracle):
    environment = dict(
        os.environ,
        PYTHONPATH=os.pathsep.join((str(ROOT), str(Path(__file__).parents[1]))),
        MESA_GL_VERSION_OVERRIDE=version,
        MESA_GLSL_VERSION_OVERRIDE=version.replace(".", "") + "0",
    )
    command = [sys.executable, "-c", OLD_GL, "egl", oracle]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["tiles True", "quads True"]


def run_window(environment: dict[str, str], *prefix: str) -> subprocess.CompletedProcess[str]:
    script = (
        "from render.gl.contexts import create_context\n"
        "context = create_context('window'); print(context.renderer)\n"
        "context.check_errors('open'); context.close(); context.close()\n"
    )
    command = [*prefix, sys.executable, "-c", script]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)


@pytest.mark.slow
def test_window_opens_on_a_virtual_screen():
    done = run_window(dict(os.environ, PYTHONPATH=str(ROOT)), "xvfb-run", "-a")
    assert done.returncode == 0 and done.stdout.strip(), done.stderr


def test_window_without_a_screen_points_to_xvfb():
    screens = ("DISPLAY", "WAYLAND_DISPLAY")
    environment = {k: v for k, v in os.environ.items() if k not in screens}
    done = run_window(dict(environment, PYTHONPATH=str(ROOT)))
    assert "InputError" in done.stderr and "xvfb-run" in done.stderr


def test_threads_of_a_software_driver_share_the_cpus_in_two_halves():
    script = (
        "import os; from render.gl.contexts import create_context\n"
        "from render.gl.driver_threads import running\n"
        "before = running(); context = create_context('egl'); new = sorted(running() - before)\n"
        "assert context.software and new, (context.renderer, new)\n"
        "sets = [frozenset(os.sched_getaffinity(t)) for t in new]\n"
        "cpus = os.sched_getaffinity(0)\n"
        "if len(cpus) > 1:\n"
        "    assert len(set(sets)) == 2 and sets[0] | sets[1] == cpus, sets\n"
        "assert os.sched_getaffinity(0) == cpus\n"
        "context.close()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_context_of_the_system_draws_as_the_others_do(oracle: str) -> None:
    """On Linux that of a screen; Windows and macOS have no other."""
    command = ["xvfb-run", "-a", sys.executable, "-c", OLD_GL, "system", oracle]
    env = os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'tests' / 'render'}"}
    done = subprocess.run(command, env=env, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.stdout.split()[:2] == ["tiles", "True"], done.stderr


def test_windows_and_macos_open_the_context_of_the_system(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(contexts, "_standalone", lambda *words: asked.extend(words) or gl)
    gl = GLContext(gl=SimpleNamespace(info={"GL_RENDERER": "Apple M2"}), backend="system")  # type: ignore[arg-type]
    assert create_context() is gl and asked == ["system", "OpenGL", {}]
