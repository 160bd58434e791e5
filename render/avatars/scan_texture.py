"""The skin atlas of a registered scan: every texel takes the colour of the scan where it lies."""

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter
from scipy.spatial import KDTree

from render.avatars.maker import Maker
from render.avatars.surface_scan import Scan
from render.avatars.textures import SIZE
from render.decoder import mesh_parts
from render.decoder.posing import sphere_centre
from render.types import Doubles, Floats

NEIGHBOURS = 3
LID_MM = 0.7  # a lid lies farther than this above its eyeball
HOLE_MM = (3.0, 8.0)  # from a place of the scan: there its colour gives way to those around
SOFT = 12.0  # texels


def paint(maker: Maker, geometry: Floats, scan: Scan) -> Floats:  # [1024, 2048, 3] 0..1
    """Of a scan with colours."""
    assert scan.colors is not None
    skin = np.ones(len(scan.places), bool)
    for eye in maker.posing.eyeballs:
        centre = sphere_centre(geometry[eye])
        radius = np.median(np.linalg.norm(geometry[eye] - centre, axis=1))
        skin &= np.linalg.norm(scan.places - centre, axis=1) > radius + LID_MM
    distance, near = KDTree(scan.places[skin]).query(places(maker, geometry), k=NEIGHBOURS)
    picture = scan.colors[skin][near].mean(1).reshape(SIZE, 2 * SIZE, 3)
    low, high = HOLE_MM
    known = np.clip((high - distance[:, 0]) / (high - low), 0, 1).reshape(SIZE, 2 * SIZE, 1)
    sums = gaussian_filter(picture * (known + 1e-4), (SOFT, SOFT, 0))
    around = sums / gaussian_filter(known + 1e-4, (SOFT, SOFT, 0))
    return enlarged(np.clip(around + known * (picture - around), 0, 1))


def enlarged(stored: Floats | Doubles) -> Floats:  # [SIZE, 2 * SIZE, 3] 0..1 -> [1024, 2048, 3]
    """As large as an atlas."""
    rgb = np.rint(255 * stored).astype(np.uint8)
    large = Image.fromarray(rgb).resize((2048, 1024), Image.Resampling.BICUBIC)
    return np.asarray(large, np.float32) / np.float32(255)


def places(maker: Maker, values: Floats) -> Doubles:  # [V, C] -> [SIZE * 2 * SIZE, C]
    """What vertices have, at the texels: e.g. where these lie, in mm."""
    head = maker.surface
    return over_atlas(maker, (head.interpolate @ values[head.used]))


def over_atlas(maker: Maker, values: Floats) -> Doubles:  # [N, C] -> [SIZE * 2 * SIZE, C]
    """What Gaussians have, between those that have a place in the atlas."""
    return maker.atlas_shares @ values[maker.anchor_kinds == mesh_parts.SKIN]
