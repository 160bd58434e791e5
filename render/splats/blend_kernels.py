"""Loops that blend tiles on a CPU, sixteen pixels at once.

A tile of 8x8 px is four vectors of two rows. LLVM finds no vectors in a loop that does so much, so
what one splat does to one tile is spelled here in its instructions. There is no branch in it: to
guess wrong which rows a splat reaches costs more than all of them.
"""

# pyright: reportUntypedFunctionDecorator=false
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic
from numpy.typing import NDArray

from render.splats.projection_kernels import FAINTEST, TILE_PX
from render.types import U32, Floats

LANES, VECTORS = 16, 4  # pixels of a vector; vectors of a tile
PIXELS = LANES * VECTORS
NUMBERS = 12  # of a splat, see `projection.interleave`; nine are used
AT_ONCE = np.uintp(8)  # splats that are blended before it is asked whether they hide the rest
AHEAD = 8  # splats that are fetched before they are needed
OPAQUE = np.float32(1 / 128)  # a tile that lets less through hides the rest
FUSED = ("contract",)  # a product and its sum are rounded once where the machine can
# 2^x = P(x)^4, to 8e-5 of it, for -6 <= x <= 0: least squares of relative errors
POLYNOMIAL = (9.9997957e-01, 1.7314347e-01, 1.4839805e-02, 7.8868043e-04, 2.2039564e-05)
ZERO, ONE, HALF = np.float32(0), np.float32(1), np.float32(0.5)
TINY, LEVELS = np.float32(1e-6), np.float32(255)

FLOAT, INT, LONG = ir.FloatType(), ir.IntType(32), ir.IntType(64)
VECTOR = ir.VectorType(FLOAT, LANES)
BITS = ir.VectorType(ir.IntType(1), LANES)


def _constant(values: list[float]) -> ir.Constant:
    return ir.Constant(VECTOR, values)


def _everywhere(builder: Any, number: Any) -> Any:
    """A vector of sixteen times this number."""
    if isinstance(number, float):
        return _constant([number] * LANES)
    empty = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(empty, number, INT(0))
    return builder.shuffle_vector(first, empty, ir.Constant(ir.VectorType(INT, LANES), [0] * LANES))


def _checked(name: str, array: Any, dimensions: int) -> None:
    if array != types.Array(types.float32, dimensions, "C"):
        raise TypingError(f"{name}: expected a contiguous float32 array, got {array}")


@intrinsic
def blend_splats(typing_context, tile, splats, pairs, first, stop, last, left, top):  # type: ignore[no-untyped-def]
    """Blend the splats pairs[first] .. pairs[stop - 1], one at least, behind what a tile holds:
    what it lets through, red, green, blue [4 * 64]. All of that stays in registers from splat to
    splat. pairs[last] is the last one that may be fetched."""
    _checked("tile", tile, 1)
    _checked("splats", splats, 2)
    if pairs != types.Array(types.uint32, 1, "C"):
        raise TypingError(f"pairs: expected a contiguous uint32 array, got {pairs}")

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        def add(a, b):  # type: ignore[no-untyped-def]
            return builder.fadd(a, b, flags=FUSED)

        def minus(a, b):  # type: ignore[no-untyped-def]
            return builder.fsub(a, b, flags=FUSED)

        def times(a, b):  # type: ignore[no-untyped-def]
            return builder.fmul(a, b, flags=FUSED)

        def row(place):  # type: ignore[no-untyped-def]
            """Where the numbers of the splat at this place of the list begin."""
            index = builder.zext(builder.load(builder.gep(arrays[2].data, [place])), LONG)
            return builder.gep(arrays[1].data, [builder.mul(index, LONG(NUMBERS))])

        arrays = [context.make_array(t)(context, builder, a)
                  for t, a in zip(signature.args[:3], arguments[:3], strict=True)]  # fmt: skip
        first, stop, last = arguments[3:6]
        pixels = builder.bitcast(arrays[0].data, VECTOR.as_pointer())
        left, top = (_everywhere(builder, number) for number in arguments[6:])
        columns = add(left, _constant([float(lane % TILE_PX) for lane in range(LANES)]))
        places = [builder.gep(pixels, [LONG(k)]) for k in range(4 * VECTORS)]
        held = [builder.load(place, align=4) for place in places]
        before, loop = builder.block, builder.append_basic_block("blend")
        after = builder.append_basic_block("blended")
        builder.branch(loop)
        builder.position_at_end(loop)
        i, sums = builder.phi(LONG), [builder.phi(VECTOR) for _ in held]
        i.add_incoming(first, before)
        for phi, value in zip(sums, held, strict=True):
            phi.add_incoming(value, before)

        ahead = builder.add(i, LONG(AHEAD))
        ahead = builder.select(builder.icmp_unsigned("<", ahead, last), ahead, last)
        _fetch(builder, row(ahead))
        start, blended = row(i), list(sums)
        x, y, p, q, r, log2_opacity, *colors = (
            _everywhere(builder, builder.load(builder.gep(start, [LONG(k)]))) for k in range(9)
        )
        across = times(p, minus(columns, x))
        for k in range(VECTORS):
            rows = _constant([float(2 * k + lane // TILE_PX) for lane in range(LANES)])
            down = minus(add(top, rows), y)
            u, v = add(across, times(q, down)), times(r, down)
            power = minus(minus(log2_opacity, times(u, u)), times(v, v))
            seen = builder.fcmp_ordered(">=", power, _everywhere(builder, -float(FAINTEST)))
            alpha = _everywhere(builder, POLYNOMIAL[-1])
            for coefficient in POLYNOMIAL[-2::-1]:
                alpha = add(times(alpha, power), _everywhere(builder, coefficient))
            alpha = builder.fmul(alpha, alpha)
            alpha = builder.fmul(alpha, alpha)
            through = sums[k]
            weight = builder.select(seen, builder.fmul(alpha, through), _everywhere(builder, 0.0))
            blended[k] = builder.fsub(through, weight)
            for channel, color in enumerate(colors, 1):
                at = VECTORS * channel + k
                blended[at] = add(times(weight, color), sums[at])

        following = builder.add(i, LONG(1))
        i.add_incoming(following, loop)
        for phi, value in zip(sums, blended, strict=True):
            phi.add_incoming(value, loop)
        builder.cbranch(builder.icmp_unsigned("<", following, stop), loop, after)
        builder.position_at_end(after)
        for value, place in zip(blended, places, strict=True):
            builder.store(value, place, align=4)
        return context.get_dummy_value()

    kinds = types.uint64, types.uint64, types.uint64, types.float32, types.float32
    return types.void(tile, splats, pairs, *kinds), generate


@intrinsic
def lets_through(typing_context, tile, least):  # type: ignore[no-untyped-def]
    """Does any pixel of a tile let so much through?"""
    _checked("tile", tile, 1)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        pixels = builder.bitcast(array.data, VECTOR.as_pointer())
        least, some = _everywhere(builder, arguments[1]), ir.Constant(BITS, [0] * LANES)
        for k in range(VECTORS):
            value = builder.load(builder.gep(pixels, [LONG(k)]))
            value.align = 4
            some = builder.or_(some, builder.fcmp_ordered(">=", value, least))
        kind = ir.FunctionType(ir.IntType(1), [BITS])
        name = f"llvm.vector.reduce.or.v{LANES}i1"
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), [some])

    return types.boolean(tile, least), generate


def _fetch(builder: Any, start: Any) -> None:
    """Bring a splat into the nearest cache, without waiting for it."""
    pointer = ir.IntType(8).as_pointer()
    kind = ir.FunctionType(ir.VoidType(), [pointer, INT, INT, INT])
    function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
    read, nearest, data = INT(0), INT(3), INT(1)
    for number in (0, NUMBERS - 4):  # most lie in two lines of the cache
        place = builder.bitcast(builder.gep(start, [LONG(number)]), pointer)
        builder.call(function, [place, read, nearest, data])


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def blend_tiles(
    tiles: NDArray[np.int64],  # [n] of the picture
    starts: tuple[U32, ...],  # [tiles + 2] of each portion, nearest first, see tile_pairs.Pairs
    pairs: tuple[U32, ...],
    splats: Floats,  # [N, NUMBERS]
    background: Floats,  # [3]
    picture: NDArray[np.int32],  # -> [H, W] bytes of red, green, blue, alpha
) -> None:
    height, width = picture.shape
    across = (width + TILE_PX - 1) // TILE_PX
    tile = np.empty(4 * PIXELS, np.float32)
    through, red = tile[:PIXELS], tile[PIXELS : 2 * PIXELS]
    green, blue = tile[2 * PIXELS : 3 * PIXELS], tile[3 * PIXELS :]
    words = np.empty(PIXELS, np.int32)
    for number in tiles:
        row, column = TILE_PX * (number // across), TILE_PX * (number % across)
        left, top = np.float32(column) + HALF, np.float32(row) + HALF
        tile[:PIXELS], tile[PIXELS:] = ONE, ZERO
        hidden = False
        for portion in range(len(starts)):
            near_to_far, first = pairs[portion], starts[portion]
            i, end = np.uintp(first[number]), np.uintp(first[number + 1]) - np.uintp(1)
            last = end - np.uintp(1)
            while i < end and not hidden:
                stop = min(i + AT_ONCE, end)
                blend_splats(tile, splats, near_to_far, i, stop, last, left, top)  # pyright: ignore[reportCallIssue]
                i = stop
                hidden = not lets_through(tile, OPAQUE)  # pyright: ignore[reportCallIssue]
        for k in range(PIXELS):
            # Behind a hidden rest it looks like before it, not like the background.
            rest = ZERO if hidden else through[k]
            scale = (ONE - rest) / max(ONE - through[k], TINY) * LEVELS
            behind = rest * LEVELS
            a = np.int32(red[k] * scale + behind * background[0] + HALF)
            b = np.int32(green[k] * scale + behind * background[1] + HALF)
            c = np.int32(blue[k] * scale + behind * background[2] + HALF)
            alpha = np.int32((ONE - rest) * LEVELS + HALF)
            words[k] = a | b << np.int32(8) | c << np.int32(16) | alpha << np.int32(24)
        for y in range(min(TILE_PX, height - row)):
            for x in range(min(TILE_PX, width - column)):
                picture[row + y, column + x] = words[TILE_PX * y + x]
