"""Contacts of one mass that begin with a touch and end within a step.

No noise acts within a step, so that such a contact is a function of the speed of the touch. Tables
of polynomials hold that function. A contact is then read from them instead of being followed, which
makes the price of a contact the same for all laws.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.compiled_laws import Stops
from stochvi.engine.compiling import kernel
from stochvi.engine.law_calls import follow
from stochvi.engine.sums import FOUND, IMPULSE, LEFT, PEAK, SPEED, TIME

CELLS, TERMS = 96, 6
"""Number of polynomials of a quantity, for equal ratios of speeds, and of their coefficients."""

SLOWEST, FASTEST = 1e-3, 10.0
"""Range of the speeds of touches of a table, in units of the rms speed of the mass."""

TABLE_ERROR = 1e-9
"""Largest relative error of the polynomials in the middle and near the ends of a cell. Contacts of
other cells are followed: of those where the force has a kink, or in which sub-steps are too coarse
for a smooth function."""

REBOUND, DURATION, BRAKING, HARDEST, PUSHING = range(5)
QUANTITIES = 5
"""Quantities of a complete contact: speed of leaving over that of the touch; duration, s; impulse
over the speed of the touch; peak force over the same; and for how long the stop pushes, s."""


class Complete(NamedTuple):
    """Complete contacts with the lower and the upper stop, by the speed of the touch.

    Parameters
    ----------
    first, per_cell : logarithm of the slowest speed, and cells to a unit of the logarithm.
    terms : (2, CELLS, QUANTITIES, TERMS), coefficients of the powers of the place in a cell, from
        0 to 1. The duration is infinite in a cell whose contacts have to be followed.
    """

    first: float
    per_cell: float
    terms: NDArray[np.float64]


NOTHING_KNOWN = Complete(0.0, 0.0, np.zeros((0, CELLS, QUANTITIES, TERMS)))
"""No complete contact, where noise acts in a step."""


def complete_contacts(
    stops: Stops, laws: NDArray[Any], stiffness: float, speed: float, longest: float
) -> Complete:
    """Tables of the contacts with the stops of one pair that last at most `longest` s, for a mass
    with the rms speed `speed`, m/s; places of stops are measured from its rest position."""
    # errors are smallest with these places (Chebyshev)
    places = 0.5 - 0.5 * np.cos(0.5 * np.pi / TERMS * np.arange(1, 2 * TERMS, 2))
    tried = np.array([*places, 0.02, 0.5])
    first, width = math.log(SLOWEST * speed), math.log(FASTEST / SLOWEST) / CELLS
    touches = np.exp(first + width * (np.arange(CELLS)[:, None] + tried))
    terms = np.zeros((2, CELLS, QUANTITIES, TERMS))
    terms[:, :, DURATION, 0] = np.inf
    powers = tried[:, None] ** np.arange(TERMS)
    to_terms = np.linalg.inv(powers[:TERMS])
    for which in range(2):
        if stops.rigid[0, which]:
            continue
        found = np.empty((touches.size, QUANTITIES))
        pressing = -stiffness * (2 * which - 1) * stops.places[0, which]
        follow_touches(
            touches.ravel(), laws, stops.kinds[0, which], stops.numbers, which, longest, pressing,
            stiffness, found,
        )  # fmt: skip
        found = found.reshape(CELLS, len(tried), QUANTITIES)
        made = np.einsum("pn,cnq->cqp", to_terms, found[:, :TERMS])
        off = np.abs(np.einsum("np,cqp->cnq", powers[TERMS:], made) - found[:, TERMS:])
        good = np.all(off <= TABLE_ERROR * np.abs(found[:, TERMS:]), axis=(1, 2))
        terms[which, good] = made[good]
    return Complete(first, 1.0 / width, terms)


@kernel
def follow_touches(
    touches, laws, kind, numbers, row, longest, pressing, stiffness, quantities
):  # fmt: skip
    """Follow contacts from touches at some speeds to their ends: rows of QUANTITIES, nan where a
    contact lasts longer."""
    found = np.zeros(FOUND)
    for i in range(touches.shape[0]):
        w = touches[i]
        found[PEAK] = 0.0
        follow(laws, kind, numbers, row, 0.0, w, longest, pressing, stiffness, found)
        quantities[i, REBOUND] = -found[SPEED] / w
        quantities[i, DURATION] = longest - found[LEFT] if found[LEFT] > 0.0 else math.nan
        quantities[i, BRAKING] = found[IMPULSE] / w
        quantities[i, HARDEST] = found[PEAK] / w
        quantities[i, PUSHING] = found[TIME]


@kernel
def quantity_of(terms, which, cell, quantity, u):
    """A quantity of a contact at the place u in a cell."""
    found = terms[which, cell, quantity, TERMS - 1]
    for k in range(TERMS - 2, -1, -1):
        found = terms[which, cell, quantity, k] + u * found
    return found
