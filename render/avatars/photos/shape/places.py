"""Where the detector's points lie on the head: a table, made from pictures of known heads.

Pictures of the shipped people in several views and expressions are given to the detector, each
point is cast back onto the posed mesh, and its place is the middle of all it hit, on the mean
face. So whatever the detector has of a bias is in the table. `livedrive train landmarks` remakes
it.
"""

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from render import cameras
from render.avatars import sheet
from render.avatars.maker import Maker
from render.avatars.photos.shape.detector import ON_SKIN, FaceDetector
from render.decoder import identity
from render.decoder.decoder import Decoder
from render.types import AHEAD, Camera, Doubles, Floats, Ints, Renderer
from sensors import files

PATH = Path(__file__).with_name("places.npz")
SIZE_PX = 1024
YAWS, PITCHES = (-40.0, -20.0, 0.0, 20.0, 40.0), (-12.0, 12.0)
POSES: tuple[dict[str, float], ...] = (
    {},
    {"jawOpen": 0.4},
    {"mouthSmile_L": 0.7, "mouthSmile_R": 0.7, "cheekSquint_L": 0.4, "cheekSquint_R": 0.4},
    {"browInnerUp_L": 0.6, "browInnerUp_R": 0.6, "mouthPucker": 0.5},
)
FACING = 0.35  # least cosine to the viewer of a place that counts
BESIDE_MM = 4.0  # from the skin, a point that falls into an eye or a mouth


@dataclass(frozen=True)
class PointPlaces:
    """Of the points that lie on the skin."""

    corners: Ints  # [468, 3] vertices of a triangle
    weights: Floats  # [468, 3] barycentric
    spread_mm: Floats  # [468] how far the detector's points lie from here, the median

    def of(self, vertices: NDArray[np.floating]) -> Doubles:  # [..., V, 3] -> [..., 468, 3]
        return np.einsum("...nci,nc->...ni", vertices[..., self.corners, :], self.weights)


def load() -> PointPlaces:
    table = files.load_npz(PATH)
    return PointPlaces(table["corners"].astype(np.int32), table["weights"], table["spread_mm"])


def save(found: PointPlaces, path: Path) -> None:
    with files.replacing(path) as draft, draft.open("wb") as file:
        np.savez_compressed(
            file,
            corners=found.corners.astype(np.uint16),
            weights=found.weights,
            spread_mm=found.spread_mm,
        )


def make(
    maker: Maker, detector: FaceDetector, renderer: Renderer, people: list[str]
) -> PointPlaces:
    from tqdm import tqdm

    decoder = Decoder.load(gaussians="65k")
    cast = Caster(maker.skin)
    hits: list[Doubles] = []
    for name, pose in tqdm(list(product(people, POSES)), desc="landmarks", disable=None):
        who, code = identity.load(name), sheet.code(decoder, pose)
        vertices, cloud = decoder.vertices(code, AHEAD, who), decoder.decode(code, AHEAD, who)[1]
        for yaw, pitch in product(YAWS, PITCHES):
            camera = cameras.portrait(SIZE_PX, SIZE_PX, yaw, pitch)
            renderer.draw(cloud, camera)
            faces = detector.faces(renderer.read_rgba()[..., :3].copy())
            if len(faces) == 1:
                hits.append(cast(vertices, maker.template, camera, faces[0][:ON_SKIN]))
    return middle(maker, np.array(hits))


def middle(maker: Maker, hits: Doubles) -> PointPlaces:
    """Geometric medians of what was hit, [S, 468, 3] mm on the mean face or NaN: on triangles."""
    found = np.nanmedian(hits, axis=0)
    for _ in range(20):
        away = np.linalg.norm(hits - found, axis=2, keepdims=True)
        share = 1 / np.maximum(away, 0.05)
        found = np.nansum(hits * share, 0) / np.nansum(np.where(np.isnan(away), 0, share), 0)
    corners, weights = nearest(maker.template.astype(np.float64), maker.skin, found)
    spread = np.nanmedian(np.linalg.norm(hits - found, axis=2), 0)
    return PointPlaces(corners, weights.astype(np.float32), spread.astype(np.float32))


class Caster:
    """Casts pixels onto a posed head."""

    def __init__(self, triangles: Ints) -> None:  # [F, 3]
        self._triangles = triangles

    def __call__(
        self, vertices: Floats, rest: Floats, camera: Camera, at: Doubles
    ) -> Doubles:  # [n, 2] px -> [n, 3] the same places on `rest`, NaN where there is none
        view = vertices @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
        flat = view[:, :2] / view[:, 2:] * camera.K[0, 0] + camera.K[:2, 2]
        corners = view[self._triangles]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        middle = corners.mean(1)
        lengths = np.linalg.norm(across, axis=1) * np.linalg.norm(middle, axis=1)
        cosine = -(across * middle).sum(1) / np.maximum(lengths, 1e-9)
        front = np.flatnonzero(cosine > 0)
        a, b, c = (flat[self._triangles[front, k]] for k in range(3))
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        out = np.full((len(at), 3), np.nan)
        for row, point in enumerate(at):
            near = np.flatnonzero(((low <= point) & (point <= high)).all(1))
            shares = _barycentric(a[near], b[near], c[near], point)
            inside = (shares >= -1e-6).all(1)
            if inside.any():
                hits, shares = near[inside], shares[inside]
                first = int(np.argmin(middle[front[hits], 2]))
                triangle, share = front[hits[first]], shares[first]
                if middle[triangle, 2] < np.median(view[:, 2]):  # else it fell through an opening
                    if cosine[triangle] > FACING:
                        out[row] = share @ rest[self._triangles[triangle]]
                    continue
            facing = front[cosine[front] > FACING]
            facing = facing[middle[facing, 2] < np.median(view[:, 2])]
            off = np.linalg.norm(flat[self._triangles[facing, 0]] - point, axis=1)
            best = int(off.argmin())
            if off[best] * middle[facing[best], 2] / camera.K[0, 0] < BESIDE_MM:
                out[row] = rest[self._triangles[facing[best], 0]]
        return out


def _barycentric(a: Doubles, b: Doubles, c: Doubles, at: Doubles) -> Doubles:  # [n, 2] -> [n, 3]
    u, v, w = b - a, c - a, at - a
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    area = np.where(np.abs(area) < 1e-9, 1e-9, area)
    second = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / area
    third = (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / area
    return np.stack([1 - second - third, second, third], 1)


def nearest(vertices: Doubles, triangles: Ints, points: Doubles) -> tuple[Ints, Doubles]:
    """Triangles [n, 3] and barycentric weights [n, 3] of the surface nearest to `points`."""
    from scipy.spatial import KDTree

    near = np.asarray(KDTree(vertices[triangles].mean(1)).query(points, k=24)[1])
    a, b, c = (vertices[triangles[near, k]] for k in range(3))  # [n, 24, 3]
    u, v, w = b - a, c - a, points[:, None] - a
    uu, uv, vv, wu, wv = ((p * q).sum(2) for p, q in ((u, u), (u, v), (v, v), (w, u), (w, v)))
    area = np.maximum(uu * vv - uv * uv, 1e-12)
    shares = np.stack([(vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area], 2)
    shares = np.concatenate([1 - shares.sum(2, keepdims=True), shares], 2).clip(0, 1)
    shares /= shares.sum(2, keepdims=True)
    found = np.einsum("nkc,nkci->nki", shares, np.stack([a, b, c], 2))
    off = np.linalg.norm(found - points[:, None], axis=2)
    rows, best = np.arange(len(points)), np.argsort(off, axis=1)[:, 0]
    return triangles[near[rows, best]], shares[rows, best]
