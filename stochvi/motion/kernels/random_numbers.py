"""Random numbers for many paths at once. Chapters: rows of numbers that own nothing; streams and
normals."""

import math
from functools import partial

import numpy as np
from numba.core import types
from numba.core.imputils import impl_ret_borrowed
from numba.extending import lower_builtin, type_callable
from numpy.typing import NDArray

from stochvi.engine.arithmetic import GOLDEN, bits_of, fma, number_of, split_mix
from stochvi.engine.compiling import kernel

# ------------------------------------------------------------------------------
# Views of rows of numbers of many paths (lanes) that own nothing.
#
# An array that a kernel makes of a part of another one counts its owners: each time that it is
# named or chosen an atomic number is changed. In a step of few paths that takes longer than the
# step. A view from `row_of` has no owner, so that there is nothing to count; what it shows must
# outlive it.
#
# Rows of one memory, in functions that are put where they are called (`inline="always"`), lie at
# distances that the compiler knows: loops over the lanes then need no test of whether rows overlap,
# which takes as long as the loop over 20 lanes.
# ------------------------------------------------------------------------------


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


# ------------------------------------------------------------------------------
# Random numbers for many paths at once: one xoroshiro128++ stream per path, normals in pairs.
#
# The stream belongs to the path: its state is expanded from (seed, path) by SplitMix64, so that
# results depend neither on threads nor on how paths are gathered into blocks. Loops run over the
# paths of a block, hold no branches, and vectorise.
#
# Generator: D. Blackman and S. Vigna, ACM Trans. Math. Softw. 47 (2021) 36; two words of state, so
# that a loop over paths has few arrays to prove distinct, which the vectoriser needs. Normals: G.
# E. P. Box and M. E. Muller, Ann. Math. Statist. 29 (1958) 610, with both uniforms of 52 bits, so
# that the largest normal is sqrt(2 * 52 ln 2) = 8.49.
# ------------------------------------------------------------------------------


ONE_BITS = np.uint64(0x3FF0000000000000)
MANTISSA = np.uint64(0x000FFFFFFFFFFFFF)
S12, S15, S17, S21 = (np.uint64(n) for n in (12, 15, 17, 21))
S28, S36, S47, S49 = (np.uint64(n) for n in (28, 36, 47, 49))
LN2 = math.log(2.0)
SQRT2 = math.sqrt(2.0)
QUARTER_TURN = math.pi / 2.0


def seed_streams(
    seed: int | np.uint64, first_path: int, state: NDArray[np.uint64], apart: int = 1
) -> None:
    """Fill `state` (2, paths) for the paths first_path, first_path + 1, ..., or those `apart`."""
    mix = getattr(split_mix, "py_func", split_mix)  # not compiled: it is asked once
    paths = (first_path + apart * np.arange(state.shape[1])).astype(np.uint64)
    z = mix(mix(np.array([seed], np.uint64) + GOLDEN) + paths * GOLDEN)
    for word in range(2):
        z += GOLDEN
        state[word] = mix(z)


@kernel(forceinline=True)
def log_unit(u):
    """Natural logarithm of 2^-52 <= u <= 1, relative error below 1e-15."""
    bits = bits_of(u)
    exponent = np.int64(bits >> np.uint64(52)) - 1023
    m = number_of((bits & MANTISSA) | ONE_BITS)
    high = m > SQRT2
    m = m * 0.5 if high else m
    e = float(exponent + 1) if high else float(exponent)
    # ln m = 2 artanh t, |t| <= 0.1716
    t = (m - 1.0) / (m + 1.0)
    q = t * t
    s = 1.0 / 21.0
    s = fma(s, q, 1.0 / 19.0)
    s = fma(s, q, 1.0 / 17.0)
    s = fma(s, q, 1.0 / 15.0)
    s = fma(s, q, 1.0 / 13.0)
    s = fma(s, q, 1.0 / 11.0)
    s = fma(s, q, 1.0 / 9.0)
    s = fma(s, q, 1.0 / 7.0)
    s = fma(s, q, 1.0 / 5.0)
    s = fma(s, q, 1.0 / 3.0)
    s = fma(s, q, 1.0)
    return fma(e, LN2, 2.0 * t * s)


@kernel(forceinline=True)
def normal_pair(s0, s1):
    """Two independent standard normals from two draws: the new state, and the normals."""
    t = s0 + s1
    draw_1 = ((t << S17) | (t >> S47)) + s0
    s1 ^= s0
    s0 = ((s0 << S49) | (s0 >> S15)) ^ s1 ^ (s1 << S21)
    s1 = (s1 << S28) | (s1 >> S36)
    t = s0 + s1
    draw_2 = ((t << S17) | (t >> S47)) + s0
    s1 ^= s0
    s0 = ((s0 << S49) | (s0 >> S15)) ^ s1 ^ (s1 << S21)
    s1 = (s1 << S28) | (s1 >> S36)

    u = 2.0 - number_of((draw_1 >> S12) | ONE_BITS)
    radius = math.sqrt(-2.0 * log_unit(u))
    # the angle is a quarter turn chosen by two bits and a remainder within +-pi/4
    a = (number_of((draw_2 >> S12) | ONE_BITS) - 1.5) * QUARTER_TURN
    q = a * a
    sine = -7.6471637318198164759e-13
    sine = fma(sine, q, 1.6059043836821614599e-10)
    sine = fma(sine, q, -2.5052108385441718775e-8)
    sine = fma(sine, q, 2.7557319223985890653e-6)
    sine = fma(sine, q, -1.9841269841269841270e-4)
    sine = fma(sine, q, 8.3333333333333333333e-3)
    sine = fma(sine, q, -1.6666666666666666667e-1)
    sine = fma(sine, q, 1.0) * a
    cosine = 4.7794773323873852974e-14
    cosine = fma(cosine, q, -1.1470745597729724714e-11)
    cosine = fma(cosine, q, 2.0876756987868098979e-9)
    cosine = fma(cosine, q, -2.7557319223985890653e-7)
    cosine = fma(cosine, q, 2.4801587301587301587e-5)
    cosine = fma(cosine, q, -1.3888888888888888889e-3)
    cosine = fma(cosine, q, 4.1666666666666666667e-2)
    cosine = fma(cosine, q, -0.5)
    cosine = fma(cosine, q, 1.0)
    swap = (draw_2 & np.uint64(1)) != 0
    x = sine if swap else cosine
    y = cosine if swap else sine
    sign = radius if (draw_2 & np.uint64(2)) != 0 else -radius
    return s0, s1, x * sign, y * sign


@kernel(inline="always")
def normal_pairs(state0, state1, first, second):
    """Two independent standard normals per path; advances every stream by two draws."""
    for i in range(first.shape[0]):
        state0[i], state1[i], first[i], second[i] = normal_pair(state0[i], state1[i])


@kernel
def normal_rows(state0, state1, first, second):
    """Fill (rows, paths) arrays with pairs of normals, row after row."""
    for row in range(first.shape[0]):
        normal_pairs(state0, state1, first[row], second[row])
