"""Numbers of many paths, a row for each number and a lane for each path, in one block of memory.

`rows_of(memory)` is a view (rows, ROW) whose strides are constants of the compiled code, and which
owns nothing. The compiler then knows that rows do not overlap: loops over the lanes become vector
instructions without a test at run time. It counts no references either. Rows must be numbers
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


@kernel(inline="always")
def lanes_from(low, high):
    """The lanes from `low` to `high` - 1, without a sign.

    A signed number that may be negative counts from the end, which would cost the vectors.
    """
    return range(np.uint64(low), np.uint64(high))


def rows_of(memory):
    """The rows of a block of memory."""
    return memory.reshape(-1, ROW)


def columns_of(memory, first):
    """The rows from `first` on, by lanes: (ROW, rows)."""
    return rows_of(memory)[first:].T


def _view(context, builder, memory, argument, result, first):
    """A view of a block of memory as an array of this type, from a row on."""
    source = context.make_array(memory)(context, builder, value=argument)
    view = context.make_array(result)(context, builder)
    item = context.get_abi_sizeof(context.get_data_type(memory.dtype))

    def number(value):
        return context.get_constant(types.intp, value)

    rows = builder.sub(builder.sdiv(source.nitems, number(ROW)), first)
    shape, strides = (rows, number(ROW)), (number(ROW * item), number(item))
    context.populate_array(
        view,
        data=builder.gep(source.data, [builder.mul(first, number(ROW))]),
        shape=shape if result.layout == "C" else shape[::-1],
        strides=strides if result.layout == "C" else strides[::-1],
        itemsize=number(item),
        meminfo=None,
        parent=None,
    )
    return view._getvalue()


@intrinsic
def _rows_of(typing, memory):
    """The same for compiled functions."""
    result = types.Array(memory.dtype, 2, "C")

    def codegen(context, builder, signature, arguments):
        first = context.get_constant(types.intp, 0)
        return _view(context, builder, memory, arguments[0], result, first)

    return result(memory), codegen


@intrinsic
def _columns_of(typing, memory, first):
    """The same for compiled functions."""
    result = types.Array(memory.dtype, 2, "F")

    def codegen(context, builder, signature, arguments):
        return _view(context, builder, memory, arguments[0], result, arguments[1])

    return result(memory, types.intp), codegen


@overload(rows_of)
def _choose(memory):
    return lambda memory: _rows_of(memory)


@overload(columns_of)
def _choose_columns(memory, first):
    return lambda memory, first: _columns_of(memory, first)


rows_of.made_of = {object: (_choose,)}  # type: ignore[attr-defined]
columns_of.made_of = {object: (_choose_columns,)}  # type: ignore[attr-defined]
