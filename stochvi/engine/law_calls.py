"""How kernels call the laws of stops.

The functions of a class of laws are compiled apart from the kernels that call them, which know them
by their addresses (`compiled_laws`). A kernel is therefore compiled once for all laws. The
sub-steps of many lanes are one call, so that the price of a call does not count.
"""

from __future__ import annotations

from numba.core import types

from stochvi.engine.calls import call_by_address
from stochvi.engine.compiling import kernel
from stochvi.engine.law import force, margin, mean_rebound, rate, read, rebound
from stochvi.engine.mass_contacts import Shaken, follow_by_sub_steps, through
from stochvi.engine.sub_steps import press

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

OF_MASS = types.intp(
    types.float64[:, ::1], types.intp, types.float64, types.float64, types.float64, types.float64,
    types.float64, types.float64[::1],
)  # fmt: skip
"""Signature of the function of a contact of one mass: table and row of numbers, then as
`through`."""


OF_SHAKEN = types.intp(
    types.float64[:, ::1], types.intp, types.float64, types.float64, types.float64,
    types.UniTuple(types.float64, 7), types.float64[::1],
)  # fmt: skip
"""Signature of the function of a contact of one mass that is shaken: table and row of numbers,
deflection and rate, the time that is left, the numbers of `Shaken`, and what is found."""


call_of_stop = call_by_address(OF_STOP)
call_of_lanes = call_by_address(OF_LANES)
call_of_mass = call_by_address(OF_MASS)
call_of_shaken = call_by_address(OF_SHAKEN)


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


@kernel
def press_all(laws, kind, memory, low, high, numbers, fastest):
    """`press` of the lanes on stops with laws of the class `kind`."""
    call_of_lanes(laws[kind, 1], (memory, low, high, numbers, fastest))


@kernel
def follow(laws, kind, numbers, row, y, v, left, pressing, stiffness, found):
    """`through` for a stop with a law of the class `kind`, whose numbers are a row of a table."""
    call_of_mass(laws[kind, 2], (numbers, row, y, v, left, pressing, stiffness, found))


@kernel
def follow_shaken(laws, kind, numbers, row, y, v, left, motion, found):
    """`follow_by_sub_steps` of a mass with the numbers of `Shaken`."""
    call_of_shaken(laws[kind, 3], (numbers, row, y, v, left, motion, found))


def functions_of_class(law):
    """The functions of the class of a law: of one stop, of many lanes, of one mass, and of one mass
    that is shaken.

    The numbers of that law do not matter.
    """

    @kernel
    def of_stop(what, numbers, row, y, v, push):
        own = read(law, numbers, row)
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

    @kernel
    def of_mass(numbers, row, y, v, left, pressing, stiffness, found):
        through(read(law, numbers, row), y, v, left, pressing, stiffness, found)
        return 0

    @kernel
    def of_shaken(numbers, row, y, v, left, motion, found):
        follow_by_sub_steps(Shaken(*motion), read(law, numbers, row), y, v, left, found)
        return 0

    return of_stop, of_lanes, of_mass, of_shaken
