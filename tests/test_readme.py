"""README and its like: commands that run, figures that equal the committed reports."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from app.main import main

ROOT = Path(__file__).parent.parent
README = ROOT / "README.md"
PAGES = [README, *sorted(ROOT.glob("*/weights/*.md")), ROOT / ".github" / "CONTRIBUTING.md"]
NESTED = ("avatar", "session", "train", "eval", "bench", "call")  # commands with actions
TABLE = re.compile(r"<!-- (\S+\.json) ([^:]*): (.*?) -->\n((?:\|.*\n)+)")
# Commands of README that take seconds and need neither devices nor data; the rest is parsed only.
QUICK = (
    "replay recordings/demo --ply heads --gltf heads --every 30",
    "session create mine --audio voice.wav",
    "avatar list",
    "avatar show ada --picture ada.png",
    "avatar export ada ada.ply --pose smile",
)


def commands() -> list[str]:
    """What follows `livedrive` on every line of a code block of README, without its comment."""
    lines = re.findall(r"^\.venv/bin/livedrive (.*)$", README.read_text(), re.MULTILINE)
    return [line.split("  #")[0].strip() for line in lines]


def livedrive(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    code = "import sys; from app.main import main; sys.exit(main())"
    return subprocess.run(
        [sys.executable, "-c", code, *words],
        cwd=folder,
        env={"PATH": "/usr/bin:/bin", "HOME": str(folder), "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=240,
    )


def test_readme_is_a_manual_of_180_lines() -> None:
    assert len(README.read_text().splitlines()) <= 180


def headings(page: Path) -> list[str]:
    """As links name them."""
    titles = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return [re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    """To a file that is there and, after a #, to a heading of it."""
    for link, place in re.findall(r"\]\(([^)#:]*)(?:#([^)]+))?\)", page.read_text()):
        target = page.parent / link if link else page
        assert target.exists(), link
        assert not place or place in headings(target), f"{link}#{place}"


def usage(words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> str:
    """What `livedrive WORDS -h` prints."""
    monkeypatch.setattr(sys, "argv", ["livedrive", *words, "-h"])
    with pytest.raises(SystemExit):
        main()
    return capsys.readouterr().out


def test_every_command_of_readme_is_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """Each names a command that `livedrive -h` knows, with options that its `-h` knows."""
    helps: dict[tuple[str, ...], str] = {}
    for command in commands():
        words = shlex.split(command)
        name = tuple(words[:2]) if words[0] in NESTED else tuple(words[:1])
        if name not in helps:
            helps[name] = usage(list(name), monkeypatch, capsys)
        unknown = [w for w in words if w.startswith("--") and w not in helps[name]]
        assert unknown == [], command
        assert f"usage: livedrive {name[0]}" in helps[name]


@pytest.mark.slow
@pytest.mark.parametrize("command", QUICK)
def test_quick_commands_of_readme_run(command: str, tmp_path: Path) -> None:
    assert command in commands()
    (tmp_path / "recordings").mkdir()
    shorter = ROOT / "recordings" / "smoke"  # three seconds, and for the command the same
    (tmp_path / "recordings" / "demo").symlink_to(shorter)
    (tmp_path / "voice.wav").symlink_to(shorter / "audio.wav")
    done = livedrive(shlex.split(command), tmp_path)
    assert done.returncode == 0, done.stderr


def tables() -> list[tuple[Path, str, str, str, str]]:
    found = []
    for page in PAGES:
        for report, prefix, columns, body in TABLE.findall(page.read_text()):
            found.append((page.parent / report, prefix, columns, body, page.parent.name))
    return found


@pytest.mark.parametrize(("report", "prefix", "columns", "body", "page"), tables())
def test_figures_equal_the_committed_report(
    report: Path, prefix: str, columns: str, body: str, page: str
) -> None:
    """`<!-- REPORT.json PREFIX: METRIC METRIC -->` above a table: a cell is PREFIX/ROW/METRIC."""
    metrics = json.loads(report.read_text())["metrics"]
    for line in body.splitlines()[2:]:
        row, *cells = [cell.strip() for cell in line.strip("|").split("|")]
        for metric, cell in zip(columns.split(), cells, strict=True):
            name = "/".join(part for part in (prefix, row, metric) if part)
            if cell == "-":
                assert name not in metrics
                continue
            digits = len(cell.partition(".")[2])
            assert f"{metrics[name]:.{digits}f}" == cell, f"{name} is {metrics[name]}, page: {cell}"


def test_some_tables_are_checked() -> None:
    assert len(tables()) >= 4
