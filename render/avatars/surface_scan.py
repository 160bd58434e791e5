"""A head scan of any topology (OBJ, PLY, GLB or STL), as points with normals and colours.

trimesh reads the file. A scan is sampled evenly over its area, and the samples of a small cell
are averaged: so its topology and much of its noise are gone.
"""

import io
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from render.avatars.alignment import UNITS, Doubles, Pose, unit
from sensors import files
from sensors.types import InputError

KINDS = (".obj", ".ply", ".glb", ".stl")
MAX_BYTES = 512 << 20  # of a file
MAX_FACES = 4_000_000
MIN_FACES = 500
SAMPLES = 400_000
CELL_MM = 2.5
AROUND = 9  # cells whose normals are averaged
INSTALL = "pip install 'livedrive[register]'"
LARGEST = 1e6  # of a coordinate


@dataclass(frozen=True)
class Scan:
    points: Doubles  # [n, 3] mm, about CELL_MM apart
    normals: Doubles  # [n, 3] outwards
    places: Doubles  # [m, 3] mm, denser
    colors: Doubles | None  # [m, 3] 0..1 of these
    unit: str  # of the file

    def moved(self, pose: Pose) -> "Scan":
        """As seen from a head that stands like `pose`."""
        return Scan(
            pose.undo(self.points),
            self.normals @ pose.rotation,
            pose.undo(self.places),
            self.colors,
            self.unit,
        )


def read(path: Path, landmarks: Doubles) -> Scan:
    """The scan in millimetres, or as large as it is where landmarks [n, 3] will tell its size.

    Raises InputError for what is no mesh, empty, or too large."""
    mesh = load_mesh(path)
    rng = np.random.default_rng(0)
    places, faces, colors = _sampled(mesh, rng)
    name = "mm" if len(landmarks) >= 3 else unit(places, str(path))
    places = places * UNITS[name]
    cell = CELL_MM if len(landmarks) < 3 else float(np.ptp(places, axis=0).max()) / 130
    points, normals = _cells(places, mesh.face_normals[faces], cell)
    return Scan(points, normals, places, colors, name)


def no_colors(path: Path) -> InputError:
    return InputError(
        f"{path}: expected colours of vertices or a texture, got neither; export it with them, or "
        "give an atlas with --texture"
    )


def load_mesh(path: Path) -> Any:
    """A trimesh.Trimesh in the file's own units. Raises InputError as `read` does."""
    try:
        import trimesh
    except ImportError:
        raise InputError(
            f"{path}: expected vertices in the topology of the face data, or trimesh to register "
            f"others, got neither; run: {INSTALL}"
        ) from None
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise InputError(f"{path}: expected {', '.join(KINDS)}, got {kind!r}; export it as GLB")
    with files.open_regular(path) as file:
        size = file.seek(0, 2)
        file.seek(0)
        if size > MAX_BYTES:
            raise InputError(
                f"{path}: expected at most {MAX_BYTES >> 20} MB, got {size >> 20}; decimate it"
            )
        _check_counts(path, kind, file, size)
        file.seek(0)
        data = io.BytesIO(file.read())  # trimesh wants a name, a descriptor has none
        options = {"resolver": _Beside(path)} if kind == ".obj" else {}
        try:
            with np.errstate(all="ignore"):
                mesh = trimesh.load_mesh(data, file_type=kind[1:], process=False, **options)
        except Exception as error:  # of a parser of files from anywhere
            text = f"{type(error).__name__}: {error}"[:120]
            raise InputError(
                f"{path}: expected a mesh as {kind[1:].upper()}, got {text}; export it again"
            ) from None
    count = len(getattr(mesh, "faces", ()))
    if not MIN_FACES <= count <= MAX_FACES:
        raise InputError(
            f"{path}: expected a mesh of {MIN_FACES}..{MAX_FACES} triangles, got {count}; "
            "export the whole scan, or decimate it"
        )
    places, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if faces.shape[1:] != (3,) or places.shape[1:] != (3,):
        raise InputError(f"{path}: expected triangles, got other shapes; export it again")
    if faces.min() < 0 or faces.max() >= len(places):
        raise InputError(
            f"{path}: expected triangles of its {len(places)} vertices, got the numbers "
            f"{faces.min()}..{faces.max()}; export it again"
        )
    if not np.isfinite(places).all() or np.abs(places).max() > LARGEST or not mesh.area > 0:
        raise InputError(f"{path}: expected finite places of vertices, got others; export it again")
    return mesh


class _Beside:
    """Materials and textures of an OBJ: files of its own folder, never elsewhere."""

    def __init__(self, path: Path) -> None:
        self._folder = path.parent

    def get(self, name: str) -> bytes:
        beside = self._folder / Path(name.strip()).name
        with files.open_regular(beside) as file:
            data: bytes = file.read(MAX_BYTES)
        return data

    __getitem__ = get


def _check_counts(path: Path, kind: str, file: Any, size: int) -> None:
    """A header that claims more than its file can hold is refused before it is believed."""

    def fail(what: str) -> InputError:
        return InputError(f"{path}: expected a whole file, got {what}; export it again")

    if kind == ".glb":
        start = file.read(20)
        if len(start) < 20 or start[:4] != b"glTF":
            raise fail("no GLB")
        (length,) = struct.unpack_from("<I", start, 12)
        try:
            tree = files.parse_json(file.read(min(length, files.MAX_JSON + 1)))
            counts = [int(a["count"]) for a in tree.get("accessors", [])]
            lone = [a for a in tree.get("accessors", []) if "bufferView" not in a or "sparse" in a]
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
            raise fail(f"a header that is no GLB's ({error})"[:120]) from None
        if lone or max(counts, default=0) > size or len(counts) > 4096:
            raise fail("accessors without data")
        if tree.get("extensionsRequired"):
            raise fail(f"compression ({tree['extensionsRequired']})"[:120])
    elif kind == ".ply":
        header = file.read(65536).split(b"end_header")[0]
        for line in header.splitlines():
            words = line.split()
            if words[:1] == [b"element"] and (
                len(words) != 3 or not words[2].isdigit() or len(words[2]) > 9
                or int(words[2]) > size
            ):  # fmt: skip
                raise fail("counts beyond its size")


def _sampled(mesh: Any, rng: np.random.Generator) -> tuple[Doubles, Any, Doubles | None]:
    """Places evenly over the area [SAMPLES, 3], their faces, their colours where it has any."""
    corners = np.asarray(mesh.vertices)[mesh.faces]
    area = np.asarray(mesh.area_faces).cumsum()
    faces = np.searchsorted(area, rng.random(SAMPLES) * area[-1]).clip(0, len(area) - 1)
    a, b = rng.random((2, SAMPLES))
    fold = a + b > 1
    a, b = np.where(fold, 1 - a, a), np.where(fold, 1 - b, b)
    shares = np.stack([1 - a - b, a, b], 1)
    places = np.einsum("nc,nci->ni", shares, corners[faces])
    return places, faces, _colors(mesh, faces, shares)


def _colors(mesh: Any, faces: Any, shares: Doubles) -> Doubles | None:  # [n, 3] 0..1
    visual = mesh.visual
    if visual.kind == "texture" and visual.uv is not None:
        material = visual.material
        image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        if image is None:
            return None
        if image.width * image.height > 16384 * 8192:
            raise InputError("texture: expected at most 128 megapixels, got more; shrink it")
        picture = np.asarray(image.convert("RGB"))
        uv = np.einsum("nc,nci->ni", shares, np.asarray(visual.uv)[mesh.faces[faces]])
        rows = ((1 - uv[:, 1] % 1) * image.height).astype(int).clip(0, image.height - 1)
        columns = (uv[:, 0] % 1 * image.width).astype(int).clip(0, image.width - 1)
        return picture[rows, columns].astype(np.float64) / 255
    if visual.kind == "vertex":
        rgb = np.asarray(visual.vertex_colors)[:, :3] / 255
        return np.einsum("nc,nci->ni", shares, rgb[mesh.faces[faces]])
    return None


def _cells(places: Doubles, normals: Doubles, size: float) -> tuple[Doubles, Doubles]:
    from scipy.spatial import KDTree

    keys = np.floor((places - places.min(0)) / size).astype(np.int64)
    _, cell = np.unique(keys @ np.array([1, 1 << 20, 1 << 40]), return_inverse=True)
    count = np.bincount(cell)

    def summed(values: Doubles) -> Doubles:
        return np.stack([np.bincount(cell, values[:, k]) for k in range(3)], 1).astype(np.float64)

    points, sums = summed(places) / count[:, None], summed(normals)
    _, near = KDTree(points).query(points, k=min(AROUND, len(points)))
    out = sums[near].sum(1)
    out /= np.linalg.norm(out, axis=1, keepdims=True) + 1e-12
    if (out * (points - points.mean(0))).sum() < 0:
        out = -out  # a scan turned inside out
    return points, out
