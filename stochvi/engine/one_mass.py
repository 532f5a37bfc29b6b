"""What is left of a step of one mass that may touch its stops. Chapters: tables of complete
contacts; motion between the stops; impacts and contacts in the rest of a step."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.arithmetic import (
    ENDED,
    FOUND,
    IMPULSE,
    LEFT,
    LOSS,
    MOST_EVENTS,
    PEAK,
    PLACE,
    RESTING,
    ROWS_OF_PAIR,
    ROWS_OF_STOP,
    SPEED,
    TIME,
    log_contact,
    log_impact,
    uniform_of,
)
from stochvi.engine.calls import Stops, follow, mean_rebound_of, rebound_of
from stochvi.engine.compiling import kernel
from stochvi.engine.sub_steps import time_to_touch, undamped_motion

# ------------------------------------------------------------------------------
# Contacts of one mass that begin with a touch and end within a step.
#
# No noise acts within a step, so that such a contact is a function of the speed of the touch.
# Tables of polynomials hold that function. A contact is then read from them instead of being
# followed, which makes the price of a contact the same for all laws.
# ------------------------------------------------------------------------------


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


@kernel
def known_contact(w, left, which, at, sums, lane):
    """A contact that is known as a whole, from its touch at the speed w: the speed after it, and
    what is left; -1 where it has to be followed."""
    place = (math.log(w) - at.complete.first) * at.complete.per_cell if w > 0.0 else -1.0
    if not 0.0 <= place < CELLS:
        return 0.0, -1.0
    cell = int(place)
    u = place - cell
    left -= quantity_of(at.complete.terms, which, cell, DURATION, u)
    if not left > 0.0:
        return 0.0, -1.0
    row = ROWS_OF_PAIR + ROWS_OF_STOP * which
    back = w * quantity_of(at.complete.terms, which, cell, REBOUND, u)
    sums[lane, row + IMPULSE] += w * quantity_of(at.complete.terms, which, cell, BRAKING, u)
    sums[lane, row + LOSS] += 0.5 * (w - back) * (w + back) if at.lossy[which] else 0.0
    sums[lane, row + TIME] += quantity_of(at.complete.terms, which, cell, PUSHING, u)
    sums[lane, row + PEAK] += w * quantity_of(at.complete.terms, which, cell, HARDEST, u)
    sums[lane, row + ENDED] += 1.0
    return back, left


# ------------------------------------------------------------------------------
# What is left of a step of one mass in which it may touch its stops.
#
# Between the stops the mass moves on its spring alone; x is measured from the rest position. An
# impact on a rigid stop takes no time. A contact with a compliant stop is followed (`sub_steps`),
# unless it is known as a whole, from the tables above. A step may hold any number of both, and a
# contact may last many steps.
# ------------------------------------------------------------------------------


NO_STOP = -1
"""Beside 0 and 1, the numbers of the lower and of the upper stop."""


class MassStops(NamedTuple):
    """The lower and the upper stop of one mass.

    Parameters
    ----------
    places : (2,), m, from the rest position, infinite for none.
    kinds, rigid, lossy : (2,), number of the class of each law, and traits of the law; a place
        without a stop counts as rigid.
    numbers : (2, width), numbers of the laws.
    laws : `functions_of` the classes of their laws, with those of one mass.
    complete : see this class.
    """

    places: NDArray[np.float64]
    kinds: NDArray[np.int64]
    rigid: NDArray[np.bool_]
    lossy: NDArray[np.bool_]
    numbers: NDArray[np.float64]
    laws: NDArray[np.int64]
    complete: Complete


@kernel
def contact_that_lasts(x, at):
    """The compliant stop that a mass is inside of, or NO_STOP."""
    if x > at.places[1] and not at.rigid[1]:
        return 1
    return 0 if x < at.places[0] and not at.rigid[0] else NO_STOP


@kernel
def strike(w, left, which, pressing, at, sums, lane, uniform):
    """An impact on a rigid stop at the speed w: the speed after it, and what is left of the step, 0
    for a mass that rests on the stop."""
    kind = at.kinds[which]
    back = rebound_of(at.laws, kind, at.numbers, which, w, uniform)
    row = ROWS_OF_PAIR + ROWS_OF_STOP * which
    sums[lane, row + IMPULSE] += w + back
    sums[lane, row + LOSS] += 0.5 * (w - back) * (w + back)
    if pressing > 0.0 and back <= RESTING * pressing * left:
        # ever lower bounces, whose impulses add up to the pressing force
        sums[lane, row + IMPULSE] += pressing * left
        both = 1.0 + mean_rebound_of(at.laws, kind, at.numbers, which, 1.0)
        sums[lane, 3 * which + 1] += pressing * left / both
        return 0.0, 0.0
    return back, left


@kernel
def follow_contact(stiffness, y, v, left, which, at, peaks, sums, lane, found):
    """A contact from the deflection y: deflection and rate at its end, and what is left of the
    step, 0 where it lasts."""
    found[PEAK] = peaks[lane, which]
    pressing = -stiffness * (2.0 * which - 1.0) * at.places[which]
    follow(at.laws, at.kinds[which], at.numbers, which, y, v, left, pressing, stiffness, found)
    row = ROWS_OF_PAIR + ROWS_OF_STOP * which
    sums[lane, row + IMPULSE] += found[IMPULSE]
    sums[lane, row + LOSS] += found[LOSS] if at.lossy[which] else 0.0
    sums[lane, row + TIME] += found[TIME]
    peaks[lane, which] = found[PEAK]
    if found[LEFT] > 0.0:
        sums[lane, row + PEAK] += found[PEAK]
        sums[lane, row + ENDED] += 1.0
        peaks[lane, which] = 0.0
    return found[PLACE], found[SPEED], found[LEFT]


@kernel
def finish_step(stiffness, omega, x, v, left, at, threshold, peaks, sums, lane, word, found, page):
    """What is left of a step of one path: displacement and velocity at its end.

    Parameters
    ----------
    stiffness, omega : 1/s^2 and rad/s, that of the spring and its root.
    left : s, what is left of the step.
    at : `MassStops`.
    threshold : m/s, speed of the slowest impact that is counted.
    peaks : (paths, 2), largest force so far of a contact that lasts, of the lower and the upper
        stop.
    sums : (paths, rows of a contact pair), added to.
    lane : number of the path.
    word : that of the path in this step, by which `arithmetic` draws what scatters.
    found : FOUND numbers, overwritten.
    page : None, or part of a log, which gets the impacts that are counted.
    """
    whole = left
    which = contact_that_lasts(x, at)
    for event in range(MOST_EVENTS):
        touched, w = which == NO_STOP, 0.0
        if touched:
            up, w_up = time_to_touch(x, v, at.places[1], left, stiffness, omega)
            down, w_down = time_to_touch(-x, -v, -at.places[0], left, stiffness, omega)
            t = min(up, down)
            if t > left:
                return undamped_motion(x, v, -stiffness * x, left, omega)
            left -= t
            which, w = (1, w_up) if up <= down else (0, w_down)
            x, v = at.places[which], w if which == 1 else -w
            counted = w > 0.0 and w >= threshold
            sums[lane, 3 * which] += 1.0 if counted else 0.0
            sums[lane, 3 * which + 1] += w
            sums[lane, 3 * which + 2] += w * w
            if page is not None:  # a test of its own is left out when compiled
                if not at.rigid[which]:
                    taken = sums[lane, ROWS_OF_PAIR + ROWS_OF_STOP * which + LOSS]
                    log_contact(page, 0, whole - left, v, counted, taken)
                elif page.open and counted:
                    log_impact(page, 0, whole - left, v)
        side, stop = 2.0 * which - 1.0, at.places[which]
        y, back, rest = 0.0, 0.0, -1.0
        if at.rigid[which]:
            pressing = -stiffness * side * stop
            back, rest = strike(w, left, which, pressing, at, sums, lane, uniform_of(word, event))
        elif touched:
            back, rest = known_contact(w, left, which, at, sums, lane)
        u = -back
        if rest < 0.0:
            y, u, rest = follow_contact(
                stiffness, side * (x - stop), side * v, left, which, at, peaks, sums, lane, found
            )
        x, v, left = stop + side * y, side * u, rest
        if left <= 0.0:
            break
        which = NO_STOP
    # rounding, or bounces without end, must not leave the mass in a wall
    x = min(x, at.places[1]) if at.rigid[1] else x
    return (max(x, at.places[0]) if at.rigid[0] else x), v
