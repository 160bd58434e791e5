"""The moving head as files of Gaussians: a folder of PLY or of glTF, named by frame index."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from app.sinks.sink import FrameResult, RunInfo
from render.decoder import Decoder
from render.identity import Identity
from render.types import Gaussians
from sensors.types import InputError

SH_0 = 0.28209479177387814  # the constant spherical harmonic: colour = 0.5 + SH_0 * coefficient
PLY_COLUMNS = (
    *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)
MM = 0.001  # m


class CloudSink:
    """Writes the Gaussians of every n-th frame (1 to 2 MB each)."""

    def __init__(
        self,
        folder: Path,
        every: int,
        suffix: str,
        write: Callable[[Gaussians], bytes],
        decoder: Decoder,
        identity: Identity,
    ) -> None:
        if every < 1:
            raise InputError(f"--every: expected 1 or more frames, got {every}; try --every 1")
        self._folder, self._every, self._suffix, self._write = folder, every, suffix, write
        self._decoder, self._identity = decoder, identity

    def on_start(self, info: RunInfo) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)

    def on_frame(self, result: FrameResult) -> None:
        driven = result.driven
        if driven.index % self._every == 0:
            _, gaussians = self._decoder.decode(driven.expression, driven.gaze, self._identity)
            path = self._folder / f"frame_{driven.index:06d}{self._suffix}"
            path.write_bytes(self._write(gaussians))

    def close(self) -> None:
        pass


def ply_bytes(gaussians: Gaussians) -> bytes:
    """A PLY as the first Gaussian-splatting code wrote it: metres, log scales, logit opacities."""
    opacities = gaussians.opacities.clip(1e-6, 1 - 1e-6)
    columns = [
        gaussians.means * MM,
        np.zeros((len(gaussians), 3)),  # normals, unused
        (gaussians.colors - 0.5) / SH_0,
        np.log(opacities / (1 - opacities))[:, None],
        np.log(np.maximum(gaussians.scales, 1e-6) * MM),
        gaussians.quats / np.maximum(np.linalg.norm(gaussians.quats, axis=1), 1e-12)[:, None],
    ]
    properties = "".join(f"property float {name}\n" for name in PLY_COLUMNS)
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(gaussians)}\n{properties}"
    return f"{head}end_header\n".encode() + np.concatenate(columns, 1).astype("<f4").tobytes()
