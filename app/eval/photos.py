"""`livedrive eval photos`: avatars from photographs of people that nothing was made from.

Truth is rule-made: virtual people of the face data, held out from training, photographed by this
project's own renderer in other light, with other lenses and some expressions. They are drawn from
the same identity shapes as the people that shapes are learned from; a scan of a man is not.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.eval.settings import ReportSettings
from app.terminal.arguments import Count, File
from sensors import files

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from render.avatars.photos.picture import Photo
    from render.types import Floats

COUNTS = (1, 3, 5)
PAINTED = 3  # photographs from which skin is made, too
RANK = f"{PAINTED}/rank_1_shape_and_colour"


@dataclass(frozen=True, kw_only=True)
class PhotosSettings(ReportSettings):
    """Evaluate avatars from photographs of held-out people."""

    face: Path = Path("face")
    """Folder of the face data."""
    people: Count = 8
    """Held-out people, each from 1, 3 and 5 photographs."""
    picture: File = None
    """PNG to write: of each person three photographs, then the avatar made of these from there."""


def evaluate(settings: PhotosSettings) -> None:
    """Print every metric; exit with status 1 where a threshold is missed."""
    from tqdm import tqdm

    from app.terminal.thresholds import at_least, at_most, finish
    from render.avatars.maker import Maker
    from render.avatars.photos import person, places, point_shapes, shapes
    from render.avatars.photos.detector import FaceDetector
    from render.evaluation import photographed
    from render.gl.contexts import create_context

    context = create_context()
    maker, detector = Maker(context=context), FaceDetector()
    studio = photographed.PhotoStudio(settings.face, maker, context)
    table = places.load()
    known, people = shapes.build(maker, table), point_shapes.load()

    def made_of(photos: list["Photo"]) -> "Floats":  # -> [V, 3]
        return known.through(person.fitted(maker, table, people, photos).points).astype(np.float32)

    errors = {count: list["Floats"]() for count in COUNTS}
    sized = {count: list[float]() for count in COUNTS}
    made = {count: list["Floats"]() for count in COUNTS}
    truth, painted, skins = list["Floats"](), list["Floats"](), list["Floats"]()
    rows, seconds, mean = list[Any](), list[float](), list[float]()
    for index in tqdm(range(settings.people), desc="people", disable=None):
        sitter = studio.sitter(index, settings.seed, detector)
        truth.append(photographed.shape_signature(studio, sitter.geometry))
        skins.append(sitter.skin)
        mean.append(float(studio.errors_mm(maker.template, sitter.geometry).mean()))
        for count in COUNTS:
            head = made_of(sitter.photos[:count])
            errors[count].append(studio.errors_mm(head, sitter.geometry))
            sized[count].append(float(studio.errors_mm(head, sitter.geometry, scaled=True).mean()))
            made[count].append(photographed.shape_signature(studio, head))
        start = time.process_time()
        found = person.make(maker, sitter.photos[:PAINTED], lambda stage, done: None)
        seconds.append(time.process_time() - start)
        painted.append(found.skin)
        if settings.picture:
            rows.append(studio.beside(sitter, found))
    metrics: dict[str, float] = {"mean face/mean_mm": float(np.mean(mean))}
    for count in COUNTS:
        off = np.concatenate(errors[count])
        metrics |= {
            f"{count}/mean_mm": float(off.mean()),
            f"{count}/median_mm": float(np.median(off)),
            f"{count}/p95_mm": float(np.percentile(off, 95)),
            f"{count}/worst_person_mm": max(float(one.mean()) for one in errors[count]),
            f"{count}/but_for_size_mm": float(np.mean(sized[count])),
            f"{count}/rank_1_shape": first(np.array(made[count]) @ np.array(truth).T),
        }
    others = np.mean([photographed.colors(skin) for skin in skins], 0)
    own, true = (
        np.array([photographed.color_signature(skin, others) for skin in some])
        for some in (painted, skins)
    )
    alike = np.array(made[PAINTED]) @ np.array(truth).T + own @ true.T
    metrics |= {RANK: first(alike), f"{PAINTED}/rank_1_colour": first(own @ true.T)}
    scan, photos = studio.scan(settings.seed, detector)
    for count in COUNTS:
        head = made_of(photos[:count])
        metrics[f"scan/{count}/mean_mm"] = float(studio.errors_mm(head, scan).mean())
        off = studio.errors_mm(head, scan, scaled=True)
        metrics[f"scan/{count}/but_for_size_mm"] = float(off.mean())
    metrics["scan/mean face/mean_mm"] = float(studio.errors_mm(maker.template, scan).mean())
    metrics["cpu_seconds_median"] = float(np.median(seconds))
    for name, value in metrics.items():
        print(f"{name:40s} {value:.3f}")
    means = [f"{whose}{n}/mean_mm" for whose in ("", "scan/") for n in COUNTS]
    bars = [at_most(name, metrics[name], 2.5) for name in means]
    bars.append(at_least(RANK, metrics[RANK], 0.9))
    if settings.picture:
        from PIL import Image

        with files.replacing(settings.picture) as draft:
            Image.fromarray(np.concatenate(rows)).save(draft)
    facts = {"seed": settings.seed, "people": settings.people}
    finish({"metrics": metrics, "bars": bars, **facts}, settings.report)


def first(alike: "NDArray[np.floating[Any]]") -> float:  # [made, true]
    """Share of those made who are most like the one they were made from."""
    return float((np.argmax(alike, axis=1) == np.arange(len(alike))).mean())
