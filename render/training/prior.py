"""`livedrive train prior`: the face data -> the prior over faces, and the avatars that ship.

Stages, each resumable: virtual people and the light on their faces (truth.py), places of the
Gaussians (anchors.py), photometric fit (fit.py), VAE, identity encoder and light decoder
(learn.py), avatars (avatars.py).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from render.avatars.maker import Maker
from render.decoder import prior_file
from render.decoder.coding import EXPRESSION_DIM, Coding, extend
from render.decoder.decoder import NUM_RIG, Decoder
from render.decoder.identity import Identity
from render.decoder.learned import atlas, weights_file
from render.training import avatars, prior_tensors
from render.training.data import face_data, people
from render.training.fitting import fit, learn, truth
from render.training.fitting.resume import write
from render.training.fitting.wardrobe import Wardrobe
from render.training.geometry import anchors as places
from render.training.geometry import assembly as assemblies
from render.training.geometry import hidden, teeth
from sensors.types import InputError

LICENCE = (
    "derived from the ICT Face Model Light (MIT, (c) 2020 USC Institute for Creative "
    "Technologies), MakeHuman skins and hair (CC0), and detail of the Reom character of CharMorph "
    "(CC BY, mesh ComplexAce, textures Hope)"
)
# Squared weight of a region's vertices in the distance between two faces.
REGION_WEIGHT = {"lips": 8.0, "eyelids": 8.0, "inner_mouth_lip_roll": 4.0}
SMALLEST_DEVIATION = 0.05
HELD_OUT_PEOPLE = 10
SITTERS = 6  # who tell what a head shows


@dataclass(frozen=True, kw_only=True)
class Preset:
    """Sizes of a run."""

    people: int
    poses: int  # of each person, beside the neutral face
    gaussians: int  # asked for; a quarter is never seen and left out
    fit_people: int
    steps: int  # of the networks


PRESETS = {
    "debug": Preset(people=10, poses=1, gaussians=22_000, fit_people=2, steps=10),
    "default": Preset(people=200, poses=3, gaussians=87_500, fit_people=30, steps=1200),
    "paper": Preset(people=3000, poses=12, gaussians=174_000, fit_people=300, steps=60_000),
}


def run(
    face_folder: Path,
    out: Path,
    preset: str,
    work: Path,
    take: Path | None = None,
    seed: int = 0,
    device: str = "cpu",  # of the networks
) -> None:
    """Train into `out`; intermediate results live in `work` and are used again."""
    import torch

    torch.set_num_threads(1)
    size = PRESETS[preset]
    assembly = assemblies.build(face_data.load(face_folder))
    seeds = range(size.people)
    known = truth.run(assembly, work / "people", seeds, size.poses, take, held_out=False)
    anchors = place(assembly, size.gaussians, seed, work / f"anchors_{size.gaussians}.npz")
    wardrobe = Wardrobe(assembly.face, work / "wardrobe")
    studio = fit.Studio(assembly, anchors, known, wardrobe)
    fitted = fit.load(studio, list(range(size.fit_people)), seed, work / "fitted.npz")
    used = studio.surface.used
    coding = code(assembly, known, weights_file.FOLDER, seed)
    at = atlas.build(assembly.places[used])
    examples = learn.examples(assembly, known, coding, at, used, wardrobe)
    held_seeds = range(people.HELD_OUT, people.HELD_OUT + min(HELD_OUT_PEOPLE, size.people))
    held = truth.run(assembly, work / "people", held_seeds, size.poses, take, held_out=True)
    judged = learn.examples(assembly, held, coding, at, used, wardrobe)
    weight = vertex_weights(assembly, used)
    state = work / "networks.state"
    nets, left = learn.run(
        examples, judged, at.to_vertices, weight, state, size.steps, seed, device
    )
    tensors = prior_tensors.tensors(
        assembly, anchors, fitted, coding, nets, used, wardrobe.wrinkles
    )
    rows = np.flatnonzero(np.isin(used, assembly.face.regions["teeth"]))
    tensors |= teeth.light(
        learn.changes(nets, examples), examples.light[: learn.MAPPED, rows].numpy(), rows
    )
    taken = " --take TAKE.csv" if take else ""
    common = {
        "command": f"livedrive train prior --face DIR --preset {preset} --seed {seed}{taken}",
        "licence": LICENCE,
        "seed": seed,
    }
    metrics = {
        "gaussians": len(anchors.triangles),
        "people": size.people,
        "fit_people": size.fit_people,
        "light_unexplained_held_out": left,
    }
    card = {"kind": prior_file.KIND, "rig_names": assembly.face.rig_names, "metrics": metrics}
    weights_file.save(out / "prior", tensors, {**card, **common})
    tensors = prior_tensors.without(tensors, unseen(assembly, wardrobe, out))
    card["metrics"] = {**metrics, "gaussians": len(tensors["anchor_triangles"])}
    weights_file.save(out / "prior", tensors, {**card, **common})
    tensors |= avatars.eye_colors(wardrobe, Maker(out))
    weights_file.save(out / "prior", tensors, {**card, **common})
    Decoder.load(out)
    avatars.run(assembly, wardrobe, out, common)


def unseen(assembly: assemblies.Assembly, wardrobe: Wardrobe, folder: Path) -> NDArray[np.integer]:
    """The anchors of a folder's prior that no person without hair ever shows."""
    maker, sitters = Maker(folder), list[Identity]()
    for seed in range(SITTERS):
        person = people.draw(assembly.face, seed)
        skin, eye = wardrobe.texture(person), wardrobe.eye(person.eye)
        sitters.append(maker.identity("", people.neutral(assembly.face, person), skin, eye))
    return hidden.hidden(Decoder.load(folder, "65k"), sitters)


def place(assembly: assemblies.Assembly, count: int, seed: int, path: Path) -> places.Anchors:
    """The anchors, from `path` if they were placed before."""
    if path.exists():
        z = np.load(path, allow_pickle=False)
        return places.Anchors(z["triangles"], z["barycentric"], z["scales"])
    made = places.place(assembly, count, seed)
    write(path, lambda draft: np.savez(draft, **vars(made)))
    return made


def code(assembly: assemblies.Assembly, known: truth.Truth, shipped: Path, seed: int) -> Coding:
    """The code's fixed map, and the moments of plausible faces in it.

    The map of a shipped prior is kept to the bit: encoders were trained against it.
    """
    try:
        old, _ = weights_file.load(shipped / "prior", prior_file.KIND)
        to_code, to_rig = old["to_code"][:NUM_RIG], old["to_rig"][:, :NUM_RIG]
    except InputError:
        to_code, to_rig = rig_map(assembly.face, seed)
    full_code, full_rig, free, frame = extend(to_code, to_rig, seed)
    codes = known.rig @ full_code @ frame.T
    count = len(full_code)
    mean, deviation = np.zeros(EXPRESSION_DIM, np.float32), np.ones(EXPRESSION_DIM, np.float32)
    mean[:count] = codes[:, :count].mean(0)
    deviation[:count] = np.maximum(codes[:, :count].std(0), SMALLEST_DEVIATION)
    return Coding(full_code, full_rig, free, frame, mean, deviation)


def rig_map(face: face_data.FaceData, seed: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """to_code [53, 256] and its inverse to_rig [256, 53]: distance of codes is that of faces."""
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
    to_code = (scale * lower @ rotation).astype(np.float32)
    return to_code, (rotation.T @ np.linalg.inv(lower) / scale).astype(np.float32)


def vertex_weights(
    assembly: assemblies.Assembly, used: NDArray[np.int32]
) -> NDArray[np.float32]:  # [U]
    """How much the light on a vertex matters to the networks."""
    weight = np.full(len(used), 0.3, np.float32)
    weight[used >= face_data.SKIN_VERTICES] = 0.5
    weight[np.isin(used, assembly.face.regions["narrow_face"])] = 1.0
    weight[np.isin(used, np.concatenate(assembly.posing.eyeballs))] = 1.5
    return weight
