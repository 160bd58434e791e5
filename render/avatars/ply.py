"""Heads as PLY files in the layout of the original 3D Gaussian splatting code (INRIA).

One static head: no expression travels with it. Millimetres, +y up, +z out of the face.
"""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from render.splats.shine import colors_from
from render.types import Gaussians
from sensors import files
from sensors.types import InputError

SH_0 = 0.28209479177387814  # the constant spherical harmonic: color = 0.5 + SH_0 * f_dc
ROTATION, SCALE = [f"rot_{i}" for i in range(4)], [f"scale_{i}" for i in range(3)]
COLOR, PLACE = [f"f_dc_{i}" for i in range(3)], ["x", "y", "z"]
FIELDS = [*PLACE, "nx", "ny", "nz", *COLOR, "opacity", *SCALE, *ROTATION]
SIZE_MM = (50.0, 1000.0)  # a cloud outside it is not in millimetres and is scaled to HEAD_MM
HEAD_MM = 300.0
LARGEST = 1e6  # of any number
LOG_SCALE = (-30.0, 30.0)  # beyond, a scale is 0 or infinite in float32


TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "<i2", "ushort": "<u2", "int": "<i4"},
    **{"uint": "<u4", "float": "<f4", "double": "<f8", "int8": "i1", "uint8": "u1"},
    **{"int16": "<i2", "uint16": "<u2", "int32": "<i4", "uint32": "<u4"},
    **{"float32": "<f4", "float64": "<f8"},
}
MAX_HEADER = 65536  # bytes
COUNT = re.compile("[0-9]{1,12}")


def save(path: Path, cloud: Gaussians) -> None:
    """Write what a splat viewer reads: logits of opacities, logarithms of scales."""
    rows = np.zeros(len(cloud), [(name, "<f4") for name in FIELDS])
    opacity = np.clip(cloud.opacities.astype(np.float64), 1e-4, 1 - 1e-4)
    quats = cloud.quats / np.linalg.norm(cloud.quats, axis=1, keepdims=True)
    for names, values in (
        (PLACE, cloud.means),
        (COLOR, (colors_from(cloud) - 0.5) / SH_0),
        (["opacity"], np.log(opacity / (1 - opacity))[:, None]),
        (SCALE, np.log(np.maximum(cloud.scales, 1e-6))),
        (ROTATION, quats),
    ):
        for column, name in enumerate(names):
            rows[name] = values[:, column]
    words = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    words += [*(f"property float {name}" for name in FIELDS), "end_header", ""]
    data = "\n".join(words).encode() + rows.tobytes()
    files.write_bytes(path, data, private=True, durable=False)


def load(path: Path) -> Gaussians:
    """Read a static cloud; its view-dependent colours (f_rest) are left out.

    A cloud that is not of the size of a head in millimetres is centred and scaled.
    """
    rows = _vertices(path)
    names = rows.dtype.names or ()
    missing = [name for name in FIELDS if name not in names and name[0] != "n"]
    if missing:
        raise InputError(
            f"{path}: expected Gaussian splats with a property {missing[0]!r}, got "
            f"{len(names)} others; export it as 3DGS PLY"
        )

    def columns(names: list[str]) -> NDArray[np.float32]:
        return np.stack([rows[name] for name in names], 1).astype(np.float32)

    arrays = [columns(names) for names in (PLACE, ROTATION, SCALE, ["opacity"], COLOR)]
    if len(rows) == 0 or not all((np.abs(a) < LARGEST).all() for a in arrays):
        raise InputError(f"{path}: expected finite splats, got none or NaN; export it again")
    means, quats, scales, logits, colors = arrays
    scales = np.exp(scales.clip(*LOG_SCALE))
    low, high = np.percentile(means, (2, 98), axis=0)
    size = float((high - low).max())
    if not SIZE_MM[0] <= size <= SIZE_MM[1]:
        factor = np.float32(HEAD_MM / max(size, 1e-9))
        means, scales = (means - 0.5 * (low + high).astype(np.float32)) * factor, scales * factor
    quats[np.linalg.norm(quats, axis=1) < 1e-6] = (1, 0, 0, 0)
    opacities = (1 / (1 + np.exp(-logits[:, 0].clip(-30, 30)))).astype(np.float32)
    return Gaussians(
        np.ascontiguousarray(means), quats, scales, opacities, (0.5 + SH_0 * colors).clip(0, 1)
    )


def _vertices(path: Path) -> NDArray[np.void]:
    """The element `vertex`, which must come first, as one record a row."""
    data = files.read_bytes(path)
    end = data.find(b"end_header", 0, MAX_HEADER)
    start = data.find(b"\n", end) + 1
    lines = data[: max(end, 0)].decode("latin-1").splitlines()
    binary = any(line.split() == ["format", "binary_little_endian", "1.0"] for line in lines)
    if end < 0 or start == 0 or lines[:1] != ["ply"] or not binary:
        raise InputError(
            f"{path}: expected a PLY file, format binary_little_endian 1.0, got something else; "
            "export it again"
        )
    count, fields = -1, []
    for words in (line.split() for line in lines):
        if words[:1] == ["element"] and len(words) == 3:
            if count >= 0:
                break
            known = words[1] == "vertex" and COUNT.fullmatch(words[2])
            count = int(words[2]) if known else -2
        elif words[:1] == ["property"]:
            if len(words) != 3 or words[1] not in TYPES:
                raise InputError(
                    f"{path}: expected properties of one number each, got {' '.join(words)[:80]!r};"
                    " export it as 3DGS PLY"
                )
            fields.append((words[2], TYPES[words[1]]))
    names = [name for name, _ in fields]
    if doubled := [name for name in names if names.count(name) > 1]:
        raise InputError(
            f"{path}: expected each property once, got {doubled[0]!r} twice; export it again"
        )
    dtype = np.dtype(fields)
    if count < 0 or len(data) - start < count * dtype.itemsize:
        raise InputError(
            f"{path}: expected {max(count, 0)} vertices first in the PLY file, got a truncated or "
            "other one; export it again"
        )
    return np.frombuffer(data, dtype, count, start)
