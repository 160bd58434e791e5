"""The motion file: codes, gaze, ARKit, and the vertices that the metrics look at."""

import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.drive.sink import FrameResult, RunInfo
from app.face.arkit import ARKIT_NAMES, arkit
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from sensors import files


@dataclass(frozen=True)
class Rows:
    """A float32 array that is made row by row while it is written: an hour of vertices is 4 GB."""

    shape: tuple[int, ...]
    rows: Iterable[NDArray[np.float32]]


class MotionSink:
    """Collects codes (1.2 kB a frame, 130 MB an hour); vertices are decoded when it closes."""

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
) -> dict[str, NDArray[np.generic] | Rows]:
    """The arrays of a motion file from (t_ns, expression [256], gaze [2, 3]) of each frame."""
    expression = np.array([f[1] for f in frames], np.float32).reshape(-1, 256)
    gaze = np.array([f[2] for f in frames], np.float32).reshape(-1, 2, 3)

    def vertices(region: str) -> Rows:
        places = decoder.regions[region]
        codes = zip(expression, gaze, strict=True)
        rows = (decoder.vertices(code, eyes, identity)[places] for code, eyes in codes)
        return Rows((len(frames), len(places), 3), rows)

    return {
        "t_ns": np.array([f[0] for f in frames], np.int64),
        "expression": expression,
        "gaze": gaze,
        "arkit": arkit(decoder.rig(expression), gaze, decoder.rig_names),
        "arkit_names": np.array(ARKIT_NAMES),
        "lips_mm": vertices("lips"),
        "upper_face_mm": vertices("upper_face"),
    }


def save_npz(path: Path, arrays: Mapping[str, NDArray[np.generic] | Rows]) -> None:
    """np.savez without the time of day: equal arrays make equal files."""
    with (
        files.replacing(path, private=True) as draft,
        zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
    ):
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                if isinstance(array, Rows):
                    kind = {"descr": "<f4", "fortran_order": False, "shape": array.shape}
                    np.lib.format.write_array_header_1_0(entry, kind)
                    for row in array.rows:
                        entry.write(row.astype("<f4").tobytes())
                else:
                    np.lib.format.write_array(entry, array, allow_pickle=False)
