"""Impacts on the stops of any number of pairs: when a gap reaches a stop, and what it changes.

Within a step the gap y = phi . q of a pair is the quintic through its values, slopes and curvatures
at both ends of what is left of the step. An impact is the first upward root of the distance beyond
a stop. It changes the end of the step by -(1 + R) w T(remaining time), T the Taylor series of the
response to a unit reset. The resets act along M^-1 d, so elastic ones keep the energy. While a stop
that gives way is touched, `modal_contacts` integrates the motion.

Symbols: g0, v0, a0 and g1, v1, a1 are value, slope and curvature of a gap at the two ends of what
is left of the step; c0 ... c5 the Bernstein coefficients of the distance beyond a stop; w is the
impact speed and R the restitution.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.compiling import kernel
from stochvi.methods.monte_carlo.kernels.bounces import MOST_BOUNCES, RESTING
from stochvi.methods.monte_carlo.kernels.impact_log import log_impact, page_of
from stochvi.methods.monte_carlo.kernels.matrix_passes import matrix_pass
from stochvi.methods.monte_carlo.kernels.modal_contacts import (
    decay_freely,
    find_contacts,
    integrate_contacts,
    is_rigid,
    move_forces,
)

MOST_SWEEPS = 1000
"""Largest number of passes over all stops in which ends of steps beyond a stop are put between the
stops: each pass reduces the distance by about the ratio of the lightest mass to the heaviest."""

SHORTEST_PIECE = 2.0**-40
"""Smallest part of a step in which a first root is searched: an excursion beyond a stop that is
shorter is not seen."""

NEWTON_STEPS = 5
"""Number of Newton steps from the root of the chord to that of the polynomial, the same in all
lanes; a lane that needs more is handled alone."""

ROOT_ERROR = 1e-12
"""Relative change of a root in a Newton step at which the root is accepted: as the method is of
second order, the next step would change it by rounding only."""


class Resets(NamedTuple):
    """Responses to a unit change of the speed of each pair.

    Parameters
    ----------
    states : (pairs, 2 modes, terms), Taylor series in time of all displacements and velocities.
    at_once : (pairs, pairs, 2), immediate changes of slope and curvature of every gap.
    later : (pairs, pairs, 3, terms), Taylor series of value, slope and curvature of every gap.
    """

    states: NDArray[np.float64]
    at_once: NDArray[np.float64]
    later: NDArray[np.float64]


class SinglePair(NamedTuple):
    """The only pair of a structure, for the impacts of many lanes at once.

    Parameters
    ----------
    step : s, length of a step.
    stops : (1, 2, 3), position, restitution and speed threshold of the lower and the upper stop.
    impact : table of a matrix pass from powers of the time left to the response to a unit reset.
    first_row : the first row of the pair in the sums.
    """

    step: float
    stops: NDArray[np.float64]
    impact: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]
    first_row: int


class LaneArrays(NamedTuple):
    """Arrays (lanes,) in which single impacts are computed.

    Parameters
    ----------
    c0 ... c5 : Bernstein coefficients of the distance beyond the stop.
    root, slope, bend : fraction of the step at which the stop is reached; first and second
        derivative of the polynomial there.
    side : 1 for the upper stop, -1 for the lower one, 0 for a lane that is not handled.
    powers : (terms, lanes), powers of the time left after the impact.
    response : (rows, lanes), response to a unit reset at the end of the step.
    """

    c0: NDArray[np.float64]
    c1: NDArray[np.float64]
    c2: NDArray[np.float64]
    c3: NDArray[np.float64]
    c4: NDArray[np.float64]
    c5: NDArray[np.float64]
    root: NDArray[np.float64]
    slope: NDArray[np.float64]
    bend: NDArray[np.float64]
    side: NDArray[np.float64]
    powers: NDArray[np.float64]
    response: NDArray[np.float64]


@kernel(inline="always")
def quintic(c0, c1, c2, c3, c4, c5, t):
    """Value and derivative at t of the polynomial with these Bernstein coefficients."""
    u = 1.0 - t
    # de Casteljau down to two points: their mean is the value, their distance the slope
    c0, c1, c2, c3, c4 = (
        u * c0 + t * c1, u * c1 + t * c2, u * c2 + t * c3, u * c3 + t * c4, u * c4 + t * c5,
    )  # fmt: skip
    c0, c1, c2, c3 = u * c0 + t * c1, u * c1 + t * c2, u * c2 + t * c3, u * c3 + t * c4
    c0, c1, c2 = u * c0 + t * c1, u * c1 + t * c2, u * c2 + t * c3
    c0, c1 = u * c0 + t * c1, u * c1 + t * c2
    return u * c0 + t * c1, 5.0 * (c1 - c0)


@kernel(inline="always")
def rises_once(c1, c2, c3, c4, c5):
    """Whether Bernstein coefficients after a first one <= 0 change sign once, to positive."""
    early = ((c1 <= 0.0) | (c2 > 0.0)) & ((c2 <= 0.0) | (c3 > 0.0))
    return early & ((c3 <= 0.0) | (c4 > 0.0)) & (c5 > 0.0)


@kernel
def bracketed_root(c0, c1, c2, c3, c4, c5):
    """The upward root in (0, 1] of a polynomial that has one, c0 <= 0 < c5, and its slope there."""
    low, high = 0.0, 1.0
    t, slope = c0 / (c0 - c5), 0.0
    for _ in range(100):
        value, slope = quintic(c0, c1, c2, c3, c4, c5, t)
        if value > 0.0:
            high = t
        else:
            low = t
        following = t - value / slope if slope > 0.0 else low
        if not (low < following < high):
            following = 0.5 * (low + high)
        if abs(following - t) <= ROOT_ERROR * t:
            break
        t = following
    return t, slope


@kernel
def first_root(c0, c1, c2, c3, c4, c5, stack):
    """First upward root in (0, 1] of a polynomial with c0 <= 0 and its slope there; 2 for no root.

    By Descartes' rule in Bernstein form there is no root without a sign change, and one root with
    one change; with more changes the interval is halved. The halves still to be searched are rows
    (coefficients, start, end) of `stack`.
    """
    start, end = 0.0, 1.0
    waiting = 0
    while True:
        positive, changes = False, 0
        for c in (c1, c2, c3, c4, c5):
            if c != 0.0 and (c > 0.0) != positive:
                positive = not positive
                changes += 1
        if changes == 1:
            t, slope = bracketed_root(c0, c1, c2, c3, c4, c5)
            return start + (end - start) * t, slope / (end - start)
        if changes > 1 and waiting < stack.shape[0] and end - start > SHORTEST_PIECE:
            # de Casteljau in the middle: the left half goes on, the right half waits
            row = stack[waiting]
            middle = 0.5 * (start + end)
            row[5], row[6], row[7] = c5, middle, end
            c1, c2, c3, c4, c5 = (
                0.5 * (c0 + c1), 0.5 * (c1 + c2), 0.5 * (c2 + c3), 0.5 * (c3 + c4), 0.5 * (c4 + c5),
            )  # fmt: skip
            row[4] = c5
            c2, c3, c4, c5 = 0.5 * (c1 + c2), 0.5 * (c2 + c3), 0.5 * (c3 + c4), 0.5 * (c4 + c5)
            row[3] = c5
            c3, c4, c5 = 0.5 * (c2 + c3), 0.5 * (c3 + c4), 0.5 * (c4 + c5)
            row[2] = c5
            c4, c5 = 0.5 * (c3 + c4), 0.5 * (c4 + c5)
            row[1] = c5
            c5 = 0.5 * (c4 + c5)
            row[0] = c5
            end = middle
            waiting += 1
            continue
        if waiting == 0:
            return 2.0, 0.0
        waiting -= 1
        row = stack[waiting]
        c0, c1, c2, c3, c4, c5 = min(row[0], 0.0), row[1], row[2], row[3], row[4], row[5]
        start, end = row[6], row[7]


@kernel
def find_crossing(gaps, j, span, stop, side, stack):
    """Fraction of the span until side (y - stop) crosses 0 upwards, 2 for never, and the speed."""
    start, end = side * (gaps[j, 0] - stop), side * (gaps[j, 3] - stop)
    leaving, coming = 0.2 * span * side * gaps[j, 1], 0.2 * span * side * gaps[j, 4]
    bend = 0.05 * span * span * side
    if start >= 0.0 and leaving > 0.0:
        return 0.0, side * gaps[j, 1]
    # a start beyond the stop, by rounding for example, is moved onto it by a linear correction
    beyond = max(start, 0.0)
    c0, c5 = start - beyond, end
    c1, c2 = (
        start + leaving - 0.8 * beyond,
        start + 2.0 * leaving + bend * gaps[j, 2] - 0.6 * beyond,
    )
    c4, c3 = end - coming - 0.2 * beyond, end - 2.0 * coming + bend * gaps[j, 5] - 0.4 * beyond
    if max(max(max(c1, c2), max(c3, c4)), c5) <= 0.0:
        return 2.0, 0.0
    if rises_once(c1, c2, c3, c4, c5):
        t, slope = bracketed_root(c0, c1, c2, c3, c4, c5)
    else:
        t, slope = first_root(c0, c1, c2, c3, c4, c5, stack)
    return t, max(slope / span, 0.0)


@kernel
def move_start(gaps, j, t, span):
    """Replace the start of gap j by value, slope and curvature at the fraction t of the span."""
    g0, v0, a0 = gaps[j, 0], gaps[j, 1], gaps[j, 2]
    # y = g0 + v0 s + a0 s^2 / 2 + k3 t^3 + k4 t^4 + k5 t^5 with s = t span
    rise = gaps[j, 3] - g0 - v0 * span - 0.5 * a0 * span * span
    slope = (gaps[j, 4] - v0 - a0 * span) * span
    bend = (gaps[j, 5] - a0) * span * span
    k3 = 10.0 * rise - 4.0 * slope + 0.5 * bend
    k4 = -15.0 * rise + 7.0 * slope - bend
    k5 = 6.0 * rise - 3.0 * slope + 0.5 * bend
    s = t * span
    gaps[j, 0] = g0 + s * (v0 + 0.5 * s * a0) + t * t * t * (k3 + t * (k4 + t * k5))
    gaps[j, 1] = v0 + s * a0 + t * t * (3.0 * k3 + t * (4.0 * k4 + t * 5.0 * k5)) / span
    gaps[j, 2] = a0 + t * (6.0 * k3 + t * (12.0 * k4 + t * 20.0 * k5)) / (span * span)


@kernel
def apply_reset(end, pair, change, span, resets):
    """Change the speed of a pair by `change`, m/s, `span` seconds before the end of the step."""
    state, lane, gaps = end
    series, at_once, later = resets.states, resets.at_once, resets.later
    terms = series.shape[2]
    for row in range(series.shape[1]):
        total = series[pair, row, terms - 1]
        for k in range(terms - 2, -1, -1):
            total = total * span + series[pair, row, k]
        state[row, lane] += change * total
    for other in range(gaps.shape[0]):
        gaps[other, 1] += change * at_once[pair, other, 0]
        gaps[other, 2] += change * at_once[pair, other, 1]
        for what in range(3):
            total = later[pair, other, what, terms - 1]
            for k in range(terms - 2, -1, -1):
                total = total * span + later[pair, other, what, k]
            gaps[other, 3 + what] += change * total


@kernel
def put_on_stop(end, pair, stop, side, resets):
    """Move a gap that ends beyond a stop onto it; returns the speed taken away, m/s, or 0.

    A force that holds y on the stop over the rest r of a step changes the speed by -a r and the
    distance by -a r^2 / 2, both along the direction M^-1 d. Speed and distance beyond the stop are
    taken away in that direction; where damping is part of the flow, the speed that it took from the
    motion beyond the stop is given back.
    """
    state, lane, gaps = end
    series, at_once = resets.states, resets.at_once
    beyond = side * (gaps[pair, 3] - stop)
    if beyond < 0.0:
        return 0.0
    taken = max(side * gaps[pair, 4], 0.0) - at_once[pair, pair, 1] * beyond
    modes = series.shape[1] // 2
    for k in range(modes):
        share, damped = series[pair, modes + k, 0] * side, series[pair, modes + k, 1] * side
        state[k, lane] -= beyond * share
        state[modes + k, lane] -= taken * share + beyond * damped
    for other in range(gaps.shape[0]):
        share, damped = at_once[pair, other, 0] * side, at_once[pair, other, 1] * side
        gaps[other, 3] -= beyond * share
        gaps[other, 4] -= taken * share + beyond * damped
    return taken


@kernel
def step_with_stops(end, step, stops, resets, contacts, accelerations, work, tally, page=None):
    """One step of one path with any number of contacts and impacts on any pair.

    Parameters
    ----------
    end : `modal_contacts.PathEnd`, changed.
    stops : (pairs, 2, 3), position (infinite for none), restitution and speed threshold of the
        lower and the upper stop of each pair.
    contacts : None where all stops are rigid, else their `modal_contacts.Contacts`.
    accelerations : None, or `modal_contacts.Accelerations`, which see contacts alone.
    work : `modal_contacts.Workspace`, overwritten.
    tally : `modal_contacts.Tally`, added to.
    page : None, or part of a log.
    """
    gaps, sums = end.gaps, tally.sums
    pairs = gaps.shape[0]
    span = step
    work.resting[:] = 0.0
    touching = False
    if contacts is not None:
        touching = find_contacts(gaps, stops, contacts, work)
    for bounces in range(MOST_BOUNCES + 1):
        if contacts is not None:  # noqa: SIM102 - a test of its own is left out when compiled
            if touching:
                start = step - span
                t = integrate_contacts(
                    gaps, span, start, step, work, stops, contacts, accelerations, tally, page
                )
                terms = resets.states.shape[2]
                decay_freely(end, t, span, work, terms, contacts, accelerations)
                span -= t
                touching = False
                if span <= 0.0:
                    break
        first, w, pair, upper = 2.0, 0.0, -1, 0
        for j in range(pairs):
            for which in range(2):
                stop = stops[j, which, 0]
                if work.resting[j, which] == 0.0 and math.isfinite(stop):
                    t, speed = find_crossing(gaps, j, span, stop, 2.0 * which - 1.0, work.stack)
                    if t < first:
                        first, w, pair, upper = t, speed, j, which
        if pair < 0:
            break
        side = 2.0 * upper - 1.0
        stop, restitution = stops[pair, upper, 0], stops[pair, upper, 1]
        sums[pair, 3 * upper] += 1.0 if w >= stops[pair, upper, 2] else 0.0
        sums[pair, 3 * upper + 1] += w
        sums[pair, 3 * upper + 2] += w * w
        for j in range(pairs):
            move_start(gaps, j, first, span)
        if accelerations is not None:
            move_forces(accelerations, first)
        span *= 1.0 - first
        if page is not None:  # noqa: SIM102
            if page.open and w >= stops[pair, upper, 2]:
                log_impact(page, pair, step - span, side * w)
        gaps[pair, 0], gaps[pair, 1] = stop, side * w
        if contacts is not None:  # noqa: SIM102
            if not is_rigid(contacts, pair, upper):
                if span <= 0.0:
                    break
                work.inside[pair, upper] = 1
                touching = True
                continue
        apply_reset(end, pair, -side * (1.0 + restitution) * w, span, resets)
        gaps[pair, 1] = -side * restitution * w
        pressing = side * gaps[pair, 2]
        rests = (pressing > 0.0) & (restitution * w <= RESTING * pressing * step)
        if rests or bounces >= MOST_BOUNCES - 2 * pairs:
            work.resting[pair, upper] = 1.0
            taken = put_on_stop(end, pair, stop, side, resets)
            sums[pair, 3 * upper + 1] += taken / (1.0 + restitution)
    keep_between_stops(end, stops, resets, contacts, sums)


@kernel
def keep_between_stops(end, stops, resets, contacts, sums):
    """Move the gaps that end beyond rigid stops onto them.

    A mass that is moved onto one stop may come to lie beyond another, hence several passes.
    """
    gaps = end.gaps
    for _ in range(MOST_SWEEPS):
        moved = False
        for j in range(gaps.shape[0]):
            for which in range(2):
                side, stop = 2.0 * which - 1.0, stops[j, which, 0]
                if is_rigid(contacts, j, which) and side * (gaps[j, 3] - stop) > 0.0:
                    taken = put_on_stop(end, j, stop, side, resets)
                    sums[j, 3 * which + 1] += taken / (1.0 + stops[j, which, 1])
                    gaps[j, 3] = stop
                    moved = True
        if not moved:
            return


@kernel
def newton_roots(c0, c1, c2, c3, c4, c5, t, count):
    """Root t in each lane of a polynomial that is <= 0 at 0 and rises through 0 once."""
    for i in range(count):
        s = c0[i] / (c0[i] - c5[i])
        for _ in range(NEWTON_STEPS):
            value, slope = quintic(c0[i], c1[i], c2[i], c3[i], c4[i], c5[i], s)
            s = min(max(s - value / slope, 0.0), 1.0)
        t[i] = s if s >= 0.0 else 0.0  # a NaN would stay in the lanes of `response`


@kernel
def root_slopes(c0, c1, c2, c3, c4, c5, t, slope, count):
    """Slope of the polynomial of each lane at t, or -1 where t is no root."""
    for i in range(count):
        value, rise = quintic(c0[i], c1[i], c2[i], c3[i], c4[i], c5[i], t[i])
        slope[i] = rise if abs(value) <= ROOT_ERROR * rise else -1.0


@kernel
def root_curvatures(c0, c1, c2, c3, c4, c5, t, bend, count):
    """Second derivative of the polynomial of each lane at t."""
    for i in range(count):
        s, u = t[i], 1.0 - t[i]
        d0, d1 = c2[i] - 2.0 * c1[i] + c0[i], c3[i] - 2.0 * c2[i] + c1[i]
        d2, d3 = c4[i] - 2.0 * c3[i] + c2[i], c5[i] - 2.0 * c4[i] + c3[i]
        d0, d1, d2 = u * d0 + s * d1, u * d1 + s * d2, u * d2 + s * d3
        d0, d1 = u * d0 + s * d1, u * d1 + s * d2
        bend[i] = 20.0 * (u * d0 + s * d1)


@kernel
def remaining_powers(t, step, powers, count):
    """Powers 0, 1, ... of the time left after the root, one row each."""
    for i in range(count):
        powers[0, i] = 1.0
    for k in range(1, powers.shape[0]):
        for i in range(count):
            powers[k, i] = powers[k - 1, i] * ((1.0 - t[i]) * step)


@kernel
def single_impacts(pair, ends, new, index, count, sums, arrays, log, first_path, number):
    """Impacts of a `SinglePair` that are alone in their step, many lanes at once.

    A lane is handled here if its end lies beyond one stop, its quintic rises through that stop
    once, and the hull of the motion after the impact stays between the stops. The other lanes are
    put at the front of `index`, in order; returns their number.

    Parameters
    ----------
    ends : (y0, v0, a0, y1, v1, a1), each (1, lanes), of which the end y1 is changed.
    new : (states, lanes), states at the end of the step, changed.
    index, count : numbers of the lanes that may reach a stop, and how many they are.
    sums : (rows, lanes); impacts of counted steps (`number` >= 0) are added from `first_row` on.
    arrays : `LaneArrays`, overwritten.
    log : None, or an `impact_log.Log`, where `first_path` is the number of the first lane.
    """
    step, stops, table, first_row = pair
    y0, v0, a0, y1, v1, a1 = ends
    c0, c1, c2, c3, c4, c5, t, slope, bend, side, powers, response = arrays
    fifth, twentieth = 0.2 * step, 0.05 * step * step
    for k in range(count):
        i = index[k]
        sign = 1.0 if y1[0, i] > stops[0, 1, 0] else -1.0
        stop = stops[0, 1, 0] if sign > 0.0 else stops[0, 0, 0]
        begin, end = sign * (y0[0, i] - stop), sign * (y1[0, i] - stop)
        c0[k], c5[k] = begin, end
        c1[k] = begin + fifth * sign * v0[0, i]
        c2[k] = begin + 2.0 * fifth * sign * v0[0, i] + twentieth * sign * a0[0, i]
        c4[k] = end - fifth * sign * v1[0, i]
        c3[k] = end - 2.0 * fifth * sign * v1[0, i] + twentieth * sign * a1[0, i]
        once = rises_once(c1[k], c2[k], c3[k], c4[k], end)
        side[k] = sign if once & (begin <= 0.0) else 0.0
    newton_roots(c0, c1, c2, c3, c4, c5, t, count)
    root_slopes(c0, c1, c2, c3, c4, c5, t, slope, count)
    root_curvatures(c0, c1, c2, c3, c4, c5, t, bend, count)
    remaining_powers(t, step, powers, count)
    matrix_pass(response, 0.0, powers, table, count)
    left = 0
    width = stops[0, 1, 0] - stops[0, 0, 0]
    for k in range(count):
        i, sign, rest = index[k], side[k], powers[1, k]
        which = 1 if sign > 0.0 else 0
        restitution = stops[0, which, 1]
        w = slope[k] / step
        change = -(1.0 + restitution) * w
        end = c5[k] + change * response[0, k]
        speed = sign * v1[0, i] + change * response[1, k]
        curve = sign * a1[0, i] + change * response[2, k]
        # Bernstein coefficients of the motion after the impact
        b1 = -0.2 * rest * restitution * w
        b2 = 2.0 * b1 + 0.05 * rest * rest * bend[k] / (step * step)
        b4 = end - 0.2 * rest * speed
        b3 = end - 0.4 * rest * speed + 0.05 * rest * rest * curve
        highest = max(max(b1, b2), max(max(b3, b4), end))
        lowest = min(min(b1, b2), min(min(b3, b4), end))
        if (sign == 0.0) | (slope[k] < 0.0) | (highest > 0.0) | (lowest < -width):
            index[left] = i
            left += 1
            continue
        for row in range(response.shape[0] - 3):
            new[row, i] += sign * change * response[3 + row, k]
        y1[0, i] += sign * change * response[0, k]
        if number >= 0:
            row = first_row + 3 * which
            sums[row, i] += 1.0 if w >= stops[0, which, 2] else 0.0
            sums[row + 1, i] += w
            sums[row + 2, i] += w * w
        if log is not None:
            page = page_of(log, first_path + i, number, step)
            if page.open and w >= stops[0, which, 2]:
                log_impact(page, 0, t[k] * step, sign * w)
    return left
