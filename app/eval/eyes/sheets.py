"""Sheets of eye pictures with gaze (arrow), lid opening (line) and confidence drawn in."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from app.eval.eyes.real import RealClip

SIZE_PX = 200
GOOD, BAD, GAZE = (80, 220, 80), (255, 70, 70), (255, 190, 40)


def sheet(
    pictures: list[NDArray[np.uint8]],  # [400, 400]
    rows: list[tuple[NDArray[np.floating], float, float]],  # gaze [3], lid, score
    path: Path,
    columns: int = 6,
    accepted: list[bool] | None = None,  # default: by the score
) -> None:
    """Write a sheet of many pictures, with their readings."""
    from PIL import Image, ImageDraw

    size = SIZE_PX
    page = Image.new("RGB", (columns * size, -(-len(pictures) // columns) * size))
    draw = ImageDraw.Draw(page)
    shown = accepted or [score > 0.5 for _, _, score in rows]
    for k, (picture, (gaze, lid, score), good) in enumerate(
        zip(pictures, rows, shown, strict=True)
    ):
        x, y = k % columns * size, k // columns * size
        page.paste(Image.fromarray(picture).resize((size, size)).convert("RGB"), (x, y))
        middle = np.array([x + size / 2, y + size / 2])
        tip = middle + 160 * gaze[:2] * (1, -1)
        away = (tip - middle) / max(float(np.linalg.norm(tip - middle)), 1e-6)
        aside = np.array([-away[1], away[0]])
        draw.line((*middle, *tip), fill=GAZE, width=3)
        draw.polygon([*tip, *(tip - 9 * away + 5 * aside), *(tip - 9 * away - 5 * aside)], GAZE)
        # height of the upper lid: shut is a quarter below the middle of the picture
        level = y + size * (0.75 - 0.45 * lid)
        draw.line((x + 0.25 * size, level, x + 0.75 * size, level), fill=GOOD, width=2)
        colour = GOOD if good else BAD
        draw.ellipse((x + size - 16, y + 6, x + size - 6, y + 16), fill=colour)
        draw.text((x + size - 48, y + 5), f"{score:.2f}", fill=colour)
    path.parent.mkdir(parents=True, exist_ok=True)
    page.save(path)


def clip_sheet(clip: "RealClip", path: Path, moments: int = 40, columns: int = 10) -> None:
    """Write a sheet of one real clip: evenly spaced frames and all blinks, left eye then right."""
    chosen = set(np.linspace(0, len(clip.opening) - 1, moments).astype(int).tolist())
    for first, last in clip.label.blinks:
        chosen |= set(range(max(first - 2, 0), min(last + 3, len(clip.opening)), 2))
    pairs = [(t, eye) for eye in clip.eyes for t in sorted(chosen)]
    rows = [(clip.gaze[t, e], float(clip.lids[t, e]), float(clip.score[t, e])) for t, e in pairs]
    accepted = [bool(clip.accepted[t, e]) for t, e in pairs]
    sheet([clip.views[t, e] for t, e in pairs], rows, path, columns, accepted)
