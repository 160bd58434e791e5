"""How people differ at the places that the detector finds: principal components of many people.

Learned from people drawn from the identity shapes of the face data, those that training sees; so
size, too, goes with the rest of a face as it does there. Remade by `livedrive train landmarks
--face FACE_DATA`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from render.types import Doubles
from sensors import files

PATH = Path(__file__).with_name("point_shapes.npz")
MODES = 64  # the last one moves points by a fiftieth of a millimetre


@dataclass(frozen=True)
class PointShapes:
    """Millimetres; K modes of one deviation each, N places."""

    at: Doubles  # [N, 3] of the mean face
    modes: Doubles  # [K, N, 3]

    def of(self, shares: Doubles) -> Doubles:  # [K] deviations -> [N, 3]
        return self.at + np.tensordot(shares, self.modes, 1)


def learn(people: Iterable[Doubles]) -> PointShapes:
    """From the places of many people, each [N, 3], placed on each other."""
    found = np.array(list(people))
    at = found.mean(0)
    _, spreads, axes = np.linalg.svd((found - at).reshape(len(found), -1), full_matrices=False)
    modes = axes[:MODES] * spreads[:MODES, None] / np.sqrt(len(found) - 1)
    return PointShapes(at, modes.reshape(-1, *at.shape))


def load() -> PointShapes:
    table = files.load_npz(PATH)
    return PointShapes(table["at"].astype(np.float64), table["modes"].astype(np.float64))


def save(found: PointShapes, path: Path) -> None:
    with files.replacing(path) as draft, draft.open("wb") as file:
        at, modes = found.at.astype(np.float32), found.modes.astype(np.float16)
        np.savez_compressed(file, at=at, modes=modes)
