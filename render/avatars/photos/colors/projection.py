"""One photograph on the skin atlas: where it is seen, not at a slant nor behind anything; bent to
where the detector saw the face's points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.interpolate import RBFInterpolator
from scipy.ndimage import distance_transform_edt, map_coordinates, minimum_filter

from render.avatars import textures
from render.avatars.photos.shape.detector import LEFT_EYE, MOUTH, ON_SKIN, OVAL, RIGHT_EYE
from render.avatars.photos.shape.fit import PhotoCamera
from render.avatars.photos.shape.picture import Photo
from render.lighting import exposed
from render.types import Doubles

CELL_PX = 3  # of the depth map
GRID_PX = 12  # between places where the bending of a picture is computed
BEHIND_MM = 6.0  # of what is in front: not seen
SLANT = (0.15, 0.5)  # cosines to the viewer: from not at all to fully
OPENING_PX = 2.0  # around eyes and mouth, what is in them
FEATHER = 0.05  # share of the face's width over which it fades towards its outline, beside hair
MOST_BEND = 0.06  # of the face's width
FACING = 0.3  # least cosine to the viewer of a point that bends a photograph
TEXELS, SOFT = 330, 0.4  # across a face; of one, the blur that leaves nothing finer
GRAIN_PX = 0.6  # blur of small photographs, whose finest is noise
LESS_TOLD = 0.35  # of the light, where the camera is dazzled
DAZZLED = 0.95  # stored; what is brighter is told too roughly


@dataclass(frozen=True)
class Projection:
    """One photograph on the atlas."""

    color: Doubles  # [T, 3] linear, lit
    weight: Doubles  # [T] 0..1 how well it is seen
    dazzled: NDArray[np.bool_]  # [T] as bright as the camera can tell

    @property
    def told(self) -> Doubles:  # [T] 0..1
        """How much it tells of the light."""
        return self.weight * np.where(self.dazzled, LESS_TOLD, 1)


def project(
    photo: Photo,
    shot: PhotoCamera,
    points: tuple[Doubles, Doubles],  # [468, 3] mm and normals, of the detector's places
    texels: tuple[Doubles, Doubles],  # [T, 3] the same of the texels
) -> Projection:
    height, width = photo.picture.shape[:2]
    size = (width, height)
    where, turned = texels[0], texels[1] @ shot.turn.T
    turned /= np.linalg.norm(turned, axis=1, keepdims=True) + 1e-9
    x, px = shot.view(where), shot.project(where, size)
    cosine = towards(turned, x)
    inside = ((px > 1) & (px < np.array([width - 1, height - 1]))).all(1)
    front = (cosine > 0) & inside
    moved = px.copy()
    moved[front] += _bend(photo, shot, points, px[front])
    row, column = moved[:, 1].clip(0, height - 1), moved[:, 0].clip(0, width - 1)
    weight = np.clip((cosine - SLANT[0]) / (SLANT[1] - SLANT[0]), 0, 1) * inside
    weight *= _in_front(px, x[:, 2], size, front)
    weight *= _mask(photo)[row.astype(int), column.astype(int)]
    blur = max(GRAIN_PX, SOFT * float(np.ptp(photo.points[list(OVAL), 0])) / TEXELS)
    stored = textures.soft(photo.picture.astype(np.float32) / np.float32(255), blur)
    linear = exposed(np.minimum(stored, np.float32(DAZZLED)))
    at = [moved[:, 1] - 0.5, moved[:, 0] - 0.5]
    color = [map_coordinates(linear[..., c], at, order=1, mode="nearest") for c in range(3)]
    lit = np.stack(color, 1).astype(np.float64)
    return Projection(lit, weight, lit.max(1) > 0.99 * exposed(np.full(1, DAZZLED, np.float32))[0])


def towards(normals: Doubles, x: Doubles) -> Doubles:  # [n, 3], [n, 3] seen from the camera -> [n]
    """Cosines to the viewer, times the normals' lengths."""
    return -(normals * x).sum(1) / np.linalg.norm(x, axis=1)


def _bend(photo: Photo, shot: PhotoCamera, points: tuple[Doubles, Doubles], px: Doubles) -> Doubles:
    """At px [n, 2] what the fit leaves between the detector's points and their places [n, 2] px."""
    height, width = photo.picture.shape[:2]
    at = shot.project(points[0], (width, height))
    facing = towards(points[1] @ shot.turn.T, shot.view(points[0]))
    off = photo.points[:ON_SKIN] - at
    most = MOST_BEND * float(np.ptp(photo.points[list(OVAL), 0]))
    good = (facing > FACING) & (np.linalg.norm(off, axis=1) < most)
    middle = points[0].mean(0)
    rim = shot.project(middle + 2 * (points[0] - middle), (width, height))[list(OVAL)]
    known = np.concatenate([at[good], rim])  # far from the face nothing is bent
    moves = np.concatenate([off[good], np.zeros_like(rim)])
    field = RBFInterpolator(known, moves, neighbors=32, smoothing=10, kernel="linear")
    rows, columns = (np.arange(0, size + GRID_PX, GRID_PX) for size in (height, width))
    grid = np.stack(np.meshgrid(columns, rows), 2).astype(np.float64)
    bent = field(grid.reshape(-1, 2)).reshape(grid.shape)
    where = [px[:, 1] / GRID_PX, px[:, 0] / GRID_PX]
    return np.stack([map_coordinates(bent[..., c], where, order=1) for c in range(2)], 1)


def _in_front(
    px: Doubles, depth: Doubles, size: tuple[int, int], front: NDArray[np.bool_]
) -> Doubles:
    """[T] 0 or 1: nothing of the head lies before it. A depth map of the texels themselves."""
    across, down = size[0] // CELL_PX + 2, size[1] // CELL_PX + 2
    cell = (px / CELL_PX).clip(0, [across - 1, down - 1]).astype(int)
    nearest = np.full((down, across), np.inf)
    np.minimum.at(nearest, (cell[front, 1], cell[front, 0]), depth[front])
    nearest = minimum_filter(nearest, 3)
    return (depth < nearest[cell[:, 1], cell[:, 0]] + BEHIND_MM).astype(np.float64)


def _mask(photo: Photo) -> Doubles:  # [H, W] 0..1
    """Where the photograph shows the face's skin: not in eyes or mouth, nor at the face's edge."""
    height, width = photo.picture.shape[:2]

    def filled(which: tuple[int, ...]) -> NDArray[np.bool_]:
        image = Image.new("L", (width, height))
        ImageDraw.Draw(image).polygon([tuple(photo.points[k]) for k in which], fill=1)
        return np.asarray(image) > 0

    face, span = filled(OVAL), float(np.ptp(photo.points[list(OVAL), 0]))
    out = np.clip(np.asarray(distance_transform_edt(face)) / span / FEATHER, 0, 1)
    for which in (LEFT_EYE, RIGHT_EYE, MOUTH):
        hole = filled(which)
        if hole.any():
            out *= np.asarray(distance_transform_edt(~hole)) > OPENING_PX
    return out
