"""How the decoder's loops are compiled, and what becomes of a Gaussian as vectors of LLVM.

LLVM makes no vectors of a plain loop over so few numbers.
"""

from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic

LANES, QUARTER = 16, 4
FLOAT, INDEX = ir.FloatType(), ir.IntType(32)
ROW, FOUR, PAIR = (ir.VectorType(FLOAT, lanes) for lanes in (LANES, QUARTER, 2))
FIRST_THREE = ir.Constant(ir.VectorType(ir.IntType(1), QUARTER), [1, 1, 1, 0])
FUSED = "contract"  # a product and its sum are rounded once where the machine can
loop = njit(cache=True, nogil=True, error_model="numpy", fastmath={FUSED})


@intrinsic
def place_gaussian(  # type: ignore[no-untyped-def]
    typing_context, table, a, b, c, p, q, r, deep, behind, albedo, share,
    means, quats, colors, shine, n,
):  # fmt: skip
    """Mix three rows [n, 16] (uintp) of what vertices hand on, see `light.vertex_attributes`, by
    their shares (float32), and make Gaussian n of them: its place so `deep` under the skin, its
    turn, light on its albedo, `share` of the light that it mirrors."""
    for array in (table, albedo, means, quats, colors, shine):
        if array != types.Array(types.float32, 2, "C"):
            raise TypingError(f"place_gaussian: expected contiguous float32 [n, m], got {array}")
    arguments = table, a, b, c, p, q, r, deep, behind, albedo, share, means, quats, colors, shine, n

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        def start(k, width, kind):  # type: ignore[no-untyped-def]
            """Where the numbers of this Gaussian begin in an array."""
            array = context.make_array(signature.args[k])(context, builder, values[k])
            place = builder.gep(array.data, [builder.mul(values[-1], values[-1].type(width))])
            return builder.bitcast(place, kind.as_pointer())

        def times(x, y):  # type: ignore[no-untyped-def]
            return builder.fmul(x, y, flags=(FUSED,))

        def store_three(value, k):  # type: ignore[no-untyped-def]
            pointer = FOUR.as_pointer()
            kind = ir.FunctionType(ir.VoidType(), [FOUR, pointer, INDEX, FIRST_THREE.type])
            masked = cgutils.get_or_insert_function(
                builder.module, kind, "llvm.masked.store.v4f32.p0"
            )
            builder.call(masked, [value, start(k, 3, FOUR), INDEX(4), FIRST_THREE])

        array = context.make_array(signature.args[0])(context, builder, values[0])
        first, total = builder.bitcast(array.data, ROW.as_pointer()), None
        for index, weight in zip(values[1:4], values[4:7], strict=True):
            row = builder.load(builder.gep(first, [index]))
            row.align = 4
            part = times(_spread(builder, weight, ROW), row)
            total = part if total is None else builder.fadd(total, part, flags=(FUSED,))

        place, turn, light = (_lanes(builder, total, range(k, k + 4)) for k in (0, 4, 8))
        # the normal as it stands in the turn: z + behind, -y, x
        signed = times(_spread(builder, values[7], FOUR), ir.Constant(FOUR, [-1.0, 1.0, -1.0, 0.0]))
        too_far = builder.insert_element(ir.Constant(FOUR, [0.0] * 4), values[8], INDEX(2))
        normal = builder.fsub(_lanes(builder, total, (6, 5, 4, 7)), too_far)
        store_three(builder.fadd(place, times(signed, normal), flags=(FUSED,)), 11)
        builder.store(turn, start(12, 4, FOUR)).align = 4

        kind = ir.FunctionType(FOUR, [FOUR.as_pointer(), INDEX, FIRST_THREE.type, FOUR])
        masked = cgutils.get_or_insert_function(builder.module, kind, "llvm.masked.load.v4f32.p0")
        nothing = ir.Constant(FOUR, [0.0] * 4)
        white = builder.call(masked, [start(9, 3, FOUR), INDEX(4), FIRST_THREE, nothing])
        store_three(builder.fmul(white, light), 13)

        mirrored = builder.fmul(
            _lanes(builder, total, (12, 13)), _spread(builder, values[10], PAIR)
        )
        builder.store(mirrored, start(14, 4, PAIR)).align = 4
        return context.get_dummy_value()

    return types.void(*arguments), generate


def _spread(builder: Any, number: Any, kind: ir.VectorType) -> Any:
    """A vector of one number."""
    empty, lanes = ir.Constant(kind, ir.Undefined), ir.VectorType(INDEX, kind.count)
    first = builder.insert_element(empty, number, INDEX(0))
    return builder.shuffle_vector(first, empty, ir.Constant(lanes, [0] * kind.count))


def _lanes(builder: Any, row: Any, lanes: Any) -> Any:
    """Some of a row's numbers."""
    chosen = list(lanes)
    kind = ir.VectorType(INDEX, len(chosen))
    return builder.shuffle_vector(row, ir.Constant(ROW, ir.Undefined), ir.Constant(kind, chosen))
