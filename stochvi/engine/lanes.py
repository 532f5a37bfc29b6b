"""Numbers of many paths, a row for each number and a lane for each path, in one block of memory.

`rows_of(memory)` is a view (rows, ROW) whose strides are constants of the compiled code, and which
owns nothing. The compiler then knows that rows do not overlap: loops over the lanes become vector
instructions without a test at run time. It counts no references either. Rows must be numbers
that are known while compiling, or that do not change within a loop over the lanes.
"""

from __future__ import annotations

import numpy as np
from numba.core import types
from numba.extending import lower_builtin, type_callable

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


def _view(context, builder, signature, argument, first):
    """Emit a view of a block of memory, from a row on."""
    memory, result = signature.args[0], signature.return_type
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


@type_callable(rows_of)
def type_of_rows(context):
    return lambda memory: types.Array(memory.dtype, 2, "C")


@lower_builtin(rows_of, types.Array)
def write_rows(context, builder, signature, arguments):
    first = context.get_constant(types.intp, 0)
    return _view(context, builder, signature, arguments[0], first)


@type_callable(columns_of)
def type_of_columns(context):
    return lambda memory, first: types.Array(memory.dtype, 2, "F")


@lower_builtin(columns_of, types.Array, types.Integer)
def write_columns(context, builder, signature, arguments):
    first = context.cast(builder, arguments[1], signature.args[1], types.intp)
    return _view(context, builder, signature, arguments[0], first)


rows_of.made_of = {object: (type_of_rows, write_rows)}  # type: ignore[attr-defined]
columns_of.made_of = {object: (type_of_columns, write_columns)}  # type: ignore[attr-defined]
