"""Real near-eye videos against the eye encoder: blinks, pupil and order of open and shut.

For looking and checking only: nothing trains on them. Their truth is the pupil itself, found by its
darkness, so it is independent of every network.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sensors.types import InputError

if TYPE_CHECKING:
    from encoder.eye_encoder import EyeEncoder, EyeReading

BLINKS, GAZE = "three_blinks_640x480.mp4", "single_eye_gaze_320x240.mp4"
DARK = 50  # grey level below which a pixel is pupil
GAZE_STEP = 4  # every n-th frame of the long video


def read(path: Path, every: int = 1) -> list[NDArray[np.uint8]]:
    """Frames [H, W] of a video."""
    from sensors.eye_video import gray, open_video

    with open_video(path) as container:
        frames = container.decode(container.streams.video[0])
        return [gray(frame) for k, frame in enumerate(frames) if k % every == 0]


def squared(frame: NDArray[np.uint8], margin: float) -> NDArray[np.uint8]:
    """[400, 400]: the middle square, with `margin` of its side added around it (edges repeat)."""
    from sensors.eyes.views import fit

    pad = int(margin * min(frame.shape))
    height, width = frame.shape
    side = max(min(height, width), 1)
    left = (width - side) // 2
    return fit(np.pad(frame[:side, left : left + side], pad, mode="edge"))


def pupil(frame: NDArray[np.uint8]) -> tuple[float, float, float]:
    """Share of dark pixels, and their middle (x right, y up) in widths of the picture."""
    dark = frame < DARK
    share = float(dark.mean())
    if share == 0:
        return 0.0, 0.0, 0.0
    rows, columns = np.nonzero(dark)
    height, width = frame.shape
    return share, float(np.median(columns)) / width, -float(np.median(rows)) / width


def readings(
    encoder: "EyeEncoder", frames: list[NDArray[np.uint8]], margin: float, mirror: bool
) -> "list[EyeReading]":
    """One eye shown in both places, so that either side's reading can be used."""
    rows: list[EyeReading] = []
    for frame in frames:
        eye = squared(frame, margin)
        eye = eye[:, ::-1] if mirror else eye
        rows.append(encoder(np.stack([eye, eye[:, ::-1]])))
    return rows


def real_figures(encoder: "EyeEncoder", folder: Path) -> dict[str, float]:
    """Blink F1 and order on the blink video; rank correlation of gaze with the pupil's place."""
    from encoder.eye_metrics import compare_blinks, rank_correlation, shut_frames

    for name in (BLINKS, GAZE):
        if not (folder / name).is_file():
            raise InputError(
                f"--real: expected {name} in {folder}, found none; leave --real out, or give "
                "a folder with both videos"
            )
    frames = read(folder / BLINKS)
    shares = np.array([pupil(frame[::2, ::2])[0] for frame in frames])
    rows = readings(encoder, frames, margin=0.15, mirror=False)
    lids = np.array([row.lids[0] for row in rows])
    # this pupil shrinks along the video: against its usual size around each frame
    usual = np.array([np.median(shares[max(t - 60, 0) : t + 60]) for t in range(len(shares))])
    there = shares < 0.5 * usual
    found = compare_blinks(shut_frames(lids), there)
    looks = read(folder / GAZE, GAZE_STEP)
    places = np.array([pupil(frame) for frame in looks])
    gaze = np.array([row.gaze[0] for row in readings(encoder, looks, 0.3, mirror=False)])
    seen = places[:, 0] > 0.01
    return {
        "real_blinks": found.hits + found.missed,
        "real_blink_f1": found.f1,
        "real_open_over_shut_lid": float(np.median(lids[~there]) - np.median(lids[there])),
        "real_order_share": float((lids[~there][:, None] > lids[there][None]).mean()),
        "real_gaze_pupil_rank_r_x": rank_correlation(gaze[seen, 0], places[seen, 1]),
        "real_gaze_pupil_rank_r_y": rank_correlation(gaze[seen, 1], places[seen, 2]),
    }


def sheet(
    pictures: list[NDArray[np.uint8]],  # [400, 400]
    rows: list[tuple[NDArray[np.float32], float, float]],  # gaze [3], lid, score
    path: Path,
    columns: int = 6,
) -> None:
    """A picture of pictures, each with its gaze as a line, its lid as a bar, its score as a dot."""
    from PIL import Image, ImageDraw

    size = 200
    height = -(-len(pictures) // columns) * size
    page = Image.new("RGB", (columns * size, height))
    draw = ImageDraw.Draw(page)
    for k, (picture, (gaze, lid, score)) in enumerate(zip(pictures, rows, strict=True)):
        x, y = k % columns * size, k // columns * size
        page.paste(Image.fromarray(picture).resize((size, size)).convert("RGB"), (x, y))
        middle = (x + size / 2, y + size / 2)
        end = (middle[0] + 160 * float(gaze[0]), middle[1] - 160 * float(gaze[1]))
        draw.line((middle, end), fill=(255, 70, 70), width=3)
        draw.rectangle((x + 4, y + size - 4 - 100 * lid, x + 12, y + size - 4), fill=(80, 220, 80))
        draw.rectangle((x + 4, y + size - 104, x + 12, y + size - 4), outline=(80, 220, 80))
        colour = (80, 220, 80) if score > 0.5 else (255, 70, 70)
        draw.ellipse((x + size - 16, y + 6, x + size - 6, y + 16), fill=colour)
    path.parent.mkdir(parents=True, exist_ok=True)
    page.save(path)
