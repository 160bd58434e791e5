"""The decoder D(x, g; identity): expression code and gaze -> mesh and Gaussians (paper Sec. 3).

code -> rig -> posed mesh (`render/posing.py`); code and bias maps -> change of light
(`render/light_decoder.py`); both -> Gaussians that ride on the skin (`render/surface.py`).
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from render import kernels, weights_file
from render.coding import EXPRESSION_DIM, Coding
from render.identity import Identity
from render.light_decoder import LightNet
from render.lighting import HALF
from render.posing import Posing, turn
from render.surface import Placed, Still, Surface
from render.types import Density, Gaussians, Mesh

__all__ = ["EXPRESSION_DIM", "KIND", "Decoder", "turn"]
KIND = "prior"
NUM_RIG = 53  # shapes of the rig; the tongue's come after them
CORNEA_MM, CORNEA_RADIUS_MM = np.array([1.11, 0.07, 8.68], np.float32), 9.0  # from the eye's centre
HIGHLIGHT_MM, HIGHLIGHT_OPACITY = 0.5, 0.85
LID_COVERS_MM, LID_CLEARS_MM = -0.3, 0.6  # the highlight's way out from behind the edge of a lid
MOUTH_SHUT_MM, MOUTH_OPENS_MM = 0.1, 0.4  # gap of the lips at which the inside of the mouth
# begins to be drawn, and how much wider they are when it is drawn in full
Floats = NDArray[np.float32]


class Known(NamedTuple):
    """What follows from an identity alone."""

    biases: tuple[Floats, ...]  # per level [texels, C] of the light decoder, nested
    light: Floats  # [texels, 2] of the light decoder at rest
    still: Still
    reflected: Floats  # [N, 3] linear albedo
    opacities: Floats  # [N]


@dataclass(frozen=True)
class Decoder:
    """D: shared by all identities; holds no state but what follows from an identity."""

    rig_names: list[str]  # [53]
    coding: Coding
    posing: Posing
    surface: Surface
    light: LightNet
    read: csr_array  # [U, texels] map of the light decoder -> used vertices
    reads: csr_array  # [N, M] values of the M Gaussians an identity knows -> of those drawn
    opacities: Floats  # [N]
    interior: NDArray[np.intp]  # [I] Gaussians inside the mouth
    faces: NDArray[np.int32]  # [F, 3]
    regions: dict[str, NDArray[np.int32]]  # vertex sets by name
    _known: "WeakKeyDictionary[Identity, Known]"

    @classmethod
    def load(cls, folder: Path = weights_file.FOLDER, gaussians: Density = "32k") -> "Decoder":
        """Read the prior's weights; raise InputError when they are missing or damaged."""
        from render.prior_file import load

        return cls(**load(folder, gaussians), _known=WeakKeyDictionary())

    @property
    def to_code(self) -> Floats:
        """[53, 256] rig activations -> code."""
        return self.coding.to_code[:NUM_RIG]

    @property
    def to_rig(self) -> Floats:
        """[256, 53] code -> rig activations."""
        return self.coding.to_rig[:, :NUM_RIG]

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
        """Vertex sets, left eye first."""
        return self.posing.eyeballs

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
        return self.posing.pose(
            expression.astype(np.float32) @ self.coding.to_rig, gaze, identity.rest
        )

    def seen(self, expression: Floats, identity: Identity) -> Floats:  # [256] -> [2, U]
        """Shares of the sky and of the key light that reach each used vertex."""
        code = self.coding.normalised(expression.astype(np.float32))
        known, out = self.follows(identity), np.empty_like(identity.seen)
        change = self.light(code, known.biases) - known.light
        kernels.read_light(*self.texels, change, identity.seen, out)
        return out

    @cached_property
    def texels(self) -> tuple[NDArray[np.int32], NDArray[np.int32], Floats]:
        """`read` for texels in the light decoder's order: starts of rows, texels, weights."""
        place = np.argsort(self.light.order(len(self.light.ups))).astype(np.int32)
        starts, texels = self.read.indptr.astype(np.int32), self.read.indices
        return starts, place[texels], self.read.data.astype(np.float32)

    def decode(
        self,
        expression: Floats,  # [256]
        gaze: Floats,  # [2, 3] unit vectors, left eye first
        identity: Identity,
    ) -> tuple[Mesh, Gaussians]:
        """M, S <- D(x, g; Theta_id): the mesh in mm; Gaussians, highlights, hair and beard."""
        vertices = self.vertices(expression, gaze, identity)
        known = self.follows(identity)
        count, hair, beard = len(known.opacities), identity.hair, identity.beard
        total = count + 2 + len(hair) + len(beard)
        means, quats = np.empty((total, 3), np.float32), np.empty((total, 4), np.float32)
        scales, opacities = np.empty((total, 3), np.float32), np.empty(total, np.float32)
        colors = np.empty((total, 3), np.float32)

        placed = Placed(means[:count], quats[:count], scales[:count], colors[:count])
        seen = self.seen(expression, identity)
        self.surface.place(vertices, seen, known.still, known.reflected, placed)
        for line, eye, lids in zip(self.posing.lid_lines, *self.eyes, strict=True):
            line.veil(vertices, placed.means, eye, placed.colors[lids].mean(0), placed.colors)
        opacities[:count] = known.opacities
        gap = self.posing.mouth.gaps(vertices).max()
        opacities[self.interior] *= np.clip((gap - MOUTH_SHUT_MM) / MOUTH_OPENS_MM, 0, 1)

        shine = slice(count, count + 2)
        for eye, side in enumerate((1, -1)):
            cornea = turn(gaze[eye]) @ (CORNEA_MM * (side, 1, 1))
            means[count + eye] = identity.eye_centers[eye] + cornea + CORNEA_RADIUS_MM * HALF
            bare = self.posing.lid_lines[eye].bareness(vertices, means[count + eye])
            share = min(max((bare - LID_COVERS_MM) / (LID_CLEARS_MM - LID_COVERS_MM), 0.0), 1.0)
            opacities[count + eye] = HIGHLIGHT_OPACITY * share
        quats[shine], scales[shine], colors[shine] = (1, 0, 0, 0), HIGHLIGHT_MM, 1

        rest = slice(count + 2, total - len(beard))
        means[rest], quats[rest], scales[rest] = hair.means, hair.quats, hair.scales
        opacities[rest], colors[rest] = hair.opacities, hair.colors
        grown = slice(total - len(beard), total)
        beard.stand(vertices, means[grown], quats[grown])
        scales[grown], opacities[grown], colors[grown] = beard.scales, beard.opacities, beard.colors
        return Mesh(vertices, self.faces), Gaussians(means, quats, scales, opacities, colors)

    @cached_property
    def eyes(self) -> tuple[list[NDArray[np.intp]], list[NDArray[np.intp]]]:
        """Gaussians on each eyeball; on the lids before it."""
        eyelids = self.regions["eyelids"]
        left = np.isin(eyelids, self.posing.lids[0])
        return (
            [self._on(members) for members in self.eyeballs],
            [self._on(members) for members in (eyelids[left], eyelids[~left])],
        )

    def _on(self, vertices: NDArray[np.int32]) -> NDArray[np.intp]:
        """Gaussians on triangles of these vertices alone."""
        share = self.surface.interpolate @ np.isin(self.surface.used, vertices).astype(np.float32)
        return np.flatnonzero(share > 0.99)

    def follows(self, identity: Identity) -> Known:
        """Kept for as long as the identity lives."""
        known = self._known.get(identity)
        if known is None:
            neutral = self.coding.normalised(np.zeros(EXPRESSION_DIM, np.float32))
            biases = self.light.nested(identity.biases)
            known = Known(
                biases,
                self.light(neutral, biases),
                self.surface.still(identity.geometry),
                (self.reads @ identity.albedo) ** 2,
                self.opacities * (self.reads @ identity.shown),
            )
            self._known[identity] = known
        return known
