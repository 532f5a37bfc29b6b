"""What a kernel asks of a drive: a force whose values are drawn in the course of a path.

A drive is a characteristic (`characteristic`) that also has bodies of its own for

    drawn(part, z, word, event, h)    what it remembers after the time h, from its random numbers

and for `draws`. The number z that it remembers is drawn before each kick; the kick then acts by
`kicked`. The random numbers of a drive are `uniform_of(word, event + k)` with k = 0, 1, ... below
MOST_DRAWS. They belong to half a step of a path, not to its stream: a path at twice the step meets
the same values.
"""

from __future__ import annotations

from typing import Any

from numba.core import config, types

from stochvi.engine.calls import call_by_address
from stochvi.engine.characteristic import kicked, read
from stochvi.engine.compiled_laws import address_of
from stochvi.engine.compiling import kernel
from stochvi.engine.parts import generic
from stochvi.engine.uniform_numbers import word_of_step

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
        own = read(part, numbers, row)
        event = FIRST_DRAW + MOST_DRAWS * row
        for i in range(lanes):
            z = kept(own, state[memory, i])
            for half in range(first, first + halves):
                z = drawn(own, z, word_of_step(words[i], half), event, h / halves)
            state[memory, i] = z
        return 0

    return of_drive


_COMPILED: dict[type, Any] = {}
"""Functions by the class of their drives. Their machine code must live as long as this process."""


def drive_of(part: Any) -> Any:
    """Address of the function that draws for a part, for this process only; without compilation the
    function; 0 where nothing is drawn. The numbers of the part are zeros."""
    if not draws(part):
        return 0
    kind = type(part)
    if kind not in _COMPILED:
        _COMPILED[kind] = function_of_drive(part)  # type: ignore[no-untyped-call]
    return _COMPILED[kind] if config.DISABLE_JIT else address_of(_COMPILED[kind], OF_DRIVE)


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
