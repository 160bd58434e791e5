"""What a tile's pixels take of its splats, spelled in vector instructions.

LLVM finds no vectors in a loop that does so much. A splat is first asked which rows of the tile it
reaches (`reach_rows`); then every pair of rows, sixteen pixels at once, blends those that reach it
(`blend_rows`). There is no branch in either: to guess wrong costs more than to compute.
"""

# pyright: reportUntypedFunctionDecorator=false
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic

from render.splats.projection_kernels import FAINTEST, TILE_PX

ROWS = 2  # of a tile, that are blended at once
LANES = ROWS * TILE_PX
NUMBERS = 12  # of a splat, see `projection.interleave`; nine are used
# of a splat in a tile: across [8 columns]; down, left [8 rows]; red, green, blue
ACROSS, DOWN, LEFT, COLOR, KEPT = 0, 8, 16, 24, 32
CHANNELS = 4  # what a pixel lets through, red, green, blue
FUSED = ("contract",)  # a product and its sum are rounded once where the machine can
SLACK = 1e-3  # of log2 of alpha: how much a row's faintest pixel may be rounded
# 2^x = P(x)^4, to 8e-5 of it, for -6 <= x <= 0: least squares of relative errors
POLYNOMIAL = (9.9997957e-01, 1.7314347e-01, 1.4839805e-02, 7.8868043e-04, 2.2039564e-05)

FLOAT, BYTE, INT, LONG = ir.FloatType(), ir.IntType(8), ir.IntType(32), ir.IntType(64)
BITS = ir.VectorType(ir.IntType(1), LANES)
VECTOR, LINE = ir.VectorType(FLOAT, LANES), ir.VectorType(FLOAT, TILE_PX)


class _Writer:
    """Writes instructions on vectors of one kind."""

    def __init__(self, builder: Any, kind: ir.VectorType) -> None:
        self.builder, self.kind = builder, kind

    def add(self, a: Any, b: Any) -> Any:
        return self.builder.fadd(a, b, flags=FUSED)

    def minus(self, a: Any, b: Any) -> Any:
        return self.builder.fsub(a, b, flags=FUSED)

    def times(self, a: Any, b: Any) -> Any:
        return self.builder.fmul(a, b, flags=FUSED)

    def larger(self, a: Any, b: Any) -> Any:
        return self.builder.select(self.builder.fcmp_ordered(">", a, b), a, b)

    def everywhere(self, number: Any) -> Any:
        """A vector of so many times this number."""
        count = self.kind.count
        if isinstance(number, float):
            return ir.Constant(self.kind, [number] * count)
        empty = ir.Constant(self.kind, ir.Undefined)
        first = self.builder.insert_element(empty, number, INT(0))
        lanes = ir.Constant(ir.VectorType(INT, count), [0] * count)
        return self.builder.shuffle_vector(first, empty, lanes)

    def at(self, pointer: Any, place: Any) -> Any:
        """Pointer to a vector of this kind at a place of floats."""
        return self.builder.bitcast(self.builder.gep(pointer, [place]), self.kind.as_pointer())

    def load(self, pointer: Any, place: Any) -> Any:
        return self.builder.load(self.at(pointer, place), align=4)

    def store(self, value: Any, pointer: Any, place: Any) -> None:
        self.builder.store(value, self.at(pointer, place), align=4)


def _checked(name: str, array: Any, kind: Any, dimensions: int) -> None:
    if array != types.Array(kind, dimensions, "C"):
        raise TypingError(f"{name}: expected a contiguous array of {kind}, got {array}")


def _data(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    return context.make_array(kind)(context, builder, value).data


@intrinsic
def reach_rows(typing_context, splats, splat, left, top, work, place):  # type: ignore[no-untyped-def]
    """One bit for each row of the tile whose first pixel has its middle at (left, top) px: does the
    splat reach it? What `blend_rows` wants of it goes to work[place : place + KEPT]."""
    _checked("splats", splats, types.float32, 2)
    _checked("work", work, types.float32, 1)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        line = _Writer(builder, LINE)
        numbers = _data(context, builder, signature.args[0], arguments[0])
        work = _data(context, builder, signature.args[4], arguments[4])
        splat, left, top, place = arguments[1], arguments[2], arguments[3], arguments[5]
        start = builder.mul(splat, LONG(NUMBERS))
        x, y, p, q, r, log2_opacity, *color = (
            builder.load(builder.gep(numbers, [builder.add(start, LONG(k))])) for k in range(9)
        )
        steps = ir.Constant(LINE, [float(k) for k in range(TILE_PX)])
        columns = line.add(steps, line.everywhere(line.minus(left, x)))
        across = line.times(line.everywhere(p), columns)
        rows = line.add(steps, line.everywhere(line.minus(top, y)))
        down = line.times(line.everywhere(q), rows)
        v = line.times(line.everywhere(r), rows)
        rest = line.minus(line.everywhere(log2_opacity), line.times(v, v))
        for value, at in ((across, ACROSS), (down, DOWN), (rest, LEFT)):
            line.store(value, work, builder.add(place, LONG(at)))
        for k, value in enumerate(color):
            builder.store(value, builder.gep(work, [builder.add(place, LONG(COLOR + k))]))
        first, last = (
            line.everywhere(builder.extract_element(across, INT(k))) for k in (0, TILE_PX - 1)
        )
        beyond = line.minus(line.everywhere(-0.0), line.add(last, down))
        nearest = line.larger(line.larger(line.add(first, down), beyond), line.everywhere(0.0))
        most = line.minus(rest, line.times(nearest, nearest))
        faintest = line.everywhere(-float(FAINTEST) - SLACK)
        return builder.bitcast(builder.fcmp_ordered(">=", most, faintest), BYTE)

    kinds = types.uint64, types.float32, types.float32, work, types.uint64
    return types.uint8(splats, *kinds), generate


@intrinsic
def blend_rows(typing_context, tile, row, work, chosen, count):  # type: ignore[no-untyped-def]
    """Blend splats behind what two rows of a tile hold, tile[4 * 64], from `row` on: count of them,
    one at least; the places of their numbers in `work` are chosen[0] .. chosen[count - 1]."""
    _checked("tile", tile, types.float32, 1)
    _checked("work", work, types.float32, 1)
    _checked("chosen", chosen, types.uint32, 1)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        two, line = _Writer(builder, VECTOR), _Writer(builder, LINE)
        tile = _data(context, builder, signature.args[0], arguments[0])
        work = _data(context, builder, signature.args[2], arguments[2])
        chosen = _data(context, builder, signature.args[3], arguments[3])
        row, count = arguments[1], arguments[4]
        twice = ir.Constant(ir.VectorType(INT, LANES), list(range(TILE_PX)) * ROWS)
        beside = ir.Constant(ir.VectorType(INT, LANES), list(range(LANES)))
        pixel = builder.mul(row, LONG(TILE_PX))
        places = [builder.add(pixel, LONG(TILE_PX * TILE_PX * k)) for k in range(CHANNELS)]
        held = [two.load(tile, place) for place in places]
        before, loop = builder.block, builder.append_basic_block("blend")
        after = builder.append_basic_block("blended")
        builder.branch(loop)
        builder.position_at_end(loop)
        i, sums = builder.phi(LONG), [builder.phi(VECTOR) for _ in held]
        i.add_incoming(LONG(0), before)
        for phi, value in zip(sums, held, strict=True):
            phi.add_incoming(value, before)

        start = builder.zext(builder.load(builder.gep(chosen, [i])), LONG)

        def number(place: Any) -> Any:
            return builder.load(builder.gep(work, [builder.add(start, place)]))

        def of_rows(first: int) -> Any:
            """One number for each of the two rows, beside each other."""
            at = builder.add(row, LONG(first))
            values = [line.everywhere(number(builder.add(at, LONG(k)))) for k in range(ROWS)]
            return builder.shuffle_vector(*values, beside)

        across = line.load(work, builder.add(start, LONG(ACROSS)))
        across = builder.shuffle_vector(across, across, twice)
        u = two.add(across, of_rows(DOWN))
        power = two.minus(of_rows(LEFT), two.times(u, u))
        seen = builder.fcmp_ordered(">=", power, two.everywhere(-float(FAINTEST)))
        alpha = two.everywhere(POLYNOMIAL[-1])
        for coefficient in POLYNOMIAL[-2::-1]:
            alpha = two.add(two.times(alpha, power), two.everywhere(coefficient))
        alpha = builder.fmul(alpha, alpha)
        alpha = builder.fmul(alpha, alpha)
        through, *colors = sums
        weight = builder.select(seen, builder.fmul(alpha, through), two.everywhere(0.0))
        blended = [builder.fsub(through, weight)]
        for k, color in enumerate(colors):
            shade = two.everywhere(number(LONG(COLOR + k)))
            blended.append(two.add(two.times(weight, shade), color))

        following = builder.add(i, LONG(1))
        i.add_incoming(following, loop)
        for phi, value in zip(sums, blended, strict=True):
            phi.add_incoming(value, loop)
        builder.cbranch(builder.icmp_unsigned("<", following, count), loop, after)
        builder.position_at_end(after)
        for value, place in zip(blended, places, strict=True):
            two.store(value, tile, place)
        return context.get_dummy_value()

    kinds = types.uint64, work, chosen, types.uint64
    return types.void(tile, *kinds), generate


@intrinsic
def lets_through(typing_context, tile, least):  # type: ignore[no-untyped-def]
    """Does any pixel of a tile let so much through?"""
    _checked("tile", tile, types.float32, 1)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        two = _Writer(builder, VECTOR)
        tile = _data(context, builder, signature.args[0], arguments[0])
        least, some = two.everywhere(arguments[1]), ir.Constant(BITS, [0] * LANES)
        for first in range(0, TILE_PX * TILE_PX, LANES):
            value = two.load(tile, LONG(first))
            some = builder.or_(some, builder.fcmp_ordered(">=", value, least))
        kind = ir.FunctionType(ir.IntType(1), [BITS])
        name = f"llvm.vector.reduce.or.v{LANES}i1"
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), [some])

    return types.boolean(tile, least), generate


@intrinsic
def fetch(typing_context, splats, splat):  # type: ignore[no-untyped-def]
    """Bring a splat into the nearest cache, without waiting for it."""
    _checked("splats", splats, types.float32, 2)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        numbers = _data(context, builder, signature.args[0], arguments[0])
        start = builder.mul(arguments[1], LONG(NUMBERS))
        pointer = BYTE.as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer, INT, INT, INT])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        read, nearest, data = INT(0), INT(3), INT(1)
        for number in (0, NUMBERS - 4):  # most lie in two lines of the cache
            place = builder.gep(numbers, [builder.add(start, LONG(number))])
            builder.call(function, [builder.bitcast(place, pointer), read, nearest, data])
        return context.get_dummy_value()

    return types.void(splats, types.uint64), generate
