"""What is left of a step of one mass in which it may touch its stops.

Between the stops the mass moves as a flow says (`mass_flows`). An impact on a rigid stop takes no
time. A contact with a compliant stop is followed (`mass_contacts`), unless the flow knows it as a
whole, from the tables of `complete_contacts`. A step may hold any number of both, and a contact may
last many steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.bounces import MOST_EVENTS, RESTING
from stochvi.engine.compiling import kernel
from stochvi.engine.complete_contacts import Complete
from stochvi.engine.impact_log import log_contact, log_impact
from stochvi.engine.law_calls import mean_rebound_of, rebound_of
from stochvi.engine.mass_flows import (
    end_of,
    follow_in,
    known_contact,
    pressing_on,
    redirected,
    touch,
)
from stochvi.engine.sums import (
    ENDED,
    EXTREME,
    FASTEST,
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
    flow : how the mass moves between its stops, a class of `mass_flows`.
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
            found[EXTREME + FASTEST] = max(found[EXTREME + FASTEST], w)
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
