"""`livedrive eval photos`: avatars from photographs of people that nothing was made from.

Truth is rule-made: virtual people of the face data, held out from training, photographed by this
project's own renderer in other light, with other lenses and some expressions. They are drawn from
the same identity shapes as the people that shapes are learned from; a scan of a man is not.
"""

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.eval.settings import ReportSettings
from app.terminal.arguments import Count, File
from sensors import files

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from render.avatars.photos.shape.picture import Photo
    from render.evaluation.photographed import HeldOutSitter, PhotoStudio
    from render.types import Floats

    MadeOf = Callable[[list[Photo]], Floats]

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


@dataclass(frozen=True)
class PeopleFigures:
    """What was made of all people, in their order."""

    mean_mm: list[float] = field(default_factory=list[float])  # of the mean face
    errors: "dict[int, list[Floats]]" = field(default_factory=lambda: {n: [] for n in COUNTS})
    sized_mm: dict[int, list[float]] = field(default_factory=lambda: {n: [] for n in COUNTS})
    made: "dict[int, list[Floats]]" = field(default_factory=lambda: {n: [] for n in COUNTS})
    truth: "list[Floats]" = field(default_factory=list[Any])  # signatures of shapes, as in `made`
    painted: "list[Floats]" = field(default_factory=list[Any])  # skins
    skins: "list[Floats]" = field(default_factory=list[Any])  # true ones
    eyes: list[bool] = field(default_factory=list[bool])  # their colour was found
    seconds: list[float] = field(default_factory=list[float])  # CPU time of an avatar
    rows: list[Any] = field(default_factory=list[Any])  # of the picture


def evaluate(settings: PhotosSettings) -> None:
    """Print every metric; exit with status 1 where a threshold is missed."""
    from tqdm import tqdm

    from app.terminal.thresholds import at_least, at_most, finish
    from render.avatars.maker import Maker
    from render.avatars.photos import person
    from render.avatars.photos.shape import places, point_shapes, shapes
    from render.avatars.photos.shape.detector import FaceDetector
    from render.evaluation import photographed
    from render.gl.contexts import create_context

    context = create_context()
    maker = Maker(context=context)
    studio = photographed.PhotoStudio(settings.face, maker, context)
    table = places.load()
    known, people = shapes.build(maker, table), point_shapes.load()

    def made_of(photos: list["Photo"]) -> "Floats":  # -> [V, 3]
        return known.through(person.fitted(maker, table, people, photos).points).astype(np.float32)

    found = PeopleFigures()
    with closing(FaceDetector()) as detector:
        for index in tqdm(range(settings.people), desc="people", disable=None):
            sitter = studio.sitter(index, settings.seed, detector)
            _measure(studio, sitter, made_of, found)
            start = time.process_time()
            avatar = person.make(maker, sitter.photos[:PAINTED], lambda stage, done: None)
            found.seconds.append(time.process_time() - start)
            found.painted.append(avatar.skin)
            found.eyes.append(avatar.eye == sitter.eye)
            if settings.picture:
                found.rows.append(studio.beside(sitter, avatar))
        metrics = _of_people(found) | _of_scan(
            studio, *studio.scan(settings.seed, detector), made_of
        )
    metrics[f"{PAINTED}/eye_colour_found"] = float(np.mean(found.eyes))
    metrics["cpu_seconds_median"] = float(np.median(found.seconds))
    for name, value in metrics.items():
        print(f"{name:40s} {value:.3f}")
    means = [f"{whose}{n}/mean_mm" for whose in ("", "scan/") for n in COUNTS]
    bars = [at_most(name, metrics[name], 2.5) for name in means]
    bars.append(at_least(RANK, metrics[RANK], 0.9))
    if settings.picture:
        from PIL import Image

        with files.replacing(settings.picture) as draft:
            Image.fromarray(np.concatenate(found.rows)).save(draft)
    facts = {"seed": settings.seed, "people": settings.people}
    finish({"metrics": metrics, "bars": bars, **facts}, settings.report)


def _measure(
    studio: "PhotoStudio", sitter: "HeldOutSitter", made_of: "MadeOf", found: PeopleFigures
) -> None:
    """Heads from 1, 3 and 5 photographs of somebody, beside the true one."""
    from render.evaluation.photographed import shape_signature

    found.truth.append(shape_signature(studio, sitter.geometry))
    found.skins.append(sitter.skin)
    found.mean_mm.append(float(studio.errors_mm(studio.maker.template, sitter.geometry).mean()))
    for count in COUNTS:
        head = made_of(sitter.photos[:count])
        found.errors[count].append(studio.errors_mm(head, sitter.geometry))
        sized = studio.errors_mm(head, sitter.geometry, scaled=True)
        found.sized_mm[count].append(float(sized.mean()))
        found.made[count].append(shape_signature(studio, head))


def _of_people(found: PeopleFigures) -> dict[str, float]:
    from render.evaluation.photographed import color_signature, colors

    metrics: dict[str, float] = {"mean face/mean_mm": float(np.mean(found.mean_mm))}
    for count in COUNTS:
        off = np.concatenate(found.errors[count])
        metrics |= {
            f"{count}/mean_mm": float(off.mean()),
            f"{count}/median_mm": float(np.median(off)),
            f"{count}/p95_mm": float(np.percentile(off, 95)),
            f"{count}/worst_person_mm": max(float(one.mean()) for one in found.errors[count]),
            f"{count}/but_for_size_mm": float(np.mean(found.sized_mm[count])),
            f"{count}/rank_1_shape": first(np.array(found.made[count]) @ np.array(found.truth).T),
        }
    others = np.mean([colors(skin) for skin in found.skins], 0)
    own, true = (
        np.array([color_signature(skin, others) for skin in some])
        for some in (found.painted, found.skins)
    )
    alike = np.array(found.made[PAINTED]) @ np.array(found.truth).T + own @ true.T
    return metrics | {RANK: first(alike), f"{PAINTED}/rank_1_colour": first(own @ true.T)}


def _of_scan(
    studio: "PhotoStudio", scan: "Floats", photos: list["Photo"], made_of: "MadeOf"
) -> dict[str, float]:
    """Of a real man's head, scanned."""
    metrics = dict[str, float]()
    for count in COUNTS:
        head = made_of(photos[:count])
        metrics[f"scan/{count}/mean_mm"] = float(studio.errors_mm(head, scan).mean())
        off = studio.errors_mm(head, scan, scaled=True)
        metrics[f"scan/{count}/but_for_size_mm"] = float(off.mean())
    template = studio.errors_mm(studio.maker.template, scan)
    return metrics | {"scan/mean face/mean_mm": float(template.mean())}


def first(alike: "NDArray[np.floating[Any]]") -> float:  # [made, true]
    """Share of those made who are most like the one they were made from."""
    return float((np.argmax(alike, axis=1) == np.arange(len(alike))).mean())
