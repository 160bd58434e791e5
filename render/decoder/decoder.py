"""The decoder D(x, g; identity): expression code and gaze -> mesh and Gaussians (paper Sec. 3).

code -> rig -> posed mesh (`render/decoder/posing.py`); code and bias maps -> change of light
(`learned/light.py`); both -> Gaussians attached to the skin (`surface.py`).
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from render.decoder import eyes, neck
from render.decoder.coding import EXPRESSION_DIM, Coding
from render.decoder.eyes import EyeParts
from render.decoder.identity import Identity
from render.decoder.identity_cache import EMPTY, IdentityCache, reflected, static_cloud
from render.decoder.kernels import light as kernels
from render.decoder.kernels.surface import scaled
from render.decoder.learned import weights_file
from render.decoder.learned.light import LightNet
from render.decoder.neck import Neck, TurnedHead
from render.decoder.posing import Posing
from render.decoder.surface import AT_REST, Posed, SkinGaussians, Surface
from render.lighting import LIGHTINGS, SHEEN, Lighting
from render.teeth_light import TeethLight
from render.tongue_light import TongueLight
from render.types import FIELDS, Density, Floats, Gaussians, Ints, Mesh
from render.wrinkles import Wrinkles
from sensors.rotation import REST
from sensors.threads import Threads
from sensors.types import HeadPose, InputError

__all__ = ["EXPRESSION_DIM", "Decoder"]
NUM_RIG = 53  # shapes of the rig; the tongue's come after them
LIP_LIGHT = np.float32(0.55)  # of that at rest, at least: rolled lips have blots in what is learned
# Gap of the lips at which the inside of the mouth begins to be drawn, how much wider all of it is.
MOUTH_SHUT_MM, MOUTH_OPENS_MM = 0.1, 0.4


@dataclass(frozen=True)
class Decoder:
    """D: shared by all identities; holds no state but what follows from an identity."""

    rig_names: list[str]  # [53]
    coding: Coding
    posing: Posing
    surface: Surface
    light: LightNet
    light_to_vertex: csr_array  # [U, texels] map of the light decoder -> used vertices
    shares: csr_array  # [N, M] values of the M Gaussians an identity knows -> of those drawn
    opacities: Floats  # [N]
    roughness: Floats  # [N] of reflecting Gaussians
    lighting: Lighting
    eyes: list[EyeParts]  # left one first
    interior: Ints  # [I] Gaussians inside the mouth
    teeth_light: TeethLight
    tongue_light: TongueLight
    wrinkles: Wrinkles
    faces: NDArray[np.int32]  # [F, 3]
    regions: dict[str, NDArray[np.int32]]  # vertex sets by name
    density: Density
    _cache: "WeakKeyDictionary[Identity, IdentityCache]"
    _threads: Threads

    @classmethod
    def load(
        cls,
        folder: Path = weights_file.FOLDER,
        gaussians: Density = "32k",
        light: str = "studio",  # of LIGHTINGS
    ) -> "Decoder":
        """Read the prior's weights; raise InputError when they are missing or damaged."""
        from render.decoder.prior_file import load

        if light not in LIGHTINGS:
            known = ", ".join(LIGHTINGS)
            raise InputError(f"light: expected one of {known}, got {light!r}; try studio")
        fields, cache = load(folder, gaussians), WeakKeyDictionary()
        lights, threads = LIGHTINGS[light], Threads()
        return cls(**fields, density=gaussians, lighting=lights, _cache=cache, _threads=threads)

    @property
    def to_code(self) -> Floats:
        return self.coding.to_code[:NUM_RIG]  # [53, 256] rig activations -> code

    @property
    def to_rig(self) -> Floats:
        return self.coding.to_rig[:, :NUM_RIG]  # [256, 53] code -> rig activations

    @property
    def basis(self) -> csr_array:
        """[V * 3, 53] mm at full activation."""
        return self.posing.basis[:, :NUM_RIG]

    def moves(self, vertices: NDArray[np.integer]) -> Floats:  # [n] -> [256, n * 3]
        """How far, in mm, a unit of each of the code's numbers moves these vertices, gaze apart."""
        rows = (vertices[:, None].astype(np.int64) * 3 + np.arange(3)).ravel()
        return self.to_rig @ np.asarray(self.basis[rows].todense(), np.float32).T

    @property
    def eyeballs(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        return self.posing.eyeballs  # vertex sets, left eye first

    def encode(self, rig: Floats) -> Floats:  # [..., 53] or with the tongue [..., 55] -> [..., 256]
        """The expression code of rig activations."""
        return rig.astype(np.float32) @ self.coding.to_code[: rig.shape[-1]]

    def rig(self, expression: Floats) -> Floats:  # [..., 256] -> [..., 53]
        """Rig activations (ICT names, in the order of `rig_names`) of an expression code."""
        return expression.astype(np.float32) @ self.to_rig

    def sample(self, rng: np.random.Generator) -> Floats:  # [256]
        """A plausible face: a draw from the prior over codes."""
        return self.coding.code(rng.standard_normal(EXPRESSION_DIM).astype(np.float32))

    def vertices(
        self,
        expression: Floats,  # [256]
        gaze: Floats,  # [2, 3] unit vectors, left eye first
        identity: Identity,
    ) -> Floats:  # [V, 3] mm, head at rest
        """The mesh's vertices."""
        rig = expression.astype(np.float32) @ self.coding.to_rig
        return self.posing.pose(rig, gaze, identity.rest)

    def visibility(self, expression: Floats, identity: Identity) -> Floats:  # [256] -> [4, U]
        """Shares of the sky, of the key light and the rims that reach each used vertex."""
        cache, out = self.cached(identity), np.empty_like(identity.visibility)
        code = self.coding.plausible(expression.astype(np.float32))
        change, out[2:] = self.light(code, cache.biases) - cache.light, identity.visibility[2:]
        kernels.read_light(*self.texels, change, identity.visibility[:2], out[:2])
        return out

    @cached_property
    def texels(self) -> tuple[NDArray[np.int32], NDArray[np.int32], Floats, Floats]:
        """`light_to_vertex` in the order of the light decoder: starts, texels, weights; least."""
        place = np.argsort(self.light.order(len(self.light.ups))).astype(np.int32)
        least = np.isin(self.surface.used, self.regions["lips"]) * LIP_LIGHT
        starts, read = self.light_to_vertex.indptr.astype(np.int32), self.light_to_vertex
        return starts, place[read.indices], read.data.astype(np.float32), least

    def decode(
        self,
        expression: Floats,  # [256]
        gaze: Floats,  # [2, 3] unit vectors, left eye first
        identity: Identity,
        head: HeadPose = REST,
        breath: float = 0.0,  # 0..1, lifts the chest
        reuse: bool = False,
    ) -> tuple[Mesh, Gaussians]:
        """M, S <- D(x, g; Theta_id): the mesh in mm, its head at rest; Gaussians of the skin, two
        highlights, hair and beard, in this order, of a head that turns on its neck.

        With `reuse` these are the last such call's arrays for this identity, overwritten.
        """
        rig, cache = expression.astype(np.float32) @ self.coding.to_rig, self.cached(identity)
        bent = cache.neck.bent(head, breath) if breath or head != REST else None
        move = bent.head if bent else AT_REST

        def pose() -> tuple[Floats, Floats, float, Posed]:
            vertices, turned = self.posing.pose(rig, gaze, identity.rest), None
            at_rest, gap = vertices[cache.skin.rows], self.posing.mouth.gaps(vertices).max()
            if bent:
                turned = TurnedHead(bent, cache.still, cache.stretch)
                neck.bend_vertices(vertices, cache.skin, bent)
            return vertices, at_rest, gap, self.surface.posed(vertices, cache.rest, turned)

        fixed = identity, cache, self.roughness, self.lighting
        cloud = cache.cloud if reuse else static_cloud(*fixed)
        means, quats, scales, opacities, colors = (getattr(cloud, name) for name in FIELDS)
        count, beard = len(cache.opacities), len(means) - len(identity.beard)
        spots, hair, strands = slice(count, count + 2), slice(count + 2, beard), slice(beard, None)

        (vertices, at_rest, gap, posed), visibility = self._threads.both(
            pose, lambda: self.visibility(expression, identity)
        )
        assert cloud.shine
        rows = means[:count], quats[:count], scales[:count], colors[:count]
        skin = SkinGaussians(*rows, cloud.shine.weights)
        self.teeth_light.fill(visibility, gap)
        self.tongue_light.fill(vertices, identity.geometry, visibility, gap)
        looks = gaze, identity.eye_centers, cache.eye_sizes, eyes.HALF @ move[:, :3]

        def turn_hair() -> None:
            still = cache.strands.means, cache.strands.quats
            neck.turn_hair(*still, cache.hair, bent, means[hair], quats[hair])

        def place_highlights_and_beard() -> None:
            eyes.place_highlights(self.posing, vertices, *looks, means[spots], opacities[spots])
            identity.beard.attach(vertices, means[strands], quats[strands])
            if bent:
                for rows in (spots, strands):
                    neck.turn(means[rows], quats[rows], bent)
            quats[spots] = (1, 0, 0, 0)  # round: a turn shows nothing

        share = self._threads.share
        carried = self.surface.light(vertices, visibility, posed, self.lighting, move, share)
        parts = self.surface.gaussians(carried, posed, cache.reflected, cache.gloss, skin)
        parts = [turn_hair, place_highlights_and_beard, *parts]
        share(lambda part: parts[part](), len(parts))
        self.wrinkles.fold(rig, skin.colors, identity.wrinkles)
        for line, eye in zip(self.posing.lid_lines, self.eyes, strict=True):
            lid = skin.colors[eye.lid].mean(0)
            line.tint_covered(vertices, skin.means, eye.covered, lid, skin.colors, move)
        opened = np.float32(min(max((gap - MOUTH_SHUT_MM) / MOUTH_OPENS_MM, 0), 1))
        scaled(cache.opacities, self.interior, opened, opacities)
        vertices[cache.skin.rows] = at_rest
        return Mesh(vertices, self.faces), cloud

    def cached(self, identity: Identity) -> IdentityCache:
        """Kept for as long as the identity lives."""
        if (cache := self._cache.get(identity)) is None:
            hair = identity.hair.of_density(self.density)
            neutral = self.coding.normalised(np.zeros(EXPRESSION_DIM, np.float32))
            biases = self.light.nested(identity.biases)
            used = identity.geometry[self.surface.used]
            bones = Neck(tuple(identity.eye_centers.mean(0).tolist()))
            rims = self.surface.interpolate @ identity.visibility[2:].T
            gloss = self.shares @ identity.gloss
            sizes = eyes.eye_sizes(self.posing, identity.geometry, identity.eye_centers)
            stretch = self.surface.interpolate @ bones.stretch(used)
            stretched = np.flatnonzero(stretch).astype(np.int32)
            cache = IdentityCache(
                biases=biases,
                light=self.light(neutral, biases),
                rest=self.surface.at_rest(identity.geometry),
                reflected=reflected(identity, self.shares, self.density),
                gloss=gloss,
                rims=SHEEN * gloss[:, None] * rims,
                opacities=self.opacities * (self.shares @ identity.opacity_factors),
                strands=hair.lit(self.lighting),
                beard=identity.beard.lit(identity.geometry, self.lighting),
                cloud=EMPTY,
                neck=bones,
                skin=bones.share(identity.geometry),
                still=bones.share(used),
                stretch=(stretched, stretch[stretched]),
                hair=bones.share(hair.means),
                eye_sizes=sizes,
            )
            cache = cache._replace(
                cloud=static_cloud(identity, cache, self.roughness, self.lighting)
            )
            self._cache[identity] = cache
        return cache
