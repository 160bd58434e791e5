"""Gaussians as binary glTF with KHR_gaussian_splatting, for engines and viewers.

glTF has metres, +y up and +z forward, as our world but for the unit; its quaternions are xyzw.
What the head mirrors is stored as seen from the front. Viewers without the extension show points
in the colours of COLOR_0.
"""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.splats.shine import colors_from
from render.types import Floats, Gaussians
from sensors import files

EXTENSION = "KHR_gaussian_splatting"
SH_0 = 0.28209479177387814  # the constant spherical harmonic: colour = 0.5 + SH_0 * coefficient
MM = 0.001  # m
FLOAT, BYTE = 5126, 5121  # component types
VERTICES = 34962  # what a view of the buffer holds
KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942


def save(path: Path, gaussians: Gaussians) -> None:
    """Write one head as a .glb file."""
    files.write_bytes(path, gltf_bytes(gaussians), private=True, durable=False)


def gltf_bytes(gaussians: Gaussians) -> bytes:
    """A .glb file of one head."""
    gaussians.check()
    lengths = np.linalg.norm(gaussians.quats, axis=1, keepdims=True)
    quats = np.where(lengths > 0, gaussians.quats / np.maximum(lengths, 1e-12), [1, 0, 0, 0])
    colors = colors_from(gaussians)
    attributes: dict[str, NDArray[Any]] = {
        "POSITION": gaussians.means * MM,
        f"{EXTENSION}:ROTATION": quats[:, [1, 2, 3, 0]],
        f"{EXTENSION}:SCALE": gaussians.scales * MM,
        f"{EXTENSION}:OPACITY": gaussians.opacities[:, None].clip(0, 1),
        f"{EXTENSION}:SH_DEGREE_0_COEF_0": (colors - 0.5) / SH_0,
        "COLOR_0": _fallback(colors, gaussians.opacities),
    }
    accessors, views, data = list[dict[str, Any]](), list[dict[str, Any]](), bytearray()
    for values in attributes.values():
        kind = np.uint8 if values.dtype == np.uint8 else np.float32
        packed = np.ascontiguousarray(values, kind)
        place = {"byteOffset": len(data), "byteLength": packed.nbytes}
        views.append({"buffer": 0, "target": VERTICES, **place})
        accessors.append(_accessor(packed, len(accessors)))
        data += packed.tobytes()
    accessors[0] |= {
        "min": _limit(attributes["POSITION"], np.min),
        "max": _limit(attributes["POSITION"], np.max),
    }
    primitive = {
        "mode": 0,  # points
        "attributes": {name: k for k, name in enumerate(attributes)},
        "extensions": {EXTENSION: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}},
    }
    scene = {
        "asset": {"version": "2.0", "generator": "livedrive"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "head"}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }
    text = json.dumps(scene, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), JSON_CHUNK) + text
    chunks += struct.pack("<II", len(data), BINARY_CHUNK) + bytes(data)
    return struct.pack("<III", MAGIC, 2, 12 + len(chunks)) + chunks


def _limit(values: NDArray[np.float32], of: Any) -> list[float]:
    """Least or largest position as the float32 that the file holds."""
    return [float(v) for v in of(np.asarray(values, np.float32), axis=0)]


def _accessor(values: NDArray[Any], view: int) -> dict[str, Any]:
    number = {"componentType": BYTE, "normalized": True} if values.dtype == np.uint8 else {}
    return {
        "bufferView": view,
        "componentType": FLOAT,
        "count": len(values),
        "type": KINDS[values.shape[1]],
        **number,
    }


def _fallback(colors: Floats, opacities: Floats) -> NDArray[np.uint8]:  # [N, 4]
    """COLOR_0 is linear light; ours are sRGB values."""
    srgb = colors.clip(0, 1)
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    both = np.concatenate([linear, opacities[:, None].clip(0, 1)], 1)
    return np.rint(both * 255).astype(np.uint8)
