"""What hair does to the skin beside it: roots show between strands, and shade it from behind."""

import numpy as np
from scipy.spatial import KDTree

from render.lighting import BLEED, TOWARDS
from render.strands import away
from render.types import Floats

LIES_MM, LOW_MM = 30.0, 14.0  # hair so near skin lies over it; so near, it has its roots there
NEAR_MM = 4.5  # of strands that are counted around a place
STRAND_MM2, BEARD_MM2 = 5.0, 2.4  # of skin that one Gaussian of a strand hides
ROOTS = 0.9  # share of the roots' colour where strands are dense
BULK = 6  # strands: so many near each other are hair, fewer are loose ends
LIT_MM, SOFT_MM = (10.0, 22.0), 9.0  # from the hair: in its light, out of it; evened so far
RIM_MM = 3.0, 8.0  # the same for light from behind
THROUGH = 0.8  # share of the light of strands that gets to the skin between them
SHADED_MM = (6.0, 16.0)  # from the hair: in its shadow, out of it
SHADE = 0.9  # share of the light of both rims that the hair keeps off
BACKWARD = 0.6  # of -z: skin that faces so far backward has no hair in their way

RAY_MM, BEAM_MM = (6.0, 12.0, 18.0, 24.0, 30.0), 4.0  # places towards a light; strands so near them
DIM = 0.03, 0.6  # of the light that each strand keeps off; of all, at most
MATTE = 0.9  # share of the skin's gloss that hair keeps off
PALER = 1.2  # of the red of shadows, as a share, is taken from those of hair
SKYWARDS = np.array([0.0, 0.8, 0.6], np.float32)


def rooted(
    albedo: Floats,  # [n, 3] stored
    points: Floats,  # [n, 3] mm
    hair: Floats,  # [h, 3] mm, middles of its Gaussians
    root: Floats,  # [3] or [n, 3] stored colour
    strand_mm2: float = STRAND_MM2,
) -> Floats:  # [n, 3]
    """Skin in the colour of the roots, where strands lie over it: else sideburns look striped."""
    cover = near(points, hair, strand_mm2)
    return (albedo + ROOTS * cover[:, None] * (root - albedo)).astype(np.float32)


def feet(skin: Floats, normals: Floats, hair: Floats, highest: float) -> Floats:
    """[h, 3] mm of hair -> [f, 3]: where it lies over skin [n, 3] mm, no higher than that."""
    at = np.asarray(KDTree(skin).query(hair)[1])
    height = ((hair - skin[at]) * normals[at]).sum(1)
    return (hair - height[:, None] * normals[at])[height < highest].astype(np.float32)


def near(points: Floats, hair: Floats, strand_mm2: float = STRAND_MM2) -> Floats:  # [n] 0..1
    """How much of the skin strands lie over."""
    count = KDTree(hair).query_ball_point(points, NEAR_MM, return_length=True)
    return 1 - np.exp(-np.asarray(count) * strand_mm2 / (np.pi * NEAR_MM**2))


def lit(
    visibility: Floats,  # [4, n] of sky, key light and rims
    points: Floats,  # [n, 3] mm
    hair: Floats,  # [h, 3] mm
    seen: Floats,  # [h, 4] of the hair
) -> Floats:  # [4, n]
    """Skin between strands is lit as they are: light goes through hair, and in full shadow under it
    skin would look like a hole."""
    apart, near = (np.asarray(x) for x in KDTree(hair).query(points, k=BULK))
    share, close = (
        np.clip((far - apart[:, -1]) / (far - full), 0, 1) for full, far in (LIT_MM, RIM_MM)
    )
    shares = np.stack([share, share, close, close])
    out = np.maximum(visibility, shares * THROUGH * seen[near].mean(1).T)
    tree, visibility = KDTree(points), visibility.copy()
    for row in np.flatnonzero(share > 0):  # no jagged shadows of single cards
        around = tree.query_ball_point(points[row], SOFT_MM)
        visibility[:, row] += shares[:, row] * (out[:, around].mean(1) - visibility[:, row])
    return visibility.astype(np.float32)


def shaded(
    visibility: Floats,  # [4, n] of sky, key light and rims
    points: Floats,  # [n, 3] mm
    hair: Floats,  # [h, 3] mm
) -> Floats:  # [4, n]
    """Less of the rims, which shine from behind, beside hair: it stands in their way, but for skin
    that itself faces backward."""
    apart = np.asarray(KDTree(hair).query(points, k=BULK)[0])[:, -1]
    share = np.clip((SHADED_MM[1] - apart) / (SHADED_MM[1] - SHADED_MM[0]), 0, 1)
    share *= 1 - np.clip(-away(points)[:, 2] / BACKWARD, 0, 1)
    out = visibility.copy()
    out[2:] *= (1 - SHADE * share * share * (3 - 2 * share)).astype(np.float32)
    return out


def cast(
    visibility: Floats,  # [4, n] of sky, key light and rims
    points: Floats,  # [n, 3] mm
    hair: Floats,  # [h, 3] mm
) -> Floats:  # [4, n]
    """Soft shadows of loose strands, which shadows of cards leave out, on skin beside hair."""
    tree, out, free = KDTree(hair), visibility.copy(), 1 - near(points, hair)
    for row, way in ((0, SKYWARDS), (1, TOWARDS[0])):
        beams = [
            tree.query_ball_point(points + mm * way, BEAM_MM, return_length=True) for mm in RAY_MM
        ]
        kept = DIM[1] * (1 - np.exp(-DIM[0] * np.sum(beams, 0)))
        out[row] += free * (np.minimum(out[row], 1 - kept) - out[row])
    return out.astype(np.float32)


def paler(albedo: Floats, bald: Floats, haired: Floats) -> Floats:  # [n, 3] stored, [n], [n]
    """The albedo without the red that light gets in shade: hair's shadow is wide and soft, and
    with all of it looks like a burn. By the light that a bald head and this one see; what sees more
    in this one (whites that a look brings out) stays."""
    seen = bald, np.minimum(bald, haired)
    red = [1 + PALER * BLEED * (1 - share[:, None]) for share in seen]
    return (albedo * np.sqrt(red[0] / red[1])).clip(0, 1).astype(np.float32)
