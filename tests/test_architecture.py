"""The house rules of DESIGN 2 and 6, held by the source itself."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("app", "sensors", "encoder", "render")
ALLOWED = {
    "app": {"app", "sensors", "encoder", "render"},
    "sensors": {"sensors"},
    "encoder": {"encoder"},
    "render": {"render"},
}
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module}
    return found


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_packages_import_only_what_the_flow_allows(path: Path) -> None:
    package = path.relative_to(ROOT).parts[0]
    for module in imports(path):
        top = module.split(".")[0]
        if top in PACKAGES and top not in ALLOWED[package]:
            assert package == "encoder" and module == "sensors.types", f"{path} imports {module}"


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_files_stay_short_and_take_time_as_an_argument(path: Path) -> None:
    text = path.read_text()
    assert len(text.splitlines()) <= 400
    assert "time.time(" not in text


def test_no_other_folders() -> None:
    folders = {p.name for p in ROOT.iterdir() if p.is_dir() and not p.name.startswith(".")}
    built = {name for name in folders if name.endswith(".egg-info") or name == "build"}
    assert folders - built <= {*PACKAGES, "tests", "recordings"}


def test_the_readme_links_to_what_is_there() -> None:
    """Red in a clone whose recordings/ lacks a picture: git ignores most of what lies there."""
    links = re.findall(r"\]\(([^)#:]+)\)", (ROOT / "README.md").read_text())
    assert len(links) > 4 and [link for link in links if not (ROOT / link).exists()] == []


def test_commands_start_without_heavy_imports() -> None:
    import subprocess
    import sys

    code = (
        "import sys, app.main; "
        "print([m for m in ('torch', 'av', 'onnxruntime', 'moderngl') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
