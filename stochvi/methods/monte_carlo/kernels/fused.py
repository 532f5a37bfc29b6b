"""A product and a sum with one rounding, which is one instruction of most processors.

The compiler puts a copy of a function into every kernel that calls it. Where it may choose which
products to fuse (`fastmath={"contract"}`), the copies round differently, and which of them runs
depends on the kernels that the process compiled before and on those that it loaded from the disk.
Kernels are therefore compiled without `fastmath`, and loops that gain from fusing call `fma`.
"""

from numba.core import types
from numba.extending import lower_builtin, type_callable


def fma(a: float, b: float, c: float) -> float:
    """a b + c, which compiled kernels round once."""
    return a * b + c


@type_callable(fma)
def type_of_fma(context):
    def typer(a, b, c):
        return types.float64

    return typer


@lower_builtin(fma, types.float64, types.float64, types.float64)
def write_fma(context, builder, signature, arguments):
    """One instruction; two, with a rounding each, on processors of x86 that lack it."""
    architecture, _, features = context.codegen().magic_tuple()
    if architecture.startswith("x86") and "+fma" not in features.split(","):
        return builder.fadd(builder.fmul(*arguments[:2]), arguments[2])
    return builder.fma(*arguments)
