"""How the decoder's loops are compiled, and a row of 16 numbers as one vector.

LLVM makes no vector of a plain loop over so few. What `mixed_row` returns are its lanes; those that
are stored side by side are stored together.
"""

from llvmlite import ir
from numba import njit, types
from numba.core.errors import TypingError
from numba.extending import intrinsic

LANES = 16
ROW = ir.VectorType(ir.FloatType(), LANES)
INDEX = ir.IntType(32)
FUSED = "contract"  # a product and its sum are rounded once where the machine can
loop = njit(cache=True, nogil=True, error_model="numpy", fastmath={FUSED})


@intrinsic
def mixed_row(typing_context, table, a, b, c, p, q, r):  # type: ignore[no-untyped-def]
    """[n, 16] floats, three rows (uintp) and their shares (float32) -> 16 floats."""
    if table != types.Array(types.float32, 2, "C"):
        raise TypingError(f"mixed_row: expected a contiguous float32 table, got {table}")
    signature = types.UniTuple(types.float32, LANES)(table, a, b, c, p, q, r)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        first = builder.bitcast(array.data, ROW.as_pointer())
        total = None
        for index, share in zip(arguments[1:4], arguments[4:], strict=True):
            row = builder.load(builder.gep(first, [index]))
            row.align = 4
            one = builder.insert_element(ir.Constant(ROW, ir.Undefined), share, INDEX(0))
            lanes = ir.Constant(ir.VectorType(INDEX, LANES), [0] * LANES)
            shares = builder.shuffle_vector(one, ir.Constant(ROW, ir.Undefined), lanes)
            part = builder.fmul(shares, row, flags=(FUSED,))
            total = part if total is None else builder.fadd(total, part, flags=(FUSED,))
        numbers = [builder.extract_element(total, INDEX(k)) for k in range(LANES)]
        return context.make_tuple(builder, signature.return_type, numbers)

    return signature, generate
