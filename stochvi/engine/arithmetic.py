"""Small compiled helpers that all kernels share. Chapters: products and sums with one rounding;
bits of a float; rows of numbers of many paths; first roots of cubics and quintics; random numbers
of events; rows of impact sums; when a path rests on a stop; logs of impacts."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba.core import types
from numba.extending import lower_builtin, type_callable
from numpy.typing import NDArray

from stochvi.engine.compiling import kernel

# ------------------------------------------------------------------------------
# A product and a sum with one rounding, which is one instruction of most processors.
#
# The compiler puts a copy of a function into every kernel that calls it. With
# `fastmath={"contract"}` it may choose which products to fuse, and the copies round differently.
# Which copy runs then depends on the kernels that the process has compiled or loaded before.
# Kernels are therefore compiled without `fastmath`, and loops that gain from fusing call `fma`.
# ------------------------------------------------------------------------------


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
    """Emit one instruction, or two with a rounding each on x86 processors that lack it."""
    architecture, _, features = context.codegen().magic_tuple()
    if architecture.startswith("x86") and "+fma" not in features.split(","):
        return builder.fadd(builder.fmul(*arguments[:2]), arguments[2])
    return builder.fma(*arguments)


fma.made_of = {object: (type_of_fma, write_fma)}


# ------------------------------------------------------------------------------
# The bits of a float number as a word, and back: one instruction, or none.
#
# numba compiles a function for each `np.float64(x).view(np.uint64)` of a kernel.
# ------------------------------------------------------------------------------


def bits_of(number: float) -> np.uint64:
    """The bits of a float number."""
    return np.float64(number).view(np.uint64)


def number_of(bits: np.uint64) -> np.float64:
    """The float number of these bits."""
    return np.uint64(bits).view(np.float64)


@type_callable(bits_of)
def type_of_bits(context: Any) -> Any:
    return lambda number: types.uint64


@type_callable(number_of)
def type_of_number(context: Any) -> Any:
    return lambda bits: types.float64


@lower_builtin(bits_of, types.float64)
@lower_builtin(number_of, types.uint64)
def write_cast(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Emit the other view of the same bits."""
    return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))


bits_of.made_of = {object: (type_of_bits, write_cast)}  # type: ignore[attr-defined]
number_of.made_of = {object: (type_of_number, write_cast)}  # type: ignore[attr-defined]


# ------------------------------------------------------------------------------
# Numbers of many paths, a row for each number and a lane for each path, in one block of memory.
#
# `rows_of(memory)` is a view (rows, ROW) whose strides are constants of the compiled code, and
# which owns nothing. The compiler then knows that rows do not overlap: loops over the lanes become
# vector instructions without a test at run time. It counts no references either. Rows must be
# numbers that are known while compiling, or that do not change within a loop over the lanes.
# ------------------------------------------------------------------------------


LANES = 512
"""Largest number of lanes of a block of memory."""

LINE = 8
"""Numbers in a line of the cache."""

ROW = LANES + LINE
"""Distance between rows: rows at a distance of a power of two would compete for the same lines of
the cache."""


def cleared(*shape: int, of: type = float) -> NDArray[Any]:
    """Zeros that begin with a line of the cache, as vectors are read fastest."""
    count = math.prod(shape)
    memory = np.zeros(count + LINE, of)
    first = -(memory.ctypes.data // memory.itemsize) % LINE
    return memory[first : first + count].reshape(shape)


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


# ------------------------------------------------------------------------------
# First roots of the polynomials that a displacement is between two instants.
#
# Polynomials are given by values and slopes at both ends (cubics), or by their Bernstein
# coefficients c0 ... c5 (quintics), whose hull holds the polynomial. A root counts where the
# polynomial rises.
# ------------------------------------------------------------------------------


SHORTEST_PIECE = 2.0**-40
"""Smallest part of an interval in which a first root is searched: a shorter excursion is not
seen."""

ROOT_ERROR = 1e-7
"""Relative change of a root in the last Newton step to it: as the method is of second order, what
is left is about the square of that."""


@kernel(forceinline=True)
def rises_once(c1, c2, c3, c4, c5):
    """Whether Bernstein coefficients after a first one <= 0 change sign once, to positive."""
    early = ((c1 <= 0.0) | (c2 > 0.0)) & ((c2 <= 0.0) | (c3 > 0.0))
    return early & ((c3 <= 0.0) | (c4 > 0.0)) & (c5 > 0.0)


@kernel
def bracketed_root(c0, c1, c2, c3, c4, c5):
    """The upward root in (0, 1] of a polynomial that has one, c0 <= 0 < c5, and its slope there."""
    # coefficients by powers, from the differences
    k1, k2 = 5.0 * (c1 - c0), 10.0 * (c2 - 2.0 * c1 + c0)
    k3 = 10.0 * (c3 - 3.0 * (c2 - c1) - c0)
    k4 = 5.0 * (c4 - 4.0 * (c3 + c1) + 6.0 * c2 + c0)
    k5 = c5 - c0 - k1 - k2 - k3 - k4
    low, high, t = 0.0, 1.0, c0 / (c0 - c5)
    slope = 0.0
    for _ in range(100):
        value = c0 + t * (k1 + t * (k2 + t * (k3 + t * (k4 + t * k5))))
        slope = k1 + t * (2.0 * k2 + t * (3.0 * k3 + t * (4.0 * k4 + t * 5.0 * k5)))
        if value > 0.0:
            high = t
        else:
            low = t
        following = t - value / slope if slope > 0.0 else -1.0
        # the ends are allowed: at the root Newton's step may round to nothing
        if not (low <= following <= high):
            following = 0.5 * (low + high)
        near = abs(following - t) <= ROOT_ERROR * t
        t = following
        if near:
            break
    slope = k1 + t * (2.0 * k2 + t * (3.0 * k3 + t * (4.0 * k4 + t * 5.0 * k5)))
    return t, slope


@kernel
def first_root(c0, c1, c2, c3, c4, c5, stack):
    """First upward root in (0, 1] of a polynomial with c0 <= 0 and its slope there; 2 for no root.

    By Descartes' rule in Bernstein form there is no root without a sign change, and one root with
    one change; with more changes the interval is halved. The halves still to be searched are rows
    (coefficients, start, end) of `stack`.
    """
    start, end = 0.0, 1.0
    waiting = 0
    while True:
        positive, changes = False, 0
        for c in (c1, c2, c3, c4, c5):
            if c != 0.0 and (c > 0.0) != positive:
                positive = not positive
                changes += 1
        if changes == 1:
            t, slope = bracketed_root(c0, c1, c2, c3, c4, c5)
            return start + (end - start) * t, slope / (end - start)
        if changes > 1 and waiting < stack.shape[0] and end - start > SHORTEST_PIECE:
            # de Casteljau in the middle: the left half goes on, the right half waits
            row = stack[waiting]
            middle = 0.5 * (start + end)
            row[5], row[6], row[7] = c5, middle, end
            c1, c2, c3, c4, c5 = (
                0.5 * (c0 + c1), 0.5 * (c1 + c2), 0.5 * (c2 + c3), 0.5 * (c3 + c4), 0.5 * (c4 + c5),
            )  # fmt: skip
            row[4] = c5
            c2, c3, c4, c5 = 0.5 * (c1 + c2), 0.5 * (c2 + c3), 0.5 * (c3 + c4), 0.5 * (c4 + c5)
            row[3] = c5
            c3, c4, c5 = 0.5 * (c2 + c3), 0.5 * (c3 + c4), 0.5 * (c4 + c5)
            row[2] = c5
            c4, c5 = 0.5 * (c3 + c4), 0.5 * (c4 + c5)
            row[1] = c5
            c5 = 0.5 * (c4 + c5)
            row[0] = c5
            end = middle
            waiting += 1
            continue
        if waiting == 0:
            return 2.0, 0.0
        waiting -= 1
        row = stack[waiting]
        c0, c1, c2, c3, c4, c5 = min(row[0], 0.0), row[1], row[2], row[3], row[4], row[5]
        start, end = row[6], row[7]


@kernel
def cubic_between(x0, v0, x1, v1, span):
    """Coefficients by powers of time of the cubic with these values and slopes at 0 and `span`."""
    mean = (x1 - x0) / span
    return x0, v0, (3.0 * mean - 2.0 * v0 - v1) / span, (v0 + v1 - 2.0 * mean) / (span * span)


@kernel
def cubic_maximum(f0, r0, f1, r1, span):
    """Largest value of the cubic with these values and slopes at the ends."""
    highest = max(f0, f1)
    if r0 > 0.0 and r1 < 0.0:
        _, c, half, third = cubic_between(f0, r0, f1, r1, span)
        # where c + 2 half t + 3 third t^2 falls through 0
        t = c / (math.sqrt(max(half * half - 3.0 * third * c, 0.0)) - half)
        highest = max(highest, f0 + t * (c + t * (half + t * third)))
    return highest


@kernel
def first_upward_root(c0, c1, c2, c3):
    """First s in (0, 1] where c0 + c1 s + c2 s^2 + c3 s^3 crosses 0 upwards, or 2 for none.

    The cubic starts at or below 0. Its pieces between extrema are monotone, so each holds at
    most one root, which Newton's method finds, kept within bounds by bisection.
    """
    if c0 == 0.0 and c1 == 0.0 and c2 > 0.0:
        return 0.0  # from rest on the stop
    extrema = (2.0, 2.0)
    discriminant = c2 * c2 - 3.0 * c1 * c3
    if discriminant > 0.0:
        q = -(c2 + math.copysign(math.sqrt(discriminant), c2))
        first = q / (3.0 * c3) if c3 != 0.0 else 2.0
        second = c1 / q if q != 0.0 else 2.0
        extrema = (min(first, second), max(first, second))
    left, left_value = 0.0, min(c0, 0.0)
    for piece in range(3):
        right = 1.0 if piece == 2 else extrema[piece]
        if not (left < right <= 1.0):
            continue
        right_value = c0 + right * (c1 + right * (c2 + right * c3))
        if left_value <= 0.0 and right_value > 0.0:
            low, high = left, right
            s = left - left_value * (right - left) / (right_value - left_value)
            for _ in range(60):
                value = c0 + s * (c1 + s * (c2 + s * c3))
                if value > 0.0:
                    high = s
                else:
                    low = s
                slope = c1 + s * (2.0 * c2 + s * 3.0 * c3)
                step = s - value / slope if slope != 0.0 else -1.0
                # the ends are allowed: at the root Newton's step may round to nothing
                following = step if low <= step <= high else 0.5 * (low + high)
                if abs(following - s) <= 1e-15 or high - low <= 1e-15:
                    break
                s = following
            return s
        left, left_value = right, right_value
    return 2.0


@kernel
def time_to_stop(x0, v0, x1, v1, span, stop):
    """Fraction of the interval until x crosses `stop` upwards, 2 for never, and the speed there."""
    top = max(max(x0 + v0 * span / 3.0, x1 - v1 * span / 3.0), max(x0, x1))
    if top <= stop:  # the cubic lies in the hull of its four control points
        return 2.0, 0.0
    rise = x1 - x0
    c1 = v0 * span
    c2 = 3.0 * rise - (2.0 * v0 + v1) * span
    c3 = (v0 + v1) * span - 2.0 * rise
    s = first_upward_root(x0 - stop, c1, c2, c3)
    return s, max((c1 + s * (2.0 * c2 + s * 3.0 * c3)) / span, 0.0)


# ------------------------------------------------------------------------------
# Random numbers that belong to an event of a path, and not to its stream.
#
# SplitMix64 turns a word that belongs to a path and a step, and the number of an event in that
# step, into one uniform number. Nothing is kept or advanced: the number is the same however paths
# are gathered into blocks. The normals of the path are the same with and without it.
#
# Generator: G. L. Steele, D. Lea and C. H. Flood, OOPSLA 2014, 453.
# ------------------------------------------------------------------------------


GOLDEN = np.uint64(0x9E3779B97F4A7C15)
MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
MIX_2 = np.uint64(0x94D049BB133111EB)
S12, S27, S30, S31 = (np.uint64(n) for n in (12, 27, 30, 31))
UNIT = 2.0**-52
LOW_BITS = 0xFFFFFFFF
"""Bits of the number of a step, which is negative in a burn-in."""


@kernel(forceinline=True)
def split_mix(z):
    """One output of SplitMix64 for the counter z."""
    z = (z ^ (z >> S30)) * MIX_1
    z = (z ^ (z >> S27)) * MIX_2
    return z ^ (z >> S31)


@kernel
def word_of_step(word, number):
    """The word of a step of a path, from a word of its stream and the number of the step."""
    return word + np.uint64(number & LOW_BITS) * GOLDEN


@kernel
def uniform_of(word, number):
    """A uniform number in (0, 1) of the event `number` that belongs to a word."""
    bits = split_mix(split_mix(word) + np.uint64(number) * GOLDEN) >> S12
    return (np.float64(bits) + 0.5) * UNIT


# ------------------------------------------------------------------------------
# Rows of the sums over the impacts and contacts of a pair; per unit of its reduced mass.
# ------------------------------------------------------------------------------


ROWS_OF_PAIR = 6
"""Rows of the impacts of a pair: N, F1 and F2 at the lower stop, then at the upper stop."""

IMPULSE, LOSS, PEAK, TIME, ENDED = range(5)
ROWS_OF_STOP = 5
"""Rows of the contacts with one compliant stop: impulse, dissipated energy, sum of the peak
forces of ended contacts, time in which the stop pushes, and number of ended contacts."""

ROWS_OF_CONTACT_PAIR = ROWS_OF_PAIR + 2 * ROWS_OF_STOP
"""Rows of a pair with compliant stops: those of impacts, then those of the contacts with the
lower stop, and with the upper stop."""


# ------------------------------------------------------------------------------
# When a path rests on a stop, in all kernels: after how many bounces, and after how slow ones.
# ------------------------------------------------------------------------------


MOST_BOUNCES = 1000
"""Largest number of impacts of a path in one step. A mass with more of them is pressed against the
stop: its speed is at most 1/2000 of the speed that the pressing acceleration brings in the step,
and it is put to rest on the stop."""

RESTING = 1e-8
"""A rebound whose speed is at most this share of the speed that the pressing acceleration brings in
one step rests on the stop. In the response domain, where the pressing acceleration changes within
an interval, it is a share of the rms speed. At speeds of order 1, 1e-8 is the root of the rounding
error of double precision: below it, the energy of a rebound is lost in the rounding of the energy.
"""


# ------------------------------------------------------------------------------
# Logs of single impacts, each with the time at which it happens.
#
# Without a request for impacts a log has no rows, and impacts are not counted. Most kernels lose no
# time by that, and are compiled once. Kernels of many single steps get `None` instead: they are
# compiled a second time without the code for a log, which saves 5 to 10 % of their time.
# ------------------------------------------------------------------------------


COLUMNS = 4
"""Number of columns of a log, one row an impact: path, pair, time, speed."""

NO_ENERGIES = np.empty(0)
"""The energies of a log that nobody asks for them."""


class Log(NamedTuple):
    """The impacts of a block of paths.

    Parameters
    ----------
    events : (rows, COLUMNS): number of the path in the block, number of the pair, time in s, and
        impact speed in m/s, negative at the lower stop.
    count : (1,), number of impacts, including those for which there was no row left.
    start : s, the time at which the first counted step begins.
    taken : (rows,), what a compliant stop has taken from the path before each of its impacts, per
        unit of the reduced mass; the last contact before it is over then. With it the log has slow
        impacts on compliant stops as well. By default there is none.
    """

    events: NDArray[np.float64]
    count: NDArray[np.int64]
    start: float
    taken: NDArray[np.float64] = NO_ENERGIES


class Page(NamedTuple):
    """The part of a log for one path in one step, which begins at the time `start`.

    Impacts are logged where it is `open`: in counted steps, and if the log has rows.
    """

    events: NDArray[np.float64]
    count: NDArray[np.int64]
    open: bool
    path: int
    start: float
    taken: NDArray[np.float64]


NO_LOG = Log(np.empty((0, COLUMNS)), np.zeros(1, np.int64), 0.0)
"""The log of a kernel whose impacts are not logged."""

NO_RECORD = np.empty((0, 0, 0))
"""The record of a kernel whose states are not recorded."""


@kernel
def page_of(log, path, number, step):
    """Part of a log for a path in the counted step `number`; None without a log.

    Steps of the burn-in have negative numbers.
    """
    if log is None:
        return None
    opened = (number >= 0) & (log.events.shape[0] > 0)
    return Page(log.events, log.count, opened, path, log.start + number * step, log.taken)


@kernel
def page_after(page, elapsed):
    """Part of a log for what is left of a step after `elapsed` s."""
    return Page(
        page.events, page.count, page.open, page.path, page.start + elapsed, page.taken
    )  # fmt: skip


@kernel
def log_impact(page, pair, elapsed, speed):
    """Count an impact, and write it into the next row of an open page if there is one left.

    `elapsed` is the time since the step began, s; `speed` is negative at the lower stop, m/s.
    """
    k = page.count[0]
    if k < page.events.shape[0]:
        page.events[k, 0], page.events[k, 1] = page.path, pair
        page.events[k, 2], page.events[k, 3] = page.start + elapsed, speed
    page.count[0] = k + 1


@kernel
def log_contact(page, pair, elapsed, speed, counted, taken):
    """Log the touch of a compliant stop, which has `taken` so much before it.

    Touches that do not count are logged where the page asks for energies.
    """
    if page.open and (counted or page.taken.shape[0] > 0):
        k = page.count[0]
        if k < page.taken.shape[0]:
            page.taken[k] = taken
        log_impact(page, pair, elapsed, speed)
