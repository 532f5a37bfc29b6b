"""Numbers of many paths, a row for each number and a lane for each path, in one block of memory.

`rows_of(memory)` is a view (rows, ROW) whose strides are constants of the compiled code, and which
owns nothing. The compiler then knows that rows do not overlap, so that loops over the lanes become
vector instructions without a test at run time, and it counts no references. Rows must be numbers
that are known while compiling, or that do not change within a loop over the lanes.
"""

from __future__ import annotations

import numpy as np
from numba.core import types
from numba.extending import intrinsic, overload

from stochvi.engine.compiling import kernel

LANES = 512
"""Largest number of lanes of a block of memory."""

ROW = LANES + 8
"""Distance between rows: rows at a distance of a power of two would compete for the same lines of
the cache."""


@kernel
def memory_of(rows):
    """Zeros for that number of rows."""
    return np.zeros(rows * ROW)


def rows_of(memory):
    """The rows of a block of memory."""
    return memory.reshape(-1, ROW)


@intrinsic
def _rows_of(typing, memory):
    """The same for compiled functions."""
    result = types.Array(memory.dtype, 2, "C")

    def codegen(context, builder, signature, arguments):
        source = context.make_array(memory)(context, builder, value=arguments[0])
        view = context.make_array(result)(context, builder)
        item = context.get_abi_sizeof(context.get_data_type(memory.dtype))

        def number(value):
            return context.get_constant(types.intp, value)

        rows = builder.sdiv(source.nitems, number(ROW))
        context.populate_array(
            view,
            data=source.data,
            shape=(rows, number(ROW)),
            strides=(number(ROW * item), number(item)),
            itemsize=number(item),
            meminfo=None,
            parent=None,
        )
        return view._getvalue()

    return result(memory), codegen


@overload(rows_of)
def _choose(memory):
    return lambda memory: _rows_of(memory)


rows_of.made_of = {object: (_choose,)}  # type: ignore[attr-defined]
