"""Labels of real eye videos: which frames hold a blink, or no eye at all.

Read from `labels.json` beside the videos, or from the shipped `real_clips.json` for the clips that
it names. A clip has a `name`, `left` and `right` (files; one may be missing), and lists of [first,
last] frames: `blinks` (below half the usual opening), `partial` (the lid turns back before that;
counts neither as found nor as false) and `no_eye`.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sensors import files
from sensors.types import EYE_NAMES, InputError

FORMAT = 1
NAME = "labels.json"
SHIPPED = Path(__file__).parent / "real_clips.json"
LISTS = ("blinks", "partial", "no_eye")
Spans = tuple[tuple[int, int], ...]


@dataclass(frozen=True, kw_only=True)
class Label:
    """Labels of one clip; frames count from 0, spans include their first and last frame."""

    name: str
    videos: tuple[Path | None, Path | None]  # left, right
    blinks: Spans = ()
    partial: Spans = ()
    no_eye: Spans = ()


def inside(spans: Spans, frames: int, margin: int = 0) -> NDArray[np.bool_]:
    """Whether each frame lies in a span [frames], spans `margin` frames wider at both ends."""
    result = np.zeros(frames, np.bool_)
    for first, last in spans:
        result[max(first - margin, 0) : last + 1 + margin] = True
    return result


def load_labels(folder: Path) -> list[Label]:
    """Labels of the clips that lie in `folder`.

    Raises InputError where there are none, or where the file has another format.
    """
    own = folder / NAME
    path = own if own.is_file() else SHIPPED
    try:
        words = json.loads(files.read_text(path))
        if words["format"] != FORMAT:
            raise ValueError(f"format {words['format']}")
        labels = [_label(row, folder) for row in words["clips"]]
    except (KeyError, TypeError, ValueError, UnicodeDecodeError) as error:
        raise InputError(
            f"labels {path}: expected format {FORMAT} with clips of name, left, right and frame "
            f"lists, got {error!r}; see app/eval/eyes/labels.py"
        ) from error
    there = [x for x in labels if all(v is None or v.is_file() for v in x.videos)]
    if not there:
        raise InputError(
            f"--real: expected {NAME} or the clips of the shipped labels in {folder}, found none; "
            "leave --real out, or give a folder with videos"
        )
    return there


def _label(row: dict[str, object], folder: Path) -> Label:
    videos = [folder / str(row[name]) if row.get(name) else None for name in EYE_NAMES]
    if videos == [None, None]:
        raise ValueError(f"{row['name']}: neither left nor right")
    spans = {name: _spans(row.get(name, ())) for name in LISTS}
    return Label(name=str(row["name"]), videos=(videos[0], videos[1]), **spans)


def _spans(rows: object) -> Spans:
    array = np.asarray(rows, np.int64).reshape(-1, 2)
    if len(array) and ((array < 0).any() or (array[:, 1] < array[:, 0]).any()):
        raise ValueError(f"frames {array.tolist()}")
    return tuple((int(a), int(b)) for a, b in array)
