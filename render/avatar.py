"""Theta_id for anyone: a mean geometry and a mean texture become an avatar (paper Sec. 3).

Needs the prior's weights only, not the face data. Geometry has the topology of the prior's mesh.
"""

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render import atlas, beard, mesh_parts, prior_file, textures, weights_file
from render.contexts import GLContext, create_context
from render.cover import turned_out
from render.errors import InputError
from render.identity import Identity
from render.mesh_occlusion import Occlusion
from render.posing import Rest
from render.types import Gaussians

Floats = NDArray[np.float32]


class Maker:
    """Computes identities; keeps the prior and a GL context between them."""

    def __init__(
        self, folder: Path = weights_file.FOLDER, context: GLContext | None = None
    ) -> None:
        self._t, card = weights_file.load(folder / "prior", prior_file.KIND)
        fields = prior_file.parts(self._t, card)
        self.posing, self.surface = fields["posing"], fields["surface"]
        self.faces, self.regions = fields["faces"], fields["regions"]
        self.template = prior_file.template(self._t)
        self.anchor_triangles = self._t["anchor_triangles"].astype(np.int32)
        self._context = context

    @cached_property
    def solid(self) -> NDArray[np.int32]:
        """[S, 3] triangles that block light: all that is drawn but the lashes."""
        drawn = self.faces[self._t["drawn"]]
        return drawn[~(self._t["vertex_kinds"][drawn] == 3).all(1)]

    @cached_property
    def occlusion(self) -> Occlusion:
        return Occlusion(self._context or create_context(), self.solid)

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
        """Theta_id, bald and shaven; `dataclasses.replace` adds hair and beard."""
        rest = self.posing.rest(geometry)
        bald = self.seen(rest)
        seen = bald if cover is None else self.seen(rest, cover)
        seen = turned_out(self.surface, self.posing, rest.geometry, seen)
        return Identity(
            name=name,
            rest=rest,
            albedo=self.albedo(skin, eye),
            shown=np.ones(len(self.surface.scales), np.float32),
            seen=np.ascontiguousarray(seen.T),
            biases=self.biases(rest, skin, bald),
            hair=no_hair(),
            beard=beard.none(),
        )

    def seen(self, rest: Rest, cover: Floats | None = None) -> Floats:  # [U, 2]
        normals = self.normals(rest.geometry)
        return self.occlusion(rest.geometry, normals, cover)[self.surface.used]

    @property
    def eyes(self) -> list[str]:
        return sorted(k.removeprefix("eye.") for k in self._t if k.startswith("eye."))

    def albedo(self, skin: Floats, eye: str | Floats) -> Floats:  # [N, 3]
        """The colour of every Gaussian, read as the photometric fit found best."""
        if isinstance(eye, str) and eye not in self.eyes:
            raise InputError(f"eye: expected one of {', '.join(self.eyes)}, got {eye!r}")
        t = self._t
        picture = np.ones((8, 8, 3), np.float32) if isinstance(eye, str) else eye
        plain = t["anchor_plain"].astype(np.float32) / np.float32(255)
        levels = textures.levels(t["anchor_kinds"], t["anchor_uv"], plain, skin, picture)
        albedo = np.einsum("nl,nlc->nc", t["anchor_mixing"].astype(np.float32), levels)
        if isinstance(eye, str):
            on_eye = t["anchor_kinds"] == mesh_parts.EYE
            albedo[on_eye] = t[f"eye.{eye}"].astype(np.float32) / 255
        return np.clip(albedo, 0, 1)

    def biases(self, rest: Rest, skin: Floats, seen: Floats) -> tuple[Floats, ...]:
        """The identity encoder: a bias map for every level of the light decoder."""
        import torch

        from render import networks

        network = networks.IdentityEncoder()
        network.load_state_dict(self._state("identity"))
        used = self.surface.used
        moved = rest.geometry[used] - self.template[used]
        colors = vertex_albedo(
            skin, self._t["vertex_colors"], self._t["vertex_uv"], self._t["vertex_kinds"][used] == 0
        )
        maps = identity_maps(atlas.build(self._t["places"]), colors, moved, seen)
        with torch.no_grad():
            levels = network(torch.from_numpy(maps)[None])
        return tuple(level[0].flatten(1).T.contiguous().numpy() for level in levels)

    def expression_encoder(self) -> Any:
        """The VAE's encoder with its trained weights (render.networks.ExpressionEncoder)."""
        from render import networks

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


def identity_maps(at: atlas.Atlas, albedo: Floats, moved_mm: Floats, seen: Floats) -> Floats:
    """[U, 3], [U, 3], [U, 2] -> what the identity encoder reads [8, 64, 128]."""
    rows = np.concatenate([albedo - 0.5, moved_mm / GEOMETRY_UNIT_MM, seen - 0.5], 1)
    return atlas.picture(at, rows.astype(np.float32))


def vertex_albedo(
    skin: Floats,  # [H, 2 H, 3]
    colors: NDArray[np.uint8],  # [U, 3] of what has no texture
    uv: Floats,  # [U, 2]
    on_skin: NDArray[np.bool_],  # [U]
) -> Floats:  # [U, 3]
    """The person's skin at the vertices, coarse; everyone's colours elsewhere."""
    out = colors.astype(np.float32) / np.float32(255)
    step = max(1, skin.shape[0] // 128)
    out[on_skin] = textures.sample(skin[::step, ::step], uv[on_skin] * np.array([0.5, 1], "f4"))
    return out


def no_hair() -> Gaussians:
    return Gaussians(
        means=np.zeros((0, 3), np.float32),
        quats=np.zeros((0, 4), np.float32),
        scales=np.zeros((0, 3), np.float32),
        opacities=np.zeros(0, np.float32),
        colors=np.zeros((0, 3), np.float32),
    )
