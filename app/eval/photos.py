"""`livedrive eval photos`: avatars from photographs of people that nothing was made from.

Truth is rule-made: virtual people of the face data, held out from training, photographed by this
project's own renderer in other light, with other lenses and some expressions.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.eval.settings import ReportSettings
from app.terminal.arguments import File
from sensors import files

if TYPE_CHECKING:
    from collections.abc import Callable

    from render.types import Floats

COUNTS = (1, 3, 5)
PAINTED = 3  # photographs from which skin is made, too
RANK = "rank_1_3_shape_and_colour"
COLOR = 0.02  # stored: a difference that counts as much as a millimetre


@dataclass(frozen=True, kw_only=True)
class PhotosSettings(ReportSettings):
    """Evaluate avatars from photographs of held-out people."""

    face: Path = Path("face")
    """Folder of the face data."""
    people: int = 8
    """Held-out people, each from 1, 3 and 5 photographs."""
    picture: File = None
    """PNG to write: of each person three photographs, then the avatar made of these from there."""


def evaluate(settings: PhotosSettings) -> None:
    """Print every metric; exit with status 1 where a threshold is missed."""
    from tqdm import tqdm

    from app.terminal.thresholds import at_least, at_most, finish
    from render.avatars.maker import Maker
    from render.avatars.photos import fit, person, places, shapes
    from render.avatars.photos.detector import FaceDetector
    from render.evaluation.photographed import PhotoStudio, colors
    from render.gl.contexts import create_context

    context = create_context()
    maker, detector = Maker(context=context), FaceDetector()
    studio = PhotoStudio(settings.face, maker, context)
    errors = {count: list["Floats"]() for count in COUNTS}
    shapes_made = {count: list["Floats"]() for count in COUNTS}
    made, truth = list[tuple["Floats", "Floats"]](), list[tuple["Floats", "Floats"]]()
    rows, seconds, mean = list[Any](), list[float](), list[float]()
    table = places.load()
    known = shapes.build(maker, table)
    for index in tqdm(range(settings.people), desc="people", disable=None):
        sitter = studio.sitter(index, settings.seed, detector)
        truth.append((sitter.geometry, colors(sitter.skin)))
        mean.append(float(studio.errors_mm(maker.template, sitter.geometry).mean()))
        for count in COUNTS:
            views = [photo.view for photo in sitter.photos[:count]]
            head = known.head(fit.fit(maker, table, known, views).shares).astype(np.float32)
            errors[count].append(studio.errors_mm(head, sitter.geometry))
            shapes_made[count].append(head)
        start = time.process_time()
        found = person.make(maker, sitter.photos[:PAINTED], lambda stage, done: None)
        seconds.append(time.process_time() - start)
        made.append((found.geometry, colors(found.skin)))
        if settings.picture:
            rows.append(studio.beside(sitter, found))
    metrics: dict[str, float] = {"mean_face_mm": float(np.mean(mean))}
    for count in COUNTS:
        off = np.concatenate(errors[count])
        metrics |= {
            f"shape_{count}_mean_mm": float(off.mean()),
            f"shape_{count}_median_mm": float(np.median(off)),
            f"shape_{count}_p95_mm": float(np.percentile(off, 95)),
            f"shape_{count}_worst_person_mm": max(float(one.mean()) for one in errors[count]),
        }
        bare = [(shape, np.zeros(1, np.float32)) for shape in shapes_made[count]]
        metrics[f"rank_1_{count}_shape"] = _first(bare, truth, 0.0, studio.errors_mm)
    metrics[RANK] = _first(made, truth, 1 / COLOR, studio.errors_mm)
    metrics["cpu_seconds_median"] = float(np.median(seconds))
    for name, value in metrics.items():
        print(f"{name:40s} {value:.3f}")
    bars = [at_most(f"shape_{n}_mean_mm", metrics[f"shape_{n}_mean_mm"], 2.5) for n in COUNTS]
    bars.append(at_least(RANK, metrics[RANK], 0.9))
    if settings.picture:
        from PIL import Image

        Image.fromarray(np.concatenate(rows)).save(files.create(settings.picture))
    facts = {"seed": settings.seed, "people": settings.people}
    finish({"metrics": metrics, "bars": bars, **facts}, settings.report)


def _first(
    made: "list[tuple[Floats, Floats]]",  # geometry and coarse colours
    truth: "list[tuple[Floats, Floats]]",
    color: float,
    errors: "Callable[[Floats, Floats], Floats]",
) -> float:
    """Share of the people whom nobody held out is as near to as they are to themselves: by shape
    and, where `color` is above zero, by the colours of the face."""
    right = 0
    for index, one in enumerate(made):
        far = [
            float(np.square(errors(one[0], shape)).mean())
            + (float(np.square(color * (one[1] - skin)).mean()) if color else 0.0)
            for shape, skin in truth
        ]
        right += int(np.argmin(far)) == index
    return right / len(made)
