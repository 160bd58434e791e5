"""`livedrive train prior`: the face data -> the decoder's weights and the avatars.

The expression code is a change of coordinates of the rig, chosen so that the distance between two
codes is the distance between two faces (root of the weighted squared vertex distance), spread
over 256 dimensions by a random rotation. It is fitted in closed form; a learned, non-linear prior
over faces takes its place later behind the same interface.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from render import identity, weights_file
from render.decoder import EXPRESSION_DIM, KIND, Decoder
from render.training import appearance, face_data, hair
from render.training.visibility import seen, views
from render.types import Gaussians

LICENCE = (
    "derived from the ICT Face Model Light (MIT, (c) 2020 USC Institute for Creative "
    "Technologies) and MakeHuman skins, eyes and hair (CC0)"
)
# Squared weight of a region's vertices in the distance between two faces.
REGION_WEIGHT = {"lips": 8.0, "eyelids": 8.0, "inner_mouth_lip_roll": 4.0}
SMALLEST_MM = 0.01  # displacements below it are left out of the basis
# What can come to light: an open mouth, bared teeth, closed eyes.
POSES: tuple[dict[str, float], ...] = (
    {},
    {"jawOpen": 0.9, "mouthUpperUp_L": 0.8, "mouthUpperUp_R": 0.8},
    {"jawOpen": 0.4, "mouthLowerDown_L": 1, "mouthLowerDown_R": 1, "mouthFunnel": 0.5},
    {"mouthSmile_L": 1, "mouthSmile_R": 1, "jawOpen": 0.2, "eyeBlink_L": 1, "eyeBlink_R": 1},
    {"eyeWide_L": 1, "eyeWide_R": 1, "mouthStretch_L": 1, "mouthStretch_R": 1, "jawOpen": 0.5},
)
KEPT_REGIONS = (
    *("lips", "lips_upper", "lips_lower", "upper_face", "eyelids", "brows", "eyeball_l"),
    *("eyeball_r", "inner_mouth_lip_roll"),
)


@dataclass(frozen=True)
class Person:
    """The recipe of one avatar."""

    seed: int  # of the 100 identity modes
    strength: float  # standard deviations of the modes
    skin: str
    eye: str
    hair: str
    tint: tuple[float, float, float] | None


PEOPLE = {
    "ben": Person(
        11, 0.55, "albedo/mh_young_lightskinned_male2.jpg", "eye_brownlight.png", "short04", None
    ),
    "ada": Person(
        5,
        0.5,
        "albedo/mh_young_lightskinned_female3.jpg",
        "eye_green.png",
        "bob02_swept",
        (0.33, 0.2, 0.12),
    ),
    "kofi": Person(
        23, 0.5, "albedo/mh_young_darkskinned_male.jpg", "eye_brown.png", "short01", None
    ),
}


def run(
    face_folder: Path, out: Path, anchors: int = 30000, hairs: int = 4000, seed: int = 0
) -> None:
    """Fit the prior, bake every avatar, and write weights and cards under `out`."""
    face = face_data.load(face_folder)
    command = f"livedrive train prior --face DIR --seed {seed}"
    common = {"command": command, "licence": LICENCE, "seed": seed}
    placed = prune(face, appearance.place(face, anchors, seed))
    tensors = {**code(face, seed), **basis(face), **anchored(face, placed)}
    tensors["faces"] = face.faces.astype(np.uint16)
    for name in KEPT_REGIONS:
        tensors[f"region_{name}"] = face.regions[name].astype(np.uint16)
    error = np.abs(tensors["to_code"] @ tensors["to_rig"] - np.eye(len(face.rig_names))).max()
    metrics = {"gaussians": len(placed.triangles), "rig_round_trip_max_error": float(error)}
    card = {"kind": KIND, "rig_names": face.rig_names, "metrics": metrics, **common}
    weights_file.save(out / "prior", tensors, card)
    for name, person in tqdm(PEOPLE.items(), desc="avatars", unit="avatar"):
        card = {"kind": identity.KIND, "recipe": vars(person), **common}
        path = out / f"{identity.PREFIX}{name}"
        weights_file.save(path, bake(face, placed, person, hairs), card)
    Decoder.load(out)


def prune(face: face_data.FaceData, placed: appearance.Anchors) -> appearance.Anchors:
    """Leave out what no expression shows: roots of teeth, the depths of the mouth, sockets."""
    visible = np.zeros(len(placed.triangles), bool)
    cameras = list(views())
    for pose in POSES:
        vertices = face.neutral.copy()
        for name, activation in pose.items():
            vertices += activation * face.rig[face.rig_names.index(name)]
        corners = vertices[face.faces[placed.triangles]]
        means = (corners * placed.barycentric[..., None]).sum(1)
        scales = np.repeat(placed.scales[:, None], 3, 1)
        still = np.tile(np.array([1, 0, 0, 0], np.float32), (len(means), 1))
        cloud = Gaussians(means, still, scales, placed.opacities, np.zeros_like(means))
        visible |= seen(cloud, cameras)
    return appearance.Anchors(
        placed.triangles[visible],
        placed.barycentric[visible],
        placed.scales[visible],
        placed.opacities[visible],
    )


def code(face: face_data.FaceData, seed: int) -> dict[str, NDArray[np.float32]]:
    """to_code [53, 256] and its inverse to_rig [256, 53]."""
    weight = np.full(len(face.neutral), 1.0)
    for region, value in REGION_WEIGHT.items():
        weight[face.regions[region]] = value
    weight[np.concatenate([face.regions["eyeball_l"], face.regions["eyeball_r"]])] = 0
    moved = (face.rig * np.sqrt(weight / weight.sum())[None, :, None]).reshape(len(face.rig), -1)
    gram = moved.astype(np.float64) @ moved.T.astype(np.float64)
    gram += np.eye(len(gram)) * gram.trace() / len(gram) * 1e-3
    lower = np.linalg.cholesky(gram)
    normal = np.random.default_rng(seed).standard_normal((EXPRESSION_DIM, len(gram)))
    rotation = np.linalg.qr(normal)[0].T
    scale = np.sqrt(EXPRESSION_DIM)
    return {
        "to_code": (scale * lower @ rotation).astype(np.float32),
        "to_rig": (rotation.T @ np.linalg.inv(lower) / scale).astype(np.float32),
    }


def basis(face: face_data.FaceData) -> dict[str, NDArray[np.generic]]:
    """The rig's displacements as compressed sparse rows, one row a coordinate."""
    from scipy.sparse import csr_array

    moved = face.rig.copy()
    moved[:, np.concatenate([face.regions["eyeball_l"], face.regions["eyeball_r"]])] = 0
    moved[np.abs(moved) < SMALLEST_MM] = 0
    rows = csr_array(moved.reshape(len(moved), -1).T)
    return {
        "basis_values": rows.data.astype(np.float16),
        "basis_columns": rows.indices.astype(np.uint8),
        "geometry_rows": rows.indptr.astype(np.int32),
    }


def anchored(
    face: face_data.FaceData, placed: appearance.Anchors
) -> dict[str, NDArray[np.generic]]:
    corners = face.neutral[face.faces[placed.triangles]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return {
        "anchor_triangles": placed.triangles,
        "anchor_barycentric": placed.barycentric,
        "anchor_scales": placed.scales,
        "anchor_areas": np.linalg.norm(normal, axis=1).astype(np.float32) + 1e-9,
    }


def bake(
    face: face_data.FaceData, placed: appearance.Anchors, person: Person, hairs: int
) -> dict[str, NDArray[np.generic]]:
    """The tensors of one identity."""
    rng = np.random.default_rng(person.seed)
    modes = rng.standard_normal(len(face.identities)).astype(np.float32) * person.strength
    vertices = face_data.geometry(face, modes)
    eyes = [face_data.sphere_centre(vertices[face.regions[f"sclera_{side}"]]) for side in "lr"]
    colors = appearance.colors(face, placed, vertices, person.skin, person.eye)
    strands = hair.grow(face, vertices, person.hair, person.tint, hairs, person.seed)
    return {
        "geometry": vertices.astype(np.float32),
        "eye_centers": np.stack(eyes),
        "colors": np.round(colors * 255).astype(np.uint8),
        "opacities": placed.opacities,
        "hair_means": strands.means,
        "hair_quats": strands.quats,
        "hair_scales": strands.scales.astype(np.float16),
        "hair_opacities": strands.opacities.astype(np.float16),
        "hair_colors": np.round(strands.colors * 255).astype(np.uint8),
    }
