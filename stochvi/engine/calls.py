"""Calls of laws, springs, dampers and drives by the addresses of their compiled functions.
Chapters: addresses; laws of stops; the stops of a structure in tables; drives whose values are
drawn; springs and dampers; functions that are averaged over time.

A function that is compiled apart from the kernels that call it is known to them by its address. A
kernel is therefore compiled once, whichever function it calls, and without one that is never
called. Addresses hold for one process.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba.core import cgutils, config, types
from numba.extending import lower_builtin, models, register_model, type_callable, unbox
from numpy.typing import NDArray

from stochvi.engine.arithmetic import uniform_of, word_of_step
from stochvi.engine.borrowed import described, read_address
from stochvi.engine.compiling import kernel
from stochvi.engine.impact_laws import compiled_of
from stochvi.engine.parts import (
    Affine,
    force,
    generic,
    is_lossy,
    is_rigid,
    is_smooth,
    kicked,
    margin,
    mean_rebound,
    moved,
    pull,
    rate,
    read_characteristic,
    read_law,
    rebound,
    slope,
    watched,
)
from stochvi.engine.sub_steps import press


def call_by_address(signature: Any) -> Callable[..., Any]:
    """The call (function, arguments) of any function of a signature, for kernels.

    Without compilation the function stands in the place of its address.
    """

    def call(function, arguments):
        return function(*arguments)

    @type_callable(call)
    def type_of_call(context):
        return lambda function, arguments: signature.return_type

    @lower_builtin(call, types.Integer, types.BaseTuple)
    def write_call(context, builder, call, values):
        address = builder.inttoptr(values[0], cgutils.voidptr_t)
        return emit_call(context, builder, address, call.args[1], values[1], signature)

    call.made_of = {object: (type_of_call, write_call)}
    return call


def emit_call(context, builder, address, given, arguments, signature):
    """Emit the call of a function of a signature, with a tuple of arguments of `given` types."""
    values = [
        context.cast(builder, builder.extract_value(arguments, k), argument, wanted)
        for k, (argument, wanted) in enumerate(zip(given, signature.args, strict=True))
    ]
    native = [context.get_value_type(each) for each in signature.args]
    result = context.get_value_type(signature.return_type)
    pointer = cgutils.ir.FunctionType(result, native).as_pointer()
    return builder.call(builder.bitcast(address, pointer), values)


class ApartType(types.Type):  # type: ignore[misc, name-defined]
    """The type of the address of a function of a signature."""

    def __init__(self, signature: Any) -> None:
        self.signature = signature
        digest = hashlib.sha256(str(signature).encode()).hexdigest()[:16]
        super().__init__(name=f"apart({digest})")


register_model(ApartType)(models.OpaqueModel)
unbox(ApartType)(read_address)


class Apart:
    """A kernel that other kernels call by its address, in the place of `call_apart`."""

    def __init__(self, function: Any, signature: Any, wanted: bool) -> None:
        self._numba_type_ = ApartType(signature)
        self.address = address_of(function, signature) if wanted else 0


def apart(
    function: Any, example: tuple[Any, ...], *, wanted: bool = True, returns: Any = types.none
) -> Any:
    """A kernel that is compiled apart from those that call it, by `call_apart` with such arguments,
    whose tuples are borrowed; without compilation the function.

    It is compiled where it is `wanted` only: elsewhere no kernel may call it.
    """
    if config.DISABLE_JIT:
        return function
    kinds = tuple(described(each)[0] for each in example)
    key = function, tuple(map(id, kinds)), returns, wanted
    if key not in _APART:
        _APART[key] = Apart(function, returns(*kinds), wanted)
    return _APART[key]


_APART: dict[Any, Apart] = {}
"""What `apart` has made, by the function, the types of its arguments, and whether it is wanted."""


def call_apart(function, arguments):
    """What a function that is compiled apart returns."""
    return function(*arguments)


@type_callable(call_apart)
def type_of_call_apart(context):
    def typer(function, arguments):
        agree = tuple(map(types.unliteral, arguments)) == function.signature.args
        return function.signature.return_type if agree else None

    return typer


@lower_builtin(call_apart, ApartType, types.BaseTuple)
def write_call_apart(context, builder, call, values):
    return emit_call(context, builder, values[0], call.args[1], values[1], call.args[0].signature)


call_apart.made_of = {object: (type_of_call_apart, write_call_apart)}  # type: ignore[attr-defined]


# ------------------------------------------------------------------------------
# How kernels call the laws of stops.
#
# The functions of a class of laws are compiled apart from the kernels that call them, which know
# them by their addresses. A kernel is therefore compiled once for all laws. The sub-steps of many
# lanes are one call, so that the price of a call does not count.
# ------------------------------------------------------------------------------


FORCE, MARGIN, RATE, REBOUND, MEAN_REBOUND = range(5)
"""Questions to the law of one stop."""

OF_STOP = types.float64(
    types.intp, types.float64[:, ::1], types.intp, types.float64, types.float64, types.float64
)
"""Signature of the function of one stop: the question, table and row of numbers, three numbers."""

OF_LANES = types.intp(
    types.float64[::1], types.intp, types.intp, types.float64[:, ::1], types.float64
)
"""Signature of the function of many lanes, `press`."""

call_of_stop = call_by_address(OF_STOP)
call_of_lanes = call_by_address(OF_LANES)


@kernel
def rebound_of(laws, kind, numbers, row, w, uniform):
    """`rebound` of a stop with a law of the class `kind`, whose numbers are a row of a table."""
    return call_of_stop(laws[kind, 0], (REBOUND, numbers, row, 0.0, w, uniform))


@kernel
def mean_rebound_of(laws, kind, numbers, row, w):
    """`mean_rebound` of a stop, as `rebound_of`."""
    return call_of_stop(laws[kind, 0], (MEAN_REBOUND, numbers, row, 0.0, w, 0.0))


@kernel
def force_of(laws, kind, numbers, row, y, v):
    """`force` of a stop with a law of the class `kind`, whose numbers are a row of a table."""
    return call_of_stop(laws[kind, 0], (FORCE, numbers, row, y, v, 0.0))


@kernel
def margin_of(laws, kind, numbers, row, y, v):
    """`margin` of a stop with a law of the class `kind`, whose numbers are a row of a table."""
    return call_of_stop(laws[kind, 0], (MARGIN, numbers, row, y, v, 0.0))


@kernel
def rate_of(laws, kind, numbers, row, y, v, push):
    """`rate` of a stop with a law of the class `kind`, whose numbers are a row of a table."""
    return call_of_stop(laws[kind, 0], (RATE, numbers, row, y, v, push))


def press_lanes(
    law: Any, memory: NDArray[np.float64], lanes: int, numbers: NDArray[np.float64], fastest: float
) -> None:
    """`press` of the first lanes on stops with laws of the class of this one."""
    functions_of([law], lanes=True)
    _COMPILED_LAWS[type(law)][1](memory, 0, lanes, numbers, fastest)


@kernel
def press_all(laws, kind, memory, low, high, numbers, fastest):
    """`press` of the lanes on stops with laws of the class `kind`."""
    call_of_lanes(laws[kind, 1], (memory, low, high, numbers, fastest))


def functions_of_class(law):
    """The functions of the class of a law: of one stop, and of many lanes.

    The numbers of that law do not matter.
    """

    @kernel
    def of_stop(what, numbers, row, y, v, push):
        own = read_law(law, numbers, row)
        if what == FORCE:
            return force(own, y, v)
        if what == MARGIN:
            return margin(own, y, v)
        if what == RATE:
            return rate(own, y, v, push)
        if what == REBOUND:
            return rebound(own, v, push)
        return mean_rebound(own, v)

    @kernel
    def of_lanes(memory, low, high, numbers, fastest):
        press(law, memory, low, high, numbers, fastest)
        return 0

    return of_stop, of_lanes


# ------------------------------------------------------------------------------
# The laws of the stops of a structure, in a table of numbers and one of compiled functions.
# ------------------------------------------------------------------------------


class Stops(NamedTuple):
    """The stops of all pairs, with forces per unit of the reduced mass of each pair.

    Parameters
    ----------
    places : (pairs, 2), m, positions of the lower and the upper stop, infinite for none.
    kinds : (pairs, 2), number of the class of each law.
    rigid, lossy, smooth : (pairs, 2), traits of each law; a place without a stop counts as rigid.
    numbers : (2 pairs, width), numbers of the law of each stop.
    thresholds : (pairs,), m/s, speed of the slowest impact that is counted.
    tangents : (pairs,), the pair without stops whose gap is the motion along those of this pair,
        below 0 where nothing rubs; None where no pair rubs, whose friction is then absent from the
        compiled code.
    ratios : (pairs,), reduced mass of the pair over that of its tangent.
    frictions : (pairs, 2), coefficient of friction of each stop.
    bounces : None where no stop is rigid, whose impacts are then absent from the compiled code;
        else an empty array.
    rubs : None where no compliant stop rubs, whose friction is then absent from the compiled code;
        else an empty array.
    """

    places: NDArray[np.float64]
    kinds: NDArray[np.int64]
    rigid: NDArray[np.bool_]
    lossy: NDArray[np.bool_]
    smooth: NDArray[np.bool_]
    numbers: NDArray[np.float64]
    thresholds: NDArray[np.float64]
    tangents: NDArray[np.int64] | None
    ratios: NDArray[np.float64]
    frictions: NDArray[np.float64]
    bounces: NDArray[np.float64] | None
    rubs: NDArray[np.float64] | None


_COMPILED_LAWS: dict[type, tuple[Any, ...]] = {}
"""Functions of one stop and of many lanes, by the class of their laws. Their machine code must live
as long as this process."""


def functions_of(laws: list[Any], *, lanes: bool = False) -> NDArray[Any]:
    """Addresses of the functions of classes of laws, (classes, 2): of one stop, and of many lanes,
    which are compiled where they are wanted and the law is compliant.

    Addresses hold for this process only. Without compilation they are the functions.
    """
    signatures = (OF_STOP, OF_LANES)
    table = np.zeros((len(laws), len(signatures)), object if config.DISABLE_JIT else np.int64)
    for row, law in zip(table, laws, strict=True):
        kind = type(law)
        if kind not in _COMPILED_LAWS:
            # the numbers of this law must not become part of the code
            blank = (np.zeros((1,) * np.ndim(each)) if np.ndim(each) else 0.0 for each in law)
            _COMPILED_LAWS[kind] = functions_of_class(kind(*blank))  # type: ignore[no-untyped-call]
        wanted = True, lanes and not is_rigid(law)
        for k, signature in enumerate(signatures):
            function = _COMPILED_LAWS[kind][k]
            if config.DISABLE_JIT:
                row[k] = function
            elif wanted[k]:
                row[k] = address_of(function, signature)
    return table


@cache
def address_of(function: Any, signature: Any) -> int:
    """Address of a function that is compiled for a signature, in this process."""
    function.compile(signature)
    compiled = function.overloads[signature.args]
    address: int = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_cfunc_wrapper_name)
    return address


def row_of_numbers(law: Any) -> NDArray[np.float64]:
    """The numbers of a law, as `read` finds them in a table."""
    return np.concatenate([np.ravel(np.asarray(each, float)) for each in law])


def stops_of(
    places: NDArray[np.float64], thresholds: NDArray[np.float64],
    laws: dict[tuple[int, int], Any], tangents: NDArray[np.int64] | None = None,
    ratios: NDArray[np.float64] | None = None, frictions: NDArray[np.float64] | None = None,
) -> tuple[Stops, list[Any]]:  # fmt: skip
    """The stops of all pairs, and a law of each class, for `functions_of`.

    `laws` holds the law of each stop by its pair and 0 for the lower, 1 for the upper stop; the
    other arrays are those of `Stops`, and left out where nothing rubs.
    """
    example = {type(law): law for law in laws.values()}
    classes = sorted(example, key=lambda kind: kind.__qualname__)
    rows = {2 * pair + upper: row_of_numbers(law) for (pair, upper), law in laws.items()}
    width = max((len(row) for row in rows.values()), default=1)
    numbers = np.zeros((2 * len(places), width))
    kinds = np.zeros(places.shape, np.int64)
    rigid, lossy, smooth = np.ones(places.shape, bool), *np.zeros((2, *places.shape), bool)
    for (pair, upper), law in laws.items():
        at, row = (pair, upper), rows[2 * pair + upper]
        numbers[2 * pair + upper, : len(row)] = row
        kinds[at] = classes.index(type(law))
        rigid[at], lossy[at], smooth[at] = is_rigid(law), is_lossy(law), is_smooth(law)
    soft = frictions is not None and bool(np.any(frictions[~rigid] > 0.0))
    stops = Stops(
        places, kinds, rigid, lossy, smooth, numbers, thresholds,
        tangents if tangents is not None and bool(np.any(tangents >= 0)) else None,
        np.ones(len(places)) if ratios is None else ratios,
        np.zeros(places.shape) if frictions is None else frictions,
        np.zeros(0) if any(map(is_rigid, laws.values())) or not laws else None,
        np.zeros(0) if soft else None,
    )  # fmt: skip
    return stops, [example[kind] for kind in classes]


# ------------------------------------------------------------------------------
# What a kernel asks of a drive: a force whose values are drawn in the course of a path.
#
# A drive is a characteristic (`parts`) that also has bodies of its own for
#
#     drawn(part, z, word, event, h)    what it remembers after the time h, from its random numbers
#
# and for `draws`. The number z that it remembers is drawn before each kick; the kick then acts by
# `kicked`. The random numbers of a drive are `uniform_of(word, event + k)` with k = 0, 1, ... below
# MOST_DRAWS. They belong to half a step of a path, not to its stream: a path at twice the step
# meets the same values.
# ------------------------------------------------------------------------------


FIRST_DRAW, MOST_DRAWS = 1 << 41, 1 << 20
"""Number of the first random number of the first drive, beyond those of impacts and statistics; and
the most that one drive draws for a kick."""

Rows = types.float64[:, ::1]

OF_DRIVE = types.intp(
    Rows, types.intp, Rows, types.intp, types.uint64[::1], types.intp, types.intp, types.float64,
    types.intp,
)  # fmt: skip
"""Signature of the function of a drive: numbers and their row; rows of states, with the row of what
it remembers; words of the paths, number of the first half step and of half steps; time; lanes."""

call_of_drive = call_by_address(OF_DRIVE)


@generic
def draws(part):
    """Whether values are drawn for this part."""


@generic
def kept(part, z):
    """What is left of z when a kick begins."""


@generic
def drawn(part, z, word, event, h):
    """What a drive remembers after the time h, s, from uniform numbers of a word, `event` first."""


@draws.of(object)
def _(part):
    return False


@kept.of(object)
def _(part, z):
    return z


@drawn.of(object)
def _(part, z, word, event, h):
    return z


def function_of_drive(part):
    """The function that draws for a class of drives; the numbers of that part do not matter."""

    @kernel
    def of_drive(numbers, row, state, memory, words, first, halves, h, lanes):
        own = read_characteristic(part, numbers, row)
        event = FIRST_DRAW + MOST_DRAWS * row
        for i in range(lanes):
            z = kept(own, state[memory, i])
            for half in range(first, first + halves):
                z = drawn(own, z, word_of_step(words[i], half), event, h / halves)
            state[memory, i] = z
        return 0

    return of_drive


_COMPILED_DRIVES: dict[type, Any] = {}
"""Functions by the class of their drives. Their machine code must live as long as this process."""


def drive_of(part: Any) -> Any:
    """Address of the function that draws for a part, for this process only; without compilation the
    function; 0 where nothing is drawn. The numbers of the part are zeros."""
    if not draws(part):
        return 0
    kind = type(part)
    if kind not in _COMPILED_DRIVES:
        _COMPILED_DRIVES[kind] = function_of_drive(part)  # type: ignore[no-untyped-call]
    return (
        _COMPILED_DRIVES[kind]
        if config.DISABLE_JIT
        else address_of(_COMPILED_DRIVES[kind], OF_DRIVE)
    )


@kernel
def draw_all(parts, states, words, first, halves, h, lanes):
    """Draw the values of all drives for a kick of the time h, which is `halves` half steps long."""
    for j in range(parts.rows.shape[0]):
        if parts.drives[j] != 0:
            call_of_drive(
                parts.drives[j],
                (parts.numbers, j, states, parts.memories[j], words, first, halves, h, lanes),
            )


@kernel
def changes_of(part, word, event, h, found):
    """Write what a drive changes the rate by, m/s, in each interval of the time h, s; at first it
    remembers 0. Its random numbers are those of a word, from `event` on."""
    z = 0.0
    for k in range(found.shape[0]):
        z = drawn(part, kept(part, z), word_of_step(word, k), event, h)
        found[k] = kicked(part, 0.0, 0.0, z, 0.0, 0.0, h)


# ------------------------------------------------------------------------------
# How kernels call springs and dampers that are functions: by an address, for all lanes at once.
#
# As for the laws of stops above, a kernel is compiled once for all classes of parts.
# ------------------------------------------------------------------------------


KICK, PULL, MOVE, SLOPE = range(4)
"""Questions to a part."""


OF_PART = types.intp(
    types.intp, Rows, types.intp, Rows, Rows, Rows, types.intp, types.float64, types.float64,
    types.float64, types.float64, types.intp,
)  # fmt: skip
"""Signature of the function of a part: the question; numbers and their row; rows of displacements,
of rates and of states, with the row of the memory among the states; affine force; time; lanes."""


call_of_part = call_by_address(OF_PART)


def function_of_class(part):
    """The function of the class of a part; the numbers of that part do not matter."""

    @kernel
    def of_part(what, numbers, row, x, v, state, memory, stiffness, damping, force, h, lanes):
        own = read_characteristic(part, numbers, row)
        if what == KICK:
            for i in range(lanes):
                push = stiffness * x[row, i] + force
                z = watched(own, x[row, i], v[row, i], state[memory, i], h)
                state[memory, i] = z
                v[row, i] = kicked(own, x[row, i], v[row, i], z, push, damping, h)
        elif what == PULL:
            for i in range(lanes):
                linear = stiffness * x[row, i] + damping * v[row, i] + force
                v[row, i] = pull(own, x[row, i], v[row, i], state[memory, i]) - linear
        elif what == SLOPE:
            for i in range(lanes):
                v[row, i] = slope(own, state[memory, i], v[row, i])
        else:
            for i in range(lanes):
                z = moved(own, state[memory, i], x[row, i])
                state[memory, i] = moved(own, z, v[row, i])
        return 0

    return of_part


_COMPILED_CHARACTERISTICS: dict[type, Any] = {}
"""Functions by the class of their parts. Their machine code must live as long as this process."""


class Characteristics(NamedTuple):
    """The springs and dampers of a structure that are functions, for a kernel.

    Parameters
    ----------
    functions : (parts,), addresses of the functions of their classes, for this process only;
        without compilation the functions.
    numbers : (parts, width), numbers of each part, per unit of its reduced mass.
    affine : (parts, 3), `Affine` of each.
    rows, changes : (parts, modes), displacement of a part per unit of each mode, and the change of
        each modal velocity per unit change of the rate of a part.
    places : (parts,), displacement of each at rest, m.
    memories : (parts,), row of the memory of each among the states; below 0 for none.
    drives : (parts,), as `functions`, what draws the values of each drive; 0 for other parts.
    """

    functions: NDArray[Any]
    numbers: NDArray[np.float64]
    affine: NDArray[np.float64]
    rows: NDArray[np.float64]
    changes: NDArray[np.float64]
    places: NDArray[np.float64]
    memories: NDArray[np.int64]
    drives: NDArray[Any]

    @classmethod
    def of(
        cls, parts: list[Any], affine: list[Affine], rows: NDArray[np.float64],
        changes: NDArray[np.float64], places: NDArray[np.float64], memories: list[int],
    ) -> Characteristics:  # fmt: skip
        """The parts with their numbers in a table."""
        functions, drives = np.zeros((2, len(parts)), object if config.DISABLE_JIT else np.int64)
        numbers = [row_of_numbers(part) for part in parts]
        table = np.zeros((len(parts), max(map(len, numbers), default=1)))
        for k, (part, own) in enumerate(zip(parts, numbers, strict=True)):
            table[k, : len(own)] = own
            kind = type(part)
            # the numbers of this part must not become part of the code
            blank = kind(
                *(np.zeros((1,) * np.ndim(each)) if np.ndim(each) else 0.0 for each in part)
            )
            if kind not in _COMPILED_CHARACTERISTICS:
                _COMPILED_CHARACTERISTICS[kind] = function_of_class(blank)  # type: ignore[no-untyped-call]
            compiled = _COMPILED_CHARACTERISTICS[kind]
            functions[k] = compiled if config.DISABLE_JIT else address_of(compiled, OF_PART)
            drives[k] = drive_of(blank)
        return cls(
            functions, table, np.array(affine, float).reshape(-1, 3), np.ascontiguousarray(rows),
            np.ascontiguousarray(changes), places, np.array(memories, np.int64), drives,
        )  # fmt: skip


@kernel
def take_samples(sampled, memories, states, samples, first, lanes):
    """Set the memories of parts to rows of samples, from the row `first` on: that of part j to row
    sampled[j], which is below 0 for a part without samples."""
    for j in range(sampled.shape[0]):
        if sampled[j] >= 0:
            for i in range(lanes):
                states[memories[j], i] = samples[first + sampled[j], i]


@kernel
def add_rows(out, row, weights, states, first, lanes):
    """Add the sum of the products of weights with rows of states, from the row `first` on."""
    for k in range(weights.shape[0]):
        weight = weights[k]
        if weight != 0.0:
            for i in range(lanes):
                out[row, i] += weight * states[first + k, i]


@kernel
def displacements(parts, states, smooth, x, lanes):
    """Displacements x (parts, lanes) from states and from Y."""
    for j in range(parts.rows.shape[0]):
        for i in range(lanes):
            x[j, i] = parts.places[j]
        add_rows(x, j, parts.rows[j], states, 0, lanes)
        add_rows(x, j, parts.rows[j], smooth, 0, lanes)


@kernel
def rates(parts, j, states, smooth, v, lanes):
    """Rates v[j] of a part from states and from Y."""
    modes = parts.rows.shape[1]
    for i in range(lanes):
        v[j, i] = 0.0
    add_rows(v, j, parts.rows[j], states, modes, lanes)
    add_rows(v, j, parts.rows[j], smooth, modes, lanes)


@kernel
def kick_all(parts, backwards, states, smooth, rows, h, lanes, sums, first):
    """Kick the states by all parts for a time h, in their order or in the opposite one.

    Where `first` is not below 0, three rows of `sums` for each part begin there, per unit of its
    reduced mass. They get the impulse of its force, of that times its displacement, and its work.
    """
    x, v, before = rows
    displacements(parts, states, smooth, x, lanes)
    count, modes = parts.rows.shape
    for k in range(count):
        j = count - 1 - k if backwards else k
        rates(parts, j, states, smooth, v, lanes)
        for i in range(lanes):
            before[j, i] = v[j, i]
        ask(parts, KICK, j, x, v, states, h, lanes)
        for i in range(lanes):
            before[j, i] = v[j, i] - before[j, i]
        if first >= 0:
            at = first + 3 * j
            for i in range(lanes):
                change = before[j, i]
                sums[at, i] -= change
                sums[at + 1, i] -= change * x[j, i]
                sums[at + 2, i] -= change * (v[j, i] - 0.5 * change)
        for m in range(modes):
            weight = parts.changes[j, m]
            if weight != 0.0:
                for i in range(lanes):
                    states[modes + m, i] += weight * before[j, i]


@kernel
def ask(parts, what, j, x, v, states, h, lanes):
    """Call the function of a part."""
    call_of_part(
        parts.functions[j],
        (
            what, parts.numbers, j, x, v, states, max(parts.memories[j], 0), parts.affine[j, 0],
            parts.affine[j, 1], parts.affine[j, 2], h, lanes,
        ),
    )  # fmt: skip


@kernel
def add_pulls_of_parts(pulled, parts, states, smooth, rows, lanes):
    """Add the modal forces of all parts, less those of their affine forces."""
    x, v, _ = rows
    displacements(parts, states, smooth, x, lanes)
    for j in range(parts.rows.shape[0]):
        rates(parts, j, states, smooth, v, lanes)
        ask(parts, PULL, j, x, v, states, 0.0, lanes)
        for m in range(pulled.shape[0]):
            weight = parts.changes[j, m]
            for i in range(lanes):
                pulled[m, i] += weight * v[j, i]


@kernel
def turning_point(x0, v0, x1, v1, struck, h):
    """Displacement at which a motion turns within a step, from its ends; x1 if it does not turn.

    A smooth motion turns with a constant acceleration. One that an impact has turned consists of
    two straight lines.
    """
    if v0 * v1 >= 0.0:
        return x1
    share = v0 / (v0 - v1)
    if struck:
        way = (x1 - x0 - v1 * h) * share
        return x0 + way if way * v0 > 0.0 else x1
    return x0 + 0.5 * share * h * v0


@kernel
def remembering(parts):
    """Whether any part has a memory."""
    return parts.memories.max() >= 0


@kernel
def all_rates(parts, states, smooth, v, lanes):
    """Rates v (parts, lanes) from states and from Y."""
    for j in range(parts.rows.shape[0]):
        rates(parts, j, states, smooth, v, lanes)


@kernel
def move_all(parts, states, smooth, rows, ends, h, lanes):
    """Change the memories of all parts by the motion of a step that ended in `states`.

    The first of `rows` holds the displacements at its start. `ends` are rows of the rates at its
    start, of those at its end without impacts, and room for the displacements at its end.
    """
    x, v, _ = rows
    v0, free, x1 = ends
    displacements(parts, states, smooth, x1, lanes)
    for j in range(parts.rows.shape[0]):
        if parts.memories[j] < 0:
            continue
        rates(parts, j, states, smooth, v, lanes)
        for i in range(lanes):
            struck = v[j, i] != free[j, i]
            turn = turning_point(x[j, i], v0[j, i], x1[j, i], v[j, i], struck, h)
            x[j, i], v[j, i] = turn - x[j, i], x1[j, i] - turn
        ask(parts, MOVE, j, x, v, states, 0.0, lanes)


# ------------------------------------------------------------------------------
# How kernels average functions of the motion over time: by an address, for all lanes at once.
# ------------------------------------------------------------------------------


OF_STATISTIC = types.intp(Rows, Rows, types.intp, types.intp)
"""Signature of the function of a statistic: a row of displacements and one of rates, the sums and
their row, number of lanes."""

call_of_statistic = call_by_address(OF_STATISTIC)

FIRST_STATISTIC_DRAW = 1 << 40
"""Number of the first random number of a step that a statistic draws, beyond those of impacts."""


class Statistics(NamedTuple):
    """Functions of the motion that are averaged, for a kernel.

    Parameters
    ----------
    functions : (statistics,), addresses of their functions, for this process only; without
        compilation the functions.
    displacements, rates : (statistics, modes), displacement and rate that a function takes, from
        the displacements and velocities of the modes.
    places : (statistics,), displacement of each at rest, m.
    spreads : (statistics,), standard deviation of what half a kick of noise adds to a rate, m/s.
    """

    functions: NDArray[Any]
    displacements: NDArray[np.float64]
    rates: NDArray[np.float64]
    places: NDArray[np.float64]
    spreads: NDArray[np.float64]


def no_statistics() -> Statistics:
    functions = np.zeros(0, object if config.DISABLE_JIT else np.int64)
    return Statistics(functions, np.zeros((0, 1)), np.zeros((0, 1)), np.zeros(0), np.zeros(0))


NO_STATISTICS = no_statistics()


def addresses_of(functions: list[Callable[..., float]]) -> NDArray[Any]:
    """Addresses of functions of displacement and rate, compiled to add up their values."""
    table = np.zeros(len(functions), object if config.DISABLE_JIT else np.int64)
    for k, function in enumerate(functions):
        added = adding(function)
        table[k] = added if config.DISABLE_JIT else address_of(added, OF_STATISTIC)
    return table


@lru_cache(maxsize=64)
def adding(function: Callable[..., float]) -> Any:
    """The function that adds the values of all lanes to a row of sums. Its machine code must live
    as long as it is called."""
    value = compiled_of(function)

    @kernel
    def add_values(motion, sums, row, lanes):
        for i in range(lanes):
            sums[row, i] += value(motion[0, i], motion[1, i])
        return 0

    return add_values


@kernel
def add_statistics(statistics, states, words, number, motion, sums, first, lanes):
    """Add the values of all functions to the rows of sums from `first` on.

    `motion` (2, lanes) is room for the displacements and the rates of one function. Rates are taken
    in the middle of a kick: half a kick of noise is drawn for each, apart from the noise of the
    path.
    """
    count, modes = statistics.displacements.shape
    for k in range(count):
        for i in range(lanes):
            motion[0, i], motion[1, i] = statistics.places[k], 0.0
        add_rows(motion, 0, statistics.displacements[k], states, 0, lanes)
        add_rows(motion, 1, statistics.rates[k], states, modes, lanes)
        spread = statistics.spreads[k]
        if spread > 0.0:
            for i in range(lanes):
                word = word_of_step(words[i], number)
                size = math.sqrt(-2.0 * math.log(uniform_of(word, FIRST_STATISTIC_DRAW + 2 * k)))
                turn = 2.0 * math.pi * uniform_of(word, FIRST_STATISTIC_DRAW + 2 * k + 1)
                motion[1, i] += spread * size * math.cos(turn)
        call_of_statistic(statistics.functions[k], (motion, sums, first + k, lanes))
