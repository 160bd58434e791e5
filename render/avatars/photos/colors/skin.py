"""The skin atlas of a person from photographs.

Each photograph is projected onto the posed head where it is seen (`projection.py`). The light is
taken off: how bright and coloured it is by what is likely (`exposure.py`), how it falls by lamps
and shadows (`light.py`). What several show is averaged, what none shows comes from the other side
of the face, and what is left from how skins vary over heads (`complete.py`).
"""

from dataclasses import dataclass, replace

import numpy as np

from render.avatars import scan_texture, textures
from render.avatars.detail import ATLAS
from render.avatars.maker import Maker
from render.avatars.photos.colors import complete, creases, exposure, light
from render.avatars.photos.colors.covered import HairPlaces, beard_color, covered
from render.avatars.photos.colors.projection import Projection, project
from render.avatars.photos.shape.fit import FaceFit
from render.avatars.photos.shape.picture import Photo
from render.avatars.photos.shape.places import PointPlaces
from render.avatars.textures import SIZE
from render.types import AHEAD, Doubles, Floats

SHARPEST = 8.0  # power of the weights: who sees best decides
ENOUGH = 0.6  # of the face, that tells its colour
DARK_LIGHT, BRIGHT_LIGHT = 0.3, 3.0  # limits of light on a place, of the mean
TINY = 1e-9


@dataclass(frozen=True)
class PaintedSkin:
    atlas: Floats  # [1024, 2048, 3] 0..1
    lights: list[Doubles]  # [3] linear, in each photograph
    tone: Doubles  # [3] linear, of the face
    beard: Doubles | None = None  # [3] linear, where one is seen


def paint(
    maker: Maker,
    places: PointPlaces,
    photos: list[Photo],
    found: FaceFit,
    rest: Floats,  # [V, 3] mm
) -> PaintedSkin:
    posed = maker.posing.rest(rest)
    faces = list[tuple[Floats, Floats]]()  # vertices and normals of each photograph's face
    for shot in found.shots:
        vertices = maker.posing.pose(shot.expression.astype(np.float32), AHEAD, posed)
        faces.append((vertices, maker.normals(vertices)))
    columns = [rest, maker.template, *(column for face in faces for column in face)]
    values = scan_texture.places(maker, np.concatenate(columns, 1)).astype(np.float64)
    at, on_mean, *texels = np.split(values, len(columns), axis=1)
    seen, lamps = list[Projection](), list[Floats]()
    for k, (photo, shot) in enumerate(zip(photos, found.shots, strict=True)):
        points, turned = (places.of(column.astype(np.float64)) for column in faces[k])
        seen.append(project(photo, shot, (points, turned), (texels[2 * k], texels[2 * k + 1])))
        lamps.append(light.lamps(maker, *faces[k]))
    lights, tone = exposure.estimate(maker, photos, [_middle(p) for p in seen])
    seen = [
        replace(one, color=one.color / shining) for one, shining in zip(seen, lights, strict=True)
    ]
    typical = complete.typical(maker)
    usual, folds = typical * tone, creases.folded(maker, [shot.expression for shot in found.shots])
    lit = list[Doubles]()
    plain = unlit(maker, seen, lamps, typical, tone)
    for one, fold, color in zip(seen, folds, plain, strict=True):
        even = creases.smoothed(light.evened(color, one.told, usual), one.weight, fold)
        soft = light.soft_hues(even, one.weight * ~one.dazzled, usual)
        lit.append(light.natural(light.matte(soft, usual), tone))
    hairy = HairPlaces.of(maker, at, places.of(rest.astype(np.float64)))
    clean = [w.weight * (1 - covered(c, tone, hairy)) for w, c in zip(seen, lit, strict=True)]
    total = sum(clean, np.zeros(len(at)))
    atlas = complete.complete(maker, merge(lit, clean), total, on_mean, usual)
    beard = beard_color(lit, [one.weight for one in seen], tone, hairy)
    return PaintedSkin(atlas, lights, tone, beard)


def unlit(
    maker: Maker, seen: list[Projection], lamps: list[Floats], typical: Doubles, tone: Doubles
) -> list[Doubles]:  # K of [T, 3] linear
    """The colours of K photographs in the light that all of them have on skin of this tone."""
    own = _at_gaussians(maker, typical)
    found = list[Doubles]()
    for one, shining in zip(seen, lamps, strict=True):
        weight = _at_gaussians(maker, one.told[:, None])[:, 0] * maker.face
        found.append(light.cast(shining, _at_gaussians(maker, one.color), weight, own))
    gains = scan_texture.over_atlas(maker, np.concatenate(found, 1).astype(np.float32))
    each = np.split(gains.astype(np.float64), len(seen), axis=1)
    return [
        one.color / (gain / tone).clip(DARK_LIGHT, BRIGHT_LIGHT)
        for one, gain in zip(seen, each, strict=True)
    ]


def _at_gaussians(maker: Maker, values: Doubles) -> Doubles:  # [T, C] -> [N, C]
    """What texels have, at the Gaussians; of skin alone."""
    picture = values.reshape(SIZE, 2 * SIZE, -1).astype(np.float32)
    return textures.sample(picture, maker.anchor_uv * ATLAS).astype(np.float64)


def merge(colors: list[Doubles], weights: list[Doubles]) -> Doubles:  # K of [T, 3], [T] -> [T, 3]
    """Who sees a place best decides; one that is hardly seen at all has the colour seen there."""
    best = np.max(weights, axis=0) + TINY
    shares = [(weight / best) ** SHARPEST for weight in weights]
    out = np.sum([s[:, None] * c for s, c in zip(shares, colors, strict=True)], 0)
    return out / (np.sum(shares, 0) + TINY)[:, None]


def _middle(one: Projection) -> Doubles:  # [3]
    """The colour of the face, where it is seen best."""
    seen = one.weight > 0.7 * one.weight.max()
    plain = seen & ~one.dazzled
    return np.median(one.color[plain if plain.sum() > ENOUGH * seen.sum() else seen], 0)
