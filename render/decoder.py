"""The decoder D(x, g; identity): expression code and gaze -> mesh and Gaussians (paper Sec. 3).

This first decoder is linear in the expression code: the code's 256 numbers are rig activations
in coordinates where distance is vertex distance (render/training/prior.py), the mesh follows,
the eyeballs turn with the gaze, and Gaussians ride on the triangles.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from render import weights_file
from render.identity import Identity
from render.types import Gaussians, Mesh

KIND = "prior"
EXPRESSION_DIM = 256
FLATNESS = 0.25  # thickness of an anchored Gaussian, as a share of its width
HIGHLIGHT = np.array([0.30, 0.42, 0.86])  # where the key light mirrors in the cornea
Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Decoder:
    """D: shared by all identities; holds no state."""

    rig_names: list[str]
    to_code: Floats  # [53, 256]
    to_rig: Floats  # [256, 53]
    basis: csr_array  # [V * 3, 53] mm at full activation
    faces: NDArray[np.int32]  # [F, 3]
    eyeballs: tuple[NDArray[np.int32], NDArray[np.int32]]  # vertex sets, left eye first
    regions: dict[str, NDArray[np.int32]]  # vertex sets by name
    corners: NDArray[np.int32]  # [3, N] vertex of each anchor's triangle
    barycentric: Floats  # [3, N, 1]
    rest_scales: Floats  # [N] mm
    rest_areas: Floats  # [N] mm^2, twice the area of the triangle on the mean face

    @classmethod
    def load(cls, folder: Path = weights_file.FOLDER) -> "Decoder":
        """Read the prior's weights; raise InputError when they are missing or damaged."""
        t, card = weights_file.load(folder / "prior", KIND)
        rows = t["geometry_rows"]
        basis = csr_array(
            (t["basis_values"].astype(np.float32), t["basis_columns"].astype(np.int32), rows),
            shape=(len(rows) - 1, len(card["rig_names"])),
        )
        faces = t["faces"].astype(np.int32)
        regions = {
            name.removeprefix("region_"): t[name].astype(np.int32)
            for name in t
            if name.startswith("region_")
        }
        return cls(
            rig_names=list(card["rig_names"]),
            to_code=t["to_code"],
            to_rig=t["to_rig"],
            basis=basis,
            faces=faces,
            eyeballs=(regions["eyeball_l"], regions["eyeball_r"]),
            regions=regions,
            corners=np.ascontiguousarray(faces[t["anchor_triangles"]].T),
            barycentric=np.ascontiguousarray(t["anchor_barycentric"].T)[..., None],
            rest_scales=t["anchor_scales"],
            rest_areas=t["anchor_areas"],
        )

    def encode(self, rig: Floats) -> Floats:  # [..., 53] -> [..., 256]
        """The expression code of rig activations."""
        return rig.astype(np.float32) @ self.to_code

    def rig(self, expression: Floats) -> Floats:  # [..., 256] -> [..., 53]
        """Rig activations (ICT names, in the order of `rig_names`) of an expression code."""
        return expression.astype(np.float32) @ self.to_rig

    def vertices(
        self,
        expression: Floats,  # [256]
        gaze: Floats,  # [2, 3] unit vectors, left eye first
        identity: Identity,
    ) -> Floats:  # [V, 3] mm, head at rest
        """The mesh's vertices."""
        offsets = self.basis @ self.rig(expression)
        vertices = identity.geometry + offsets.reshape(-1, 3)
        for eye, members in enumerate(self.eyeballs):
            center = identity.eye_centers[eye]
            vertices[members] = (identity.geometry[members] - center) @ turn(gaze[eye]).T + center
        return vertices

    def decode(
        self,
        expression: Floats,  # [256]
        gaze: Floats,  # [2, 3] unit vectors, left eye first
        identity: Identity,
    ) -> tuple[Mesh, Gaussians]:
        """M, S <- D(x, g; Theta_id): the mesh in mm and its Gaussians, hair and highlights."""
        vertices = self.vertices(expression, gaze, identity)
        a, b, c = (vertices.take(self.corners[k], 0) for k in range(3))
        wa, wb, wc = self.barycentric
        count, hair = len(a), identity.hair
        total = count + 2 + len(hair)
        means, quats = np.empty((total, 3), np.float32), np.zeros((total, 4), np.float32)
        scales = np.empty((total, 3), np.float32)

        means[:count] = a * wa + b * wb + c * wc
        normal = _cross(b - a, c - a)
        area = np.sqrt(np.einsum("nk,nk->n", normal, normal)) + 1e-9
        # The shortest turn from z to the normal; the plane's splats are round, so it suffices.
        quats[:count, 0] = area + normal[:, 2] + 1e-4 * area
        quats[:count, 1] = -normal[:, 1]
        quats[:count, 2] = normal[:, 0]
        width = self.rest_scales * np.clip(np.sqrt(area / self.rest_areas), 0.5, 1.6)
        scales[:count, :2] = width[:, None]
        scales[:count, 2] = width * FLATNESS

        shine = slice(count, count + 2)
        means[shine] = identity.eye_centers + 15.6 * HIGHLIGHT
        quats[shine] = (1, 0, 0, 0)
        scales[shine] = 0.55

        rest = slice(count + 2, total)
        means[rest], quats[rest], scales[rest] = hair.means, hair.quats, hair.scales
        cloud = Gaussians(means, quats, scales, identity.opacities, identity.colors)
        return Mesh(vertices, self.faces), cloud


def turn(gaze: Floats) -> Floats:  # [3] unit -> [3, 3]
    """Rotation of an eyeball that looks along `gaze`: yaw about y, then pitch, no roll."""
    yaw = np.arctan2(gaze[0], gaze[2])
    pitch = -np.arcsin(np.clip(gaze[1], -1, 1))
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    around_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]], np.float32)
    around_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]], np.float32)
    return around_y @ around_x


def _cross(u: Floats, v: Floats) -> Floats:  # [n, 3], [n, 3] -> [n, 3]
    out = np.empty_like(u)
    out[:, 0] = u[:, 1] * v[:, 2] - u[:, 2] * v[:, 1]
    out[:, 1] = u[:, 2] * v[:, 0] - u[:, 0] * v[:, 2]
    out[:, 2] = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    return out
