"""The prior on disk: one safetensors file, and the decoder's parts from it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array, eye_array

from render import wrinkles
from render.decoder import density, eyes, surface
from render.decoder.coding import KIND, Coding
from render.decoder.cover import cover, lining, molars
from render.decoder.learned import atlas, weights_file
from render.decoder.learned.light import LightNet
from render.decoder.lines import Line, Lips
from render.decoder.posing import GEOMETRY_STEPS, Posing, look_columns
from render.teeth_light import TeethLight
from render.tongue_light import TongueLight
from render.types import Density

LIPS_MM = 18.0  # from their middle: farther out the lining of the mouth keeps its corners dark
Tensors = dict[str, NDArray[Any]]
KNOWN = 4  # every density, and the order of the file
_known: dict[tuple[str, Density | None], dict[str, Any]] = {}  # the last ones


def load(folder: Path, gaussians: Density) -> dict[str, Any]:
    """The fields of render.decoder.decoder.Decoder."""
    return parts(*weights_file.load(folder / "prior", KIND), gaussians)


def parts(t: Tensors, card: dict[str, Any], gaussians: Density | None = None) -> dict[str, Any]:
    """The same from what was read; without a preset in the order of the file.

    It takes a second: a process computes it once. Nobody changes the arrays."""
    key = card["sha256"], gaussians
    if key not in _known:
        if len(_known) >= KNOWN:
            _known.pop(next(iter(_known)))
        _known[key] = _parts(t, card, gaussians)
    return dict(_known[key])


def _parts(t: Tensors, card: dict[str, Any], gaussians: Density | None) -> dict[str, Any]:
    regions = {
        name.removeprefix("region_"): t[name].astype(np.int32)
        for name in t
        if name.startswith("region_")
    }
    faces, pose = t["faces"].astype(np.int32), posing(t, regions, card["rig_names"])
    head = surface.build(
        mesh=template(t),
        faces=faces,
        drawn=t["drawn"],
        kinds=t["vertex_kinds"],
        blood=regions["narrow_face"],
        lids=regions["eyelids"],
        tongue=pose.tongue,
        triangles=t["anchor_triangles"],
        weights=t["anchor_weights"].astype(np.float32),
        widths=t["anchor_widths"].astype(np.float32),
    )
    opacities = t["anchor_opacities"].astype(np.float32) / np.float32(255)
    kinds, shares = t["anchor_kinds"], csr_array(eye_array(len(opacities)), dtype=np.float32)
    rows = np.arange(len(opacities))
    lips = np.concatenate([regions["lips"], regions["inner_mouth_lip_roll"]])
    edges, face = np.concatenate([regions["eyelids"], lips]), regions["narrow_face"]
    deep = density.thick(head, template(t), kinds, face, edges)
    if gaussians:
        groups = density.groups(head, template(t), kinds, face, deep)
        rows, shares, widths, opacities = density.choose(
            head, template(t), kinds, opacities, *groups, gaussians
        )
        head, deep = replace(head.take(rows), scales=widths), deep[rows]
    widths, opacities = cover(
        head, opacities, kinds[rows], regions["eyelids"], lips, face, deep, pose, template(t)
    )
    lips_mm = float(template(t)[pose.mouth.upper, 1].mean())
    opacities = opacities * molars(head, t["teeth_rows"], lips_mm, template(t))
    flesh = np.concatenate([regions["gums"], pose.tongue, head.used[t["teeth_rows"]]])
    middle = lips[np.abs(template(t)[lips, 0]) < LIPS_MM]
    front = np.union1d(np.setdiff1d(face, edges), middle)
    inside = t["anchor_inside"][rows] > 0
    opacities = opacities * lining(head, inside, flesh, front, pose, template(t))
    head = replace(head, scales=widths)
    if gaussians:
        scales = np.where(deep, density.NARROWER[gaussians], 1) * head.scales
        head = replace(head, scales=scales.astype(np.float32))
        layers = density.layered(head, template(t), deep, shares, opacities)
        head = replace(head.take(layers.rows), scales=layers.widths, depths=layers.depths)
        shares, opacities, rows = layers.shares, layers.opacities, rows[layers.rows]
    return {
        "rig_names": list(card["rig_names"]),
        "coding": Coding.of(t),
        "posing": pose,
        "surface": head,
        "light": LightNet.of(t),
        "light_to_vertex": light_to_vertex(t, head.used, pose),
        "opacities": opacities,
        "roughness": shares @ (t["anchor_roughness"].astype(np.float32) / np.float32(255)),
        "shares": shares,
        "eyes": eyes.build(head, pose, regions["eyelids"], template(t)),
        "interior": np.flatnonzero(t["anchor_inside"][rows]).astype(np.int32),
        "teeth_light": TeethLight.of(
            t["teeth_rows"], np.isin(head.used, regions["gums"]), template(t)[head.used], lips_mm
        ),
        "tongue_light": TongueLight.of(head.used, pose.tongue),
        "wrinkles": folds(t, card["rig_names"], head, shares),
        "faces": faces,
        "regions": regions,
    }


def folds(
    t: Tensors, names: list[str], head: surface.Surface, shares: csr_array
) -> wrinkles.Wrinkles:
    maps = shares @ (t["anchor_wrinkles"].astype(np.float32) / wrinkles.STEPS)
    across = head.interpolate @ template(t)[head.used, 0]
    return wrinkles.build(maps, across, names, len(t["to_code"]))


def light_to_vertex(t: Tensors, used: NDArray[np.int32], pose: Posing) -> csr_array:  # [U, T]
    """Texels of the light decoder's map -> used vertices.

    Teeth: see `geometry/teeth.py`. Light that changes with the expression alone says nothing
    about the parts of an eye that a look brings out.
    """
    to_vertices = atlas.build(t["places"].astype(np.float32)).to_vertices
    rows, texels, weights = t["teeth_rows"], t["teeth_texels"], t["teeth_light"]
    keep = np.ones(len(t["places"]), np.float32)
    keep[rows] = 0
    keep[np.isin(used, np.concatenate([hidden for _, hidden in eyes.bared(pose, template(t))]))] = 0
    where = np.repeat(rows, len(texels)), np.tile(texels, len(rows))
    teeth = csr_array((weights.astype(np.float32).ravel(), where), to_vertices.shape)
    return csr_array(diags_array(keep) @ to_vertices + teeth, dtype=np.float32)


def template(t: Tensors) -> NDArray[np.float32]:  # [V, 3] mm
    """The mean face at rest."""
    return t["template"].astype(np.float32) / GEOMETRY_STEPS


def posing(t: Tensors, regions: dict[str, NDArray[np.int32]], rig_names: list[str]) -> Posing:
    rows = t["geometry_rows"]
    basis = csr_array(
        (t["basis_values"].astype(np.float32), t["basis_columns"].astype(np.int32), rows),
        shape=(len(rows) - 1, len(t["to_code"])),
    )
    return Posing(
        basis=basis,
        eyeballs=(regions["eyeball_l"], regions["eyeball_r"]),
        lids=(t["lids_l"], t["lids_r"]),
        mouth=Line.of(t, "mouth"),
        lips=Lips.of(template(t), regions["lips_upper"], regions["lips_lower"]),
        lid_lines=(Line.of(t, "lid_l"), Line.of(t, "lid_r")),
        blinks=(int(t["columns"][0]), int(t["columns"][1])),
        jaw=(int(t["columns"][2]), int(t["columns"][3])),
        looks=look_columns(rig_names),
    )
