"""Names of files that a command will write, judged before the work that fills them."""

from collections.abc import Mapping
from pathlib import Path

from sensors import files
from sensors.types import InputError

PICTURES = (".png", ".jpg", ".jpeg")
VIDEOS = (".mp4", ".mkv", ".mov")
PLOTS = (*PICTURES, ".pdf", ".svg")
REPORTS = (".json",)


def check(option: str, path: Path | None, endings: tuple[str, ...] = ()) -> None:
    """Raises InputError unless `path`, where there is one, has one of the endings, where there are
    any, and can be a file of a folder that exists."""
    if path is None:
        return
    if endings and path.suffix.lower() not in endings:
        raise InputError(
            f"{option}: expected a name ending in {', '.join(endings)}, got {path.name!r}; "
            f"try {path.stem or 'out'}{endings[0]}"
        )
    if not path.parent.is_dir():
        raise InputError(
            f"{option}: expected a folder {path.parent}, got none; run: mkdir -p {path.parent}"
        )
    files.check_regular(path)


def check_distinct(paths: Mapping[str, Path | None], folders: Mapping[str, Path | None]) -> None:
    """Raises InputError where two options name one place, which would hold the last alone; folders
    may be shared among themselves, as their files have different endings."""
    options: dict[Path, str] = {}
    for option, path in (*paths.items(), *folders.items()):
        if path is None:
            continue
        other = options.setdefault(path.resolve(), option)
        if other != option and not {option, other} <= set(folders):
            raise InputError(
                f"{option}: expected another name than that of {other}, got {path} for both; "
                "choose another for one of them"
            )
