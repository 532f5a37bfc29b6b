"""What is left of a step of one path, with any number of impacts and contacts on any pairs.

Without the stops each gap is the quintic through its values, slopes and curvatures at both ends of
what is left of the step. An event is the first upward root of the distance beyond a stop. A rigid
stop turns the speed at once; a contact with a compliant one is integrated until no such stop is
touched (`contacts`). Both are pushes, whose responses are added to the ends (`pushes`). They act
along M^-1 d, so that elastic impacts keep the energy.
"""

from __future__ import annotations

import math
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
    gap_at,
    integrate_contacts,
    make_contacts,
    quintic_coefficients,
)
from stochvi.engine.impact_log import log_impact
from stochvi.engine.law_calls import margin_of, rebound_of
from stochvi.engine.pushes import MOMENTS, apply_push, moments_later
from stochvi.engine.roots import bracketed_root, first_root, rises_once

MOST_SWEEPS = 1000
"""Largest number of passes over all stops in which ends of steps beyond a stop are put between the
stops: each pass reduces the distance by about the ratio of the lightest mass to the heaviest."""


class Workspace(NamedTuple):
    """Arrays for a step of one path.

    Parameters
    ----------
    contacts : `Contacts`.
    now, later : (MOMENTS,) and (terms,), moments of a push.
    stack : (64, 8), parts of a step in which a root is still to be searched.
    """

    contacts: Contacts
    now: NDArray[np.float64]
    later: NDArray[np.float64]
    stack: NDArray[np.float64]


@kernel
def make_workspace(pairs, terms):
    """Arrays for that number of pairs, and of terms of the responses."""
    return Workspace(make_contacts(pairs), np.zeros(MOMENTS), np.zeros(terms), np.zeros((64, 8)))


@kernel
def find_contacts(gaps, contacts, stops, laws):
    """Note the state of each stop when a step begins; returns whether one is in contact."""
    touching = False
    for j in range(gaps.shape[0]):
        for which in range(2):
            side = 2.0 * which - 1.0
            y, v = side * (gaps[j, 0] - stops.places[j, which]), side * gaps[j, 1]
            contacts.inside[j, which] = APART
            if y > 0.0:
                kind, row = stops.kinds[j, which], 2 * j + which
                rigid = stops.rigid[j, which]
                if not rigid:
                    pushing = margin_of(laws, kind, stops.numbers, row, y, v) > 0.0
                    contacts.inside[j, which] = PUSHES if pushing else WITHDRAWN
                    touching = True
    return touching


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
def first_touch(gaps, span, stops, resting, stack):
    """Fraction of the span until the first stop is touched, 2 for never; the speed; the stop."""
    first, w, pair, upper = 2.0, 0.0, -1, 0
    for j in range(gaps.shape[0]):
        for which in range(2):
            stop = stops.places[j, which]
            if resting[j, which] == 0 and math.isfinite(stop):
                t, speed = find_crossing(gaps, j, span, stop, 2.0 * which - 1.0, stack)
                if t < first:
                    first, w, pair, upper = t, speed, j, which
    return first, w, pair, upper


@kernel
def move_starts(gaps, t, span, quintics):
    """Replace the starts of all gaps by values, slopes and curvatures after t of the span, s."""
    for j in range(gaps.shape[0]):
        quintic_coefficients(gaps, j, span, quintics)
        gaps[j, 0], gaps[j, 1], gaps[j, 2] = gap_at(quintics, j, t)


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
def add_push(pair, left, gaps, change, responses, followed, work):
    """Add the response to a push, whose moments are `work.now`, `left` s before the end."""
    moments_later(work.now, left, work.later)
    apply_push(pair, work.now, work.later, responses, gaps, change)
    if followed is not None:
        follow_push(followed, pair, work.now, work.later, responses.accelerations)


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
    states, series, _ = responses
    beyond = side * (gaps[pair, 3] - stop)
    if beyond < 0.0:
        return 0.0
    taken = max(side * gaps[pair, 4], 0.0) - series[pair, pair, 2, 0] * beyond
    modes = states.shape[1] // 2
    for k in range(modes):
        share, damped = states[pair, modes + k, 0] * side, states[pair, modes + k, 1] * side
        change[k] -= beyond * share
        change[modes + k] -= taken * share + beyond * damped
    for other in range(gaps.shape[0]):
        share, damped = series[pair, other, 1, 0] * side, series[pair, other, 2, 0] * side
        gaps[other, 3] -= beyond * share
        gaps[other, 4] -= taken * share + beyond * damped
    return taken


@kernel
def keep_between_stops(gaps, change, stops, laws, responses, sums):
    """Move the gaps that end beyond rigid stops onto them.

    A mass that is moved onto one stop may come to lie beyond another, hence several passes.
    """
    for _ in range(MOST_SWEEPS):
        moved = False
        for j in range(gaps.shape[0]):
            for which in range(2):
                side, stop = 2.0 * which - 1.0, stops.places[j, which]
                if side * (gaps[j, 3] - stop) > 0.0 and stops.rigid[j, which]:
                    taken = put_on_stop(j, stop, side, gaps, change, responses)
                    sums[j, 3 * which + 1] += taken / speeds_of(laws, stops, j, which)
                    gaps[j, 3] = stop
                    moved = True
        if not moved:
            return


@kernel
def speeds_of(laws, stops, pair, upper):
    """Change of the speed in an impact at the speed 1, 1 + R."""
    return 1.0 + rebound_of(laws, stops.kinds[pair, upper], stops.numbers, 2 * pair + upper, 1.0)


@kernel
def finish_alone(
    step, span, gaps, change, fastest, stops, laws, responses, followed, work, tally, page
):  # fmt: skip
    """What is left of a step of one path, with any number of contacts and impacts on any pair.

    Parameters
    ----------
    step, span : s, the step and what is left of it.
    gaps : (pairs, 6), value, slope and curvature of every gap at the start and the end of that,
        without the stops; replaced.
    change : (states,), what the stops add to displacements and velocities at the end of the step.
    fastest : None where all stops are rigid, else the fastest rate of the structure, rad/s.
    stops, laws, responses : `Stops`, `functions_of` the classes of laws, and `Responses`.
    followed : None, or `Followed`.
    work : `Workspace`, overwritten.
    tally : `Tally`, added to.
    page : None, or part of a log.
    """
    sums, contacts = tally.sums, work.contacts
    pairs = gaps.shape[0]
    for j in range(pairs):
        contacts.resting[j, 0] = contacts.resting[j, 1] = 0
    touching = False
    if fastest is not None:
        touching = find_contacts(gaps, contacts, stops, laws)
    for bounces in range(MOST_BOUNCES + 1):
        if fastest is not None:  # noqa: SIM102 - a test of its own is left out when compiled
            if touching:
                t = integrate_contacts(
                    gaps, span, step - span, step, fastest, contacts, stops, laws, responses,
                    followed, tally, page,
                )  # fmt: skip
                if followed is not None:
                    move_forces(followed, t / span)
                move_starts(gaps, t, span, contacts.quintics)
                span -= t
                for j in range(pairs):
                    if contacts.pushed[j] != 0:
                        for k in range(MOMENTS):
                            work.now[k] = contacts.moments[j, k]
                        add_push(j, span, gaps, change, responses, followed, work)
                for j in range(pairs):
                    gaps[j, 0], gaps[j, 1] = contacts.gaps[Y, j], contacts.gaps[V, j]
                touching = False
                if span <= 0.0:
                    break
        first, w, pair, upper = first_touch(gaps, span, stops, contacts.resting, work.stack)
        if pair < 0:
            break
        side, kind, row = 2.0 * upper - 1.0, stops.kinds[pair, upper], 2 * pair + upper
        stop, counted = stops.places[pair, upper], w >= stops.thresholds[pair]
        sums[pair, 3 * upper] += 1.0 if counted else 0.0
        sums[pair, 3 * upper + 1] += w
        sums[pair, 3 * upper + 2] += w * w
        move_starts(gaps, first * span, span, contacts.quintics)
        if followed is not None:
            move_forces(followed, first)
        span *= 1.0 - first
        if page is not None:  # noqa: SIM102
            if page.open and counted:
                log_impact(page, pair, step - span, side * w)
        gaps[pair, 0], gaps[pair, 1] = stop, side * w
        rigid = stops.rigid[pair, upper]
        if not rigid:
            if span <= 0.0:
                break
            contacts.inside[pair, upper] = PUSHES
            touching = True
            continue
        rebound = rebound_of(laws, kind, stops.numbers, row, w)
        work.now[:] = 0.0
        work.now[0] = -side * (w + rebound)
        add_push(pair, span, gaps, change, responses, followed, work)
        gaps[pair, 0], gaps[pair, 1] = stop, -side * rebound
        pressing = side * gaps[pair, 2]
        rests = (pressing > 0.0) & (rebound <= RESTING * pressing * step)
        if rests or bounces >= MOST_BOUNCES - 2 * pairs:
            contacts.resting[pair, upper] = 1
            taken = put_on_stop(pair, stop, side, gaps, change, responses)
            sums[pair, 3 * upper + 1] += taken / speeds_of(laws, stops, pair, upper)
    keep_between_stops(gaps, change, stops, laws, responses, sums)
