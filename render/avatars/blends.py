"""What is seen of the colours of a head's Gaussians, on its face and on its eyes: the same for
everyone (detail.py), once for every number of Gaussians."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, eye_array

from render.avatars import detail
from render.decoder import mesh_parts, prior_file
from render.decoder.surface import Surface
from render.types import Density

_known: dict[str, "dict[Density, Blends]"] = {}  # of the last prior


class Blends(NamedTuple):
    """Of one density: of the colours that a file holds for the densest, of those that are drawn
    for thinner ones."""

    shares: csr_array  # see Decoder.shares
    skin: detail.Blend  # of the face
    eyes: detail.Blend


def of_densities(
    t: prior_file.Tensors,
    card: dict[str, Any],
    surface: Surface,  # of all Gaussians, in the order of the file
    face: NDArray[np.bool_],  # [N] those on the skin of the face
) -> dict[Density, Blends]:
    """It takes seconds: a process computes it once."""
    if card["sha256"] not in _known:
        _known.clear()
        _known[card["sha256"]] = _of_densities(t, card, surface, face)
    return _known[card["sha256"]]


def _of_densities(
    t: prior_file.Tensors, card: dict[str, Any], surface: Surface, face: NDArray[np.bool_]
) -> dict[Density, Blends]:
    mesh, faces = prior_file.template(t), t["faces"].astype(np.int32)
    uv = np.zeros((len(mesh), 2), np.float32)
    uv[surface.used] = t["vertex_uv"]
    off = np.abs(surface.interpolate @ t["vertex_uv"] - t["anchor_uv"]).max(1)
    eye, places = t["anchor_kinds"] == mesh_parts.EYE, []
    for which in (face, eye):
        corners = faces[np.unique(t["anchor_triangles"][which & (off < detail.SEAM)])]
        places.append(detail.places(corners, mesh, uv, int(detail.DENSITY * which.sum())))
    densities: tuple[Density, ...] = ("65k", *detail.THINNER)
    out = dict[Density, Blends]()
    for density in densities:
        fields = prior_file.parts(t, card, density)
        head = detail.drawn(fields["surface"], fields["opacities"], mesh)
        shares = fields["shares"]
        of = shares if density == "65k" else csr_array(eye_array(len(head.points)))
        on_eye = shares @ eye.astype(np.float32) > 0.99
        skin, eyes = (
            detail.blend(head, of, *places[0]),
            detail.blend(head, of, *places[1], among=on_eye, views_deg=detail.EYE_VIEWS_DEG),
        )
        out[density] = Blends(shares, skin, eyes)
    return out
