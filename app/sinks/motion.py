"""The motion file: codes, gaze, ARKit, and the vertices that the metrics look at."""

import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.drive.sink import FrameResult, RunInfo
from app.face.arkit import ARKIT_NAMES, arkit
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from sensors import files


class MotionSink:
    """Collects codes (about 1.2 kB a frame); vertices are decoded when it closes."""

    def __init__(self, path: Path, decoder: Decoder, identity: Identity) -> None:
        self._path, self._decoder, self._identity = path, decoder, identity
        self._frames: list[tuple[int, NDArray[np.float32], NDArray[np.float32]]] = []
        self._heads: list[tuple[float, ...]] = []

    def on_start(self, info: RunInfo) -> None:
        pass

    def on_frame(self, result: FrameResult) -> None:
        driven = result.driven
        self._frames.append((driven.t_ns, driven.expression, driven.gaze))
        self._heads.append((*driven.head.position, *driven.head.quat, driven.breath))

    def close(self) -> None:
        arrays = motion_arrays(self._frames, self._decoder, self._identity)
        heads = np.array(self._heads, np.float32).reshape(-1, 8)
        head = {"head_mm": heads[:, :3], "head_quat": heads[:, 3:7], "breath": heads[:, 7]}
        save_npz(self._path, {**arrays, **head})


def motion_arrays(
    frames: list[tuple[int, NDArray[np.float32], NDArray[np.float32]]],
    decoder: Decoder,
    identity: Identity,
) -> dict[str, NDArray[np.generic]]:
    """The arrays of a motion file from (t_ns, expression [256], gaze [2, 3]) of each frame."""
    expression = np.array([f[1] for f in frames], np.float32).reshape(-1, 256)
    gaze = np.array([f[2] for f in frames], np.float32).reshape(-1, 2, 3)
    regions = {"lips_mm": decoder.regions["lips"], "upper_face_mm": decoder.regions["upper_face"]}
    parts = {k: np.empty((len(frames), len(v), 3), np.float32) for k, v in regions.items()}
    for t in range(len(frames)):
        vertices = decoder.vertices(expression[t], gaze[t], identity)
        for name, region in regions.items():
            parts[name][t] = vertices[region]
    return {
        "t_ns": np.array([f[0] for f in frames], np.int64),
        "expression": expression,
        "gaze": gaze,
        "arkit": arkit(decoder.rig(expression), gaze, decoder.rig_names),
        "arkit_names": np.array(ARKIT_NAMES),
        **parts,
    }


def save_npz(path: Path, arrays: dict[str, NDArray[np.generic]]) -> None:
    """np.savez without the time of day: equal arrays make equal files."""
    with (
        files.replacing(path, private=True) as draft,
        zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
    ):
        for name, array in arrays.items():
            data = BytesIO()
            np.lib.format.write_array(data, array, allow_pickle=False)
            entry = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, data.getvalue())
