"""What was trained and fitted -> the tensors of the prior's weights file."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.avatars import textures
from render.decoder import mesh_parts
from render.decoder.coding import Coding
from render.decoder.identity import GLOSS_STEPS
from render.decoder.learned.light import tensors_of
from render.decoder.posing import GEOMETRY_STEPS
from render.decoder.prior_file import Tensors
from render.training.fitting.fit import Fitted
from render.training.fitting.learn import DecoderNetworks
from render.training.geometry.anchors import Anchors, plain, uv
from render.training.geometry.assembly import Assembly
from render.types import Floats
from render.wrinkles import STEPS

KEPT_REGIONS = (
    *("lips", "lips_upper", "lips_lower", "upper_face", "eyelids", "brows", "eyeball_l"),
    *("eyeball_r", "inner_mouth_lip_roll", "narrow_face", "gums"),
)
OF_VERTICES = ("vertex_colors", "vertex_uv", "places")  # that Gaussians lie on
INTERIOR = ("teeth", "gums_tongue", "mouth_socket")


def tensors(
    assembly: Assembly,
    anchors: Anchors,
    fitted: Fitted,
    coding: Coding,
    nets: DecoderNetworks,
    used: NDArray[np.int32],
    folds: Floats,  # [SIZE, SIZE, 4] see look/wrinkles.py
) -> Tensors:
    """What render/decoder/prior_file.py and render/avatars/maker.py read."""
    face, pose = assembly.face, assembly.posing
    inside = np.isin(
        face.faces[anchors.triangles], np.concatenate([face.regions[r] for r in INTERIOR])
    ).all(1)
    basis, kinds, at = pose.basis, assembly.kinds[anchors.triangles], uv(assembly, anchors)
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
        "anchor_gloss": np.rint(fitted.gloss * GLOSS_STEPS).astype(np.uint8),
        "anchor_roughness": np.rint(fitted.roughness * 255).astype(np.uint8),
        "anchor_inside": inside,
        "anchor_kinds": kinds.astype(np.uint8),
        "anchor_uv": at,
        "anchor_plain": np.rint(plain(assembly, anchors) * 255).astype(np.uint8),
        "anchor_wrinkles": wrinkled(folds, at, kinds),
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


def without(tensors: Tensors, anchors: NDArray[np.integer]) -> Tensors:
    """Less these rows of the anchors, and the vertices that nothing lies on then."""
    out, corners = dict(tensors), tensors["faces"].astype(np.int64)[tensors["anchor_triangles"]]
    keep = np.ones(len(corners), bool)
    keep[anchors] = False
    used, left = np.unique(corners), np.unique(corners[keep])
    stays = np.isin(used, left)
    eyes = tensors["anchor_kinds"] == mesh_parts.EYE
    for name, rows in tensors.items():
        if name.startswith("anchor_"):
            out[name] = rows[keep]
        elif name.startswith("eye."):
            out[name] = rows[keep[eyes]]
        elif name in OF_VERTICES:
            out[name] = rows[stays]
    teeth = stays[tensors["teeth_rows"]]
    out["teeth_rows"] = (np.cumsum(stays) - 1)[tensors["teeth_rows"][teeth]].astype(np.int32)
    out["teeth_light"] = tensors["teeth_light"][teeth]
    return out


def wrinkled(folds: Floats, at: Floats, kinds: NDArray[np.integer]) -> NDArray[np.int8]:
    """Maps of wrinkles [SIZE, SIZE, 4] at the anchors, in the steps of a file."""
    on_face = (kinds == mesh_parts.SKIN) & (at[:, 0] < 1)
    soft = textures.soft(folds, textures.SKIN_SIGMAS[0])
    return np.rint(on_face[:, None] * textures.sample(soft, at) * STEPS).astype(np.int8)
