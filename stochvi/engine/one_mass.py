"""What is left of a step of one mass in which it may touch its stops.

Between the stops the motion is undamped, x'' = -w0^2 x, x measured from the rest position. An
impact on a rigid stop takes no time. A contact with a compliant stop is read from the tables of
`complete_contacts` where it ends within the step, and else followed (`mass_contacts`). A step may
hold any number of both, and a contact may last many steps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.bounces import MOST_EVENTS, RESTING
from stochvi.engine.compiling import kernel
from stochvi.engine.complete_contacts import (
    BRAKING,
    CELLS,
    DURATION,
    HARDEST,
    PUSHING,
    REBOUND,
    Complete,
    quantity_of,
)
from stochvi.engine.free_motion import time_to_touch, undamped_motion
from stochvi.engine.impact_log import log_impact
from stochvi.engine.law_calls import follow, mean_rebound_of, rebound_of
from stochvi.engine.sums import (
    ENDED,
    IMPULSE,
    LEFT,
    LOSS,
    PEAK,
    PLACE,
    ROWS_OF_PAIR,
    ROWS_OF_STOP,
    SPEED,
    TIME,
)
from stochvi.engine.uniform_numbers import uniform_of

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
    stiffness : w0^2, 1/s^2.
    complete : see this class.
    """

    places: NDArray[np.float64]
    kinds: NDArray[np.int64]
    rigid: NDArray[np.bool_]
    lossy: NDArray[np.bool_]
    numbers: NDArray[np.float64]
    laws: NDArray[np.int64]
    stiffness: float
    complete: Complete


@kernel
def contact_that_lasts(x, at):
    """The compliant stop that a mass is inside of, or NO_STOP."""
    if x > at.places[1] and not at.rigid[1]:
        return 1
    return 0 if x < at.places[0] and not at.rigid[0] else NO_STOP


@kernel
def strike(w, left, which, at, sums, lane, uniform):
    """An impact on a rigid stop at the speed w: the speed after it, and what is left of the step, 0
    for a mass that rests on the stop."""
    kind = at.kinds[which]
    back = rebound_of(at.laws, kind, at.numbers, which, w, uniform)
    row = ROWS_OF_PAIR + ROWS_OF_STOP * which
    sums[lane, row + IMPULSE] += w + back
    sums[lane, row + LOSS] += 0.5 * (w - back) * (w + back)
    pressing = -at.stiffness * (2.0 * which - 1.0) * at.places[which]
    if pressing > 0.0 and back <= RESTING * pressing * left:
        # ever lower bounces, whose impulses add up to the pressing force
        sums[lane, row + IMPULSE] += pressing * left
        both = 1.0 + mean_rebound_of(at.laws, kind, at.numbers, which, 1.0)
        sums[lane, 3 * which + 1] += pressing * left / both
        return 0.0, 0.0
    return back, left


@kernel
def read_contact(w, left, which, at, sums, lane):
    """A contact from its touch at the speed w: the speed after it, and what is left of the step;
    -1 where it has to be followed."""
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


@kernel
def follow_contact(y, v, left, which, at, peaks, sums, lane, found):
    """A contact from the deflection y: deflection and rate at its end, and what is left of the
    step, 0 where it lasts."""
    pressing = -at.stiffness * (2.0 * which - 1.0) * at.places[which]
    found[PEAK] = peaks[lane, which]
    follow(
        at.laws, at.kinds[which], at.numbers, which, y, v, left, pressing, at.stiffness,
        found,
    )  # fmt: skip
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
def finish_step(x, v, left, at, threshold, peaks, sums, lane, word, found, page):
    """What is left of a step of one path: displacement and velocity at its end.

    Parameters
    ----------
    left : s, what is left of the step.
    at : `MassStops`.
    threshold : m/s, speed of the slowest impact that is counted.
    peaks : (paths, 2), largest force so far of a contact that lasts, of the lower and the upper
        stop.
    sums : (paths, rows of a contact pair), added to.
    lane : number of the path.
    word : that of the path in this step, by which `uniform_numbers` draws what scatters.
    found : FOUND numbers, overwritten.
    page : None, or part of a log, which gets the impacts that are counted.
    """
    stiffness, whole = at.stiffness, left
    omega = math.sqrt(stiffness)
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
            counted = w > 0.0 and w >= threshold
            sums[lane, 3 * which] += 1.0 if counted else 0.0
            sums[lane, 3 * which + 1] += w
            sums[lane, 3 * which + 2] += w * w
            if page is not None:  # noqa: SIM102 - a test of its own is left out when compiled
                if page.open and counted:
                    log_impact(page, 0, whole - left, w if which == 1 else -w)
        side, stop = 2.0 * which - 1.0, at.places[which]
        y, back, rest = 0.0, 0.0, -1.0
        if at.rigid[which]:
            back, rest = strike(w, left, which, at, sums, lane, uniform_of(word, event))
        elif touched:
            back, rest = read_contact(w, left, which, at, sums, lane)
        if rest >= 0.0:
            left, v = rest, -side * back
        else:
            start, speed = (0.0, w) if touched else (side * (x - stop), side * v)
            y, v, left = follow_contact(start, speed, left, which, at, peaks, sums, lane, found)
            v *= side
        x = stop + side * y
        if left <= 0.0:
            break
        which = NO_STOP
    # rounding, or bounces without end, must not leave the mass in a wall
    x = min(x, at.places[1]) if at.rigid[1] else x
    return (max(x, at.places[0]) if at.rigid[0] else x), v
