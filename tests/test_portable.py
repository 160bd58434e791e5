"""Windows and macOS: every module can be imported where the modules of Unix alone are missing."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("app", "sensors", "encoder", "render")
UNIX_ONLY = ("fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty")

SCRIPT = """
import builtins, importlib, sys

hidden, packages, names = [words.split(",") for words in sys.argv[1:]]
found = builtins.__import__


def import_as_elsewhere(name, importer=None, *rest):
    ours = (importer or {}).get("__name__", "").split(".")[0] in packages
    if ours and name.split(".")[0] in hidden:
        raise ModuleNotFoundError(f"No module named {name!r} on this system", name=name)
    return found(name, importer, *rest)


builtins.__import__ = import_as_elsewhere
for name in names:
    importlib.import_module(name)
"""


def imported(names: list[str], hidden: tuple[str, ...]) -> subprocess.CompletedProcess[str]:
    words = [",".join(words) for words in (hidden, PACKAGES, names)]
    command = [sys.executable, "-c", SCRIPT, *words]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True)


@pytest.mark.slow
def test_every_module_is_imported_without_those_of_unix() -> None:
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in sorted(paths)]
    done = imported([name for name in names if not name.endswith("__main__")], UNIX_ONLY)
    assert done.returncode == 0, done.stderr[-600:]


def test_a_hidden_module_is_missed() -> None:
    done = imported(["sensors.folders"], ("platformdirs",))
    assert "No module named 'platformdirs' on this system" in done.stderr
