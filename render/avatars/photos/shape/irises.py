"""The size of a face by its irises: people's irises differ less in size than their faces do."""

from dataclasses import replace

import numpy as np

from render.avatars.photos.shape.detector import EYES
from render.avatars.photos.shape.fit import FaceFit, PhotoCamera
from render.avatars.photos.shape.picture import Photo
from render.types import Doubles

# Across the detector's rings on drawn people; people's irises have 11.7, with a deviation of 4 %.
IRIS_MM = 11.4
SHARE = 0.3  # of what the irises tell: they and the fit are wrong by about as much


def sized(found: FaceFit, photos: list[Photo]) -> FaceFit:
    """With everything larger or smaller, as the photograph from the front tells: what it shows
    stays the same."""
    front = max(range(len(photos)), key=lambda k: -found.shots[k].turn[2, 2])
    seen = iris_mm(photos[front], found.shots[front], found.points)
    factor = (IRIS_MM / seen) ** SHARE
    shots = [replace(shot, offset=factor * shot.offset) for shot in found.shots]
    return replace(found, points=factor * found.points, shots=shots)


def iris_mm(photo: Photo, shot: PhotoCamera, points: Doubles) -> float:  # [468, 3] mm
    """Mean diameter of both irises, as far away as the corners of the eyes."""
    across = list[float]()
    for outline, iris in EYES:
        ring = photo.points[iris + 1 : iris + 5]
        away = shot.view(points[[outline[0], outline[8]]])[:, 2].mean()
        px = np.linalg.norm(ring[:2] - ring[2:], axis=1).mean()
        across.append(float(px * away / shot.focal_px))
    return float(np.mean(across))
