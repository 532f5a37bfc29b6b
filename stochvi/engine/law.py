"""What a kernel asks of the law of a stop, and how it finds the law of each of many stops.

A law is a class of named tuples of numbers, for forces per unit mass. It has one of two functions:

    rebound(law, w)     speed after an impact at the speed w, of a stop that is rigid
    force(law, y, v)    force of a stop in contact, at the deflection y and its rate v

The other functions say how a contact is followed; they have bodies that serve most laws.

The stops of a structure have laws of several classes. `Laws` is the chain of these classes, known
while compiling; the numbers of each stop are a row of one table. The functions that end in `_of`
take the law of one stop from both.
"""

from __future__ import annotations

from types import NoneType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.parts import generic


@generic
def rebound(law, w):
    """Speed after an impact at the speed w, m/s."""


@generic
def force(law, y, v):
    """Force of a stop that pushes, m/s^2, at the deflection y > 0 (m) and its rate v (m/s)."""


@generic
def margin(law, y, v):
    """Deflection, m, that is left until the stop no longer pushes; linear in y and v."""


@generic
def rate(law, y, v, push):
    """Largest rate (rad/s) in a contact that is at y and v, with the acceleration `push` onto the
    stop: that of its oscillation or of its damping."""


@generic
def is_rigid(law):
    """Whether the stop is rigid."""


@generic
def is_lossy(law):
    """Whether a contact takes energy."""


@generic
def is_smooth(law):
    """Whether the force has derivatives where the contact begins."""


@generic
def read(law, numbers, row):
    """The law of this class whose numbers are a row of a table."""


@margin.of(object)
def _(law, y, v):
    return y


@rebound.of(object)
def _(law, w):
    return 0.0


@force.of(object)
def _(law, y, v):
    return 0.0


@rate.of(object)
def _(law, y, v, push):
    return 0.0


@is_rigid.of(object)
def _(law):
    return False


@is_lossy.of(object)
def _(law):
    return False


@is_smooth.of(object)
def _(law):
    return True


class Laws(NamedTuple):
    """The classes of the laws of many stops, one after the other.

    Parameters
    ----------
    first : a law of the first class; its numbers are not used.
    others : `Laws` of the other classes, or None.
    """

    first: Any
    others: Any


class Stops(NamedTuple):
    """The stops of all pairs, with forces per unit of the reduced mass of each pair.

    Parameters
    ----------
    places : (pairs, 2), m, positions of the lower and the upper stop, infinite for none.
    kinds : (pairs, 2), number of the class of each law in the chain of `Laws`.
    numbers : (2 pairs, width), numbers of the law of each stop.
    thresholds : (pairs,), m/s, speed of the slowest impact that is counted.
    """

    places: NDArray[np.float64]
    kinds: NDArray[np.int64]
    numbers: NDArray[np.float64]
    thresholds: NDArray[np.float64]


# ---- the law of one stop among many -----------------------------------------------------------


@generic
def rebound_of(laws, kind, numbers, row, w):
    """`rebound` of a stop with a law of the class `kind`, whose numbers are a row of a table."""


@rebound_of.of(NoneType)
def _(laws, kind, numbers, row, w):
    return 0.0


@rebound_of.of(Laws)
def _(laws, kind, numbers, row, w):
    if kind == 0:
        return rebound(read(laws.first, numbers, row), w)
    return rebound_of(laws.others, kind - 1, numbers, row, w)


@generic
def force_of(laws, kind, numbers, row, y, v):
    """`force` of a stop with a law of the class `kind`, whose numbers are a row of a table."""


@force_of.of(NoneType)
def _(laws, kind, numbers, row, y, v):
    return 0.0


@force_of.of(Laws)
def _(laws, kind, numbers, row, y, v):
    if kind == 0:
        return force(read(laws.first, numbers, row), y, v)
    return force_of(laws.others, kind - 1, numbers, row, y, v)


@generic
def margin_of(laws, kind, numbers, row, y, v):
    """`margin` of a stop with a law of the class `kind`, whose numbers are a row of a table."""


@margin_of.of(NoneType)
def _(laws, kind, numbers, row, y, v):
    return 0.0


@margin_of.of(Laws)
def _(laws, kind, numbers, row, y, v):
    if kind == 0:
        return margin(read(laws.first, numbers, row), y, v)
    return margin_of(laws.others, kind - 1, numbers, row, y, v)


@generic
def rate_of(laws, kind, numbers, row, y, v, push):
    """`rate` of a stop with a law of the class `kind`, whose numbers are a row of a table."""


@rate_of.of(NoneType)
def _(laws, kind, numbers, row, y, v, push):
    return 0.0


@rate_of.of(Laws)
def _(laws, kind, numbers, row, y, v, push):
    if kind == 0:
        return rate(read(laws.first, numbers, row), y, v, push)
    return rate_of(laws.others, kind - 1, numbers, row, y, v, push)


@generic
def traits_of(laws, kind, numbers, row):
    """Whether the law of a stop is rigid, takes energy, and is smooth at the touch."""


@traits_of.of(NoneType)
def _(laws, kind, numbers, row):
    return True, False, True


@traits_of.of(Laws)
def _(laws, kind, numbers, row):
    if kind == 0:
        law = read(laws.first, numbers, row)
        return is_rigid(law), is_lossy(law), is_smooth(law)
    return traits_of(laws.others, kind - 1, numbers, row)
