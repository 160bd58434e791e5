"""What one thread does to some of a cloud's Gaussians: the loops of the projection in a row.

A few thousand at a time stay in the caches from one loop to the next.
"""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit

from render.splats import projection_kernels as kernels
from render.splats import reach_kernels
from render.splats.shine import FAST, ONE, ZERO, add_shine
from render.types import U32, U64, Floats

RUN = 512  # Gaussians that are left out together


@njit(cache=True, nogil=True)
def shown_slices(
    opacities: Floats,  # [N]
    at_once: int,  # Gaussians of a slice, at most; a multiple of RUN
) -> list[tuple[int, int]]:
    """First and last (left out) Gaussians of slices that hold all that can be seen.

    Skin under hair is transparent, one long run after another.
    """
    slices = [(0, 0)]
    for first in range(0, len(opacities), RUN):
        last = min(first + RUN, len(opacities))
        for opacity in opacities[first:last]:
            if opacity >= kernels.MIN_ALPHA:
                start, end = slices[-1]
                if end == first and last - start <= at_once:
                    slices[-1] = start, last
                else:
                    slices.append((first, last))
                break
    return slices


@njit(**FAST)
def project(
    first: int,  # Gaussian
    last: int,  # left out
    means: Floats,  # [N * 3] see projection_kernels, as all of these
    quats: Floats,  # [N * 4]
    scales: Floats,  # [N * 3]
    opacities: Floats,  # [N]
    view: Floats,  # [12]
    lens: Floats,  # [8]
    depths: Floats,  # -> [N]
    faded: Floats,  # -> [N]
    variances: Floats,  # -> [3, N]
    ellipses: Floats,  # -> [7, N], but for log2 of the opacity and half of the height
) -> None:
    count = last - first
    means, quats = means[3 * first : 3 * last], quats[4 * first : 4 * last]
    scales, depths = scales[3 * first : 3 * last], depths[first:last]
    slope_x, slope_y = np.empty(count, np.float32), np.empty(count, np.float32)
    x, y = ellipses[0][first:last], ellipses[1][first:last]
    p, q, r = ellipses[2][first:last], ellipses[3][first:last], ellipses[4][first:last]
    var_x, var_y, cov = (
        variances[0][first:last],
        variances[1][first:last],
        variances[2][first:last],
    )
    kernels.project_means(means, view, lens, x, y, depths, slope_x, slope_y)
    kernels.fade(opacities[first:last], scales, lens[0], depths, faded[first:last])
    kernels.project_covariances(
        quats, scales, view, lens, depths, slope_x, slope_y, var_x, var_y, cov
    )
    kernels.invert(var_x, var_y, cov, p, q, r)


@njit(**FAST)
def shine_on(
    first: int,
    last: int,
    means: Floats,  # [N * 3] see shine.add_shine, as all of these
    quats: Floats,  # [N * 4]
    viewer: Floats,  # [3]
    weights: Floats,  # [M * 4]
    roughness: Floats,  # [M]
    soft: Floats,
    towards: Floats,
    lamps: Floats,
    film: Floats,
    colors: Floats,  # [N * 3]
) -> None:
    last = min(last, len(roughness))
    if first < last:
        means, quats = means[3 * first : 3 * last], quats[4 * first : 4 * last]
        weights, roughness = weights[4 * first : 4 * last], roughness[first:last]
        colors = colors[3 * first : 3 * last]
        add_shine(means, quats, viewer, weights, roughness, soft, towards, lamps, film, colors)


@njit(**FAST)
def bound_and_cull(
    first: int,
    last: int,
    means: Floats,  # [N * 3] see projection_kernels, as all of these
    quats: Floats,  # [N * 4]
    scales: Floats,  # [N * 3]
    opacities: Floats,  # [N]
    colors: Floats,  # [N * 3]
    faded: Floats,  # [N]
    variances: Floats,  # [3, N]
    across: np.float32,
    down: np.float32,
    near_mm: np.float32,
    ellipses: Floats,  # [7, N] -> half of the height
    boxes: U32,  # -> [N * 2]
    depths: Floats,  # [N], changed in place
) -> None:
    x, y = ellipses[0][first:last], ellipses[1][first:last]
    log2_opacity, half_y = ellipses[5][first:last], ellipses[6][first:last]
    var_x, var_y = variances[0][first:last], variances[1][first:last]
    boxes, depths, faded = boxes[2 * first : 2 * last], depths[first:last], faded[first:last]
    means, quats = means[3 * first : 3 * last], quats[4 * first : 4 * last]
    scales, colors = scales[3 * first : 3 * last], colors[3 * first : 3 * last]
    kernels.bound(x, y, var_x, var_y, log2_opacity, across, down, half_y, boxes)
    opacities = opacities[first:last]
    kernels.cull(means, quats, scales, opacities, faded, colors, boxes, near_mm, depths)


@njit(**FAST)
def reach(
    first: int,
    last: int,
    ellipses: Floats,  # [7, N]
    boxes: U32,  # [N * 2]
    across: int,  # tiles of a picture
    rows: U32,  # -> [N] work
    reaches: U64,  # -> [N] see reach_kernels
    further: U32,  # -> [N]
) -> None:
    """The tiles that these splats reach."""
    boxes, rows = boxes[2 * first : 2 * last], rows[first:last]
    reaches, further = reaches[first:last], further[first:last]
    x, y, half_y = ellipses[0][first:last], ellipses[1][first:last], ellipses[6][first:last]
    p, q, r = ellipses[2][first:last], ellipses[3][first:last], ellipses[4][first:last]
    log2_opacity = ellipses[5][first:last]
    above = np.float32(0)
    reach_kernels.reached_rows(x, y, p, q, r, log2_opacity, half_y, boxes, above, rows)
    reach_kernels.join_reaches(boxes, rows, across, reaches)
    tall = np.flatnonzero(reaches >= reach_kernels.FURTHER)  # a few in a hundred
    below, found = np.float32(reach_kernels.ROWS), np.empty(len(tall), np.uint32)
    boxes = boxes.reshape(-1, 2)[tall].reshape(-1)
    x, y, half_y, log2_opacity = x[tall], y[tall], half_y[tall], log2_opacity[tall]
    p, q, r = p[tall], q[tall], r[tall]
    reach_kernels.reached_rows(x, y, p, q, r, log2_opacity, half_y, boxes, below, found)
    further[tall] = found


@njit(**FAST)
def interleave(
    ellipses: Floats,  # [7, N] x, y (px), p, q, r, log2 of the opacity; and more
    colors: Floats,  # [N * 3]
    first: int,
    last: int,
    splats: Floats,  # -> [N, 9 and more] the six and a colour, 0..1, beside each other
) -> None:
    for i in range(first, last):
        for k in range(6):
            splats[i, k] = ellipses[k, i]
        for k in range(3):
            splats[i, 6 + k] = min(max(colors[3 * i + k], ZERO), ONE)
