"""Evaluates the prior against the reference renderer on held-out people, expressions and views.

The truth of a person is the face data's mesh, posed and lit exactly, drawn by the mesh renderer.
The prior sees that person's mean geometry and texture, codes each expression with its encoder, and
decodes mesh and Gaussians. Needs the face data.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from render import cameras, mouth_tints, tongue_light, wrinkles
from render.avatars.maker import GEOMETRY_UNIT_MM, Maker
from render.decoder import beard, mesh_parts
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.decoder.learned import atlas, weights_file
from render.decoder.posing import Rest
from render.evaluation import metrics as prior_metrics
from render.gl.contexts import GLContext
from render.gl.mesh_renderer import MeshRenderer
from render.lighting import Lighting
from render.splats.renderer import wrap_context
from render.training.data import expressions, face_data
from render.training.fitting.wardrobe import Wardrobe
from render.training.geometry import assembly as assemblies
from render.types import Camera, Density, Floats, Gaussians
from sensors import folders

SIZE_PX = 512
BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
FLAT = Lighting(BLACK, BLACK, BLACK, BLACK, WHITE, WHITE)
EYE_SPAN_MM = 60.0
IRIS_DEG = 21.0  # half angle of the iris as seen from the eye's centre


@dataclass(frozen=True)
class Subject:
    """A held-out person: the ground truth, and the identity that the prior makes of them."""

    geometry: Floats  # [V, 3] mm, as given to the prior
    rest: Rest  # the truth at rest
    skin: Floats  # [1024, 2048, 3]
    eye: Floats  # [512, 512, 3]
    light: Floats  # [U, 4] that reaches them at rest
    identity: Identity


class Judge:
    """Draws truth and decoded Gaussians side by side."""

    def __init__(
        self, face_folder: Path, context: GLContext, weights: Path = weights_file.FOLDER
    ) -> None:
        self.assembly = assemblies.build(face_data.load(face_folder))
        face = self.assembly.face
        parts = mesh_parts.build(face.faces, face.uv_faces, face.uv, self.assembly.kinds)
        self._mesh = MeshRenderer(context, parts)
        cache = folders.cache() / "wardrobe"  # textures of the truth take a minute
        cache.mkdir(parents=True, exist_ok=True)
        self.wardrobe = Wardrobe(face, cache)
        self._mesh.set_texture("relief", self.wardrobe.relief_map)
        self._mesh.set_texture("wrinkles", self.wardrobe.wrinkles)
        self._folds = wrinkles.rig_map(self.assembly.names, len(self.assembly.names))
        self.splats = wrap_context(context)
        self.weights = weights
        self.decoder = Decoder.load(weights, "65k")
        self.maker = Maker(weights, context)
        self._decoders: dict[Density, Decoder] = {"65k": self.decoder}
        self._dressed: Subject | None = None

    def subject(self, geometry: Floats, skin: Floats, eye: Floats) -> Subject:
        """Without lashes: the truth is a mesh, strands are not judged."""
        identity = self.maker.identity("judged", geometry, skin, eye)
        identity = replace(identity, beard=beard.none())
        rest = self.assembly.posing.rest(geometry)
        return Subject(geometry, rest, skin, eye, self.maker.visibility(identity.rest), identity)

    # --- truth ---

    def true_vertices(self, who: Subject, rig: Floats, gaze: Floats) -> Floats:
        return self.assembly.posing.pose(rig, gaze, who.rest)

    def true_light(self, vertices: Floats) -> Floats:  # [V, 4]
        return self.maker.occlusion(vertices, self.assembly.normals(vertices))

    def true_picture(
        self, who: Subject, rig: Floats, vertices: Floats, light: Floats, camera: Camera
    ) -> NDArray[np.uint8]:
        surface, around = self.decoder.surface, self.decoder.surface.face
        colors = self.assembly.colors.copy()
        sums, rest_sums = (around.normals(v)[1] for v in (vertices, who.rest.geometry))
        colors[surface.used[surface.live]] *= np.sqrt(surface.flush(sums, rest_sums))
        self._dress(who)
        seen, posing = np.ascontiguousarray(light.T), self.assembly.posing
        tongue, parted = posing.tongue, posing.mouth.gaps(vertices).max()
        mouth_tints.tint(colors, tongue, self.assembly.face.regions["teeth_lower"])
        tongue_light.light_tongue(vertices, who.rest.geometry, tongue, tongue, seen, parted)
        self.decoder.teeth_light.of_vertices(surface.used).fill(seen, parted)
        return self._mesh.draw(
            vertices, self.assembly.normals(vertices), colors, np.ascontiguousarray(seen.T), camera,
            folds=wrinkles.amounts(rig, self._folds), lids=posing.openings(vertices),
        )  # fmt: skip

    def face_mask(self, who: Subject, vertices: Floats, camera: Camera) -> NDArray[np.bool_]:
        """Pixels that show the face: front of the head, eyes and mouth; no scalp, ears, neck."""
        face = self.assembly.face
        shown = np.ones(len(vertices), bool)
        shown[: face_data.SKIN_VERTICES] = False
        shown[face.regions["narrow_face"]] = True
        colors = np.repeat(shown[:, None], 3, 1).astype(np.float32)  # black hides, white shows
        light = np.tile(np.array([1, 0, 0, 0], np.float32), (len(vertices), 1))
        black = replace(camera, background=BLACK)
        self._dress(who)
        picture = self._mesh.draw(
            vertices, self.assembly.normals(vertices), colors, light, black, FLAT, mirrors=False
        )
        return picture.max(2) > 12

    def _dress(self, who: Subject) -> None:
        if self._dressed is not who:
            self._mesh.set_texture("skin", who.skin)
            self._mesh.set_texture("eye", who.eye)
            self._dressed = who

    # --- prior ---

    @cached_property
    def _encoder(self) -> Any:
        return self.maker.expression_encoder()

    @cached_property
    def _atlas(self) -> atlas.Atlas:
        return atlas.build(self.assembly.places[self.decoder.surface.used])

    @cached_property
    def rig_basis(self) -> tuple[NDArray[np.int64], Floats]:
        """Vertices of face and tongue, and the dense basis of their coordinates."""
        regions = self.assembly.face.regions
        rows = np.unique(np.concatenate([regions["narrow_face"], regions["tongue"]])).astype(int)
        index = (rows[:, None] * 3 + np.arange(3)).ravel()
        return rows, self.decoder.posing.basis[index].toarray()

    def encode(self, who: Subject, vertices: Floats, light: Floats) -> Floats:  # -> [256]
        """E: change of geometry and of texture (light) from the person's neutral -> code mean."""
        used = self.decoder.surface.used
        moved = vertices - who.rest.geometry
        rows, basis = self.rig_basis
        rig = prior_metrics.recovered_rig(moved[rows][None], basis)[0]
        change = (light[used] - who.light)[:, :2]  # sky and key light
        maps = atlas.picture(
            self._atlas, np.concatenate([moved[used] / GEOMETRY_UNIT_MM, change], 1)
        )
        with torch.no_grad():
            free, _ = self._encoder(torch.from_numpy(maps)[None])
        coding = self.decoder.coding
        return rig @ coding.to_code + free[0].numpy() @ coding.free

    def decoder_of(self, density: Density) -> Decoder:
        """The decoder of so many Gaussians; kept."""
        if density not in self._decoders:
            self._decoders[density] = Decoder.load(self.weights, density)
        return self._decoders[density]

    def picture(
        self,
        who: Subject,
        code: Floats,
        gaze: Floats,
        camera: Camera,
        density: Density = "65k",
        matte: bool = False,
    ) -> tuple[Floats, NDArray[np.uint8]]:
        """Decoded vertices and the picture of the Gaussians [H, W, 3]; matte: without lobes."""
        mesh, cloud = self.decoder_of(density).decode(code, gaze, who.identity)
        if matte:
            cloud = replace(cloud, shine=None)
        self.splats.draw(cloud, camera)
        return mesh.vertices, self.splats.read_rgba()[..., :3].copy()

    # --- eyes ---

    def gaze_error_deg(self, who: Subject, yaw_deg: float, pitch_deg: float) -> float:
        """Angle between the iris drawn with Gaussians and drawn by the mesh renderer."""
        gaze = expressions.gaze(yaw_deg, pitch_deg)
        still, worst = np.zeros(len(self.assembly.names), np.float32), 0.0
        for eye in range(2):
            centre = who.rest.eye_centers[eye]
            camera = eye_camera(centre)
            vertices = self.true_vertices(who, still, gaze)
            white = self._iris(eye, who.rest.geometry)
            true = self._mesh_iris(who, vertices, white, eye, camera)
            drawn = self._splat_iris(who, gaze, white, eye, camera)
            shift = (drawn - true) / camera.K[0, 0] * (900.0 - 15.0)
            worst = max(worst, float(np.degrees(np.linalg.norm(shift) / 15.6)))
        return worst

    def _iris(self, eye: int, rest: Floats) -> NDArray[np.bool_]:  # [V]
        members = self.assembly.face.regions[f"sclera_{'lr'[eye]}"]
        arm = rest[members] - self.decoder.posing.rest(rest, sealed=True).eye_centers[eye]
        angle = np.degrees(np.arccos(arm[:, 2] / np.linalg.norm(arm, axis=1)))
        out = np.zeros(len(rest), bool)
        out[members[angle < IRIS_DEG]] = True
        return out

    def _mesh_iris(self, who, vertices, white, eye, camera):  # type: ignore[no-untyped-def]
        face = self.assembly.face
        moved = vertices.copy()
        hidden = np.ones(len(vertices), bool)
        hidden[face.regions[f"sclera_{'lr'[eye]}"]] = False
        moved[hidden, 2] -= 3000  # out of the way
        colors = np.repeat(white[:, None], 3, 1).astype(np.float32)
        light = np.tile(np.array([1, 0, 0, 0], np.float32), (len(white), 1))
        plain = replace(who, eye=np.ones((8, 8, 3), np.float32))
        self._dress(plain)
        picture = self._mesh.draw(moved, self.assembly.normals(vertices), colors,
                                  light, camera, FLAT, mirrors=False)  # fmt: skip
        return prior_metrics.iris_centre(picture)

    def _splat_iris(self, who, gaze, white, eye, camera):  # type: ignore[no-untyped-def]
        surface, identity = self.decoder.surface, who.identity
        _, cloud = self.decoder.decode(np.zeros(256, np.float32), gaze, identity)
        count = len(surface.scales)
        members = np.zeros(len(white), np.float32)
        members[self.assembly.face.regions[f"sclera_{'lr'[eye]}"]] = 1
        on_eye = surface.interpolate @ members[surface.used] > 0.99
        bright = surface.interpolate @ white[surface.used].astype(np.float32)
        rows = np.flatnonzero(on_eye)
        shown = Gaussians(
            cloud.means[:count][rows], cloud.quats[:count][rows], cloud.scales[:count][rows],
            cloud.opacities[:count][rows], np.repeat(bright[rows, None], 3, 1).clip(0, 1),
        )  # fmt: skip
        self.splats.draw(shown, camera)
        return prior_metrics.iris_centre(self.splats.read_rgba()[..., :3])


def eye_camera(centre: Floats) -> Camera:
    camera = cameras.portrait(
        SIZE_PX, SIZE_PX, target_mm=(float(centre[0]), float(centre[1]), float(centre[2]))
    )
    K = camera.K.copy()
    K[0, 0] = K[1, 1] = SIZE_PX * 900.0 / EYE_SPAN_MM
    return Camera(camera.viewmat, K, SIZE_PX, SIZE_PX, camera.near_mm, (0.0, 0.0, 0.0))
