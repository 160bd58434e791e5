"""The frozen decoder as the training losses see it: a code's vertices, lips and mouth.

`encoder` never imports `render`: these maps are handed over from here. All are linear in the code
but for the lips' spans, which are lengths.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, cast

import numpy as np

if TYPE_CHECKING:
    from torch import Tensor

    from encoder.training.geometry import TrainingFace


# region: every n-th vertex, and the weight of one in the geometry losses (w_i of the paper); gums
# tell whether the jaw opens lips or they part over teeth that are shut
LOSS_VERTICES = {
    "lips": (8, 3.0), "gums": (40, 3.0), "eyelids": (16, 1.0), "brows": (40, 0.5),
    "upper_face": (80, 0.5),
}  # fmt: skip


def face(regions: dict[str, tuple[int, float]] = LOSS_VERTICES) -> "TrainingFace":
    """A vertex is measured from its place at rest; the lips' spans are those of "ben"."""
    import torch

    from app.face.mesh import face_mesh
    from encoder.capture.motion.channels import SPEECH_COLUMNS
    from encoder.training.geometry import TrainingFace
    from render.decoder.decoder import NUM_RIG, Decoder

    decoder, mesh = Decoder.load(), face_mesh("ben")
    weights: dict[int, float] = {}
    for region, (every, weight) in regions.items():
        for vertex in decoder.regions[region][::every].tolist():
            weights[vertex] = max(weight, weights.get(vertex, 0.0))
    chosen = np.array(sorted(weights))
    coding = decoder.coding
    moved = [*SPEECH_COLUMNS, *range(NUM_RIG, len(coding.to_code))]  # the tongue's come last
    to_mouth = torch.as_tensor(coding.to_rig[:, moved] @ coding.to_code[moved])  # [256, 256]
    ends = np.array([mesh.marks.corners, mesh.marks.centres])  # [2, 2] lip vertices
    lips = mesh.lips(np.zeros((1, len(to_mouth)), np.float32))[0]
    at_rest = torch.as_tensor((lips[ends[:, 0]] - lips[ends[:, 1]]).astype(np.float32))

    def between(pairs: np.ndarray) -> "Callable[[Tensor], Tensor]":
        """Codes [B, T, 256] -> [B, T, P, 3] mm: pairs of lip vertices, against the same at rest."""
        one, other = (decoder.moves(decoder.regions["lips"][pairs[:, i]]) for i in (0, 1))
        return _moved(one - other)

    def rig_to_code(rig: np.ndarray) -> np.ndarray:
        return decoder.encode(rig)

    def spans(codes: "Tensor") -> "Tensor":
        between_ends = apart(codes) + at_rest.to(codes.device)
        return cast("Tensor", between_ends.norm(dim=-1))  # pyright: ignore[reportUnknownMemberType]

    def mouth(codes: "Tensor") -> "Tensor":
        return codes.float() @ to_mouth.to(codes.device)

    scale = torch.tensor([weights[int(v)] for v in chosen])
    vertices = _moved(decoder.moves(chosen))
    apart, gaps = between(ends), between(mesh.marks.pairs)

    def tongue(codes: "Tensor") -> "Tensor":
        return codes.float() @ torch.as_tensor(coding.to_rig[:, NUM_RIG:]).to(codes.device)

    return TrainingFace(rig_to_code, vertices, scale / scale.mean(), gaps, spans, mouth, tongue)


def _moved(linear: np.ndarray) -> "Callable[[Tensor], Tensor]":
    """linear [256, V * 3] mm -> what moves codes [B, T, 256] -> [B, T, V, 3] mm."""
    import torch

    matrix = torch.as_tensor(linear)

    def moved(codes: "Tensor") -> "Tensor":
        # in full precision: a third difference of halves would be noise
        with torch.autocast(codes.device.type, enabled=False):
            flat = codes.float() @ matrix.to(codes.device)
        return flat.reshape(*codes.shape[:-1], -1, 3)

    return moved
