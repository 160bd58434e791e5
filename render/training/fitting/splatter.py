"""How much every Gaussian shows in every pixel: a picture is linear in the colours of a cloud.

The picture model is that of `render/splats/reference.py`.
"""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_array

from render.splats.reference import LOW_PASS_PX2, MAX_ALPHA, MIN_ALPHA
from render.types import Camera, Floats

PAIRS_A_PIXEL = 40  # room that is made for them
FAINT = 0.004  # a smaller share of a pixel is left out


def shares(
    means: Floats,  # [N, 3] mm
    normals: Floats,  # [N, 3] unit
    widths: Floats,  # [N] mm
    flatness: float,
    opacities: Floats,  # [N]
    camera: Camera,
) -> tuple[csr_array, Floats]:  # [H * W, N] of each Gaussian; [H * W] of the background
    """Flat round Gaussians through EWA projection, front to back."""
    view = camera.viewmat.astype(np.float32)
    points, n = means @ view[:3, :3].T + view[:3, 3], normals @ view[:3, :3].T
    depth, focal = points[:, 2], np.float32(camera.K[0, 0])
    jacobian = np.zeros((len(means), 2, 3), np.float32)
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = focal / depth
    jacobian[:, :, 2] = -focal * points[:, :2] / depth[:, None] ** 2
    thin = np.float32(1 - flatness**2)
    round_part = np.einsum("nij,nkj->nik", jacobian, jacobian)
    leaning = np.einsum("nij,nj->ni", jacobian, n)
    spread = round_part - thin * leaning[:, :, None] * leaning[:, None, :]
    spread *= (widths * widths)[:, None, None]
    xy = (points[:, :2] / depth[:, None] * focal + camera.K[:2, 2]).astype(np.float32)
    var = np.stack([spread[:, 0, 0], spread[:, 0, 1], spread[:, 1, 1]], 1).astype(np.float32)
    var[:, [0, 2]] += np.float32(LOW_PASS_PX2)
    order = np.argsort(depth, kind="stable")
    size = camera.height * camera.width
    rows, columns = (np.empty(PAIRS_A_PIXEL * size, np.int32) for _ in range(2))
    values = np.empty(len(rows), np.float32)
    left = np.ones((camera.height, camera.width), np.float32)
    count = _blend(xy, var, opacities.astype(np.float32), order, rows, columns, values, left)
    entries = values[:count], (rows[:count], columns[:count])
    return csr_array(entries, shape=(size, len(means))), left.ravel()


@njit(cache=True, fastmath=True)
def _blend(
    xy: Floats,
    var: Floats,  # [N, 3] px^2: xx, xy, yy
    opacities: Floats,
    order: NDArray[np.intp],
    rows: NDArray[np.int32],
    columns: NDArray[np.int32],
    values: Floats,
    left: Floats,  # [H, W] 1 at first
) -> int:
    height, width = left.shape
    count = 0
    for i in order:
        a, b, c = var[i, 0], var[i, 1], var[i, 2]
        det = a * c - b * b
        opacity = min(opacities[i], np.float32(MAX_ALPHA))
        if det <= 0 or opacity < MIN_ALPHA:
            continue
        cut = np.float32(2) * np.log(opacity / np.float32(MIN_ALPHA))
        half_x, half_y = np.sqrt(cut * a), np.sqrt(cut * c)
        x0, x1 = max(0, int(np.floor(xy[i, 0] - half_x))), min(width, int(xy[i, 0] + half_x) + 1)
        y0, y1 = max(0, int(np.floor(xy[i, 1] - half_y))), min(height, int(xy[i, 1] + half_y) + 1)
        for y in range(y0, y1):
            dy = np.float32(y) + np.float32(0.5) - xy[i, 1]
            for x in range(x0, x1):
                dx = np.float32(x) + np.float32(0.5) - xy[i, 0]
                power = (c * dx * dx - 2 * b * dx * dy + a * dy * dy) / det
                if power > cut:
                    continue
                alpha = opacity * np.exp(np.float32(-0.5) * power)
                share = alpha * left[y, x]
                left[y, x] -= share
                if share > FAINT and count < len(rows):
                    rows[count], columns[count] = y * width + x, i
                    values[count] = share
                    count += 1
    return count
