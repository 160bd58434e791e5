"""The prior on disk: one safetensors file, and the decoder's parts from it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array, eye_array

from render import atlas, density, surface, weights_file
from render.coding import Coding
from render.contact import Line
from render.cover import bared, cover, molars
from render.light_decoder import LightNet, tensors_of
from render.posing import GEOMETRY_STEPS, Posing
from render.types import Density

KIND = "prior"
KEPT_REGIONS = (
    *("lips", "lips_upper", "lips_lower", "upper_face", "eyelids", "brows", "eyeball_l"),
    *("eyeball_r", "inner_mouth_lip_roll", "narrow_face"),
)
INTERIOR = ("teeth", "gums_tongue", "mouth_socket")
Tensors = dict[str, NDArray[Any]]


def load(folder: Path, gaussians: Density) -> dict[str, Any]:
    """The fields of render.decoder.Decoder."""
    return parts(*weights_file.load(folder / "prior", KIND), gaussians)


def parts(t: Tensors, card: dict[str, Any], gaussians: Density | None = None) -> dict[str, Any]:
    """The same from what was read; without a preset in the order of the file."""
    regions = {
        name.removeprefix("region_"): t[name].astype(np.int32)
        for name in t
        if name.startswith("region_")
    }
    faces = t["faces"].astype(np.int32)
    head = surface.build(
        mesh=template(t),
        faces=faces,
        drawn=t["drawn"],
        kinds=t["vertex_kinds"],
        blood=regions["narrow_face"],
        triangles=t["anchor_triangles"],
        weights=t["anchor_weights"].astype(np.float32),
        widths=t["anchor_widths"].astype(np.float32),
    )
    opacities = t["anchor_opacities"].astype(np.float32) / np.float32(255)
    kinds, reads = t["anchor_kinds"], csr_array(eye_array(len(opacities)), dtype=np.float32)
    rows = np.arange(len(opacities))
    if gaussians:
        rows, reads, widths, opacities = density.choose(
            head, template(t), kinds, opacities, gaussians
        )
        head = replace(head.take(rows), scales=widths)
    pose = posing(t, regions)
    edges = np.concatenate([regions[r] for r in ("eyelids", "lips", "inner_mouth_lip_roll")])
    face = regions["narrow_face"]
    widths, opacities = cover(head, opacities, kinds[rows], edges, face, pose, template(t))
    lips_mm = float(template(t)[pose.mouth.upper, 1].mean())
    opacities = opacities * molars(head, t["teeth_rows"], lips_mm, template(t))
    coding = Coding(
        *(t[k] for k in ("to_code", "to_rig", "free", "frame", "code_mean", "code_deviation"))
    )
    return {
        "rig_names": list(card["rig_names"]),
        "coding": coding,
        "posing": pose,
        "surface": replace(head, scales=widths),
        "light": LightNet.of(t),
        "read": read_map(t, head.used, pose),
        "opacities": opacities,
        "reads": reads,
        "interior": np.flatnonzero(t["anchor_inside"][rows]),
        "faces": faces,
        "regions": regions,
    }


def read_map(t: Tensors, used: NDArray[np.int32], pose: Posing) -> csr_array:  # [U, T]
    """Texels of the light decoder's map -> used vertices.

    Teeth see `render/training/teeth.py`. Light that changes with the expression alone says nothing
    about the parts of an eye that a look brings out.
    """
    read = atlas.build(t["places"].astype(np.float32)).read
    rows, texels, weights = t["teeth_rows"], t["teeth_texels"], t["teeth_light"]
    keep = np.ones(len(t["places"]), np.float32)
    keep[rows] = 0
    keep[np.isin(used, np.concatenate([hidden for _, hidden in bared(pose, template(t))]))] = 0
    where = np.repeat(rows, len(texels)), np.tile(texels, len(rows))
    teeth = csr_array((weights.astype(np.float32).ravel(), where), read.shape)
    return csr_array(diags_array(keep) @ read + teeth, dtype=np.float32)


def template(t: Tensors) -> NDArray[np.float32]:  # [V, 3] mm
    """The mean face at rest."""
    return t["template"].astype(np.float32) / GEOMETRY_STEPS


def tensors(
    assembly: Any,  # render.training.assembly.Assembly
    anchors: Any,  # render.training.anchors.Anchors
    fitted: Any,  # render.training.fit.Fitted
    coding: Coding,
    nets: Any,  # render.training.learn.Networks
    used: NDArray[np.int32],
) -> Tensors:
    """What `load` and `render.avatar` read."""
    from render.training.anchors import plain, uv

    face, pose = assembly.face, assembly.posing
    inside = np.isin(
        face.faces[anchors.triangles], np.concatenate([face.regions[r] for r in INTERIOR])
    ).all(1)
    basis = pose.basis
    out: dict[str, Any] = {
        "basis_values": basis.data.astype(np.float16),
        "basis_columns": basis.indices.astype(np.uint8),
        "geometry_rows": basis.indptr.astype(np.int32),
        "template": np.rint(pose.rest(face.neutral).geometry * GEOMETRY_STEPS).astype(np.int16),
        "faces": face.faces.astype(np.uint16),
        "drawn": np.flatnonzero(assembly.kinds >= 0).astype(np.int32),
        "vertex_kinds": assembly.vertex_kinds.astype(np.uint8),
        "anchor_triangles": anchors.triangles.astype(np.uint16),
        "anchor_weights": anchors.barycentric.astype(np.float16),
        "anchor_widths": fitted.widths.astype(np.float16),
        "anchor_opacities": np.rint(fitted.opacities * 255).astype(np.uint8),
        "anchor_mixing": fitted.mixing.astype(np.float16),
        "anchor_inside": inside,
        "anchor_kinds": assembly.kinds[anchors.triangles].astype(np.uint8),
        "anchor_uv": uv(assembly, anchors),
        "anchor_plain": np.rint(plain(assembly, anchors) * 255).astype(np.uint8),
        "vertex_colors": np.rint(assembly.colors[used] * 255).astype(np.uint8),
        "vertex_uv": assembly.vertex_uv[used],
        "places": assembly.places[used],
        "columns": np.array([*pose.blinks, *pose.jaw], np.int32),
        "lids_l": pose.lids[0],
        "lids_r": pose.lids[1],
        **pose.mouth.tensors("mouth"),
        **pose.lid_lines[0].tensors("lid_l"),
        **pose.lid_lines[1].tensors("lid_r"),
        **{f"region_{name}": face.regions[name].astype(np.uint16) for name in KEPT_REGIONS},
        "to_code": coding.to_code,
        "to_rig": coding.to_rig,
        "free": coding.free,
        "frame": coding.frame,
        "code_mean": coding.mean,
        "code_deviation": coding.deviation,
        **tensors_of(nets.light),
    }
    for name, network in (("identity", nets.identity), ("expression", nets.expression)):
        for key, value in network.state_dict().items():
            out[f"{name}.{key}"] = value.numpy().astype(np.float16)
    return out


def posing(t: Tensors, regions: dict[str, NDArray[np.int32]]) -> Posing:
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
        lid_lines=(Line.of(t, "lid_l"), Line.of(t, "lid_r")),
        blinks=(int(t["columns"][0]), int(t["columns"][1])),
        jaw=(int(t["columns"][2]), int(t["columns"][3])),
    )
