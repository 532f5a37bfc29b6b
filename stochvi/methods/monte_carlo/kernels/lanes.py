"""Views of rows of numbers of many paths (lanes) that own nothing.

An array that a kernel makes of a part of another one counts its owners: each time that it is named
or chosen an atomic number is changed. In a step of few paths that takes longer than the step. A
view from `row_of` has no owner, so that there is nothing to count; what it shows must outlive it.

Rows of one memory, in functions that are put where they are called (`inline="always"`), lie at
distances that the compiler knows: loops over the lanes then need no test of whether rows overlap,
which takes as long as the loop over 20 lanes.
"""

from functools import partial

import numpy as np
from numba.core import types
from numba.core.imputils import impl_ret_borrowed
from numba.extending import lower_builtin, type_callable

from stochvi.engine.compiling import kernel

LANES = 256
"""Number of paths that are advanced together: their dozen arrays of 2 kB each stay in the
first-level cache."""

CACHE_LINE = 8
"""Numbers in a line of the cache, 64 bytes."""

ROW = LANES + CACHE_LINE
"""Numbers from one row to the next: rows at a distance of a power of two would compete for the same
places of the cache."""


@kernel
def aligned_rows(rows):
    """Zeros (rows, ROW) whose rows begin at lines of the cache: a vector then never lies in two
    lines."""
    return rows_of(np.zeros(rows * ROW + CACHE_LINE))


def rows_of(room):
    """The rows of a room of float numbers, from its first line of the cache on."""
    skipped = (-(room.ctypes.data // 8)) % CACHE_LINE
    rows = (room.size - CACHE_LINE) // ROW
    return room[skipped : skipped + rows * ROW].reshape((rows, ROW))


@type_callable(rows_of)
def type_of_rows(context):
    def typer(room):
        return types.Array(room.dtype, 2, "C")

    return typer


@lower_builtin(rows_of, types.Array)
def write_rows(context, builder, signature, arguments):
    """Emit the view, which has the owner of the room. `reshape` would compile what numba says of
    its errors as well, which takes a second."""
    source = context.make_array(signature.args[0])(context, builder, value=arguments[0])
    kind = signature.return_type
    view = context.make_array(kind)(context, builder)
    number = partial(context.get_constant, types.intp)
    address = builder.ptrtoint(source.data, context.get_value_type(types.intp))
    line = number(8 * CACHE_LINE)
    first = builder.mul(builder.sdiv(builder.add(address, number(8 * CACHE_LINE - 1)), line), line)
    rows = builder.sdiv(builder.sub(source.nitems, number(CACHE_LINE)), number(ROW))
    context.populate_array(
        view, data=builder.inttoptr(first, source.data.type), shape=(rows, number(ROW)),
        strides=(number(8 * ROW), number(8)), itemsize=number(8),
        meminfo=source.meminfo, parent=source.parent,
    )  # fmt: skip
    return impl_ret_borrowed(context, builder, kind, view._getvalue())


rows_of.made_of = {object: (type_of_rows, write_rows)}


def words_of(memory):
    """Rows of float numbers as rows of words of the same bits."""
    return memory.view(np.uint64)


@type_callable(words_of)
def type_of_words(context):
    def typer(memory):
        return memory.copy(dtype=types.uint64)

    return typer


@lower_builtin(words_of, types.Array)
def write_words(context, builder, signature, arguments):
    """Emit the view: numba's own `view` compiles the texts of its errors as well."""
    source = context.make_array(signature.args[0])(context, builder, value=arguments[0])
    view = context.make_array(signature.return_type)(context, builder)
    context.populate_array(
        view, data=builder.bitcast(source.data, view.data.type), shape=source.shape,
        strides=source.strides, itemsize=source.itemsize, meminfo=source.meminfo,
        parent=source.parent,
    )  # fmt: skip
    return impl_ret_borrowed(context, builder, signature.return_type, view._getvalue())


words_of.made_of = {object: (type_of_words, write_words)}


def row_of(memory, row, lanes):
    """The first `lanes` numbers of a row of `aligned_rows`."""
    return memory[row, :lanes]


@type_callable(row_of)
def type_of_row(context):
    def typer(memory, row, lanes):
        return types.Array(memory.dtype, 1, "C")

    return typer


@lower_builtin(row_of, types.Array, types.Integer, types.Integer)
def write_row(context, builder, signature, arguments):
    """Emit the view: a place, a length and a stride, without an owner."""
    memory, row, lanes = arguments
    source = context.make_array(signature.args[0])(context, builder, value=memory)
    view = context.make_array(signature.return_type)(context, builder)
    size = context.get_abi_sizeof(context.get_data_type(signature.return_type.dtype))
    stride = context.get_constant(types.intp, size)
    offset = builder.mul(row, context.get_constant(types.intp, ROW))
    context.populate_array(
        view, data=builder.gep(source.data, [offset]), shape=(lanes,), strides=(stride,),
        itemsize=stride, meminfo=None, parent=None,
    )  # fmt: skip
    return view._getvalue()


row_of.made_of = {object: (type_of_row, write_row)}
