"""Pictures of `livedrive eval emotion`: the avatar in all emotions, and the confusion tables."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.terminal import figures
from sensors import files

if TYPE_CHECKING:
    from app.eval.emotion.metrics import Confusion, EmotionEvaluation

COLUMNS = 5  # frames in each row of the sheet
PX = 224


def save(folder: Path, evaluated: "EmotionEvaluation", seen: "dict[str, Confusion]") -> list[Path]:
    """Write emotions.png (named), emotions_blind.png (shuffled, numbered) and confusion.png."""
    folder.mkdir(parents=True, exist_ok=True)
    names, rows = _portraits(evaluated)
    order: list[int] = (
        np.random.default_rng(evaluated.settings.seed).permutation(len(names)).tolist()
    )
    key = ", ".join(names[i] for i in order)
    paths = [folder / name for name in ("emotions.png", "emotions_blind.png", "confusion.png")]
    _sheet(paths[0], rows, names)
    _sheet(paths[1], [rows[i] for i in order], [str(n + 1) for n in range(len(order))])
    files.write_text(folder / "emotions_blind.txt", key + "\n")
    _confusions(paths[2], seen)
    return paths


def _portraits(evaluated: "EmotionEvaluation") -> tuple[list[str], list[list[np.ndarray]]]:
    """Names (neutral, then each label) and their pictures [PX, PX, 3] uint8: the same frames of one
    sentence spoken in a neutral voice."""
    from app.eval.emotion.live import drive, sound_of
    from encoder.inference import load_driver
    from render import cameras
    from render.decoder import identity
    from render.splats.renderer import create_renderer
    from render.types import AHEAD

    driver, who = load_driver(evaluated.weights, "cpu"), identity.load(evaluated.settings.avatar)
    assert driver.emotions is not None
    sound = sound_of(evaluated.truths["neutral voice"][0])[: 1600 * 150]
    names = ["neutral", *driver.emotions.labels]
    codes = [drive(driver, sound, name, evaluated.settings.seed) for name in names]
    seeing = 30 + np.flatnonzero(
        evaluated.mesh.blink(codes[0])[30:] < 0.2
    )  # a blink would hide the eyes
    frames = seeing[np.linspace(0, len(seeing) - 1, COLUMNS).astype(int)]
    renderer, camera = create_renderer(), cameras.portrait(PX, PX, distance_mm=330)
    rows: list[list[np.ndarray]] = []
    for row in codes:
        pictures: list[np.ndarray] = []
        for t in frames:
            _, cloud = evaluated.decoder.decode(row[t], AHEAD, who)
            renderer.draw(cloud, camera)
            pictures.append(renderer.read_rgba()[..., :3].copy())
        rows.append(pictures)
    renderer.close()
    return names, rows


def _sheet(path: Path, rows: list[list[np.ndarray]], names: list[str]) -> None:
    from PIL import Image, ImageDraw

    sheet = Image.fromarray(np.concatenate([np.concatenate(row, 1) for row in rows]))
    draw = ImageDraw.Draw(sheet)
    for place, name in enumerate(names):
        draw.text((6, place * PX + 4), name, fill=(255, 255, 255), font_size=18)
    with files.replacing(path) as draft:
        sheet.save(draft)


def _confusions(path: Path, seen: "dict[str, Confusion]") -> None:
    from encoder.emotion.labels import LABELS

    regions = ("face", "upper", "lower")
    figure = figures.figure(13, 4.4 * len(seen))
    grid = figure.subplots(len(seen), 3, squeeze=False)
    for panels, (kind, found) in zip(grid, seen.items(), strict=True):
        for panel, region in zip(panels, regions, strict=True):
            table: Any = found.tables[region]
            panel.imshow(table, vmin=0, vmax=1, cmap="Blues")
            panel.set_xticks(range(len(LABELS)), LABELS, rotation=60, fontsize=7)
            panel.set_yticks(range(len(LABELS)), LABELS, fontsize=7)
            panel.set(title=f"{kind}, {region}", xlabel="nearest truth", ylabel="asked for")
            for (y, x), value in np.ndenumerate(table):
                if value >= 0.05:
                    dark = "white" if value > 0.5 else "black"
                    panel.text(x, y, f"{100 * value:.0f}", ha="center", va="center", fontsize=6,
                               color=dark)  # fmt: skip
    figures.save(figure, path)
