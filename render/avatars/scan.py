"""A person's geometry and texture, read from files and checked.

Geometry is a scan registered to the topology of the prior's mesh, as npz or OBJ.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.avatars import surface_scan, textures
from render.avatars.alignment import UNITS
from render.types import Floats
from sensors import files
from sensors.types import InputError

HEAD_MM = (250.0, 420.0)  # height of the mesh, neck included, from a small child to a giant
MAX_PIXELS = 16384 * 8192  # of a texture
SMALLEST_TEXTURE = 256
MAX_COLLAPSED = 0.01  # share of triangles without area


def check_geometry(vertices: NDArray[Any], faces: NDArray[np.int32], name: str) -> Floats:
    """Millimetres, or InputError; heads in cm or m are scaled."""
    count = int(faces.max()) + 1
    if vertices.dtype.kind not in "fiu":
        raise InputError(f"{name}: expected numbers, got {vertices.dtype}; save them as float32")
    if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) != count:
        raise InputError(
            f"{name}: expected vertices [{count}, 3] in the topology of the face data, got shape "
            f"{list(vertices.shape)}; register the scan to that mesh first"
        )
    vertices = vertices.astype(np.float32)
    bad = int((~np.isfinite(vertices).all(1)).sum())
    if bad:
        raise InputError(
            f"{name}: expected finite coordinates, got {bad} vertices with NaN or infinity "
            "(holes?); fill the holes first"
        )
    width, height, depth = np.ptp(vertices.astype(np.float64), axis=0).tolist()
    for factor in UNITS.values():
        broad = max(width, depth) * factor > 2 * HEAD_MM[1]
        if HEAD_MM[0] <= height * factor <= HEAD_MM[1] and not broad:
            vertices = vertices * np.float32(factor)
            break
    else:
        raise InputError(
            f"{name}: expected a head and neck {HEAD_MM[0]:.0f}..{HEAD_MM[1]:.0f} mm high (or the "
            f"same in cm or m), got {height:g}; scale it to millimetres"
        )
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    collapsed = float((np.linalg.norm(np.cross(b - a, c - a), axis=1) < 1e-4).mean())
    if collapsed > MAX_COLLAPSED:
        raise InputError(
            f"{name}: expected a surface without holes, got {collapsed:.0%} triangles without "
            "area; fill the holes first"
        )
    return vertices


def is_registered(path: Path, faces: NDArray[np.int32]) -> bool:
    """Whether a file is to be read by `read_geometry`: npz, or an OBJ with as many vertices.

    Raises InputError for another kind of file."""
    kind = path.suffix.lower()
    if kind not in (".npz", *surface_scan.KINDS):
        known = ", ".join((*surface_scan.KINDS, ".npz"))
        raise InputError(f"{path}: expected one of {known}, got {kind!r}; export it as GLB")
    if kind != ".obj":
        return kind == ".npz"
    with files.open_regular(path) as file:
        count = sum(line.startswith(b"v ") for line in file)
    return count == int(faces.max()) + 1


def read_geometry(path: Path, faces: NDArray[np.int32]) -> Floats:
    """Vertices of an npz file (`vertices`) or of an OBJ file, checked."""
    if path.suffix.lower() == ".obj":
        return check_geometry(_obj_vertices(path), faces, str(path))
    try:
        arrays = files.load_npz(path)
        if "vertices" not in arrays:
            raise InputError(
                f"{path}: expected an array 'vertices', got {', '.join(arrays) or 'nothing'}; "
                "save it with numpy.savez(path, vertices=...)"
            )
        vertices = arrays["vertices"]
    except InputError:
        raise
    except (ValueError, OSError) as error:
        if isinstance(error, FileNotFoundError):
            raise
        foreign = "pickle" in str(error) or "not a zip" in str(error)
        text = "another kind of file" if foreign else error
        raise InputError(
            f"{path}: expected an npz or OBJ file, got {text}; save it again"
        ) from None
    return check_geometry(vertices, faces, str(path))


def _obj_vertices(path: Path) -> NDArray[np.float64]:  # [V, 3]
    """In the order of the file: libraries that load OBJ split vertices at seams of the texture."""
    lines = path.read_text(errors="replace").splitlines()
    rows = [line.split()[1:4] for line in lines if line.startswith("v ")]
    try:
        return np.array(rows, np.float64).reshape(-1, 3)
    except ValueError as error:
        raise InputError(
            f"{path}: expected lines 'v x y z', got {error}; export it again as OBJ"
        ) from None


def read_texture(path: Path) -> Floats:  # [1024, 2048, 3] 0..1
    """The skin atlas (face left, back of the head right); other sizes of shape 2:1 are resized."""
    from PIL import Image

    with textures.opened(path, "a picture") as image:
        if image.width * image.height > MAX_PIXELS:
            raise InputError(
                f"{path}: expected at most {MAX_PIXELS // 1_000_000} million pixels, got "
                f"{image.width} x {image.height}; scale it down"
            )
        clear = image.has_transparency_data
        if clear and image.convert("RGBA").getchannel("A").getextrema()[0] < 255:
            raise InputError(
                f"{path}: expected an opaque texture, got transparent pixels; fill them and save "
                "as RGB"
            )
        image = textures.rgb(image)
    width, height = image.size
    if width != 2 * height or height < SMALLEST_TEXTURE:
        raise InputError(
            f"{path}: expected 2048 x 1024 pixels (2:1, at least {2 * SMALLEST_TEXTURE} wide), got "
            f"{width} x {height}; lay it out as the skins of the face data"
        )
    image = image.resize((2048, 1024), Image.Resampling.LANCZOS)
    return np.asarray(image, np.float32) / np.float32(255)
