"""What the decoder computes once for an identity and keeps while it lives."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from render.decoder.identity import Identity
from render.decoder.neck import Neck, RestSurface, Share
from render.lighting import Lighting
from render.types import FIELDS, Density, Floats, Gaussians, Ints, Shine

HIGHLIGHT_MM = 0.75


class IdentityCache(NamedTuple):
    """What follows from an identity alone."""

    biases: tuple[Floats, ...]  # per level [texels, C] of the light decoder, nested
    light: Floats  # [texels, 2] of the light decoder at rest
    rest: RestSurface
    reflected: Floats  # [N, 3] linear albedo
    gloss: Floats  # [N] weight of mirrored light
    rims: Floats  # [N, 2] the same times the shares of both rims
    opacities: Floats  # [N]
    strands: Gaussians  # hair at rest
    beard: Floats  # [B, 3] stored colours
    cloud: Gaussians  # what `decode` with `reuse` fills
    neck: Neck
    skin: Share  # of the mesh
    still: Share  # of rest.normals
    stretch: tuple[Ints, Floats]  # which Gaussians the neck stretches, and how far, a rad
    hair: Share
    eye_sizes: Floats  # [2]


EMPTY = Gaussians(*(np.zeros((0, *row), np.float32) for row in FIELDS.values()), shine=None)


def reflected(identity: Identity, shares: csr_array, density: Density) -> Floats:  # [N, 3]
    """Linear albedo of the Gaussians drawn; `shares` [N, M] see Decoder."""
    stored = shares @ identity.albedo
    if density in identity.detail:
        stored *= identity.detail[density][:, None]
    return np.minimum(stored, 1) ** 2


def static_cloud(
    identity: Identity, cache: IdentityCache, roughness: Floats, lights: Lighting
) -> Gaussians:
    """Room for a head's Gaussians, with what no expression changes filled in."""
    count, hair, beard = len(cache.opacities), cache.strands, identity.beard
    total = count + 2 + len(hair) + len(beard)
    arrays = (np.empty((total, *row), np.float32) for row in FIELDS.values())
    shine = Shine(np.empty((count, 4), np.float32), roughness, lights.colors)
    cloud = Gaussians(*arrays, shine=shine)
    highlights, strands = slice(count, count + 2), slice(total - len(beard), total)
    cloud.opacities[:count] = cache.opacities
    shine.weights[:, 2:] = cache.rims
    cloud.quats[highlights], cloud.scales[highlights] = (1, 0, 0, 0), HIGHLIGHT_MM
    cloud.colors[highlights] = 1
    for name in FIELDS:
        getattr(cloud, name)[count + 2 : strands.start] = getattr(hair, name)
    cloud.scales[strands], cloud.opacities[strands] = beard.scales, beard.opacities
    cloud.colors[strands] = cache.beard
    return cloud
