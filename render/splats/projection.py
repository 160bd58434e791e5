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
    stored: Floats,  # [N * 3] colours
    mirrors: tuple[Floats, Floats, Floats, Floats, Floats, Floats],  # from weights to film, see
    # shine.add_shine
    view: Floats,  # [12]
    lens: Floats,  # [8]
    viewer: Floats,  # [3]
    size: tuple[np.float32, np.float32],  # tiles across, down
    near_mm: np.float32,
    colors: Floats,  # -> [N * 3] as seen from there
    depths: Floats,  # -> [N] mm, HIDDEN or BROKEN
    boxes: U32,  # -> [N * 2]
    ellipses: Floats,  # -> [7, N]
) -> None:
    """All in one call: threads that call one loop after another wait for each other in between."""
    count = last - first
    means, quats = means[3 * first : 3 * last], quats[4 * first : 4 * last]
    scales, opacities = scales[3 * first : 3 * last], opacities[first:last]
    colors, depths = colors[3 * first : 3 * last], depths[first:last]
    boxes = boxes[2 * first : 2 * last]
    slope_x, slope_y = np.empty(count, np.float32), np.empty(count, np.float32)
    var_x, var_y = np.empty(count, np.float32), np.empty(count, np.float32)
    cov, faded = np.empty(count, np.float32), np.empty(count, np.float32)
    x, y = ellipses[0][first:last], ellipses[1][first:last]
    p, q, r = ellipses[2][first:last], ellipses[3][first:last], ellipses[4][first:last]
    log2_opacity, half_y = ellipses[5][first:last], ellipses[6][first:last]
    kernels.project_means(means, view, lens, x, y, depths, slope_x, slope_y)
    kernels.fade(opacities, scales, lens[0], depths, faded)
    kernels.log2_of(faded, log2_opacity)
    kernels.project_covariances(
        quats, scales, view, lens, depths, slope_x, slope_y, var_x, var_y, cov
    )
    kernels.invert(var_x, var_y, cov, p, q, r)
    kernels.bound(x, y, var_x, var_y, log2_opacity, size[0], size[1], half_y, boxes)
    for k in range(3 * count):  # a slice assigned takes five seconds more to compile
        colors[k] = stored[3 * first + k]
    weights, roughness, soft, towards, lamps, film = mirrors
    weights, roughness = weights[4 * first : 4 * last], roughness[first:last]
    if len(roughness):
        add_shine(means, quats, viewer, weights, roughness, soft, towards, lamps, film, colors)
    kernels.cull(means, quats, scales, opacities, faded, colors, boxes, near_mm, depths)


@njit(**FAST)
def reach(
    first: int,
    last: int,
    ellipses: Floats,  # [7, N]
    colors: Floats,  # [N * 3]
    boxes: U32,  # [N * 2]
    across: int,  # tiles of a picture
    rows: U32,  # -> [N] work
    reaches: U64,  # -> [N] see reach_kernels
    further: U32,  # -> [N]
    splats: Floats,  # -> [N, 9 and more] see interleave
) -> None:
    """The tiles that these splats reach, and what is blended of them."""
    interleave(ellipses, colors, first, last, splats)
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
