"""What is left of a step of one path, with any number of impacts and contacts on any pairs.

Without the stops each gap is the quintic through its values, slopes and curvatures at both ends of
what is left of the step. An event is the first upward root of the distance beyond a stop. A rigid
stop turns the speed at once; a contact with a compliant one is integrated until no such stop is
touched (`contacts`). Both are pushes, whose responses are added to the ends (`pushes`). They act
along M^-1 d, so that elastic impacts keep the energy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.bounces import MOST_BOUNCES, RESTING
from stochvi.engine.compiling import kernel
from stochvi.engine.contacts import (
    APART,
    PUSHES,
    WITHDRAWN,
    Contacts,
    V,
    Y,
    add_impact,
    count_touch,
    integrate_contacts,
    make_contacts,
)
from stochvi.engine.friction import rub_along, rub_at_rest, tangent_of
from stochvi.engine.impact_log import log_contact, log_impact
from stochvi.engine.law_calls import margin_of, mean_rebound_of, rebound_of
from stochvi.engine.pushes import (
    A0,
    A1,
    BUNDLE,
    MOMENTS,
    TERMS_AT_ONCE,
    V0,
    V1,
    Y0,
    Y1,
    add_four_terms,
    add_terms,
    moments_later,
    padded,
    powers_later,
)
from stochvi.engine.roots import bracketed_root, first_root, rises_once
from stochvi.engine.sums import IMPULSE, LOSS, ROWS_OF_PAIR, ROWS_OF_STOP
from stochvi.engine.uniform_numbers import uniform_of

MOST_SWEEPS = 1000
"""Largest number of passes over all stops in which ends of steps beyond a stop are put between the
stops: each pass reduces the distance by about the ratio of the lightest mass to the heaviest."""

NO_PAIR = -1
"""The pair that is touched next, where none is."""


class Workspace(NamedTuple):
    """What is left of a step of one path, and arrays for it.

    Parameters
    ----------
    contacts : `Contacts`.
    numbers : gaps, then `change`, then padding, in one row.
    gaps : (6, pairs), value, slope and curvature of every gap at the start and the end of what is
        left of the step, without the stops; a view of `numbers`.
    change : (states,), what the stops add to displacements and velocities at the end of the step;
        a view of `numbers`.
    now, later : (MOMENTS,) and (terms,), moments of a push, those later padded.
    impulse : (1,), the moment of an impact.
    stack : (64, 8), parts of a step in which a root is still to be searched.
    """

    contacts: Contacts
    numbers: NDArray[np.float64]
    gaps: NDArray[np.float64]
    change: NDArray[np.float64]
    now: NDArray[np.float64]
    later: NDArray[np.float64]
    impulse: NDArray[np.float64]
    stack: NDArray[np.float64]


@kernel
def make_workspace(pairs, states, terms):
    """Arrays for that number of pairs, of states, and of terms of the responses."""
    numbers = np.zeros(3 * pairs + padded(3 * pairs + states, BUNDLE))
    later = np.zeros(padded(terms, TERMS_AT_ONCE))
    return Workspace(
        make_contacts(pairs), numbers, numbers[: 6 * pairs].reshape((6, pairs)),
        numbers[6 * pairs : 6 * pairs + states], np.zeros(MOMENTS), later, np.zeros(1),
        np.zeros((64, 8)),
    )  # fmt: skip


@kernel
def find_contacts(gaps, contacts, stops, laws):
    """Note the state of each stop when a step begins; returns how many are in contact, and the
    last one of them: pair and side."""
    count, pair, upper = 0, NO_PAIR, 0
    for j in range(gaps.shape[1]):
        for which in range(2):
            side = 2.0 * which - 1.0
            y, v = side * (gaps[Y0, j] - stops.places[j, which]), side * gaps[V0, j]
            contacts.inside[j, which] = APART
            if y > 0.0:
                kind, row = stops.kinds[j, which], 2 * j + which
                rigid = stops.rigid[j, which]
                if not rigid:
                    pushing = margin_of(laws, kind, stops.numbers, row, y, v) > 0.0
                    contacts.inside[j, which] = PUSHES if pushing else WITHDRAWN
                    count, pair, upper = count + 1, j, which
    return count, pair, upper


@kernel
def find_crossing(gaps, j, span, stop, side, stack):
    """Fraction of the span until side (y - stop) crosses 0 upwards, 2 for never, and the speed."""
    start, end = side * (gaps[Y0, j] - stop), side * (gaps[Y1, j] - stop)
    leaving, coming = 0.2 * span * side * gaps[V0, j], 0.2 * span * side * gaps[V1, j]
    bend = 0.05 * span * span * side
    if start >= 0.0 and leaving > 0.0:
        return 0.0, side * gaps[V0, j]
    # a start beyond the stop, by rounding for example, is moved onto it by a linear correction
    beyond = max(start, 0.0)
    c0, c5 = start - beyond, end
    c1, c2 = (
        start + leaving - 0.8 * beyond,
        start + 2.0 * leaving + bend * gaps[A0, j] - 0.6 * beyond,
    )
    c4, c3 = end - coming - 0.2 * beyond, end - 2.0 * coming + bend * gaps[A1, j] - 0.4 * beyond
    if max(max(max(c1, c2), max(c3, c4)), c5) <= 0.0:
        return 2.0, 0.0
    if rises_once(c1, c2, c3, c4, c5):
        t, slope = bracketed_root(c0, c1, c2, c3, c4, c5)
    else:
        t, slope = first_root(c0, c1, c2, c3, c4, c5, stack)
    return t, max(slope / span, 0.0)


@kernel
def first_touch(gaps, span, places, resting, stack):
    """Fraction of the span until the first stop is touched, 2 for never; the speed; the stop."""
    first, w, pair, upper = 2.0, 0.0, NO_PAIR, 0
    for j in range(gaps.shape[1]):
        # the quintic lies in the hull of its Bernstein coefficients
        start, end = gaps[Y0, j], gaps[Y1, j]
        leaving, coming = 0.2 * span * gaps[V0, j], 0.2 * span * gaps[V1, j]
        bend = 0.05 * span * span
        c1, c2 = start + leaving, start + 2.0 * leaving + bend * gaps[A0, j]
        c4, c3 = end - coming, end - 2.0 * coming + bend * gaps[A1, j]
        highest = max(max(max(c1, c2), max(c3, c4)), max(start, end))
        lowest = min(min(min(c1, c2), min(c3, c4)), min(start, end))
        for which in range(2):
            stop = places[j, which]
            near = highest > stop if which == 1 else lowest < stop
            if near and resting[j, which] == 0:
                t, speed = find_crossing(gaps, j, span, stop, 2.0 * which - 1.0, stack)
                if t < first:
                    first, w, pair, upper = t, speed, j, which
    return first, w, pair, upper


@kernel
def move_starts(gaps, s, span):
    """Replace the starts of all gaps by values, slopes and curvatures after s of the span, s."""
    t, inverse = s / span, 1.0 / span
    for j in range(gaps.shape[1]):
        g0, v0, a0 = gaps[Y0, j], gaps[V0, j], gaps[A0, j]
        rise = gaps[Y1, j] - g0 - v0 * span - 0.5 * a0 * span * span
        slope = (gaps[V1, j] - v0 - a0 * span) * span
        bend = (gaps[A1, j] - a0) * span * span
        k3 = 10.0 * rise - 4.0 * slope + 0.5 * bend
        k4 = -15.0 * rise + 7.0 * slope - bend
        k5 = 6.0 * rise - 3.0 * slope + 0.5 * bend
        gaps[Y0, j] = g0 + s * (v0 + 0.5 * s * a0) + t * t * t * (k3 + t * (k4 + t * k5))
        gaps[V0, j] = v0 + s * a0 + t * t * (3.0 * k3 + t * (4.0 * k4 + t * 5.0 * k5)) * inverse
        gaps[A0, j] = a0 + t * (6.0 * k3 + t * (12.0 * k4 + t * 20.0 * k5)) * (inverse * inverse)


@kernel
def follow_push(followed, pair, now, later, series):
    """Add the response to a push to the accelerations at both ends of what is left of a step."""
    ends = followed.ends
    for output in range(ends.shape[1]):
        for k in range(series.shape[2] - 1):
            if k < now.shape[0]:
                ends[0, output] -= series[pair, output, k + 1] * now[k]
            ends[1, output] -= series[pair, output, k + 1] * later[k]


@kernel
def add_response(pair, now, responses, followed, work):
    """Add the response to a push on a pair, with its moments now and at the end of the step."""
    add_terms(work.numbers, 0, now, responses.starts, pair)
    add_four_terms(work.numbers, responses.starts.shape[2], work.later, responses.ends, pair)
    if followed is not None:
        follow_push(followed, pair, now, work.later, responses.accelerations)


@kernel
def add_push(pair, left, responses, followed, work):
    """Add the response to a push, whose moments are `work.now`, `left` s before the end."""
    moments_later(work.now, left, work.later)
    add_response(pair, work.now, responses, followed, work)


@kernel
def add_impulse(pair, change, left, responses, followed, work):
    """Add the response to a change of the speed of a pair, `left` s before the end."""
    work.impulse[0] = change
    powers_later(change, left, work.later)
    add_response(pair, work.impulse, responses, followed, work)


@kernel
def move_forces(followed, share):
    """Let what is left of the step begin at a share of it."""
    ends = followed.ends
    for output in range(ends.shape[1]):
        ends[0, output] += share * (ends[1, output] - ends[0, output])


@kernel
def put_on_stop(pair, stop, side, gaps, change, responses):
    """Move a gap that ends beyond a stop onto it; returns the speed taken away, m/s, or 0.

    A force that holds y on the stop over the rest r of a step changes the speed by -a r and the
    distance by -a r^2 / 2, both along the direction M^-1 d. Speed and distance beyond the stop are
    taken away in that direction; where damping is part of the flow, the speed that it took from the
    motion beyond the stop is given back.
    """
    states, series = responses.states, responses.gaps
    beyond = side * (gaps[Y1, pair] - stop)
    if beyond < 0.0:
        return 0.0
    taken = max(side * gaps[V1, pair], 0.0) - series[pair, pair, 2, 0] * beyond
    modes = states.shape[1] // 2
    for k in range(modes):
        share, damped = states[pair, modes + k, 0] * side, states[pair, modes + k, 1] * side
        change[k] -= beyond * share
        change[modes + k] -= taken * share + beyond * damped
    for other in range(gaps.shape[1]):
        share, damped = series[pair, other, 1, 0] * side, series[pair, other, 2, 0] * side
        gaps[Y1, other] -= beyond * share
        gaps[V1, other] -= taken * share + beyond * damped
    return taken


@kernel
def keep_between_stops(gaps, change, stops, laws, responses, tally):
    """Move the gaps that end beyond rigid stops onto them.

    A mass that is moved onto one stop may come to lie beyond another, hence several passes.
    """
    for _ in range(MOST_SWEEPS):
        moved = False
        for j in range(gaps.shape[1]):
            for which in range(2):
                side, stop = 2.0 * which - 1.0, stops.places[j, which]
                if side * (gaps[Y1, j] - stop) > 0.0 and stops.rigid[j, which]:
                    taken = put_on_stop(j, stop, side, gaps, change, responses)
                    add_rest(tally, taken, stops, laws, j, which)
                    rub_at_rest(
                        stops.tangents, j, which, taken, stops, gaps, change, responses, tally
                    )  # fmt: skip
                    gaps[Y1, j] = stop
                    moved = True
        if not moved:
            return


@kernel
def add_rest(tally, taken, stops, laws, pair, upper):
    """Add the speed that a stop takes from a mass at rest on it, as that of impacts."""
    kind = stops.kinds[pair, upper]
    change = 1.0 + mean_rebound_of(laws, kind, stops.numbers, 2 * pair + upper, 1.0)
    tally.sums[pair, 3 * upper + 1, tally.lane] += taken / change
    row = ROWS_OF_PAIR + ROWS_OF_STOP * upper
    if row < tally.sums.shape[1]:
        tally.sums[pair, row + IMPULSE, tally.lane] += taken


@kernel
def until_contact(step, span, impacts, stops, laws, responses, followed, work, tally, page):
    """Motion and impacts on rigid stops, until a compliant stop is touched or the step is over.

    Returns the compliant stop, its pair and side, or NO_PAIR; what is left of the step, s; and the
    number of impacts so far.
    """
    gaps, resting = work.gaps, work.contacts.resting
    while span > 0.0:
        first, w, pair, upper = first_touch(gaps, span, stops.places, resting, work.stack)
        if pair == NO_PAIR:
            break
        impacts += 1
        side, kind, row = 2.0 * upper - 1.0, stops.kinds[pair, upper], 2 * pair + upper
        stop = stops.places[pair, upper]
        counted = count_touch(tally, pair, upper, w, stops.thresholds[pair])
        move_starts(gaps, first * span, span)
        if followed is not None:
            move_forces(followed, first)
        span *= 1.0 - first
        rigid = stops.rigid[pair, upper]
        if page is not None:  # a test of its own is left out when compiled
            if not rigid:
                taken = tally.sums[pair, ROWS_OF_PAIR + ROWS_OF_STOP * upper + LOSS, tally.lane]
                log_contact(page, pair, step - span, side * w, counted, taken)
            elif page.open and counted:
                log_impact(page, pair, step - span, side * w)
        gaps[Y0, pair], gaps[V0, pair] = stop, side * w
        if not rigid:
            return pair, upper, span, impacts
        uniform = uniform_of(tally.word, impacts)
        rebound = rebound_of(laws, kind, stops.numbers, row, w, uniform)
        add_impact(tally, pair, upper, w, rebound)
        tangent = tangent_of(stops.tangents, pair)
        rebound, push, rubbed = rub_along(
            stops.tangents, pair, upper, w, rebound, gaps, V0, stops, responses, tally
        )
        add_impulse(pair, -side * push, span, responses, followed, work)
        if tangent >= 0:
            add_impulse(tangent, rubbed, span, responses, followed, work)
        gaps[Y0, pair], gaps[V0, pair] = stop, -side * rebound
        pressing = side * gaps[A0, pair]
        rests = (pressing > 0.0) & (rebound <= RESTING * pressing * step)
        if rests or impacts >= MOST_BOUNCES - 2 * gaps.shape[1]:
            resting[pair, upper] = 1
            taken = put_on_stop(pair, stop, side, gaps, work.change, responses)
            add_rest(tally, taken, stops, laws, pair, upper)
            rub_at_rest(
                stops.tangents, pair, upper, taken, stops, gaps, work.change, responses, tally
            )  # fmt: skip
    return NO_PAIR, 0, 0.0, impacts


@kernel
def finish_alone(
    step, span, touching, impacts, fastest, stops, laws, responses, followed, work, tally, page
):  # fmt: skip
    """What is left of a step of one path, with any number of contacts and impacts on any pair.

    Parameters
    ----------
    step, span : s, the step and what is left of it.
    touching, impacts : whether a compliant stop is in contact, and the number of impacts so far.
    fastest : None where all stops are rigid, else the fastest rate of the structure, rad/s.
    stops, laws, responses : `Stops`, `functions_of` the classes of laws, and `Responses`.
    followed : None, or `Followed`.
    work : `Workspace`, with gaps and changes, which are replaced.
    tally : `Tally`, added to.
    page : None, or part of a log.
    """
    gaps, contacts = work.gaps, work.contacts
    contacts.struck[0] = 0
    while True:
        if fastest is not None:  # noqa: SIM102 - a test of its own is left out when compiled
            if touching and span > 0.0:
                t = integrate_contacts(
                    gaps, span, step - span, step, fastest, contacts, stops, laws, responses,
                    followed, tally, page,
                )  # fmt: skip
                if followed is not None:
                    move_forces(followed, t / span)
                move_starts(gaps, t, span)
                span -= t
                for j in range(gaps.shape[1]):
                    if contacts.pushed[j] != 0:
                        for k in range(MOMENTS):
                            work.now[k] = contacts.moments[j, k]
                        add_push(j, span, responses, followed, work)
                for j in range(gaps.shape[1]):
                    gaps[Y0, j], gaps[V0, j] = contacts.gaps[Y, j], contacts.gaps[V, j]
        pair, upper, span, impacts = until_contact(
            step, span, impacts, stops, laws, responses, followed, work, tally, page
        )
        if pair == NO_PAIR or impacts >= MOST_BOUNCES:
            break
        contacts.inside[pair, upper] = PUSHES
        touching = True
    keep_between_stops(gaps, work.change, stops, laws, responses, tally)
