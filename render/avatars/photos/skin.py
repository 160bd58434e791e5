"""The skin atlas of a person from photographs.

Each photograph is projected onto the posed head where it is seen, not at a slant. The light is
taken off: its colour by the whites of the eyes, how it falls by second-order spherical harmonics
of the normals (Ramamoorthi and Hanrahan 2001). What several show is averaged, what none shows
comes from the other side of the face, and what is left from how skins vary over heads.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.interpolate import RBFInterpolator
from scipy.ndimage import distance_transform_edt, map_coordinates, minimum_filter

from render.avatars import scan_texture
from render.avatars.maker import Maker
from render.avatars.photos import complete, whites
from render.avatars.photos.detector import LEFT_EYE, MOUTH, ON_SKIN, OVAL, RIGHT_EYE
from render.avatars.photos.fit import FaceFit, PhotoCamera
from render.avatars.photos.picture import Photo
from render.avatars.photos.places import PointPlaces
from render.lighting import exposed
from render.types import AHEAD, Doubles, Floats

CELL_PX = 3  # of the depth map
GRID_PX = 12  # between places where the bending of a picture is computed
BEHIND_MM = 6.0  # of what is in front: not seen
SLANT = (0.15, 0.5)  # cosines to the viewer: from not at all to fully
SHARPEST = 8.0  # power of the weights: who sees best decides
OPENING_PX = 2.0  # around eyes and mouth, what is in them
FEATHER = 0.05  # share of the face's width over which it fades towards its outline, beside hair
MOST_BEND = 0.06  # of the face's width
FACING = 0.3  # least cosine to the viewer of a point that bends a photograph
DARK_LIGHT, BRIGHT_LIGHT = 0.35, 2.2  # limits of light on a place, of the mean
TINY = 1e-9
HUES = 0.35  # deviation of the logarithm from the skin's tone at which a place counts half


@dataclass(frozen=True)
class Projection:
    """One photograph on the atlas."""

    color: Doubles  # [T, 3] linear, lit
    normals: Doubles  # [T, 3] in the photograph's own space
    weight: Doubles  # [T] 0..1 how well it is seen


def paint(
    maker: Maker, places: PointPlaces, photos: list[Photo], found: FaceFit, rest: Floats
) -> Floats:
    """`rest` [V, 3] mm -> [1024, 2048, 3] 0..1"""
    posed = maker.posing.rest(rest)
    columns = [rest]
    for shot in found.shots:
        vertices = maker.posing.pose(shot.expression.astype(np.float32), AHEAD, posed)
        columns += [vertices, maker.normals(vertices)]
    values = scan_texture.places(maker, np.concatenate(columns, 1)).astype(np.float64)
    at, seen = values[:, :3], list[Projection]()
    for k, (photo, shot) in enumerate(zip(photos, found.shots, strict=True)):
        where, facing = values[:, 3 + 6 * k : 6 + 6 * k], values[:, 6 + 6 * k : 9 + 6 * k]
        points, turned = (places.of(c.astype(np.float64)) for c in columns[1 + 2 * k : 3 + 2 * k])
        seen.append(project(photo, shot, (points, turned), (where, facing)))
    tone = np.median(np.concatenate([_middle(p) for p in seen]), 0)
    lit, edge = [unlit(one, tone) for one in seen], _edge(maker, at)
    clean = [w.weight * (1 - edge * _unlike(c, tone)) for w, c in zip(seen, lit, strict=True)]
    total = sum(clean, np.zeros(len(at)))
    return complete.complete(merge(lit, clean), total, at, complete.typical(maker) * tone)


def merge(colors: list[Doubles], weights: list[Doubles]) -> Doubles:  # K of [T, 3], [T] -> [T, 3]
    """Who sees a place best decides; one that is hardly seen at all has the colour seen there."""
    best = np.max(weights, axis=0) + TINY
    shares = [(weight / best) ** SHARPEST for weight in weights]
    out = np.sum([s[:, None] * c for s, c in zip(shares, colors, strict=True)], 0)
    return out / (np.sum(shares, 0) + TINY)[:, None]


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
    cosine = _towards(turned, x)
    inside = ((px > 1) & (px < np.array([width - 1, height - 1]))).all(1)
    front = (cosine > 0) & inside
    moved = px.copy()
    moved[front] += _bend(photo, shot, points, px[front])
    row, column = moved[:, 1].clip(0, height - 1), moved[:, 0].clip(0, width - 1)
    weight = np.clip((cosine - SLANT[0]) / (SLANT[1] - SLANT[0]), 0, 1) * inside
    weight *= _in_front(px, x[:, 2], size, front)
    weight *= _mask(photo)[row.astype(int), column.astype(int)]
    linear = exposed(photo.picture.astype(np.float32) / np.float32(255)) / whites.light(photo)
    at = [moved[:, 1] - 0.5, moved[:, 0] - 0.5]
    color = [map_coordinates(linear[..., c], at, order=1, mode="nearest") for c in range(3)]
    return Projection(np.stack(color, 1).astype(np.float64), turned, weight)


def _towards(normals: Doubles, x: Doubles) -> Doubles:
    return -(normals * x).sum(1) / np.linalg.norm(x, axis=1)


def _bend(photo: Photo, shot: PhotoCamera, points: tuple[Doubles, Doubles], px: Doubles) -> Doubles:
    """At px [n, 2] what the fit leaves between the detector's points and their places [n, 2] px."""
    height, width = photo.picture.shape[:2]
    at = shot.project(points[0], (width, height))
    facing = _towards(points[1] @ shot.turn.T, shot.view(points[0]))
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
    from PIL import ImageDraw

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


def _edge(maker: Maker, at: Doubles) -> Doubles:  # [T, 3] mm -> [T] 0..1
    """Where hair may lie over the face: above the brows and at the temples."""
    brows = maker.template[maker.regions["brows"]]
    above = (at[:, 1] - brows[:, 1].max() - 4) / 6
    beside = (np.abs(at[:, 0]) - np.abs(brows[:, 0]).max() - 2) / 6
    return np.clip(np.maximum(above, beside), 0, 1)


def _unlike(color: Doubles, tone: Doubles) -> Doubles:  # [T, 3] -> [T] 0..1
    """How far a colour is from the skin's tone."""
    off = np.abs(np.log((color + 0.003) / (tone + 0.003))).max(1)
    return 1 - 1 / (1 + (off / HUES) ** 4)


def _middle(one: Projection) -> Doubles:  # [n, 3]
    return one.color[one.weight > 0.7]


def unlit(one: Projection, tone: Doubles) -> Doubles:  # [T, 3] linear
    """Its colours in the light of all photographs' mean face."""
    basis = harmonics(one.normals)
    rows = np.flatnonzero(one.weight > 0.3)
    if len(rows) < 100:
        return one.color
    own, color = basis[rows], np.log(one.color[rows] + 0.003)
    weight = one.weight[rows].copy()
    target = color.copy()
    fits = np.zeros((9, 3))
    for _ in range(8):
        heavy = own * weight[:, None]
        ridge = np.diag([0.0, *[1.0] * 3, *[4.0] * 5]) * 0.01 * weight.sum()
        fits = np.linalg.solve(heavy.T @ own + ridge + 1e-6 * np.eye(9), heavy.T @ target)
        off = np.abs(target - own @ fits).max(1)
        weight = one.weight[rows] / (1 + (off / HUES) ** 2) ** 2
    light = basis @ fits
    gain = np.exp(light - np.log(tone + 0.003))
    return one.color / gain.clip(DARK_LIGHT, BRIGHT_LIGHT)


def harmonics(n: Doubles) -> Doubles:  # [T, 3] unit -> [T, 9]
    x, y, z = n.T
    one = np.ones_like(x)
    return np.stack([one, x, y, z, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y], 1)
