"""The wheel: it holds weights, page and shaders, and runs from any folder as any user."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parent.parent
INSIDE = ("encoder/weights/", "render/weights/", "render/shaders/", "app/web/page/")
NOBODY = 65534
# root becomes somebody else, who may read the packages of this environment and write nowhere
ANOTHER = f"setpriv --reuid={NOBODY} --regid={NOBODY} --clear-groups".split()
ANOTHER += ["--inh-caps=-all,+dac_read_search", "--ambient-caps=-all,+dac_read_search"]
BUILD = "import sys; from setuptools import build_meta as b; getattr(b, sys.argv[1])(sys.argv[2])"


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sdist")
    source = folder / "source"  # building leaves files beside the source
    for package in ("app", "sensors", "encoder", "render"):
        unwanted = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, source / package, ignore=unwanted)
    for name in ("pyproject.toml", "README.md", "LICENSE", "NOTICE"):
        shutil.copy(ROOT / name, source)
    build("build_sdist", folder, source)
    return only(folder, "livedrive-*.tar.gz")


@pytest.fixture(scope="module")
def wheel(sdist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """From the source distribution, which then has all that it takes."""
    folder = tmp_path_factory.mktemp("wheel")
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    build("build_wheel", folder, folder / sdist.name.removesuffix(".tar.gz"))
    return only(folder, "livedrive-*.whl")


def build(hook: str, to: Path, source: Path) -> None:
    """As pip and other front ends do it, in the folder of the source."""
    words = [sys.executable, "-c", BUILD, hook, to]
    subprocess.run(words, cwd=source, check=True, capture_output=True)


def only(folder: Path, pattern: str) -> Path:
    (made,) = folder.glob(pattern)
    sys.stdout.write(f"\n{made.name}: {made.stat().st_size / 1e6:.1f} MB\n")
    return made


def data_files(folder: str) -> set[str]:
    kept = {path for path in (ROOT / folder).rglob("*") if path.is_file()}
    return {str(p.relative_to(ROOT)) for p in kept if "__pycache__" not in p.parts}


def test_it_holds_all_that_a_run_reads(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if "dist-info" not in name}
    for folder in INSIDE:
        assert data_files(folder) <= names
    assert "encoder/eyes/gaze_graph.npz" in names
    assert not [name for name in names if name.startswith(("tests/", "recordings/"))]


def test_another_user_runs_it_where_nothing_but_the_home_can_be_written(
    wheel: Path, tmp_path: Path
) -> None:
    installed, empty, home = wheel.parent / "installed", tmp_path / "empty", tmp_path / "home"
    words = ["install", "--quiet", "--no-deps", "--no-compile"]
    words += ["--target", str(installed), str(wheel)]
    subprocess.run([sys.executable, "-m", "pip", *words], check=True)
    home.mkdir()
    empty.mkdir()
    for path in (*installed.rglob("*"), installed, empty):
        path.chmod(path.stat().st_mode & ~0o222)
    other = ANOTHER if os.geteuid() == 0 else []
    if other:
        os.chown(home, NOBODY, NOBODY)
    environment = os.environ | {"PYTHONPATH": str(installed), "HOME": str(home)}

    def livedrive(*words: str) -> "subprocess.CompletedProcess[str]":
        script = str(installed / "bin" / "livedrive")
        return subprocess.run(
            [*other, sys.executable, script, *words],
            cwd=empty, env=environment, capture_output=True, text=True, timeout=300,
        )  # fmt: skip

    version = livedrive("--version")
    assert re.fullmatch(r"livedrive \d+\.\d+\.\d+\n", version.stdout), version.stderr
    checked = livedrive("doctor").stdout
    for part in ("OpenGL", "encoder", "avatars", "video"):
        assert f"ok      {part}" in checked, checked
    assert list(empty.iterdir()) == []
    for folder in (installed, *(path for path in installed.rglob("*") if path.is_dir())):
        folder.chmod(folder.stat().st_mode | 0o200)  # so that pytest can remove them
