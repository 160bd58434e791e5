"""Theta_id for anyone: a mean geometry and a mean texture become an avatar (paper Sec. 3).

Needs the prior's weights only, not the face data. Geometry has the topology of the prior's mesh.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from render import mouth_tints, strands
from render.avatars import blends, detail, lashes, textures
from render.decoder import mesh_parts, prior_file
from render.decoder.eyes import turned_out
from render.decoder.identity import GLOSS_STEPS, Identity
from render.decoder.learned import atlas, weights_file
from render.decoder.posing import Rest
from render.decoder.surface import SKIN
from render.gl.contexts import GLContext, create_context
from render.gl.occlusion import Occlusion
from render.types import Density, Floats
from render.wrinkles import STEPS
from sensors.types import InputError

HEM_MM = (-192.0, -168.0)  # height on the mean face at which a bust ends


class Maker:
    """Computes identities; keeps the prior and a GL context between them."""

    def __init__(
        self, folder: Path = weights_file.FOLDER, context: GLContext | None = None
    ) -> None:
        self._t, self._card = weights_file.load(folder / "prior", prior_file.KIND)
        fields = prior_file.parts(self._t, self._card)
        self.posing, self.surface = fields["posing"], fields["surface"]
        self.faces, self.regions = fields["faces"], fields["regions"]
        self.template = prior_file.template(self._t)
        self.rig_names: list[str] = fields["rig_names"]
        self.anchor_triangles = self._t["anchor_triangles"].astype(np.int32)
        self.surface_kinds = self._t["vertex_kinds"]
        self.anchor_kinds, self.anchor_uv = self._t["anchor_kinds"], self._t["anchor_uv"]
        self._context = context

    @cached_property
    def gloss(self) -> Floats:
        """[N] of bare skin, see Identity."""
        return self._t["anchor_gloss"].astype(np.float32) / np.float32(GLOSS_STEPS)

    @cached_property
    def wrinkles(self) -> Floats:
        """[N, 4] maps of every kind, see render/wrinkles.py."""
        return self._t["anchor_wrinkles"].astype(np.float32) / np.float32(STEPS)

    @cached_property
    def solid(self) -> NDArray[np.int32]:
        """[S, 3] triangles that block light."""
        return self.faces[self._t["drawn"]]

    @cached_property
    def skin(self) -> NDArray[np.int32]:
        """[F, 3] triangles of the skin."""
        return self.solid[(self._t["vertex_kinds"][self.solid] == SKIN).all(1)]

    @cached_property
    def occlusion(self) -> Occlusion:
        return Occlusion(self._context or create_context(), self.solid)

    @cached_property
    def atlas_shares(self) -> csr_array:
        """[T, n] of the Gaussians on the skin, see textures.between."""
        return textures.between(self.anchor_uv[self.anchor_kinds == mesh_parts.SKIN])

    @cached_property
    def _gather(self) -> Any:
        return mesh_parts.normal_sum(self.solid, len(self.template))

    def normals(self, vertices: Floats) -> Floats:
        return mesh_parts.vertex_normals(vertices, self.solid, self._gather)

    def identity(
        self,
        name: str,
        geometry: Floats,  # [V, 3] mm
        skin: Floats,  # [H, 2 H, 3] 0..1
        eye: str | Floats = "brown",  # a name of `eyes`, or a picture
        cover: Floats | None = None,  # [T, 3, 3] mm of hair that casts shadow
    ) -> Identity:
        """Theta_id, bald and shaven but for lashes; `dataclasses.replace` adds hair and beard."""
        rest = self.posing.rest(geometry)
        bald = self.visibility(rest)
        visibility = bald if cover is None else self.visibility(rest, cover)
        visibility = turned_out(self.surface, self.posing, rest.geometry, visibility)
        albedo = self.albedo(skin, eye)
        return Identity(
            name=name,
            rest=rest,
            albedo=albedo,
            gloss=self.gloss,
            opacity_factors=self.hem(),
            visibility=np.ascontiguousarray(visibility.T),
            biases=self.biases(rest, skin, bald[:, :2]),
            hair=strands.bald(),
            beard=lashes.grow(self.posing, rest),
            detail=self.thinner(albedo, skin),
        )

    def hem(self) -> Floats:  # [N] 0..1
        """How opaque: the bust ends in a fade towards the lower edge of the mesh, not in a cut."""
        head, (low, high) = self.surface, HEM_MM
        skin = (self._t["vertex_kinds"][head.used] == SKIN).astype(np.float32)
        share = np.clip((head.interpolate @ self.template[head.used, 1] - low) / (high - low), 0, 1)
        return np.where(head.interpolate @ skin > 0.99, share, 1).astype(np.float32)

    def visibility(self, rest: Rest, cover: Floats | None = None) -> Floats:  # [U, 4]
        normals = self.normals(rest.geometry)
        return self.occlusion(rest.geometry, normals, cover)[self.surface.used]

    @property
    def eyes(self) -> list[str]:
        return sorted(k.removeprefix("eye.") for k in self._t if k.startswith("eye."))

    def check_eye(self, eye: str) -> None:
        """Raises InputError where no eyes of this colour are known."""
        if eye not in self.eyes:
            raise InputError(
                f"--eye: expected one of {', '.join(self.eyes)}, got {eye!r}; try --eye "
                f"{self.eyes[0]}"
            )

    def albedo(self, skin: Floats, eye: str | Floats) -> Floats:  # [N, 3]
        """The colour of every Gaussian, sampled at the blur that the photometric fit chose; on the
        face then as sharp as the texture."""
        if isinstance(eye, str):
            self.check_eye(eye)
        t, on_eye = self._t, self.anchor_kinds == mesh_parts.EYE
        picture = np.ones((8, 8, 3), np.float32) if isinstance(eye, str) else eye
        plain = t["anchor_plain"].astype(np.float32) / np.float32(255)
        levels = textures.levels(t["anchor_kinds"], t["anchor_uv"], plain, skin, picture)
        albedo = np.einsum("nl,nlc->nc", t["anchor_mixing"].astype(np.float32), levels)
        albedo *= self.surface.interpolate @ self.mouth_tints
        if isinstance(eye, str):
            albedo[on_eye] = t[f"eye.{eye}"].astype(np.float32) / 255
        albedo, (_, of, of_eyes) = np.clip(albedo, 0, 1), self._shown["65k"]
        if not isinstance(eye, str):
            wanted = textures.sample(detail.wanted_eye(picture), of_eyes.uv)
            low, high = textures.bounds(picture, t["anchor_uv"][on_eye], detail.EYE_REACH)
            bounds = low, np.minimum(high + np.minimum(low, np.float32(detail.EYE_LIGHTER)), 1)
            albedo = detail.repainted(albedo, on_eye, of_eyes, wanted, bounds)
        wanted = textures.sample(detail.wanted_skin(skin), of.uv * detail.ATLAS)
        return detail.sharpened(albedo, self.face, of, wanted)

    @cached_property
    def mouth_tints(self) -> Floats:
        """[U, 3] gains, 1 outside of the mouth."""
        gains, teeth = np.ones_like(self.template), self.surface.used[self._t["teeth_rows"]]
        height = self.template[:, 1]
        lower = teeth[height[teeth] < height[self.posing.mouth.upper].mean()]
        mouth_tints.tint(gains, self.posing.tongue, lower)
        return gains[self.surface.used].astype(np.float32)

    @cached_property
    def face(self) -> NDArray[np.bool_]:
        """[N] Gaussians on the skin of the face, but for lids: at rest these lie in a fold."""
        bare = np.setdiff1d(self.regions["narrow_face"], self.regions["eyelids"])
        on_skin = self._t["anchor_kinds"] == mesh_parts.SKIN
        return (self.surface.share_on(bare) > 0.99) & on_skin

    def thinner(self, albedo: Floats, skin: Floats) -> dict[Density, Floats]:  # [n] each
        """How bright the Gaussians of thinner heads are: they have colours of their own, which
        show the skin, and the eyes as the densest head shows them."""
        from scipy.spatial import KDTree

        eye, seen = self.anchor_kinds == mesh_parts.EYE, self._shown["65k"].eyes
        known, shown, wanted = KDTree(seen.uv), seen.shares @ albedo, detail.wanted_skin(skin)

        def gains(preset: Density) -> Floats:
            shares, of, of_eyes = self._shown[preset]
            colors = np.asarray(shares @ albedo)
            out = np.ones(len(colors), np.float32)
            eyes = shown[np.asarray(known.query(of_eyes.uv)[1])]
            skins = textures.sample(wanted, of.uv * detail.ATLAS)
            for which, blend, target, limits in (
                (self.face, of, skins, detail.SKIN),
                (eye, of_eyes, eyes, detail.EYES),
            ):
                free = shares @ which.astype(np.float32) > 0.99
                out[free] = detail.gains(colors, free, blend, target, limits)[free]
            return out

        with ThreadPoolExecutor() as pool:
            return dict(zip(blends.THINNER, pool.map(gains, blends.THINNER), strict=True))

    @cached_property
    def _shown(self) -> dict[Density, blends.Blends]:
        return blends.of_densities(self._t, self._card, self.surface, self.face)

    def biases(self, rest: Rest, skin: Floats, visibility: Floats) -> tuple[Floats, ...]:
        """The identity encoder: a bias map for every level of the light decoder."""
        import torch

        from render.decoder.learned import networks

        network = networks.IdentityEncoder()
        network.load_state_dict(self._state("identity"))
        used = self.surface.used
        moved = rest.geometry[used] - self.template[used]
        colors = textures.at_vertices(
            skin, self._t["vertex_colors"], self._t["vertex_uv"], self._t["vertex_kinds"][used] == 0
        )
        maps = identity_maps(atlas.build(self._t["places"]), colors, moved, visibility)
        with torch.no_grad():
            levels = network(torch.from_numpy(maps)[None])
        return tuple(level[0].flatten(1).T.contiguous().numpy() for level in levels)

    def expression_encoder(self) -> Any:
        """The VAE's encoder with its trained weights (networks.ExpressionEncoder)."""
        from render.decoder.learned import networks

        network = networks.ExpressionEncoder(len(self._t["free"]))
        network.load_state_dict(self._state("expression"))
        return network

    def _state(self, name: str) -> dict[str, Any]:
        import torch

        prefix = f"{name}."
        return {
            key.removeprefix(prefix): torch.from_numpy(value.astype(np.float32))
            for key, value in self._t.items()
            if key.startswith(prefix)
        }


GEOMETRY_UNIT_MM = 10.0  # one unit of the geometry maps


def identity_maps(at: atlas.Atlas, albedo: Floats, moved_mm: Floats, visibility: Floats) -> Floats:
    """[U, 3], [U, 3], [U, 2] -> what the identity encoder reads [8, 64, 128]."""
    rows = np.concatenate([albedo - 0.5, moved_mm / GEOMETRY_UNIT_MM, visibility - 0.5], 1)
    return atlas.picture(at, rows.astype(np.float32))
