"""A scan of any topology on its way to an avatar: landmarks, progress, what was found."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from sensors import files
from sensors.types import InputError

if TYPE_CHECKING:
    from render.avatars.alignment import Doubles
    from render.avatars.maker import Maker
    from render.types import Floats

LARGEST = 1e6  # of a coordinate
FEWEST = 3  # landmarks that tell where a head is
FLAT = 1e-3  # of the largest coordinate: marks nearer to a line tell no turn about it


def head(
    maker: "Maker", path: Path, landmarks: Path | None, skin: "Floats | None"
) -> "tuple[Floats, Floats]":
    """-> geometry [V, 3] mm, skin atlas [1024, 2048, 3]: the one given, or the scan's colours.

    Raises InputError where the scan cannot be read, shows no face, or has no colours."""
    from tqdm import tqdm

    from render.avatars import registration, scan_texture, surface_scan

    names = registration.landmark_vertices(maker)
    marks = read_landmarks(landmarks, list(names)) if landmarks else {}
    scan = surface_scan.read(path, np.array(list(marks.values()), np.float64))
    if skin is None and scan.colors is None:
        raise surface_scan.no_colors(path)
    with tqdm(total=100, unit="%", desc="registering", disable=None, leave=False) as bar:

        def show(stage: str, done: float) -> None:
            bar.set_description(stage)
            bar.update(round(100 * done) - bar.n)

        fit = registration.register(maker, scan, marks, show)
    size = "as the landmarks tell" if marks else f"in {scan.unit}"
    print(f"registered {path}: coordinates {size}, face {fit.face_mm:.1f} mm from the scan")
    if skin is None:
        skin = scan_texture.paint(maker, fit.geometry, fit.scan)
    return fit.geometry, skin


def read_landmarks(path: Path, names: list[str]) -> "dict[str, Doubles]":
    """{name: [x, y, z]} in the coordinates of the scan; at least three of `names`."""

    def fail(got: object) -> InputError:
        return InputError(
            f"{path}: expected JSON with at least {FEWEST} of {', '.join(names)}, each [x, y, z] "
            f"in the coordinates of the scan, got {got}"[:600]
        )

    try:
        found: Any = files.read_json(path)
    except (ValueError, UnicodeDecodeError) as error:
        raise fail(error) from None
    if not isinstance(found, dict):
        raise fail(type(found).__name__)
    marks = dict[str, "Doubles"]()
    for name, place in cast("dict[str, Any]", found).items():
        if name not in names or not _is_place(place):
            raise fail(f"{name!r}: {place!r}"[:120])
        marks[name] = np.array(place, np.float64)
    if len(marks) < FEWEST:
        raise fail(f"{len(marks)}")
    places = np.stack(list(marks.values()))
    _, wide, *_ = np.linalg.svd(places - places.mean(0), compute_uv=False)
    if wide <= FLAT * np.abs(places).max():
        raise fail("some in one place, or in a line, which tell no turn")
    return marks


def _is_place(place: Any) -> bool:
    if not isinstance(place, list):
        return False
    numbers = cast("list[Any]", place)
    return len(numbers) == 3 and all(
        type(value) in (int, float) and math.isfinite(value) and abs(value) < LARGEST
        for value in numbers
    )
