"""`livedrive train landmarks`: where the points of the detector of faces lie on the head, and how
people differ there."""

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from render.avatars.photos.shape.places import PointPlaces
    from render.training.data.face_data import FaceData
    from render.types import Doubles

PEOPLE = 300  # as the decoder's training sees


def make(face: Path, out: Path | None) -> None:
    """Write both into the folder; takes some minutes.

    Raises InputError where the detector is not installed, or there is no face data."""
    from render.training.data import face_data

    data = face_data.load(face)
    if out:
        out.mkdir(parents=True, exist_ok=True)
    make_shapes(data, make_table(out), out)


def make_table(out: Path | None) -> "PointPlaces":
    """Draw the shipped people, find them, and write the table."""
    from render.avatars.maker import Maker
    from render.avatars.photos.shape import places
    from render.avatars.photos.shape.detector import FaceDetector
    from render.decoder.learned import avatar_files
    from render.splats.renderer import create_renderer

    path = out / places.PATH.name if out else places.PATH
    with closing(FaceDetector()) as detector, closing(create_renderer()) as renderer:
        table = places.make(Maker(), detector, renderer, avatar_files.shipped())
    places.save(table, path)
    print(f"wrote {path.resolve()}")
    return table


def make_shapes(data: "FaceData", table: "PointPlaces", out: Path | None) -> None:
    """Draw people from its shapes and write how their points in the table differ."""
    from render.avatars import registration
    from render.avatars.alignment import similarity
    from render.avatars.maker import Maker
    from render.avatars.photos.shape import point_shapes
    from render.training.data import people

    maker = Maker()
    seen, _ = registration.visible(maker)
    rest = maker.template.astype(np.float64)

    def placed(seed: int) -> "Doubles":  # -> [N, 3]
        head = people.neutral(data, people.draw(data, seed)).astype(np.float64)
        return table.of(similarity(head[seen], rest[seen], scaled=False).place(head))

    path = out / point_shapes.PATH.name if out else point_shapes.PATH
    point_shapes.save(point_shapes.learn(map(placed, range(PEOPLE))), path)
    print(f"wrote {path.resolve()}")
