"""Contacts of one path with any number of compliant stops at the same time. Chapters: the contacts;
what is left of a step, with impacts and contacts on any pairs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.arithmetic import (
    ENDED,
    IMPULSE,
    LOSS,
    MOST_BOUNCES,
    PEAK,
    RESTING,
    ROWS_OF_PAIR,
    ROWS_OF_STOP,
    TIME,
    bracketed_root,
    cleared,
    first_root,
    log_contact,
    log_impact,
    rises_once,
    time_to_stop,
    uniform_of,
)
from stochvi.engine.calls import force_of, margin_of, mean_rebound_of, rate_of, rebound_of
from stochvi.engine.compiling import kernel
from stochvi.engine.sub_steps import (
    A0,
    A1,
    BUNDLE,
    CONTACT_ANGLE,
    FIRST_SHARE,
    MOMENTS,
    TERMS_AT_ONCE,
    V0,
    V1,
    Y0,
    Y1,
    add_four_terms,
    add_terms,
    moments_later,
    next_moments,
    padded,
    parabola_maximum,
    powers_later,
    rub_along,
    rub_at_rest,
    rub_contact,
    share_above_zero,
    tangent_of,
)

# ------------------------------------------------------------------------------
# Contacts of one path with any number of compliant stops at the same time.
#
# Without the forces of these stops each gap is a quintic z(t) over what is left of the step. With
# them it is z plus the response to their pushes (`sub_steps`), so that the motion obeys
#
#     y_j'' = z_j'' + sum_i (G_ij f_i + sum_k c''_ijk S_ik),    f = -F(y, y') on an upper stop
#
# G_ij is the immediate response of gap j to a push on pair i; the other sum is the response to all
# pushes so far. The number of modes does not enter. The equations are integrated by the method of
# Nyström, of order 4. A sub-step is a fixed part of the shortest time scale of all contacts
# together. It ends at every event: a touch, an impact on a rigid stop, and where a stop ceases or
# begins to push. A contact may last longer than the step.
#
# A stop is seen as an upper one: y is its deflection, v the rate of that.
# ------------------------------------------------------------------------------

MOST_NEWTON = 40
"""Largest number of Newton steps to the time of an event; each repeats a sub-step."""

EVENT_ERROR = 1e-12
"""Error of the time of an event, as a share of a sub-step."""

SHORTEST_SUB_STEP = 1e-12
"""Smallest share of a sub-step that is made up to an event, so that its length is never zero."""

APART, PUSHES, WITHDRAWN = range(3)
"""States of a compliant stop: not in contact, pushing, and following the mass without a
force."""

Y, V, Y_END, V_END = range(4)
"""Rows of `Contacts.gaps`: value and slope of every gap at both ends of a sub-step."""


class Contacts(NamedTuple):
    """Arrays for the contacts of one path.

    Parameters
    ----------
    inside : (pairs, 2), state of each stop.
    resting : (pairs, 2), 1 for a rigid stop on which the mass rests until the end of the step.
    quintics : (pairs, 6), coefficients of z by powers of time.
    moments, moments_end : (pairs, MOMENTS), moments of the pushes at both ends of a sub-step, whose
        forces are positive along the gap.
    pushed : (pairs,), 1 for a pair that has been pushed in the step.
    struck : (1,), number of impacts on rigid stops during the contacts of the step.
    gaps : (4, pairs), with the rows named above.
    accelerations : (4, pairs), those of the gaps in the four stages of a sub-step.
    forces, rates : (4, pairs, 2), forces of the stops along the gap, and rates of their
        deflections, in the four stages.
    """

    inside: NDArray[np.int64]
    resting: NDArray[np.int64]
    quintics: NDArray[np.float64]
    moments: NDArray[np.float64]
    moments_end: NDArray[np.float64]
    pushed: NDArray[np.int64]
    struck: NDArray[np.int64]
    gaps: NDArray[np.float64]
    accelerations: NDArray[np.float64]
    forces: NDArray[np.float64]
    rates: NDArray[np.float64]


class Tally(NamedTuple):
    """What the impacts and contacts of a path add up to, which has a lane of two tables.

    Parameters
    ----------
    peaks : (lanes, pairs, 2), the largest forces so far of contacts that last from step to step.
    sums : (pairs, rows, lanes), added to.
    lane : number of the path in them.
    word : that of the path in this step, by which `arithmetic` draws what scatters.
    """

    peaks: NDArray[np.float64]
    sums: NDArray[np.float64]
    lane: int
    word: int


@kernel
def count_touch(tally, pair, upper, w, threshold):
    """Add a touch of a stop at the speed w, m/s; returns whether it is counted."""
    sums, lane, row = tally.sums, tally.lane, 3 * upper
    counted = w >= threshold
    sums[pair, row, lane] += 1.0 if counted else 0.0
    sums[pair, row + 1, lane] += w
    sums[pair, row + 2, lane] += w * w
    return counted


@kernel
def add_impact(tally, pair, upper, w, rebound):
    """Add impulse and loss of an impact on a rigid stop, in a scene that sums them."""
    row = ROWS_OF_PAIR + ROWS_OF_STOP * upper
    if row < tally.sums.shape[1]:
        tally.sums[pair, row + IMPULSE, tally.lane] += w + rebound
        tally.sums[pair, row + LOSS, tally.lane] += 0.5 * (w - rebound) * (w + rebound)


EARLIER, EARLIER_AT, LAST, LAST_AT = range(2, 6)
END_ROWS = 6
"""Rows of `Followed.ends` after those of the ends."""


class Followed(NamedTuple):
    """Largest absolute accelerations, forces and deflections of a path in contacts.

    Parameters
    ----------
    ends : (END_ROWS, outputs), accelerations at both ends of what is left of the step, without the
        stops. Below stand the two that were read last, with their shares of the step.
    largest : (outputs,), updated. Where it is longer, the largest push of each pair, N/kg, and
        its largest deflection, m, follow.
    """

    ends: NDArray[np.float64]
    largest: NDArray[np.float64]


class Following(NamedTuple):
    """What the largest accelerations of all lanes are made from, in one step.

    Parameters
    ----------
    rows : (outputs, modes), from modal forces of springs, dampers and stops to accelerations.
    before, after : (modes, lanes), modal forces at both ends of the step, without the stops.
    ends : (END_ROWS, outputs), overwritten.
    largest : (lanes, columns of `Followed.largest`), updated.
    """

    rows: NDArray[np.float64]
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    ends: NDArray[np.float64]
    largest: NDArray[np.float64]


@kernel
def followed_of(following, lane):
    """The part of `Following` for one lane; None where nothing is followed."""
    if following is None:
        return None
    rows, before, after = following.rows, following.before, following.after
    ends, largest = following.ends, following.largest
    for output in range(ends.shape[1]):
        ends[0, output] = ends[1, output] = 0.0
        for k in range(before.shape[0]):
            ends[0, output] += rows[output, k] * before[k, lane]
            ends[1, output] += rows[output, k] * after[k, lane]
    return Followed(ends, largest[lane])


def make_contacts(pairs: int) -> Contacts:
    """Arrays for that number of pairs."""
    return Contacts(
        cleared(pairs, 2, of=np.int64), cleared(pairs, 2, of=np.int64), cleared(pairs, 6),
        cleared(pairs, MOMENTS), cleared(pairs, MOMENTS), cleared(pairs, of=np.int64),
        cleared(1, of=np.int64), cleared(4, pairs), cleared(4, pairs),
        cleared(4, pairs, 2), cleared(4, pairs, 2),
    )  # fmt: skip


@kernel
def quintic_coefficients(gaps, j, span, q):
    """Write the coefficients by powers of time of the quintic of gap j into q[j]."""
    g0, v0, a0 = gaps[Y0, j], gaps[V0, j], gaps[A0, j]
    rise = gaps[Y1, j] - g0 - v0 * span - 0.5 * a0 * span * span
    slope = (gaps[V1, j] - v0 - a0 * span) * span
    bend = (gaps[A1, j] - a0) * span * span
    cube = span * span * span
    q[j, 0], q[j, 1], q[j, 2] = g0, v0, 0.5 * a0
    q[j, 3] = (10.0 * rise - 4.0 * slope + 0.5 * bend) / cube
    q[j, 4] = (-15.0 * rise + 7.0 * slope - bend) / (cube * span)
    q[j, 5] = (6.0 * rise - 3.0 * slope + 0.5 * bend) / (cube * span * span)


@kernel
def memory(series, s, pushed, j, what, ahead):
    """Part `what` of the response of gap j to all pushes so far, `ahead` s after their moments."""
    total = 0.0
    for i in range(s.shape[0]):
        if pushed[i] != 0:
            s0, s1, s2, s3, s4, s5 = next_moments(
                s[i, 0], s[i, 1], s[i, 2], s[i, 3], s[i, 4], s[i, 5], ahead, 0.0, 0.0, 0.0
            )
            total += series[i, j, what, 0] * s0 + series[i, j, what, 1] * s1
            total += series[i, j, what, 2] * s2 + series[i, j, what, 3] * s3
            total += series[i, j, what, 4] * s4 + series[i, j, what, 5] * s5
    return total


@kernel
def gap_at(q, j, t):
    """Value, slope and curvature at t of the quintic of gap j."""
    return (
        q[j, 0] + t * (q[j, 1] + t * (q[j, 2] + t * (q[j, 3] + t * (q[j, 4] + t * q[j, 5])))),
        q[j, 1]
        + t * (2.0 * q[j, 2] + t * (3.0 * q[j, 3] + t * (4.0 * q[j, 4] + t * 5.0 * q[j, 5]))),
        2.0 * q[j, 2] + t * (6.0 * q[j, 3] + t * (12.0 * q[j, 4] + t * 20.0 * q[j, 5])),
    )


@kernel
def push_at(number, t, h, contacts, stops, laws, series):
    """Forces and accelerations in the stage `number`, 0 to 3, of a sub-step that began at t, h s
    after that."""
    inside, q, s, pushed = contacts.inside, contacts.quintics, contacts.moments, contacts.pushed
    gaps, a, forces, rates = (
        contacts.gaps, contacts.accelerations, contacts.forces, contacts.rates,
    )  # fmt: skip
    before = max(number - 1, 0)
    of_place = 2 if number == 3 else 0
    for j in range(q.shape[0]):
        if inside[j, 0] + inside[j, 1] == 0:
            # the pair may have been in contact before
            forces[number, j, 0] = forces[number, j, 1] = 0.0
            continue
        place = gaps[Y, j] + h * (gaps[V, j] + 0.5 * h * a[of_place, j])
        speed = gaps[V, j] + h * a[before, j]
        for which in range(2):
            force = 0.0
            if inside[j, which] != APART:
                side = 2.0 * which - 1.0
                deflection = side * (place - stops.places[j, which])
                rates[number, j, which] = side * speed
                if inside[j, which] == PUSHES:
                    force = -side * max(
                        force_of(
                            laws, stops.kinds[j, which], stops.numbers, 2 * j + which, deflection,
                            side * speed,
                        ),
                        0.0,
                    )  # fmt: skip
            forces[number, j, which] = force
    for j in range(q.shape[0]):
        if inside[j, 0] + inside[j, 1] == 0:
            continue
        _, _, total = gap_at(q, j, t + h)
        total += memory(series, s, pushed, j, 2, h)
        for i in range(q.shape[0]):
            if pushed[i] != 0:
                acting = forces[before, i, 0] + forces[before, i, 1]
                total += series[i, j, 1, 0] * (forces[number, i, 0] + forces[number, i, 1])
                total += h * (series[i, j, 2, 0] + 0.5 * h * series[i, j, 2, 1]) * acting
        a[number, j] = total


@kernel
def sub_step(t, h, contacts, stops, laws, series):
    """All gaps and the moments of all pushes after a sub-step of h s from t."""
    for number in range(4):
        push_at(number, t, 0.5 * ((number + 1) // 2) * h, contacts, stops, laws, series)
    forces, s, end = contacts.forces, contacts.moments, contacts.moments_end
    for i in range(s.shape[0]):
        if contacts.pushed[i] != 0:
            first = forces[0, i, 0] + forces[0, i, 1]
            middle = 0.5 * (forces[1, i, 0] + forces[1, i, 1] + forces[2, i, 0] + forces[2, i, 1])
            last = forces[3, i, 0] + forces[3, i, 1]
            (end[i, 0], end[i, 1], end[i, 2], end[i, 3], end[i, 4], end[i, 5]) = next_moments(
                s[i, 0], s[i, 1], s[i, 2], s[i, 3], s[i, 4], s[i, 5], h, first, middle, last
            )
    gaps = contacts.gaps
    for j in range(s.shape[0]):
        z, slope, _ = gap_at(contacts.quintics, j, t + h)
        gaps[Y_END, j] = z + memory(series, end, contacts.pushed, j, 0, 0.0)
        gaps[V_END, j] = slope + memory(series, end, contacts.pushed, j, 1, 0.0)


@kernel
def at_stop(j, which, y, v, stage, contacts, stops, laws):
    """Deflection of a stop with its rate, and margin with its rate.

    They are taken from rows y and v of the gaps, and from the accelerations of a stage.
    """
    side = 2.0 * which - 1.0
    deflection = side * (contacts.gaps[y, j] - stops.places[j, which])
    speed, bend = side * contacts.gaps[v, j], side * contacts.accelerations[stage, j]
    kind, row = stops.kinds[j, which], 2 * j + which
    return (
        deflection, speed,
        margin_of(laws, kind, stops.numbers, row, deflection, speed),
        margin_of(laws, kind, stops.numbers, row, speed, bend),
    )  # fmt: skip


@kernel
def share_to_event(j, which, h, contacts, stops, laws):
    """Share of a sub-step until the state of a stop changes, 2 if it does not."""
    state = contacts.inside[j, which]
    y0, v0, m0, p0 = at_stop(j, which, Y, V, 0, contacts, stops, laws)
    y1, v1, m1, p1 = at_stop(j, which, Y_END, V_END, 3, contacts, stops, laws)
    # where a state has just begun, the number that ended the one before is 0 up to rounding
    if state == APART:
        share, _ = time_to_stop(min(y0, 0.0), v0, y1, v1, h, 0.0)
    elif state == PUSHES:
        share, _ = time_to_stop(min(-m0, 0.0), -p0, -m1, -p1, h, 0.0)
    else:
        share, _ = time_to_stop(min(-y0, 0.0), -v0, -y1, -v1, h, 0.0)
        again, _ = time_to_stop(min(m0, 0.0), p0, m1, p1, h, 0.0)
        share = min(share, again)
    return share


@kernel
def time_to_event(j, which, contacts, stops, laws):
    """Time from the end of a sub-step until the state of a stop changes, by a Newton step; negative
    where it changes before, nan where it does not come nearer."""
    y, v, margin, rise = at_stop(j, which, Y_END, V_END, 3, contacts, stops, laws)
    state = contacts.inside[j, which]
    left, fall = margin, -rise
    if state == APART:
        left, fall = -y, v
    elif state == WITHDRAWN:
        left, fall = (y, -v) if y < -margin else (-margin, rise)
    return left / fall if fall > 0.0 else math.nan


@kernel
def first_event(h, contacts, stops, laws):
    """Share of a sub-step until the first event, 2 for none, and the stop: its pair and side."""
    first, pair, upper = 2.0, -1, 0
    for j in range(stops.places.shape[0]):
        for which in range(2):
            if math.isfinite(stops.places[j, which]) and contacts.resting[j, which] == 0:
                share = share_to_event(j, which, h, contacts, stops, laws)
                if share < first:
                    first, pair, upper = share, j, which
    return first, pair, upper


@kernel
def longest_sub_step(gaps, fastest, contacts, stops, laws):
    """Longest sub-step, s: a fixed part of the shortest time scale.

    The square of the largest rate is at most the sum of the squares of all rates.
    """
    square = fastest * fastest
    for j in range(gaps.shape[1]):
        for which in range(2):
            if contacts.inside[j, which] != APART:
                side = 2.0 * which - 1.0
                push = max(max(side * gaps[A0, j], side * gaps[A1, j]), 0.0)
                y = side * (contacts.gaps[Y, j] - stops.places[j, which])
                rate = rate_of(
                    laws, stops.kinds[j, which], stops.numbers, 2 * j + which, y,
                    side * contacts.gaps[V, j], push,
                )  # fmt: skip
                square += rate * rate
    return CONTACT_ANGLE / math.sqrt(square)


@kernel
def shorter_at_touch(h, contacts, stops, laws):
    """Length of a sub-step that is at most h, s, shorter near the touch of a stop whose force is
    not smooth there."""
    shortest = FIRST_SHARE * h
    for j in range(contacts.inside.shape[0]):
        for which in range(2):
            if contacts.inside[j, which] == APART:
                continue
            smooth = stops.smooth[j, which]
            side = 2.0 * which - 1.0
            y = side * (contacts.gaps[Y, j] - stops.places[j, which])
            v = side * contacts.gaps[V, j]
            if v != 0.0 and not smooth:
                h = min(h, max(shortest, y / v if v > 0.0 else -0.5 * y / v))
    return h


@kernel
def add_contacts(h, contacts, stops, laws, followed, tally):
    """Add impulse, dissipated energy, duration and peak force of a sub-step of all contacts."""
    gaps, a, f, v = contacts.gaps, contacts.accelerations, contacts.forces, contacts.rates
    peaks, sums, lane = tally.peaks, tally.sums, tally.lane
    pairs = stops.places.shape[0]
    for j in range(stops.places.shape[0]):
        for which in range(2):
            if contacts.inside[j, which] != PUSHES:
                continue
            side, kind, row = 2.0 * which - 1.0, stops.kinds[j, which], 2 * j + which
            lossy = stops.lossy[j, which]
            y0, y1 = gaps[Y, j], gaps[Y_END, j]
            v0, v1 = gaps[V, j], gaps[V_END, j]
            first = -side * f[0, j, which]
            last = force_of(
                laws, kind, stops.numbers, row, side * (y1 - stops.places[j, which]), side * v1
            )
            middle = force_of(
                laws, kind, stops.numbers, row,
                side * (0.5 * (y0 + y1) + 0.125 * h * (v0 - v1) - stops.places[j, which]),
                side * (0.5 * (v0 + v1) + 0.125 * h * (a[0, j] - a[3, j])),
            )  # fmt: skip
            pushing = 1.0
            if lossy:  # the force before it is cut off at 0
                start = force_of(
                    laws, kind, stops.numbers, row, side * (y0 - stops.places[j, which]), side * v0
                )
                pushing = share_above_zero(start, middle, last)
            highest = parabola_maximum(first, middle, max(last, 0.0))
            peaks[lane, j, which] = max(peaks[lane, j, which], highest)
            if followed is not None:
                outputs, largest = followed.ends.shape[1], followed.largest
                if largest.shape[0] > outputs:
                    place, half = stops.places[j, which], 0.5 * (y0 + y1) + 0.125 * h * (v0 - v1)
                    deepest = parabola_maximum(
                        side * (y0 - place), side * (half - place), side * (y1 - place)
                    )
                    largest[outputs + j] = max(largest[outputs + j], highest)
                    at = outputs + pairs + j
                    largest[at] = max(largest[at], deepest)
            target = ROWS_OF_PAIR + ROWS_OF_STOP * which
            total = f[0, j, which] + 2.0 * (f[1, j, which] + f[2, j, which]) + f[3, j, which]
            sums[j, target + IMPULSE, lane] -= side * h / 6.0 * total
            sums[j, target + TIME, lane] += pushing * h
            if lossy:
                work = f[0, j, which] * v[0, j, which] + f[3, j, which] * v[3, j, which]
                work += 2.0 * f[1, j, which] * v[1, j, which]
                work += 2.0 * f[2, j, which] * v[2, j, which]
                sums[j, target + LOSS, lane] -= side * h / 6.0 * work


@kernel
def rub_contacts(rubs, h, contacts, stops, responses, tally):
    """Add the friction of all contacts in a sub-step of h s to its end; see `Stops.rubs`."""
    if rubs is None:
        return
    f, gaps = contacts.forces, contacts.gaps
    for j in range(stops.places.shape[0]):
        tangent = tangent_of(stops.tangents, j)
        if tangent < 0:
            continue
        for which in range(2):
            if contacts.inside[j, which] != PUSHES:
                continue
            total = f[0, j, which] + 2.0 * (f[1, j, which] + f[2, j, which]) + f[3, j, which]
            taken = h / 6.0 * abs(total)
            rub_contact(
                j, tangent, which, h, gaps[V, tangent], gaps[V_END, tangent], taken, contacts,
                stops, responses, tally,
            )  # fmt: skip


@kernel
def crest(a0, t0, a1, t1, a2, t2):
    """Largest absolute value of the parabola through three values, where that lies between them;
    else that of the last one. There are no earlier values where t0 is nan."""
    rise = (a1 - a0) / (t1 - t0)
    bend = ((a2 - a1) / (t2 - t1) - rise) / (t2 - t0)
    top = 0.5 * (t0 + t1) - 0.5 * rise / bend
    inner = (t0 < top) and (top < t2) and a1 * bend < 0.0  # nan is in no order
    return abs(a0 + (top - t0) * (rise + bend * (top - t1))) if inner else abs(a2)


@kernel
def forget(followed):
    """Leave out what was read before: accelerations may jump at events."""
    for output in range(followed.ends.shape[1]):
        followed.ends[EARLIER_AT, output] = followed.ends[LAST_AT, output] = math.nan


@kernel
def follow(followed, share, contacts, responses):
    """Raise the largest accelerations to those at the start of a sub-step, at a share of what is
    left of the step. A crest between the last three of them counts, too."""
    ends, largest = followed.ends, followed.largest
    series, s = responses.accelerations, contacts.moments
    for output in range(ends.shape[1]):
        total = ends[0, output] + share * (ends[1, output] - ends[0, output])
        for i in range(s.shape[0]):
            if contacts.pushed[i] != 0:
                force = contacts.forces[0, i, 0] + contacts.forces[0, i, 1]
                total -= series[i, output, 0] * force
                for m in range(min(MOMENTS, series.shape[2] - 1)):
                    total -= series[i, output, m + 1] * s[i, m]
        highest = crest(
            ends[EARLIER, output], ends[EARLIER_AT, output], ends[LAST, output],
            ends[LAST_AT, output], total, share,
        )  # fmt: skip
        largest[output] = max(largest[output], highest, abs(total))
        ends[EARLIER, output], ends[EARLIER_AT, output] = ends[LAST, output], ends[LAST_AT, output]
        ends[LAST, output], ends[LAST_AT, output] = total, share


@kernel
def apply_event(t, start, step, pair, upper, contacts, stops, laws, responses, tally, page):
    """Change the state of a stop, or apply an impact on a rigid one, t s after the contacts began.

    They began `start` s after the step.
    """
    peaks, sums, lane = tally.peaks, tally.sums, tally.lane
    gaps, inside = contacts.gaps, contacts.inside
    side, stop = 2.0 * upper - 1.0, stops.places[pair, upper]
    deflection, speed, margin, _ = at_stop(pair, upper, Y, V, 3, contacts, stops, laws)
    if inside[pair, upper] != APART:
        if inside[pair, upper] == WITHDRAWN and deflection > -margin:
            inside[pair, upper] = PUSHES
            return
        lossy = stops.lossy[pair, upper]
        if inside[pair, upper] == PUSHES and lossy and speed < 0.0:
            # the stop pulls from here on, and follows the mass without a force
            inside[pair, upper] = WITHDRAWN
            if deflection > 0.0:
                return
        target = ROWS_OF_PAIR + ROWS_OF_STOP * upper
        sums[pair, target + PEAK, lane] += peaks[lane, pair, upper]
        sums[pair, target + ENDED, lane] += 1.0
        peaks[lane, pair, upper] = 0.0
        inside[pair, upper] = APART
        gaps[Y, pair] = stop
        return
    gaps[Y, pair], w = stop, max(speed, 0.0)
    counted = count_touch(tally, pair, upper, w, stops.thresholds[pair])
    rigid = stops.rigid[pair, upper]
    if page is not None:  # a test of its own is left out when compiled
        if not rigid:
            taken = sums[pair, ROWS_OF_PAIR + ROWS_OF_STOP * upper + LOSS, lane]
            log_contact(page, pair, start + t, side * w, counted, taken)
        elif page.open and counted:
            log_impact(page, pair, start + t, side * w)
    contacts.pushed[pair] = 1
    if not rigid:
        inside[pair, upper] = PUSHES
        return
    bounce_in_contact(
        stops.bounces, t, pair, upper, w, step, contacts, stops, laws, responses, tally
    )


@kernel
def bounce_in_contact(
    bounces, t, pair, upper, w, step, contacts, stops, laws, responses, tally
):  # fmt: skip
    """An impact on a rigid stop at the speed w, m/s, while others push; see `Stops.bounces`."""
    if bounces is None:
        return
    gaps, side = contacts.gaps, 2.0 * upper - 1.0
    kind, row = stops.kinds[pair, upper], 2 * pair + upper
    # impacts between contacts have the numbers below MOST_BOUNCES
    uniform = uniform_of(tally.word, MOST_BOUNCES + contacts.struck[0])
    contacts.struck[0] += 1
    rebound = rebound_of(laws, kind, stops.numbers, row, w, uniform)
    add_impact(tally, pair, upper, w, rebound)
    tangent = tangent_of(stops.tangents, pair)
    rebound, push, rubbed = rub_along(
        stops.tangents, pair, upper, w, rebound, gaps, V, stops, responses, tally
    )
    if tangent >= 0:
        contacts.pushed[tangent] = 1
        contacts.moments[tangent, 0] += rubbed
    contacts.moments[pair, 0] -= side * push
    for j in range(gaps.shape[1]):
        gaps[V, j] -= side * push * responses.gaps[pair, j, 1, 0]
        if tangent >= 0:
            gaps[V, j] += rubbed * responses.gaps[tangent, j, 1, 0]
    gaps[V, pair] = -side * rebound
    _, _, bend = gap_at(contacts.quintics, pair, t)
    pressing = side * (bend + memory(
        responses.gaps, contacts.moments, contacts.pushed, pair, 2, 0.0
    ))  # fmt: skip
    if pressing > 0.0 and rebound <= RESTING * pressing * step:
        contacts.resting[pair, upper] = 1


@kernel
def integrate_contacts(
    gaps, span, start, step, fastest, contacts, stops, laws, responses, followed, tally, page
):  # fmt: skip
    """Contacts until all have ended or the span is over; returns the time that this took, s.

    On return `contacts` holds the moments of all pushes, and the values and slopes of all gaps.

    Parameters
    ----------
    gaps : (6, pairs), values, slopes and curvatures at both ends of the span, without the forces.
    span, start, step : s, what is left of the step, the time since it began, and its length.
    fastest : rad/s, the fastest rate of the structure.
    followed : None, or `Followed`.
    tally : `Tally`.
    page : None, or part of a log.
    """
    inside, s, series = contacts.inside, contacts.moments, responses.gaps
    pairs = gaps.shape[1]
    for j in range(pairs):
        quintic_coefficients(gaps, j, span, contacts.quintics)
        contacts.gaps[Y, j], contacts.gaps[V, j] = gaps[Y0, j], gaps[V0, j]
        contacts.pushed[j] = 1 if inside[j, 0] + inside[j, 1] > 0 else 0
        for k in range(MOMENTS):
            s[j, k] = 0.0
    t, events = 0.0, 0
    if followed is not None:
        forget(followed)
    longest = longest_sub_step(gaps, fastest, contacts, stops, laws)
    while t < span:
        h = min(shorter_at_touch(longest, contacts, stops, laws), span - t)
        ends = h == span - t
        sub_step(t, h, contacts, stops, laws, series)
        if followed is not None:
            follow(followed, t / span, contacts, responses)
        share, pair, upper = first_event(h, contacts, stops, laws)
        if share <= 1.0:
            whole = h
            h = max(share, SHORTEST_SUB_STEP) * whole
            for _ in range(MOST_NEWTON):
                sub_step(t, h, contacts, stops, laws, series)
                left = time_to_event(pair, upper, contacts, stops, laws)
                later = 0.5 * h if math.isnan(left) else min(max(h + left, 0.5 * h), whole)
                if abs(later - h) <= EVENT_ERROR * whole:
                    break
                h = later
            ends = False
        add_contacts(h, contacts, stops, laws, followed, tally)
        t = span if ends else t + h
        rub_contacts(stops.rubs, h, contacts, stops, responses, tally)
        for j in range(pairs):
            contacts.gaps[Y, j] = contacts.gaps[Y_END, j]
            contacts.gaps[V, j] = contacts.gaps[V_END, j]
            if contacts.pushed[j] != 0:
                for k in range(MOMENTS):
                    s[j, k] = contacts.moments_end[j, k]
        if share > 1.0:
            continue
        if followed is not None:  # where a contact ends or begins
            push_at(0, t, 0.0, contacts, stops, laws, series)
            follow(followed, t / span, contacts, responses)
            forget(followed)
        apply_event(t, start, step, pair, upper, contacts, stops, laws, responses, tally, page)
        events += 1
        rigid = stops.rigid[pair, upper]
        if events >= MOST_BOUNCES and rigid:
            contacts.resting[pair, upper] = 1
        lasting = 0
        for j in range(pairs):
            lasting += inside[j, 0] + inside[j, 1]
        if lasting == 0:
            break
        longest = longest_sub_step(gaps, fastest, contacts, stops, laws)
    if followed is not None:
        push_at(0, min(t, span), 0.0, contacts, stops, laws, series)
        follow(followed, min(t, span) / span, contacts, responses)
    return min(t, span)


# ------------------------------------------------------------------------------
# What is left of a step of one path, with any number of impacts and contacts on any pairs.
#
# Without the stops each gap is the quintic through its values, slopes and curvatures at both ends
# of what is left of the step. An event is the first upward root of the distance beyond a stop. A
# rigid stop turns the speed at once; a contact with a compliant one is integrated until no such
# stop is touched (`integrate_contacts`). Both are pushes, whose responses are added to the ends
# (`sub_steps`). They act along M^-1 d, so that elastic impacts keep the energy.
# ------------------------------------------------------------------------------


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
    change : (states,), what the stops add to displacements, velocities and branches at the end of
        the step;
        a view of `numbers`.
    now, later : (MOMENTS,) and (terms,), moments of a push, those later padded.
    jump : (2,), the moments of a push that takes no time: change of the speed, m/s, and of the gap.
    stack : (64, 8), parts of a step in which a root is still to be searched.
    """

    contacts: Contacts
    numbers: NDArray[np.float64]
    gaps: NDArray[np.float64]
    change: NDArray[np.float64]
    now: NDArray[np.float64]
    later: NDArray[np.float64]
    jump: NDArray[np.float64]
    stack: NDArray[np.float64]


def make_workspace(pairs: int, states: int, terms: int) -> Workspace:
    """Arrays for that number of pairs, of states, and of terms of the responses."""
    numbers = cleared(3 * pairs + padded(3 * pairs + states, BUNDLE))
    later = cleared(padded(terms, TERMS_AT_ONCE))
    return Workspace(
        make_contacts(pairs), numbers, numbers[: 6 * pairs].reshape((6, pairs)),
        numbers[6 * pairs : 6 * pairs + states], cleared(MOMENTS), later, cleared(2),
        cleared(64, 8),
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
def add_jump(pair, change, moved, left, responses, followed, work):
    """Add the response to a jump of the speed (m/s) and of the gap (m) of a pair, `left` s before
    the end."""
    work.jump[0], work.jump[1] = change, moved
    powers_later(change, moved, left, work.later)
    add_response(pair, work.jump, responses, followed, work)


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
    modes = responses.modes
    for k in range(modes):
        share, damped = states[pair, modes + k, 0] * side, states[pair, modes + k, 1] * side
        change[k] -= beyond * share
        change[modes + k] -= taken * share + beyond * damped
    for k in range(2 * modes, states.shape[1]):  # branches, which a short way only stretches
        change[k] -= beyond * states[pair, k, 1] * side
    for other in range(gaps.shape[1]):
        share, damped = series[pair, other, 1, 0] * side, series[pair, other, 2, 0] * side
        gaps[Y1, other] -= beyond * share
        gaps[V1, other] -= taken * share + beyond * damped
    return taken


@kernel
def hold_on_stop(pair, stop, side, span, responses, work):
    """Hold a gap that begins the span, s, at rest on a stop; returns the speed taken away, m/s.

    A load that turns within the span is held until then, as the line through its ends. The mass
    leaves from there, with the speed that the rest of the span gives it.
    """
    gaps = work.gaps
    pressing, last = side * gaps[A0, pair], side * gaps[A1, pair]
    if (pressing <= 0.0) | (last >= 0.0):
        return put_on_stop(pair, stop, side, gaps, work.change, responses)
    held = span * pressing / (pressing - last)
    power = -side * pressing * held
    for k in range(MOMENTS):  # of a force that falls to 0 along a line
        work.now[k] = power / (k + 2)
        power *= held
    moments_later(work.now, span - held, work.later)
    add_four_terms(work.numbers, responses.starts.shape[2], work.later, responses.ends, pair)
    return 0.5 * pressing * held


@kernel
def keep_between_stops(bounces, gaps, change, stops, laws, responses, tally):
    """Move the gaps that end beyond rigid stops onto them; see `Stops.bounces`.

    A mass that is moved onto one stop may come to lie beyond another, hence several passes.
    """
    if bounces is None:
        return
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
        side, stop = 2.0 * upper - 1.0, stops.places[pair, upper]
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
        bounce(
            stops.bounces, pair, upper, w, step, span, impacts, stops, laws, responses, followed,
            work, tally,
        )  # fmt: skip
    return NO_PAIR, 0, 0.0, impacts


@kernel
def bounce(
    bounces, pair, upper, w, step, span, impacts, stops, laws, responses, followed, work, tally
):  # fmt: skip
    """The impact of that number on a rigid stop at the speed w, m/s; see `Stops.bounces`."""
    if bounces is None:
        return
    gaps, stop, side = work.gaps, stops.places[pair, upper], 2.0 * upper - 1.0
    kind, row = stops.kinds[pair, upper], 2 * pair + upper
    uniform = uniform_of(tally.word, impacts)
    rebound = rebound_of(laws, kind, stops.numbers, row, w, uniform)
    add_impact(tally, pair, upper, w, rebound)
    tangent = tangent_of(stops.tangents, pair)
    rebound, push, rubbed = rub_along(
        stops.tangents, pair, upper, w, rebound, gaps, V0, stops, responses, tally
    )
    add_jump(pair, -side * push, 0.0, span, responses, followed, work)
    if tangent >= 0:
        add_jump(tangent, rubbed, 0.0, span, responses, followed, work)
    gaps[Y0, pair], gaps[V0, pair] = stop, -side * rebound
    pressing = side * gaps[A0, pair]
    rests = (pressing > 0.0) & (rebound <= RESTING * pressing * step)
    if rests or impacts >= MOST_BOUNCES - 2 * gaps.shape[1]:
        work.contacts.resting[pair, upper] = 1
        taken = hold_on_stop(pair, stop, side, span, responses, work)
        add_rest(tally, taken, stops, laws, pair, upper)
        rub_at_rest(
            stops.tangents, pair, upper, taken, stops, gaps, work.change, responses, tally
        )  # fmt: skip


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
    keep_between_stops(stops.bounces, gaps, work.change, stops, laws, responses, tally)
