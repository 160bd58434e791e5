"""The skin atlas of a person from photographs.

Each photograph is projected onto the posed head where it is seen, not at a slant. The light is
taken off: its colour by the whites of the eyes, how it falls by lamps and shadows (`light.py`).
What several show is averaged, what none shows comes from the other side of the face, and what is
left from how skins vary over heads.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.interpolate import RBFInterpolator
from scipy.ndimage import (
    distance_transform_edt,
    label,
    map_coordinates,
    maximum_filter,
    minimum_filter,
)
from scipy.spatial import KDTree

from render.avatars import scan_texture, textures
from render.avatars.detail import ATLAS
from render.avatars.maker import Maker
from render.avatars.photos import complete, light, whites
from render.avatars.photos.detector import BROWS, LEFT_EYE, MOUTH, ON_SKIN, OVAL, RIGHT_EYE
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
BROW_MM = 4.5  # from the points of a brow: its hair
HAIR_TEXELS = 5  # width of a strand's surroundings that it blurs
MOST_BEND = 0.06  # of the face's width
FACING = 0.3  # least cosine to the viewer of a point that bends a photograph
DARK_LIGHT, BRIGHT_LIGHT = 0.3, 3.0  # limits of light on a place, of the mean
TINY = 1e-9


@dataclass(frozen=True)
class Projection:
    """One photograph on the atlas."""

    color: Doubles  # [T, 3] linear, lit
    weight: Doubles  # [T] 0..1 how well it is seen


def paint(
    maker: Maker, places: PointPlaces, photos: list[Photo], found: FaceFit, rest: Floats
) -> Floats:
    """`rest` [V, 3] mm -> [1024, 2048, 3] 0..1"""
    posed = maker.posing.rest(rest)
    faces = list[tuple[Floats, Floats]]()  # vertices and normals of each photograph's face
    for shot in found.shots:
        vertices = maker.posing.pose(shot.expression.astype(np.float32), AHEAD, posed)
        faces.append((vertices, maker.normals(vertices)))
    columns = np.concatenate([rest, *(column for face in faces for column in face)], 1)
    values = scan_texture.places(maker, columns).astype(np.float64)
    at, *texels = np.split(values, 1 + 2 * len(faces), axis=1)
    seen, lamps = list[Projection](), list[Floats]()
    for k, (photo, shot) in enumerate(zip(photos, found.shots, strict=True)):
        points, turned = (places.of(column.astype(np.float64)) for column in faces[k])
        seen.append(project(photo, shot, (points, turned), (texels[2 * k], texels[2 * k + 1])))
        lamps.append(light.lamps(maker, *faces[k]))
    tone = np.median(np.concatenate([_middle(p) for p in seen]), 0)
    typical, edge = complete.typical(maker), _edge(maker, at)
    lit = [
        light.evened(color, one.weight, typical * tone)
        for one, color in zip(seen, unlit(maker, seen, lamps, typical, tone), strict=True)
    ]
    brows = _on_brows(at, places.of(rest.astype(np.float64)))
    clean = [w.weight * (1 - hair(c, tone, edge, brows)) for w, c in zip(seen, lit, strict=True)]
    total = sum(clean, np.zeros(len(at)))
    return complete.complete(merge(lit, clean), total, at, typical * tone)


def unlit(
    maker: Maker, seen: list[Projection], lamps: list[Floats], typical: Doubles, tone: Doubles
) -> list[Doubles]:  # K of [T, 3] linear
    """The colours of K photographs in the light that all of them have on skin of this tone."""
    own = _at_gaussians(maker, typical)
    found = list[Doubles]()
    for one, shining in zip(seen, lamps, strict=True):
        weight = _at_gaussians(maker, one.weight[:, None])[:, 0] * maker.face
        found.append(light.cast(shining, _at_gaussians(maker, one.color), weight, own))
    gains = scan_texture.over_atlas(maker, np.concatenate(found, 1).astype(np.float32))
    each = np.split(gains.astype(np.float64), len(seen), axis=1)
    return [
        one.color / (gain / tone).clip(DARK_LIGHT, BRIGHT_LIGHT)
        for one, gain in zip(seen, each, strict=True)
    ]


def _at_gaussians(maker: Maker, values: Doubles) -> Doubles:  # [T, C] -> [N, C]
    """What texels have, at the Gaussians; of skin alone."""
    picture = values.reshape(scan_texture.SIZE, 2 * scan_texture.SIZE, -1).astype(np.float32)
    return textures.sample(picture, maker.anchor_uv * ATLAS).astype(np.float64)


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
    return Projection(np.stack(color, 1).astype(np.float64), weight)


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
    wide, high = np.abs(maker.template[maker.regions["brows"], :2]).max(0)
    above = (at[:, 1] - high + 10) / 8
    beside = (np.abs(at[:, 0]) - wide + 6) / 6
    return np.clip(np.maximum(above, beside), 0, 1)


def _on_brows(at: Doubles, points: Doubles) -> NDArray[np.bool_]:  # [T, 3], [468, 3] mm -> [T]
    """Near the detector's points of a brow, but for its tail, where hair begins that hangs down."""
    lines = points[np.array(BROWS)[:, 1:]]  # [4, 4, 3]
    share = np.linspace(0, 1, 8)[:, None, None, None]
    along = lines[:, :-1] + share * (lines[:, 1:] - lines[:, :-1])
    return KDTree(along.reshape(-1, 3)).query(at)[0] < BROW_MM


def hair(
    color: Doubles, tone: Doubles, edge: Doubles, brows: NDArray[np.bool_]
) -> Doubles:  # [T, 3], [3], [T], [T] -> [T] 0..1
    """What is unlike the skin's tone at the face's edge, and what of it reaches in from there, but
    for brows."""
    unlike = 1 - light.likeness(color, tone)
    dark = ((unlike > 0.5) & ~brows).reshape(scan_texture.SIZE, -1)
    spots = np.empty(dark.shape, np.int32)
    label(dark, output=spots)
    spots = spots.ravel()
    reaching = np.isin(spots, np.setdiff1d(spots[edge > 0.5], 0))
    near = maximum_filter(reaching.reshape(scan_texture.SIZE, -1), HAIR_TEXELS).ravel()
    return np.maximum(edge * unlike, np.where(brows, 0, near))


def _middle(one: Projection) -> Doubles:  # [n, 3]
    return one.color[one.weight > 0.7]
