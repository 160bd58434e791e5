"""Differentiable splatter in torch: tiles of 8 x 8 pixels, for photometric fitting.

The picture model is that of render/reference.py. Which splat touches which tile, and the order in
depth, come from numpy and carry no gradient; opacities, widths and colours do. It blends on the
device its tensors are on: the CPU, or a GPU.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from render.reference import LOW_PASS_PX2, MAX_ALPHA, MIN_ALPHA
from render.tile_pairs import deal
from render.types import Camera

TILE_PX = 8
BUCKET = 64  # tiles blended together: similar numbers of splats, little padding


@dataclass(frozen=True)
class Flat:
    """Flat round splats on a surface, seen by one camera."""

    xy: Tensor  # [N, 2] px
    spread: Tensor  # [N, 2, 2] px^2: screen covariance of a width of 1 mm
    depth: NDArray[np.float32]  # [N] mm


def project(
    means: NDArray[np.float32],  # [N, 3] mm
    normals: NDArray[np.float32],  # [N, 3] unit
    flatness: float,
    camera: Camera,
    device: str = "cpu",
) -> Flat:
    """EWA projection of discs of 1 mm with their thickness."""
    view = camera.viewmat.astype(np.float32)
    points = means @ view[:3, :3].T + view[:3, 3]
    n = normals @ view[:3, :3].T
    depth = points[:, 2]
    focal = np.float32(camera.K[0, 0])
    jacobian = np.zeros((len(means), 2, 3), np.float32)
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = focal / depth
    jacobian[:, :, 2] = -focal * points[:, :2] / depth[:, None] ** 2
    thin = np.float32(1 - flatness**2)
    cov = np.eye(3, dtype=np.float32) - thin * n[:, :, None] * n[:, None, :]
    spread = jacobian @ cov @ jacobian.transpose(0, 2, 1)
    xy = points[:, :2] / depth[:, None] * focal + camera.K[:2, 2].astype(np.float32)
    xy, spread = (torch.from_numpy(x.astype(np.float32)).to(device) for x in (xy, spread))
    return Flat(xy, spread, depth)


def draw(
    flat: Flat,
    widths: Tensor,  # [N] mm
    opacities: Tensor,  # [N]
    colors: Tensor,  # [N, 3]
    camera: Camera,
) -> tuple[Tensor, int]:  # picture [H, W, 3], number of (splat, tile) pairs
    """Blend front to back over the camera's background."""
    cov = flat.spread * (widths * widths)[:, None, None]
    a, b, c = cov[:, 0, 0] + LOW_PASS_PX2, cov[:, 0, 1], cov[:, 1, 1] + LOW_PASS_PX2
    det = a * c - b * b
    conic = torch.stack([c / det, -b / det, a / det], 1)
    order, starts, size = _tiles(flat, a, c, opacities, camera)
    device = flat.xy.device
    background = torch.tensor(camera.background, dtype=torch.float32, device=device)
    counts = np.diff(starts.astype(np.int64))
    by_count = np.argsort(counts, kind="stable")
    by_count = by_count[counts[by_count] > 0]
    tiles = background.expand(len(counts), TILE_PX * TILE_PX, 3).clone()
    packed = torch.cat([flat.xy, conic, opacities[:, None], colors], 1)
    spot = torch.arange(TILE_PX, dtype=torch.float32, device=device) + 0.5
    px, py = spot.repeat(TILE_PX), spot.repeat_interleave(TILE_PX)
    pieces, places = [], []
    for first in range(0, len(by_count), BUCKET):
        group = by_count[first : first + BUCKET]
        longest = int(counts[group].max())
        slot = np.arange(longest)[None] + starts[group].astype(np.int64)[:, None]
        real = np.arange(longest)[None] < counts[group][:, None]
        index = torch.from_numpy(order[np.minimum(slot, len(order) - 1)].astype(np.int64))
        splat = packed[index.to(device)]  # [T, K, 9]
        corner = np.stack([group % size[0], group // size[0]], 1).astype(np.float32) * TILE_PX
        origin = torch.from_numpy(corner).to(device)
        dx = (origin[:, 0, None] - splat[..., 0])[..., None] + px  # [T, K, 64]
        dy = (origin[:, 1, None] - splat[..., 1])[..., None] + py
        power = splat[..., 2, None] * dx * dx + splat[..., 4, None] * dy * dy
        power = power + 2 * splat[..., 3, None] * dx * dy
        alpha = (splat[..., 5, None] * torch.exp(-0.5 * power)).clamp(max=MAX_ALPHA)
        shown = (alpha.detach() >= MIN_ALPHA) & torch.from_numpy(real).to(device)[..., None]
        alpha = torch.where(shown, alpha, 0.0)
        left = torch.cumprod(1 - alpha, 1)
        before = torch.cat([torch.ones_like(left[:, :1]), left[:, :-1]], 1)
        picture = torch.einsum("tkp,tkc->tpc", alpha * before, splat[..., 6:])
        pieces.append(picture + left[:, -1, :, None] * background)
        places.append(torch.from_numpy(group).to(device))
    tiles = tiles.index_copy(0, torch.cat(places), torch.cat(pieces))
    across, down = size
    grid = tiles.reshape(down, across, TILE_PX, TILE_PX, 3).permute(0, 2, 1, 3, 4)
    picture = grid.reshape(down * TILE_PX, across * TILE_PX, 3)
    return picture[: camera.height, : camera.width], len(order)


def _tiles(
    flat: Flat, a: Tensor, c: Tensor, opacities: Tensor, camera: Camera
) -> tuple[NDArray[np.intp], NDArray[np.uint32], tuple[int, int]]:
    """Splats by tile and depth, the starts of the tiles, and the number of tiles across, down."""
    with torch.no_grad():
        cutoff = 2 * torch.log((opacities / MIN_ALPHA).clamp(min=1.0))
        half = torch.sqrt(cutoff[:, None] * torch.stack([a, c], 1)).cpu().numpy()
        shown = (opacities >= MIN_ALPHA).cpu().numpy()
    size = (-(-camera.width // TILE_PX), -(-camera.height // TILE_PX))
    xy = flat.xy.cpu().numpy()
    low = np.clip(np.floor((xy - half) / TILE_PX), 0, size).astype(np.uint32)
    high = np.clip(np.ceil((xy + half) / TILE_PX), 0, size).astype(np.uint32)
    shown &= (high > low).all(1) & (flat.depth > camera.near_mm)
    order = np.argsort(flat.depth, kind="stable")
    order = order[shown[order]]
    boxes = np.stack([corner[:, 0] | corner[:, 1] << 16 for corner in (low, high)], 1)
    pairs = deal(boxes.astype(np.uint32), order.astype(np.uint32), size)
    return pairs.splats.astype(np.intp), pairs.starts, size


def dissimilarity(a: Tensor, b: Tensor) -> Tensor:  # [H, W, 3], [H, W, 3] 0..1 -> [H, W]
    """1 - SSIM per pixel, over windows of 7 x 7, mean of the channels."""
    x, y = a.permute(2, 0, 1)[None], b.permute(2, 0, 1)[None]

    def mean(v: Tensor) -> Tensor:
        return torch.nn.functional.avg_pool2d(v, 7, 1, 3, count_include_pad=False)

    mx, my = mean(x), mean(y)
    vx, vy, vxy = mean(x * x) - mx * mx, mean(y * y) - my * my, mean(x * y) - mx * my
    top = (2 * mx * my + 0.01**2) * (2 * vxy + 0.03**2)
    bottom = (mx * mx + my * my + 0.01**2) * (vx + vy + 0.03**2)
    return (1 - top / bottom)[0].mean(0)
