"""The face data as the renderer and the decoder want it: kinds of surface, posing, tongue."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from render.decoder import mesh_parts, surface
from render.decoder.learned.atlas import HEIGHT, WIDTH
from render.decoder.lines import Lips
from render.decoder.mesh_parts import SKIN_VERTICES
from render.decoder.posing import Posing, look_columns, sphere_centre
from render.teeth_light import scattered
from render.training.data import contact_lines
from render.training.data.face_data import FaceData
from render.training.look import mouth
from render.types import Floats

TONGUE_NAMES = ("tongueTipUp", "tongueBackUp")  # inside the mouth; the face data has neither
LID_REACH_MM = 21.0  # skin this near the eye's centre slides on the eyeball
# A raised tip: to the edge of the upper teeth, and over that of the lower ones.
TIP_MM = -44.0, -38.0  # heights of the underside and the top of the tip at rest, and how ...
TIP_UP_MM, TIP_FORWARD_MM = (7.0, 11.0), 11.5  # ... far they rise
SMALLEST_MM = 0.05  # displacements below it are left out of the basis


@dataclass(frozen=True)
class Assembly:
    """Everything shared by all identities."""

    face: FaceData
    posing: Posing
    kinds: NDArray[np.int32]  # [F] see mesh_parts, -1: not drawn

    @cached_property
    def solid(self) -> NDArray[np.int32]:
        """[S, 3] triangles that block light."""
        return self.face.faces[self.kinds >= 0]

    @cached_property
    def gather(self) -> csr_array:
        return mesh_parts.normal_sum(self.solid, len(self.face.neutral))

    def normals(self, vertices: Floats) -> Floats:
        return mesh_parts.vertex_normals(vertices, self.solid, self.gather)

    @cached_property
    def colors(self) -> Floats:
        """[V, 3] stored colour of what has no texture, 1 elsewhere."""
        return mouth.colors(self.face)

    @cached_property
    def vertex_kinds(self) -> NDArray[np.int32]:
        """[V] see render/decoder/surface.py."""
        out = np.full(len(self.face.neutral), surface.WET, np.int32)
        out[:SKIN_VERTICES] = surface.SKIN
        out[np.concatenate(self.posing.eyeballs)] = surface.EYE
        return out

    @cached_property
    def vertex_uv(self) -> Floats:
        """[V, 2] a texture coordinate of each vertex (one of them, at seams)."""
        out = np.zeros((len(self.face.neutral), 2), np.float32)
        drawn = self.kinds >= 0
        out[self.face.faces[drawn]] = self.face.uv[self.face.uv_faces[drawn]]
        return out

    def light_mouth(self, seen: Floats) -> None:  # [V, 2 or more] shares, changed in place
        """Teeth and gums light each other."""
        rows = np.union1d(self.face.regions["teeth"], self.face.regions["gums"])
        seen[rows, :2] = scattered(seen[rows, :2])

    @cached_property
    def places(self) -> Floats:
        """[V, 2] where each vertex lies in the atlas (`atlas.py`), texels."""
        u, v = self.vertex_uv.T
        turned = 1 - v % 1.0
        x, y = 0.5 * (u % 1.0), turned.copy()  # the face fills the left half
        regions = self.face.regions
        back = (u > 1) & (np.arange(len(u)) < SKIN_VERTICES)
        x[back] = 0.5 + 0.25 * (u[back] % 1.0)
        x[SKIN_VERTICES:], y[SKIN_VERTICES:] = 0.875, 0.05
        for members, left, top, width, height in (
            (np.arange(SKIN_VERTICES, 17039), 0.75, 0.0, 0.25, 0.4),  # mouth, gums, tongue
            (np.arange(17039, 21451), 0.75, 0.4, 0.25, 0.3),  # teeth
            (regions["sclera_l"], 0.75, 0.7, 0.125, 0.3),
            (regions["sclera_r"], 0.875, 0.7, 0.125, 0.3),
        ):
            x[members] = left + width * (u[members] % 1.0)
            y[members] = top + height * turned[members]
        # Lashes share the light of the lid they grow from.
        from scipy.spatial import KDTree

        neutral = self.face.neutral
        for side in "lr":
            lashes = regions[f"eyelashes_{side}"]
            _, near = KDTree(neutral[:SKIN_VERTICES]).query(neutral[lashes])
            x[lashes], y[lashes] = x[near], y[near]
        return np.stack([x * WIDTH, y * HEIGHT], 1).astype(np.float32)

    @cached_property
    def names(self) -> list[str]:
        """The rig's names, then the tongue's."""
        return [*self.face.rig_names, *TONGUE_NAMES]


def build(face: FaceData) -> Assembly:
    return Assembly(face, posing(face), kinds(face))


def kinds(face: FaceData) -> NDArray[np.int32]:
    out = np.full(len(face.faces), -1, np.int32)
    head = np.isin(face.materials, ("M_Face", "M_BackHead"))
    out[head] = mesh_parts.COLOURED  # the bag of the mouth
    out[head & (face.faces.max(1) < SKIN_VERTICES)] = mesh_parts.SKIN
    out[face.materials == "M_GumsTongue"] = mesh_parts.COLOURED
    out[face.materials == "M_Teeth"] = mesh_parts.TEETH
    out[np.isin(face.materials, ("M_ScleraLeft", "M_ScleraRight"))] = mesh_parts.EYE
    return out


def posing(face: FaceData) -> Posing:
    rig = np.concatenate([face.rig, tongue(face)])
    eyeballs = face.regions["eyeball_l"], face.regions["eyeball_r"]
    rig[:, np.concatenate(eyeballs)] = 0
    rig[np.abs(rig) < SMALLEST_MM] = 0
    skin = face.neutral[:SKIN_VERTICES]
    lids = [
        np.flatnonzero(
            np.linalg.norm(skin - sphere_centre(face.neutral[eye]), axis=1) < LID_REACH_MM
        ).astype(np.int32)
        for eye in eyeballs
    ]
    column = face.rig_names.index
    return Posing(
        basis=csr_array(rig.reshape(len(rig), -1).T),
        eyeballs=eyeballs,
        lids=(lids[0], lids[1]),
        mouth=contact_lines.mouth(face),
        lips=Lips.of(face.neutral, face.regions["lips_upper"], face.regions["lips_lower"]),
        lid_lines=(contact_lines.lid(face, "l"), contact_lines.lid(face, "r")),
        blinks=(column("eyeBlink_L"), column("eyeBlink_R")),
        jaw=(column("jawOpen"), column("mouthClose")),
        looks=look_columns(face.rig_names),
    )


def tongue(face: FaceData) -> Floats:  # [2, V, 3] mm
    """Tip up (as for /l t d n/, and between the teeth for /th/) and back up (as for /k g/):
    rule-made, along the tongue."""
    members = face.regions["tongue"]
    points = face.neutral[members]
    z = points[:, 2]
    along = (z - z.min()) / (z.max() - z.min())  # 0 at the root, 1 at the tip
    # The underside stays: only what lies above the middle of its cross-section moves fully.
    top = np.clip((points[:, 1] - np.percentile(points[:, 1], 20)) / 6.0, 0.25, 1.0)
    tip = np.clip((along - 0.55) / 0.45, 0, 1) ** 1.6
    above = np.clip((points[:, 1] - TIP_MM[0]) / (TIP_MM[1] - TIP_MM[0]), 0, 1)
    back = np.exp(-(((along - 0.35) / 0.18) ** 2))
    out = np.zeros((2, len(face.neutral), 3), np.float32)
    out[0, members, 1] = tip * (TIP_UP_MM[0] + above * (TIP_UP_MM[1] - TIP_UP_MM[0]))
    out[0, members, 2] = TIP_FORWARD_MM * tip
    out[1, members, 1], out[1, members, 2] = 9.0 * back * top, -1.5 * back
    return out
