"""Waiting awake, for what takes some millionths of a second: to be woken may take three hundred."""

# pyright: basic, reportUntypedFunctionDecorator=false
import platform
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

LOOKS = 10_000  # .2 to .4 ms
X86 = platform.machine() in ("x86_64", "AMD64")


@intrinsic
def _look(typing_context, flags, k):  # type: ignore[no-untyped-def]
    """flags[k] as another thread has left it, after a short rest."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        if X86:  # leaves the core to its other thread for a moment
            kind: Any = ir.FunctionType(ir.VoidType(), [])
            name = "llvm.x86.sse2.pause"
            builder.call(cgutils.get_or_insert_function(builder.module, kind, name), [])
        place = builder.gep(array.data, [arguments[1]])
        return builder.load_atomic(place, "acquire", 8)

    return types.int64(flags, k), generate


@njit(cache=True, nogil=True)
def wait_for(flags: NDArray[np.int64], count: int) -> None:
    """Until so many of the flags are not 0, or LOOKS times; other threads set them meanwhile."""
    k = seen = 0
    for _ in range(LOOKS):
        if seen == count:
            return
        seen += _look(flags, k) != 0  # pyright: ignore[reportCallIssue]
        k = k + 1 if k + 1 < len(flags) else 0
        if k == 0 and seen < count:
            seen = 0
