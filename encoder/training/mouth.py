"""The mouth's part of a code as a few numbers; the direct path is trained in them."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from encoder.capture.motion.channels import RIG_INDEX, RIG_NAMES
from encoder.denoiser.config import MOUTH
from encoder.training.geometry import TrainingFace


@dataclass(frozen=True)
class Mouth:
    """Maps between codes and the mouth: MOUTH numbers, all 0 at rest."""

    face: TrainingFace
    read: np.ndarray  # [256, MOUTH]
    write: np.ndarray  # [MOUTH, 256]
    shape: Tensor  # [MOUTH, V * 3] mm, weighted; of unit weight in all
    lips: Tensor  # [MOUTH, 2] mm that the lips open and widen
    tongue: Tensor  # [MOUTH, 2] by how much tip and back are raised
    roll: Tensor  # [MOUTH] by how much the lower lip is rolled over its teeth

    @staticmethod
    def of(face: TrainingFace) -> "Mouth":
        u, s, v = np.linalg.svd(face.mouth(torch.eye(256)).numpy().astype(np.float64))
        if s[MOUTH] > 1e-3 * s[0]:
            raise ValueError(f"expected a mouth of {MOUTH} numbers, got more")
        read = (u[:, :MOUTH] * s[:MOUTH]).astype(np.float32)
        write = v[:MOUTH].astype(np.float32)
        codes = torch.from_numpy(write)[:, None]
        weights = (face.weights / face.weights.sum()).sqrt()
        shape = (face.vertices(codes)[:, 0] * weights[:, None]).flatten(1)
        nothing = torch.zeros_like(codes[:1])
        tiny = 1e-2  # spans are lengths: straight near rest
        width = (face.spans(tiny * codes) - face.spans(nothing))[:, 0, 0] / tiny
        opening = face.gaps(codes)[..., 1].mean(-1)[:, 0]
        lips, tongue = torch.stack([opening, width], 1), face.tongue(codes)[:, 0]
        channels = face.rig_to_code(np.eye(len(RIG_NAMES), dtype=np.float32)) @ read
        roll = np.linalg.pinv(channels)[:, RIG_INDEX["mouthRollLower"]].astype(np.float32)
        return Mouth(face, read, write, shape, lips, tongue, torch.from_numpy(roll))

    def vertices(self, mouth: Tensor) -> Tensor:
        return mouth @ self.shape

    def spans(self, mouth: Tensor) -> Tensor:
        return mouth @ self.lips

    def gap(self, mouth: Tensor) -> Tensor:
        return mouth @ self.lips[:, 0]

    def codes(self, mouth: Tensor) -> Tensor:
        return mouth @ torch.from_numpy(self.write)

    def stretched(self, truth: Tensor, gains: tuple[float, float], rest: float = 1.0) -> Tensor:
        """Map [MOUTH, MOUTH] that scales how far the lips are apart and how wide they are by
        `gains`, each without the other, along the directions in which true mouths [N, MOUTH] do
        so, and all else by `rest`."""
        more = torch.tensor(gains)[:, None] - rest
        return rest * torch.eye(MOUTH) + self.lips @ (more * self.ways(truth))

    def ways(self, truth: Tensor) -> Tensor:
        """[2, MOUTH]: how true mouths [N, MOUTH] open by one mm without widening, and widen by one
        without opening; the tongue stays."""
        spans = self.spans(truth)
        ways = torch.linalg.lstsq(spans - spans.mean(0), truth - truth.mean(0)).solution
        return ways - ways @ self.tongue @ torch.linalg.pinv(self.tongue)
