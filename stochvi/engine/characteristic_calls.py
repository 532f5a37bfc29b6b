"""How kernels call springs and dampers that are functions: by an address, for all lanes at once.

As for the laws of stops (`law_calls`), a kernel is compiled once for all classes of parts.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.core import config, types
from numpy.typing import NDArray

from stochvi.engine.calls import call_by_address
from stochvi.engine.characteristic import Affine, kicked, moved, pull, read, slope, watched
from stochvi.engine.compiled_laws import address_of, row_of_numbers
from stochvi.engine.compiling import kernel
from stochvi.engine.drive import drive_of

KICK, PULL, MOVE, SLOPE = range(4)
"""Questions to a part."""

Rows = types.float64[:, ::1]

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
        own = read(part, numbers, row)
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


_COMPILED: dict[type, Any] = {}
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
            if kind not in _COMPILED:
                _COMPILED[kind] = function_of_class(blank)  # type: ignore[no-untyped-call]
            compiled = _COMPILED[kind]
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
