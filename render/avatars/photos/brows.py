"""Brows: hairs where a picture shows some, which painted on the skin alone look like a smudge.

They stand where the person's skin is darker than around it, in the colour that is seen there, and
lie as those of the shipped people do.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from render.avatars.maker import Maker
from render.avatars.photos.colors.complete import anchors, ramp
from render.avatars.photos.dress import standing
from render.decoder import identity, mesh_parts
from render.decoder.beard import Beard, frames, joined
from render.decoder.identity import Identity
from render.decoder.learned import avatar_files
from render.lighting import LUMINANCE
from render.types import Doubles, Floats, Ints

ABOVE_MM = 2.0  # the lids: there no brow grows
ZONE_MM = (6.0, 3.0)  # from hairs of the shipped people: skin that may be a brow
AROUND_MM, AROUND = 16.0, 80.0  # of it: how far; the percentile that is bare
DARK = (0.85, 0.6)  # brightness over that of bare skin: from no brow to a whole one
SMOOTH_MM, NEIGHBOURS = 1.2, 12
DENSE = 1.7  # hairs a square millimetre of a whole brow
ALIKE = 6  # hairs of others near a place, one of which it gets
MIDDLE = 0.6  # of the way from a hair's root to its middle, which lies on a place
HAIR, DARKER = 12.0, 0.6  # percentile of what a brow shows; its hairs are so much darker still
PAINT = 0.45  # of a painted brow that its hairs take the place of
UNEVEN = 0.15  # deviation of brightness from hair to hair


class SeenBrows(NamedTuple):
    """What a skin shows."""

    bare: Floats  # [N, 3] stored: the colour of bare skin nearby
    share: Doubles  # [N] 0..1 how much of a brow every Gaussian is


def grown(maker: Maker, who: Identity) -> Identity:
    """With hairs on the brows that the skin shows, and less of these on the skin."""
    pool = hairs(maker)
    roots = standing(maker, pool)
    brows = seen(maker, who, roots.astype(np.float64))
    whole = brows.share > 0.5
    if not whole.any():
        return who
    rng = np.random.default_rng(0)
    corners, shares = planted(maker, brows.share, rng)
    color = DARKER * np.percentile(who.albedo[whole].astype(np.float64) ** 2, HAIR, axis=0)
    colors = color * np.exp(rng.normal(0, UNEVEN, (len(corners), 1)))
    grows = like(maker, pool, roots, corners, shares, np.sqrt(colors).clip(0, 1), rng)
    albedo = who.albedo + PAINT * brows.share[:, None] * (brows.bare - who.albedo)
    return replace(who, albedo=albedo.astype(np.float32), beard=joined([who.beard, grows]))


def hairs(maker: Maker) -> Beard:
    """Brows of all shipped people."""
    found, lids = list[Beard](), maker.template[maker.regions["eyelids"], 1].max()
    for name in avatar_files.shipped():
        strands = identity.load(name).beard
        at = standing(maker, strands)
        found.append(strands.take((at[:, 1] > lids + ABOVE_MM) & (at[:, 2] > 0)))
    return joined(found)


def seen(maker: Maker, who: Identity, roots: Doubles) -> SeenBrows:  # [B, 3] mm of hairs of others
    at, light = anchors(maker).astype(np.float64), who.albedo @ LUMINANCE
    own = np.flatnonzero(maker.anchor_kinds == mesh_parts.SKIN)
    may = np.zeros(len(at))
    may[own] = ramp(KDTree(roots).query(at[own], distance_upper_bound=ZONE_MM[0])[0], *ZONE_MM)
    zone = np.flatnonzero(may > 0)
    bare, share = who.albedo.copy(), np.zeros(len(at))
    for row, around in zip(
        zone, KDTree(at[own]).query_ball_point(at[zone], AROUND_MM), strict=True
    ):
        rows = own[around]
        level = np.percentile(light[rows], AROUND)
        bare[row] = who.albedo[rows[light[rows] >= level]].mean(0)
        share[row] = 1 - np.clip((light[row] / level - DARK[1]) / (DARK[0] - DARK[1]), 0, 1)
    distance, near = KDTree(at[zone]).query(at[zone], k=NEIGHBOURS)
    weight = np.exp(-((distance / SMOOTH_MM) ** 2))
    share[zone] = may[zone] * (weight * share[zone][near]).sum(1) / weight.sum(1)
    return SeenBrows(bare, share)


def planted(
    maker: Maker, share: Doubles, rng: np.random.Generator
) -> tuple[Ints, Floats]:  # [n, 3] vertices, [n, 3]
    """Triangles of roots, and places on these: the denser, the more of a brow is seen."""
    own = np.bincount(maker.anchor_triangles, minlength=len(maker.faces))
    mean = np.bincount(maker.anchor_triangles, share, len(maker.faces)) / np.maximum(own, 1)
    a, b, c = (maker.template[maker.faces[:, k]].astype(np.float64) for k in range(3))
    hairs_on = DENSE * mean * 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    rows, shares = mesh_parts.scattered(hairs_on, round(hairs_on.sum()), rng)
    return maker.faces[rows], shares


def like(
    maker: Maker, pool: Beard, roots: Floats, corners: Ints, shares: Floats, albedo: Doubles,
    rng: np.random.Generator,
) -> Beard:  # fmt: skip
    """A hair on each place [n, 3], [n, 3] in its colour [n, 3], that lies as one nearby does of
    those that stand on roots [B, 3]."""
    starts = np.flatnonzero(np.r_[True, (np.diff(roots, axis=0) != 0).any(1)])
    pieces = np.diff(np.r_[starts, len(pool)])
    middles = np.repeat(np.add.reduceat(pool.offsets, starts) / pieces[:, None], pieces, 0)
    places = np.einsum("nij,ni->nj", maker.template[corners], shares)
    near = np.asarray(KDTree(roots[starts]).query(places, k=ALIKE)[1])
    chosen = near[np.arange(len(near)), rng.integers(ALIKE, size=len(near))]
    own = np.repeat(np.arange(len(chosen)), pieces[chosen])
    ends = np.cumsum(pieces[chosen])
    of = np.arange(len(own)) + np.repeat(starts[chosen] + pieces[chosen] - ends, pieces[chosen])
    turns = frames(maker.template, corners[own])
    world = frames(maker.template, pool.corners[of])
    offsets, along = (
        np.einsum("nji,njk,nk->ni", turns, world, column[of]).astype(np.float32)
        for column in (pool.offsets - MIDDLE * middles, pool.along)
    )
    return Beard(
        corners=corners[own].astype(np.uint16),
        shares=shares[own],
        offsets=offsets,
        along=along,
        scales=pool.scales[of],
        opacities=pool.opacities[of],
        albedo=albedo[own].astype(np.float32),
        seen=pool.seen[of],
    )
