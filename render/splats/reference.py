"""The readable splatter: float64 numpy, one Gaussian at a time; the oracle of the GL renderers.

The picture model is that of 3D Gaussian splatting with the constants of gsplat, but for the
low-pass filter: EWA projection with a filter of 0.15 px^2, opacity clamped to 0.999 and alpha cut
off below 1/64, Gaussians blended front to back in the order of their centres' depth. Strands that
are finer than a pixel fade by as much as the filter widens them, so that a hair is as dark from
afar as it is near (as all Gaussians do in Mip-Splatting, Yu 2024; skin was fitted to be as it is).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.splats.shine import colors_from
from render.types import Camera, Gaussians

LOW_PASS_PX2 = 0.15  # added to both screen variances; 0.3 is .5 dB and .01 of SSIM worse
MAX_ALPHA = 0.999
STRAND = 2.0  # Gaussians longer than this many times their next axis are strands
MIN_ALPHA = 1.0 / 64.0  # fainter contributions are skipped: a quarter fewer pixels than at 1/255
FRUSTUM_MARGIN = 0.3  # the Jacobian is taken no further outside the picture than this share

Array = NDArray[np.float64]


def sound(gaussians: Gaussians) -> NDArray[np.bool_]:
    """[N]: whether a picture can show them: finite, with a size and a rotation, not transparent."""
    rows = ("means", "quats", "scales", "opacities", "colors")
    arrays = [np.asarray(getattr(gaussians, name), np.float64) for name in rows]
    finite = [np.isfinite(a).reshape(len(a), -1).all(axis=1) for a in arrays]
    scales, quats = arrays[2], arrays[1]
    has_size = (scales >= 0.0).all(axis=1) & (scales > 0.0).any(axis=1)
    visible = has_size & (quats != 0.0).any(axis=1) & (arrays[3] >= MIN_ALPHA)
    return np.logical_and.reduce([*finite, visible])


@dataclass(frozen=True)
class Splats:
    """Gaussians projected to the screen, nearest first; invisible ones are already gone."""

    xy: Array  # [M, 2] px, pixel centres lie at +0.5
    cov: Array  # [M, 2, 2] px^2
    half_size: Array  # [M, 2] px, half of the box outside which alpha < MIN_ALPHA
    opacities: Array  # [M]
    colors: Array  # [M, 3]


def rotation_matrices(quats: Array) -> Array:
    """[N, 4] wxyz of any length -> [N, 3, 3]."""
    w, x, y, z = (quats / np.linalg.norm(quats, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def jacobians(points: Array, camera: Camera) -> Array:
    """Derivative [N, 2, 3] of the pixel position at the camera-space points [N, 3]."""
    focal = np.array([camera.K[0, 0], camera.K[1, 1]])
    centre = np.array([camera.K[0, 2], camera.K[1, 2]])
    size = np.array([camera.width, camera.height], np.float64)
    margin = FRUSTUM_MARGIN * 0.5 * size / focal
    depth = points[:, 2]
    slope = points[:, :2] / depth[:, None]
    slope = np.clip(slope, -centre / focal - margin, (size - centre) / focal + margin)
    out = np.zeros((len(points), 2, 3))
    out[:, 0, 0] = focal[0] / depth
    out[:, 1, 1] = focal[1] / depth
    out[:, :, 2] = -focal * slope / depth[:, None]
    return out


def fading(scales: NDArray[np.floating], points: Array, camera: Camera) -> Array:  # [N]
    """What the low-pass filter leaves of the opacity of strands [N, 3] mm at points [N, 3]."""
    _, width, length = np.sort(np.asarray(scales, np.float64), axis=1).T
    width_px2 = (width * camera.K[0, 0] / points[:, 2]) ** 2
    return np.where(length > STRAND * width, np.sqrt(width_px2 / (width_px2 + LOW_PASS_PX2)), 1.0)


def project(gaussians: Gaussians, camera: Camera) -> Splats:
    """EWA projection of all Gaussians, culled and sorted by depth."""
    view = np.asarray(camera.viewmat, np.float64)
    whole = np.flatnonzero(sound(gaussians))
    points = np.asarray(gaussians.means[whole], np.float64) @ view[:3, :3].T + view[:3, 3]
    keep = np.flatnonzero(points[:, 2] >= camera.near_mm)
    keep = keep[np.argsort(points[keep, 2], kind="stable")]
    points, order = points[keep], whole[keep]
    opacities = np.asarray(gaussians.opacities[order], np.float64)
    opacities = np.minimum(opacities * fading(gaussians.scales[order], points, camera), MAX_ALPHA)
    seen = opacities >= MIN_ALPHA
    points, order, opacities = points[seen], order[seen], opacities[seen]
    axes = rotation_matrices(np.asarray(gaussians.quats[order], np.float64))
    axes = axes * np.asarray(gaussians.scales[order], np.float64)[:, None, :]
    on_screen = jacobians(points, camera) @ view[:3, :3] @ axes  # [M, 2, 3]
    cov = on_screen @ on_screen.transpose(0, 2, 1) + LOW_PASS_PX2 * np.eye(2)
    focal = np.array([camera.K[0, 0], camera.K[1, 1]])
    xy = points[:, :2] / points[:, 2:] * focal + camera.K[:2, 2]
    cutoff = 2.0 * np.log(opacities / MIN_ALPHA)  # squared Mahalanobis distance at MIN_ALPHA
    half_size = np.sqrt(cutoff[:, None] * np.diagonal(cov, axis1=1, axis2=2))
    colors = np.asarray(colors_from(gaussians, camera.position)[order], np.float64)
    return Splats(xy, cov, half_size, opacities, colors)


def blend(splats: Splats, camera: Camera) -> tuple[Array, Array]:
    """Front to back: colours over the background [H, W, 3] and coverage [H, W], both 0..1."""
    width, height = camera.width, camera.height
    colors = np.zeros((height, width, 3))
    transmittance = np.ones((height, width))
    low = np.clip(np.floor(splats.xy - splats.half_size), 0, (width, height)).astype(int)
    high = np.clip(np.ceil(splats.xy + splats.half_size), 0, (width, height)).astype(int)
    conics = np.linalg.inv(splats.cov)
    for i in np.flatnonzero((high > low).all(axis=1)):
        (x0, y0), (x1, y1) = low[i], high[i]
        dx = np.arange(x0, x1) + 0.5 - splats.xy[i, 0]
        dy = (np.arange(y0, y1) + 0.5 - splats.xy[i, 1])[:, None]
        (a, b), (_, c) = conics[i]
        alpha = splats.opacities[i] * np.exp(-0.5 * (a * dx * dx + 2 * b * dx * dy + c * dy * dy))
        alpha = np.where(alpha < MIN_ALPHA, 0.0, alpha)
        left = transmittance[y0:y1, x0:x1]
        colors[y0:y1, x0:x1] += (alpha * left)[..., None] * splats.colors[i]
        transmittance[y0:y1, x0:x1] = left * (1.0 - alpha)
    colors += transmittance[..., None] * np.asarray(camera.background)
    return colors, 1.0 - transmittance


class ReferenceRenderer:
    """The oracle behind the Renderer interface: exact and slow, needs no GL."""

    name = "reference on numpy float64"

    def __init__(self) -> None:
        self.dropped = 0  # Gaussians of the last draw that are NaN, without size or transparent
        self._colors: Array = np.zeros((1, 1, 3))
        self._coverage: Array = np.zeros((1, 1))

    def draw(self, gaussians: Gaussians, camera: Camera) -> None:
        """Draw one picture; its size is that of the camera."""
        gaussians.check()
        self.dropped = int(np.count_nonzero(~sound(gaussians)))
        self._colors, self._coverage = blend(project(gaussians, camera), camera)

    def read_float(self) -> Array:
        """The last picture [H, W, 4] before rounding to 8 bits."""
        return np.concatenate([self._colors, self._coverage[..., None]], axis=2)

    def read_rgba(self) -> NDArray[np.uint8]:
        """The last picture [H, W, 4]; alpha is coverage, the colours lie over the background."""
        return np.rint(255.0 * self.read_float().clip(0.0, 1.0)).astype(np.uint8)

    def close(self) -> None:
        """Nothing to free."""
