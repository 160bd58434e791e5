"""Where Gaussians sit on the mesh: an even cover, denser where people look."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render import clothes
from render.decoder import mesh_parts
from render.decoder.surface import Surface, build
from render.training.geometry import mouth_anchors
from render.training.geometry.assembly import Assembly
from render.training.geometry.scatter import scatter
from render.training.geometry.visibility import seen, views
from render.types import Floats, Gaussians, Ints

# Gaussians a square millimetre, relative to the front of the face.
MATERIAL = {
    "M_Face": 0.24,
    "M_BackHead": 0.11,
    "M_GumsTongue": 0.28,
    "M_ScleraLeft": 4.5,
    "M_ScleraRight": 4.5,
}
REGION = {"narrow_face": 4.6, "lips": 1.9, "eyelids": 2.2, "brows": 1.2}  # factors on top
NOSE, NOSE_MM = 1.4, ((-20, -16, 98), (20, 30, 200))  # and where it is on the mean face
# Ears have folds, a scalp has hair or nothing to see: factors, and where both lie, |x| y z.
EARS, EARS_MM = 2.4, ((70, -22, -60), (200, 45, 40))
SCALP, SCALP_MM = 0.55, ((0, 20, -200), (200, 200, 40))
# A mesh is fine where it bends: in folds of ears, the density goes with the root of the size of
# triangles, mm^2; as dense as a face, at most.
FOLD_MM2, FOLDED = 2.7, 2.2
# Density falls off from the face's edge, not at once: factor there, and mm in which it falls by e.
EDGE, EDGE_MM = 4.0, 15.0
COLLAR, COLLAR_MM = 3.0, 5.0  # along the edge of a shirt
MOUTH_BAG = 0.12
TEETH, GUMS, TONGUE = 0.092, 0.058, 0.013  # of all Gaussians, see mouth_anchors.py
WIDTH = 0.70  # standard deviation, in units of 1 / sqrt(density), before the fit
# What can come to light: an open mouth, bared teeth, closed eyes, a raised tongue.
POSES: tuple[dict[str, float], ...] = (
    {},
    {"jawOpen": 0.9, "mouthUpperUp_L": 0.8, "mouthUpperUp_R": 0.8},
    {"jawOpen": 0.5, "mouthLowerDown_L": 1, "mouthLowerDown_R": 1, "tongueTipUp": 1},
    {"mouthSmile_L": 1, "mouthSmile_R": 1, "jawOpen": 0.2, "eyeBlink_L": 1, "eyeBlink_R": 1},
    {"eyeWide_L": 1, "eyeWide_R": 1, "mouthStretch_L": 1, "mouthStretch_R": 1, "jawOpen": 0.5},
    {"mouthLeft": 1, "jawOpen": 0.5, "mouthFunnel": 1},
    {"mouthRight": 1, "jawOpen": 0.5, "mouthFunnel": 1},
)
GAZES_DEG = ((0, 0), (28, 0), (-28, 0), (0, 18), (0, -18))  # an eyeball shows other parts


@dataclass(frozen=True)
class Anchors:
    """Gaussians glued to the mesh."""

    triangles: Ints  # [N] rows of FaceData.faces
    barycentric: Floats  # [N, 3]
    scales: Floats  # [N] mm


def place(assembly: Assembly, count: int, seed: int) -> Anchors:
    """About `count` anchors, less those that no pose and no view shows."""
    face, rng = assembly.face, np.random.default_rng(seed)
    corners = face.neutral[face.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(normals, axis=1)
    density = wanted(assembly, corners, area)
    density *= (1 - TEETH - GUMS - TONGUE) * count / (area * density).sum()
    triangles, barycentric = scatter(corners, normals, area, density, rng)
    anchors = Anchors(triangles, barycentric, (WIDTH / np.sqrt(density[triangles])).astype("f4"))
    anchors = _keep(anchors, visible(assembly, anchors))
    inside = [
        Anchors(*mouth_anchors.place(assembly, on, int(share * len(anchors.triangles)), seed))
        for on, share in (
            (mouth_anchors.crowns, TEETH),
            (mouth_anchors.gums, GUMS),
            (mouth_anchors.tongue, TONGUE),
        )
    ]
    parts = (vars(part).values() for part in (anchors, *inside))
    return Anchors(*(np.concatenate(rows) for rows in zip(*parts, strict=True)))


def wanted(assembly: Assembly, corners: Floats, area: Floats) -> NDArray[np.float64]:  # [F]
    """How dense Gaussians lie on triangles [F, 3, 3], relative to each other; 0 where none do."""
    face, middles = assembly.face, corners.mean(1)
    density = np.array([MATERIAL.get(str(m), 0.0) for m in face.materials])
    for region, factor in REGION.items():
        density[np.isin(face.faces, face.regions[region]).all(1)] *= factor
    low, high = np.array(NOSE_MM)
    density[((middles > low) & (middles < high)).all(1)] *= NOSE
    off_face = ~np.isin(face.faces, face.regions["narrow_face"]).any(1)
    sided = middles * np.where(middles[:, :1] < 0, (-1, 1, 1), (1, 1, 1))
    ears, scalp = ((sided > low) & (sided < high) for low, high in (EARS_MM, SCALP_MM))
    ears, scalp = ears.all(1) & off_face, scalp.all(1) & off_face
    density[ears] *= EARS * np.clip(np.sqrt(FOLD_MM2 / area[ears]), 1, FOLDED)
    density[scalp & ~ears] *= SCALP
    beside = off_face & (assembly.kinds == mesh_parts.SKIN)
    far = np.asarray(KDTree(face.neutral[face.regions["narrow_face"]]).query(middles[beside])[0])
    density[beside] *= 1 + (EDGE - 1) * np.exp(-far / EDGE_MM)
    neckline = np.abs(clothes.height(middles)) < COLLAR_MM
    density[neckline & (assembly.kinds == mesh_parts.SKIN)] *= COLLAR
    density[np.isin(face.faces, face.regions["mouth_socket"]).all(1)] = MOUTH_BAG
    gums, tongue = (np.isin(face.faces, face.regions[r]).all(1) for r in ("gums", "tongue"))
    density[gums | tongue | (assembly.kinds == mesh_parts.TEETH) | (assembly.kinds < 0)] = 0
    for eye in assembly.posing.eyeballs:  # the back of an eyeball is never seen
        inside = np.isin(face.faces, eye).all(1)
        density[inside & (middles[:, 2] < face.neutral[eye, 2].mean() - 4)] = 0
    return density


def _keep(anchors: Anchors, which: NDArray[np.bool_]) -> Anchors:
    return Anchors(anchors.triangles[which], anchors.barycentric[which], anchors.scales[which])


def uv(assembly: Assembly, anchors: Anchors) -> Floats:  # [N, 2]
    face = assembly.face
    corners = face.uv[face.uv_faces[anchors.triangles]]
    return (corners * anchors.barycentric[..., None]).sum(1, dtype=np.float32)


def plain(assembly: Assembly, anchors: Anchors) -> Floats:  # [N, 3]
    """Colour of what has no texture; gain of what has."""
    corners = assembly.face.faces[anchors.triangles]
    out = (assembly.colors[corners] * anchors.barycentric[..., None]).sum(1, dtype=np.float32)
    return out


def visible(assembly: Assembly, anchors: Anchors) -> NDArray[np.bool_]:
    """False for roots of teeth, the depths of the mouth and the sockets."""
    from render.training.data import expressions

    out = np.zeros(len(anchors.triangles), bool)
    rest = assembly.posing.rest(assembly.face.neutral)
    cameras = list(views())
    for index, pose in enumerate(POSES):
        rig = np.zeros(len(assembly.names), np.float32)
        expressions.set_named(rig, assembly.names, pose)
        gaze = expressions.gaze(*GAZES_DEG[index % len(GAZES_DEG)])
        vertices = assembly.posing.pose(rig, gaze, rest)
        corners = vertices[assembly.face.faces[anchors.triangles]]
        means = (corners * anchors.barycentric[..., None]).sum(1)
        scales = np.repeat(anchors.scales[:, None], 3, 1)
        still = np.tile(np.array([1, 0, 0, 0], np.float32), (len(means), 1))
        opaque = np.ones(len(means), np.float32)
        out |= seen(Gaussians(means, still, scales, opaque, np.zeros_like(means)), cameras)
    return out


def surface(assembly: Assembly, anchors: Anchors) -> Surface:
    """The anchors as the decoder's linear algebra."""
    face = assembly.face
    return build(
        mesh=assembly.posing.rest(face.neutral).geometry,
        faces=face.faces,
        drawn=np.flatnonzero(assembly.kinds >= 0).astype(np.int32),
        kinds=assembly.vertex_kinds,
        blood=face.regions["narrow_face"],
        lids=face.regions["eyelids"],
        tongue=assembly.posing.tongue,
        triangles=anchors.triangles,
        weights=anchors.barycentric,
        widths=anchors.scales,
    )
