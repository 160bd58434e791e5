"""Finds the pupil by a classical ellipse fit (OpenCV), the truth for real pictures.

Nothing here is learned, so it is independent of the networks under evaluation.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensors.types import InputError

WORK_PX = 320  # pictures are measured at this size
GLINT_PX = 15  # bright spots up to this size are closed before the fit
LEVELS = (0.06, 0.09, 0.13, 0.18, 0.24, 0.31, 0.39, 0.48)  # of the way from dark to usual
MIN_AREA, MAX_AREA = 150, 16_000  # px
MIN_OVERLAP, MIN_CONTRAST = 0.85, 0.06  # below either the fit is not trusted
MAX_ASPECT = 0.85  # rounder than this scores no better


class Pupil(NamedTuple):
    """Centre and radius in pixels from the upper left; good: the fit can be trusted."""

    x: float
    y: float
    radius: float
    good: bool


NO_PUPIL = Pupil(0.0, 0.0, 0.0, False)


def find_pupil(
    picture: NDArray[np.uint8],  # [H, W]
) -> Pupil:
    """The dark region that best fits an ellipse and contrasts most with its rim.

    Raises InputError where OpenCV is not installed.
    """
    try:
        import cv2
    except ImportError as error:
        raise InputError(
            f"--real: expected OpenCV, got {error}; run: pip install livedrive[train]"
        ) from error

    scale = WORK_PX / max(picture.shape)
    method = cv2.INTER_LINEAR if scale > 1 else cv2.INTER_AREA
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=method)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (GLINT_PX, GLINT_PX))
    small = cv2.GaussianBlur(cv2.morphologyEx(small, cv2.MORPH_OPEN, kernel), (0, 0), 2)
    dark, usual = float(np.percentile(small, 0.5)), float(np.percentile(small, 60))
    best, best_score = NO_PUPIL, 0.0
    for level in LEVELS if usual - dark > 4 else ():
        mask = (small < dark + level * (usual - dark)).astype(np.uint8)
        for contour in cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]:
            if len(contour) < 8 or not MIN_AREA < cv2.contourArea(contour) < MAX_AREA:
                continue
            ellipse = cv2.fitEllipse(contour)
            overlap, contrast = _fit(small, mask.shape, contour, ellipse)
            contrast /= usual - dark
            (x, y), axes, _ = ellipse
            aspect = min(axes) / max(max(axes), 1e-6)
            score = overlap**3 * min(aspect, MAX_ASPECT) * max(contrast, 0.0)
            if score > best_score:
                good = overlap > MIN_OVERLAP and contrast > MIN_CONTRAST
                best_score = score
                best = Pupil(x / scale, y / scale, float(np.mean(axes)) / 2 / scale, good)
    return best


def _fit(
    small: NDArray[Any],
    shape: tuple[int, ...],
    contour: NDArray[Any],
    ellipse: tuple[Any, Any, Any],
) -> tuple[float, float]:
    """Overlap of contour and ellipse, 0..1; by how many grey levels the rim is brighter."""
    import cv2

    inside, rim, filled = (np.zeros(shape, np.uint8) for _ in range(3))
    (x, y), (a, b), angle = ellipse
    cv2.ellipse(inside, ((x, y), (a, b), angle), 1, -1)
    cv2.ellipse(rim, ((x, y), (1.35 * a, 1.35 * b), angle), 1, -1)
    cv2.drawContours(filled, [contour], -1, 1, -1)
    ring = (rim == 1) & (inside == 0)
    if not ring.any() or not inside.any():
        return 0.0, 0.0
    overlap = float((inside & filled).sum() / (inside | filled).sum())
    return overlap, float(small[ring].mean()) - float(small[inside == 1].mean())
