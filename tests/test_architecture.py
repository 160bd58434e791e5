"""The house rules, held by the source itself: who may import whom, and how large a room may be.

A ring is a ring, whoever makes it: imports inside a function or under `if TYPE_CHECKING` count."""

import ast
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ("app", "sensors", "encoder", "render")
ALLOWED = {
    "app": {"app", "sensors", "encoder", "render"},
    "sensors": {"sensors"},
    "encoder": {"encoder"},
    "render": {"render"},
}
# what encoder and render may import
SHARED = {f"sensors.{name}" for name in ("types", "files", "folders", "rotation", "threads")}
SHARED |= {"sensors.livelink_table"}
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))

MAX_MODULES, MAX_LINES, MAX_TEST_LINES = 15, 250, 350
TESTS = sorted((ROOT / "tests").rglob("*.py"))
# To be emptied: whoever cures one of these takes it out.
LONG: set[str] = set()


Graph = Mapping[str, set[str]]


@cache
def text(path: Path) -> str:
    return path.read_text()


@cache
def import_statements(path: Path) -> tuple[ast.Import | ast.ImportFrom, ...]:
    nodes = ast.walk(ast.parse(text(path)))
    return tuple(node for node in nodes if isinstance(node, ast.Import | ast.ImportFrom))


def imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in import_statements(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif node.module in PACKAGES:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif node.module:
            found |= {node.module}
    return found


def test_packages_import_only_what_the_flow_allows() -> None:
    for path in SOURCES:
        package = path.relative_to(ROOT).parts[0]
        for module in imports(path):
            top = module.split(".")[0]
            if top in PACKAGES and top not in ALLOWED[package]:
                assert package != "sensors" and module in SHARED, f"{path} imports {module}"


def test_files_take_time_as_an_argument() -> None:
    """Commands, what composes a run and the starts of processes may ask for the date."""
    asks = re.compile(r"\btime\.time\(|datetime\.now\(|date\.today\(|\butcnow\(")
    found = {path for path in SOURCES if asks.search(text(path))}
    borders = (".app.commands.", ".app.compose.", ".__main__")
    assert {m for m in map(module_of, found) if not any(b in f".{m}." for b in borders)} == set()


def test_onnxruntime_is_imported_where_its_telemetry_is_switched_off() -> None:
    libraries = {"onnxruntime", "onnxscript", "onnx_ir"}  # the others may import the first
    found = {path for path in SOURCES if libraries & {name.split(".")[0] for name in imports(path)}}
    assert found == {ROOT / "encoder" / "nn" / "onnx_session.py"}


TEMPORARY = {"sensors/files.py", "sensors/standins/pulse.py"}
TEMPORARY |= {
    "encoder/capture/speech/synthesis.py",
    "app/bench/fuzz/models.py",
    "app/bench/fuzz/sessions.py",
}  # these write to a folder that they made for themselves


def test_files_are_written_where_links_are_refused() -> None:
    """See sensors/files.py: whoever sends a folder may have put links into it."""
    writes = re.compile(r"\.write_(text|bytes)\(|os\.replace\(|\.savefig\(")
    found = [
        f"{name}: {line}"
        for name, path in {str(path.relative_to(ROOT)): path for path in SOURCES}.items()
        for before, line in pairwise(["", *text(path).splitlines()])
        if name not in TEMPORARY and writes.search(line)
        if "files." not in line and not ("files.replacing(" in before and "(draft" in line)
    ]
    assert found == []


def test_the_address_of_this_machine_alone_has_one_name() -> None:
    """Red before: it was a literal in twenty files, and a constant in two."""
    found = [path for path in SOURCES if '"127.0.0.1"' in text(path)]
    assert found == [ROOT / "sensors" / "types.py"]


def test_no_other_folders() -> None:
    folders = {p.name for p in ROOT.iterdir() if p.is_dir() and not p.name.startswith(".")}
    built = {name for name in folders if name.endswith(".egg-info") or name == "build"}
    assert folders - built <= {*PACKAGES, "tests", "recordings"}


def test_commands_start_without_heavy_imports() -> None:
    import subprocess
    import sys

    code = (
        "import sys, app.command_line; "
        "print([m for m in ('torch', 'av', 'onnxruntime', 'moderngl') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_files_that_texts_name_are_there() -> None:
    names = re.compile(r"\b((?:app|encoder|render|sensors|tests)(?:/[a-z_]+)+\.(?:py|json|md))\b")
    texts = [
        *SOURCES,
        *TESTS,
        *ROOT.glob("*.md"),
        *ROOT.glob("*/*.md"),
        *ROOT.glob("*/weights/*.md"),
    ]
    gone = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in texts
        for name in names.findall(text(path))
        if not (ROOT / name).exists()
    }
    assert not gone


def test_words_from_outside_are_never_markup() -> None:
    """`app.terminal.console` is the one console: it reads no markup."""
    found = [path for path in SOURCES if "rich.console" in imports(path)]
    assert found == [ROOT / "app" / "terminal" / "console.py"]


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def folder_of(path: Path) -> str:
    return ".".join(path.parent.relative_to(ROOT).parts)


def named(path: Path) -> Iterator[str]:
    """Every module or name that a file imports, absolutely."""
    for node in import_statements(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        else:
            assert node.level == 0, f"{path} imports relatively"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@cache
def imports_of_files() -> Graph:
    modules = {module_of(path): path for path in SOURCES}
    graph: dict[str, set[str]] = {name: set() for name in modules}
    for name, path in modules.items():
        for target in named(path):
            while target and target not in modules:
                target = target.rpartition(".")[0]
            if target and target != name:
                graph[name].add(target)
    return graph


def imports_of_folders() -> dict[str, set[str]]:
    folder = {module_of(path): folder_of(path) for path in SOURCES}
    graph: dict[str, set[str]] = {name: set() for name in folder.values()}
    for name, targets in imports_of_files().items():
        graph[folder[name]] |= {folder[target] for target in targets} - {folder[name]}
    return graph


def ring(graph: Graph) -> list[str]:
    """A shortest way from a node back to itself, or nothing."""
    for start in sorted(graph):
        before: dict[str, str] = {}
        queue = [start]
        for node in queue:
            for target in sorted(graph[node]):
                if target == start:
                    way = [start, node]
                    while way[-1] != start:
                        way.append(before[way[-1]])
                    return way[::-1]
                if target not in before:
                    before[target] = node
                    queue.append(target)
    return []


def test_ring_finds_one() -> None:
    assert ring({"a": {"b"}, "b": {"c"}, "c": set()}) == []
    assert ring({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]


def test_no_ring_of_files() -> None:
    assert ring(imports_of_files()) == []


def test_no_ring_of_folders() -> None:
    found, files = ring(imports_of_folders()), imports_of_files()
    folder = {module_of(path): folder_of(path) for path in SOURCES}
    why = [
        f"{name} imports {target}"
        for here, there in pairwise(found)
        for name in files
        for target in sorted(files[name])
        if (folder[name], folder[target]) == (here, there)
    ]
    assert why == []


def test_exceptions_are_still_needed() -> None:
    assert {name for name in LONG if lines(ROOT / name) <= limit(ROOT / name)} == set()


def lines(path: Path) -> int:
    return len(text(path).splitlines())


def limit(path: Path) -> int:
    return MAX_TEST_LINES if path.is_relative_to(ROOT / "tests") else MAX_LINES


def test_files_stay_short() -> None:
    long = {
        str(path.relative_to(ROOT)): lines(path)
        for path in [*SOURCES, *TESTS]
        if lines(path) > limit(path)
    }
    assert set(long) <= LONG, f"split these files: {long}"


def test_folders_hold_few_modules() -> None:
    count: dict[str, int] = {}
    for path in [*SOURCES, *TESTS]:
        if path.name not in ("__init__.py", "__main__.py"):
            count[folder_of(path)] = count.get(folder_of(path), 0) + 1
    assert {name: num for name, num in count.items() if num > MAX_MODULES} == {}


def classes(path: Path) -> list[str]:
    body = ast.parse(text(path)).body
    return [
        node.name
        for node in body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    ]


def test_a_class_name_has_one_meaning() -> None:
    """The classes in app/commands are named as one types them (`call`, `session`)."""
    homes: dict[str, list[str]] = {}
    for path in SOURCES:
        if folder_of(path).split(".")[:2] != ["app", "commands"]:
            for name in classes(path):
                homes.setdefault(name, []).append(module_of(path))
    assert {name: found for name, found in homes.items() if len(found) > 1} == {}


SAME_LINES = 6


def logic(path: Path) -> list[tuple[int, str]]:
    """The lines that count: no blanks, comments, imports or brackets alone."""
    imported = {
        number
        for node in import_statements(path)
        for number in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    rows = ((number, line.strip()) for number, line in enumerate(text(path).splitlines(), 1))
    return [
        (number, line)
        for number, line in rows
        if re.search(r"\w", line) and not line.startswith("#") and number not in imported
    ]


def repeats(paths: Iterable[Path]) -> list[str]:
    """Where six lines stand that also stand elsewhere."""
    first: dict[tuple[str, ...], str] = {}
    found: list[str] = []
    for path in paths:
        rows = logic(path)
        for k in range(len(rows) - SAME_LINES + 1):
            number, run = rows[k][0], tuple(line for _, line in rows[k : k + SAME_LINES])
            here = f"{path.parent.name}/{path.name}:{number}"
            if first.setdefault(run, here) != here:
                found.append(f"{here} repeats {first[run]}")
    return found


def test_no_two_places_share_six_lines() -> None:
    assert repeats(SOURCES) == []


def test_shared_lines_are_found(tmp_path: Path) -> None:
    lines = [f"total += {k}" for k in range(SAME_LINES)]
    (tmp_path / "a.py").write_text("\n".join(["import os", "x = 1", *lines]))
    (tmp_path / "b.py").write_text("\n".join(["import os", "", *lines[:3], "# why", *lines[3:]]))
    found = repeats([tmp_path / "a.py", tmp_path / "b.py"])
    assert found == [f"{tmp_path.name}/b.py:3 repeats {tmp_path.name}/a.py:3"]
