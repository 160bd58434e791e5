"""The 256 numbers of an expression code, and the fixed linear map to the rig.

The first coordinates of the code (after a fixed rotation) are the rig's activations, scaled so that
the distance of two codes is the distance of two faces; two more raise the tongue; the rest is free
for what the prior learns. The map never changes: encoders are trained against it.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.decoder.learned import weights_file
from render.types import Floats

KIND = "prior"  # of the file that holds this and the rest of the decoder
EXPRESSION_DIM = 256
TONGUE_REACH = 6.0  # length of a full tongue activation in the code
# Length of the free part of a normalised code: of all faces it is shorter than the first; from the
# second on it says nothing.
FREE_LENGTHS = 9.0, 18.0


@dataclass(frozen=True)
class Coding:
    """Linear maps between codes and activations, and the prior's moments."""

    to_code: Floats  # [R, 256]; R = 53 shapes of the rig, then 2 of the tongue
    to_rig: Floats  # [256, R]
    free: Floats  # [F, 256] orthonormal rows that no activation touches
    frame: Floats  # [256, 256] orthonormal: rotates codes so that the rig comes first
    mean: Floats  # [256] of codes in that frame, over plausible faces
    deviation: Floats  # [256]

    @classmethod
    def of(cls, t: dict[str, NDArray[Any]]) -> "Coding":
        return cls(
            *(t[k] for k in ("to_code", "to_rig", "free", "frame", "code_mean", "code_deviation"))
        )

    @classmethod
    def load(cls, folder: Path = weights_file.FOLDER) -> "Coding":
        """Without the rest of the decoder, which takes seconds."""
        return cls.of(weights_file.load(folder / "prior", KIND)[0])

    def normalised(self, code: Floats) -> Floats:  # [..., 256] -> unit variance, rig first
        return ((code @ self.frame.T - self.mean) / self.deviation).astype(np.float32, copy=False)

    def plausible(self, code: Floats) -> Floats:  # [256] -> as `normalised`
        """Without a free part that is longer than any face's: networks that drive are not charged
        for theirs, and with an emotion it is 55 long. Light that was learned from faces would put
        out the eyes."""
        normalised, (low, high) = self.normalised(code), FREE_LENGTHS
        free = normalised[self.to_rig.shape[1] :]
        free *= np.float32(min(max((high - np.linalg.norm(free)) / (high - low), 0), 1))
        return normalised

    def code(self, normalised: Floats) -> Floats:
        """The way back: a Gaussian sample becomes a plausible face."""
        code = (normalised * self.deviation + self.mean) @ self.frame
        return code.astype(np.float32, copy=False)


def extend(
    to_code: Floats,  # [53, 256] as shipped
    to_rig: Floats,  # [256, 53]
    seed: int,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Tongue rows and free rows beside the fixed map -> to_code, to_rig, free, frame."""
    rows = np.linalg.qr(to_code.T.astype(np.float64))[0].T  # [53, 256] orthonormal
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((EXPRESSION_DIM - len(rows), EXPRESSION_DIM))
    noise -= noise @ rows.T @ rows
    rest = np.linalg.qr(noise.T)[0].T  # [203, 256]
    tongue, free = rest[:2], rest[2:]
    full_code = np.concatenate([to_code, TONGUE_REACH * tongue])
    full_rig = np.concatenate([to_rig, tongue.T / TONGUE_REACH], 1)
    frame = np.concatenate([rows, tongue, free])
    return tuple(a.astype(np.float32) for a in (full_code, full_rig, free, frame))  # type: ignore[return-value]
