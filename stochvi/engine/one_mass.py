"""What is left of a step of one mass that may touch its stops. Chapters: tables of complete
contacts; motion between the stops; impacts and contacts in the rest of a step."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.arithmetic import (
    ENDED,
    EXTREME,
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
    cubic_at,
    cubic_between,
    log_contact,
    log_impact,
    time_to_stop,
    uniform_of,
)
from stochvi.engine.arithmetic import FASTEST as FASTEST_SUM
from stochvi.engine.calls import Stops, follow, follow_shaken, mean_rebound_of, rebound_of
from stochvi.engine.compiling import kernel
from stochvi.engine.parts import generic
from stochvi.engine.sub_steps import decay, time_to_touch, undamped_motion

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


# ------------------------------------------------------------------------------
# How one mass moves between its stops, in what is left of a step.
#
# A flow is a class of named tuples, for which kernels are compiled:
#
#     Rotation    on its spring alone; x is measured from the rest position.
#     Chord       along the cubic through both ends of an interval between two samples.
# ------------------------------------------------------------------------------


class Rotation(NamedTuple):
    """Undamped motion on a spring: its `stiffness`, 1/s^2, and the natural frequency `omega`."""

    stiffness: float
    omega: float


class Chord(NamedTuple):
    """Motion along the cubic from a state to x1, v1, the end without the stops.

    A force F of a stop adds a response d to it, d'' + b d' + w0^2 d = -F. `damping` is b (1/s), and
    `omega` is w0 (rad/s).
    """

    x1: float
    v1: float
    damping: float
    omega: float


@generic
def touch(flow, x, v, side, stop, left):
    """Time until the mass touches a stop, and the speed there; the time is more than what is `left`
    where it does not. `side` is 1 for an upper stop, -1 for a lower one."""


@generic
def end_of(flow, x, v, left):
    """Displacement and velocity at the end of what is left, where no stop is touched."""


@generic
def pressing_on(flow, w, side, stop, left):
    """Mean acceleration onto a rigid stop that is touched at the speed w, m/s^2."""


@generic
def known_contact(flow, w, left, which, at, sums, lane):
    """A contact that is known as a whole, from its touch at the speed w: the speed after it, and
    what is left; -1 where it has to be followed."""


@generic
def follow_in(flow, y, v, left, which, at, found):
    """Follow a contact from the deflection y and its rate v; see `calls.follow`."""


@generic
def redirected(flow, x, v, left, x_after, v_after, left_after):
    """The flow after a stop has changed the motion: the state before that, and after it."""


# ---- the mass on its spring alone ----------------------------------------------------------------


@touch.of(Rotation)
def _(flow, x, v, side, stop, left):
    return time_to_touch(side * x, side * v, side * stop, left, flow.stiffness, flow.omega)


@end_of.of(Rotation)
def _(flow, x, v, left):
    return undamped_motion(x, v, -flow.stiffness * x, left, flow.omega)


@pressing_on.of(Rotation)
def _(flow, w, side, stop, left):
    return -flow.stiffness * side * stop


@known_contact.of(Rotation)
def _(flow, w, left, which, at, sums, lane):
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


@follow_in.of(Rotation)
def _(flow, y, v, left, which, at, found):
    pressing = -flow.stiffness * (2.0 * which - 1.0) * at.places[which]
    follow(
        at.laws, at.kinds[which], at.numbers, which, y, v, left, pressing, flow.stiffness, found
    )  # fmt: skip


@redirected.of(Rotation)
def _(flow, x, v, left, x_after, v_after, left_after):
    return flow


# ---- along a cubic -------------------------------------------------------------------------------


@touch.of(Chord)
def _(flow, x, v, side, stop, left):
    s, w = time_to_stop(side * x, side * v, side * flow.x1, side * flow.v1, left, side * stop)
    return s * left, w


@end_of.of(Chord)
def _(flow, x, v, left):
    return flow.x1, flow.v1


@pressing_on.of(Chord)
def _(flow, w, side, stop, left):
    return (side * flow.v1 - w) / left if left > 0.0 else 0.0


@known_contact.of(Chord)
def _(flow, w, left, which, at, sums, lane):
    return 0.0, -1.0


@follow_in.of(Chord)
def _(flow, y, v, left, which, at, found):
    b, stiffness = flow.damping, flow.omega * flow.omega
    side, stop = 2.0 * which - 1.0, at.places[which]
    q0, q1, q2, q3 = cubic_between(y, v, side * (flow.x1 - stop), side * flow.v1, left)
    # what shakes a mass that follows this cubic without the stop
    motion = (
        2.0 * q2 + b * q1 + stiffness * q0,
        6.0 * q3 + 2.0 * b * q2 + stiffness * q1,
        3.0 * b * q3 + stiffness * q2,
        stiffness * q3,
        stiffness,
        b,
        side * stop,
    )
    follow_shaken(at.laws, at.kinds[which], at.numbers, which, y, v, left, motion, found)


@redirected.of(Chord)
def _(flow, x, v, left, x_after, v_after, left_after):
    x1, v1, b, omega = flow
    if left_after > 0.0:
        z, slope = cubic_at(cubic_between(x, v, x1, v1, left), left - left_after)
        d, r = x_after - z, v_after - slope
        shape, change = decay(left_after, b, omega)
        x1 += (change + b * shape) * d + shape * r
        v1 += change * r - omega * omega * shape * d
    return Chord(x1, v1, b, omega)


# ------------------------------------------------------------------------------
# What is left of a step of one mass in which it may touch its stops.
#
# Between the stops the mass moves as a flow says (`Rotation`, `Chord`). An impact on a rigid stop
# takes no time. A contact with a compliant stop is followed (`sub_steps`), unless the flow knows it
# as a whole, from the tables above. A step may hold any number of both, and a contact may last many
# steps.
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
def follow_contact(flow, y, v, left, which, at, peaks, sums, lane, found):
    """A contact from the deflection y: deflection and rate at its end, and what is left of the
    step, 0 where it lasts."""
    found[PEAK] = peaks[lane, which]
    follow_in(flow, y, v, left, which, at, found)
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
def finish_step(flow, x, v, left, at, threshold, peaks, sums, lane, word, found, page):
    """What is left of a step of one path: displacement and velocity at its end.

    Parameters
    ----------
    flow : how the mass moves between its stops, `Rotation` or `Chord`.
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
            up, w_up = touch(flow, x, v, 1.0, at.places[1], left)
            down, w_down = touch(flow, x, v, -1.0, at.places[0], left)
            t = min(up, down)
            if t > left:
                return end_of(flow, x, v, left)
            left -= t
            which, w = (1, w_up) if up <= down else (0, w_down)
            x, v = at.places[which], w if which == 1 else -w
            counted = w > 0.0 and w >= threshold
            sums[lane, 3 * which] += 1.0 if counted else 0.0
            sums[lane, 3 * which + 1] += w
            sums[lane, 3 * which + 2] += w * w
            found[EXTREME + FASTEST_SUM] = max(found[EXTREME + FASTEST_SUM], w)
            if page is not None:  # a test of its own is left out when compiled
                if not at.rigid[which]:
                    taken = sums[lane, ROWS_OF_PAIR + ROWS_OF_STOP * which + LOSS]
                    log_contact(page, 0, whole - left, v, counted, taken)
                elif page.open and counted:
                    log_impact(page, 0, whole - left, v)
        side, stop = 2.0 * which - 1.0, at.places[which]
        y, back, rest = 0.0, 0.0, -1.0
        if at.rigid[which]:
            pressing = pressing_on(flow, w, side, stop, left)
            back, rest = strike(w, left, which, pressing, at, sums, lane, uniform_of(word, event))
        elif touched:
            back, rest = known_contact(flow, w, left, which, at, sums, lane)
        u = -back
        if rest < 0.0:
            y, u, rest = follow_contact(
                flow, side * (x - stop), side * v, left, which, at, peaks, sums, lane, found
            )
        flow = redirected(flow, x, v, left, stop + side * y, side * u, rest)
        x, v, left = stop + side * y, side * u, rest
        if left <= 0.0:
            break
        which = NO_STOP
    # rounding, or bounces without end, must not leave the mass in a wall
    x = min(x, at.places[1]) if at.rigid[1] else x
    return (max(x, at.places[0]) if at.rigid[0] else x), v
