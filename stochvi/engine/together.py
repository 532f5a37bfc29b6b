"""What is left of a step of many paths side by side, as far as each meets one stop at a time.

Most lanes in which a stop may be reached meet it alone: there is no impact, one after the other,
or one contact during which no other stop is near. In rounds, all lanes look for their first touch,
are sorted by the stop that they touch, and each stop turns its lanes together: a rigid one at once,
a compliant one in sub-steps side by side. The other lanes finish their step one by one
(`alone`), with the same equations: those with several contacts at once, or at rest on a stop.
"""

from __future__ import annotations

import math
from types import NoneType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.alone import (
    Workspace,
    find_crossing,
    finish_alone,
    keep_between_stops,
)
from stochvi.engine.bounces import RESTING
from stochvi.engine.compiling import kernel
from stochvi.engine.contacts import CONTACT_ANGLE, FIRST_SHARE, Tally
from stochvi.engine.lanes import rows_of
from stochvi.engine.law import (
    Laws,
    Stops,
    force,
    is_lossy,
    is_rigid,
    is_smooth,
    margin,
    rate,
    read,
    rebound,
    traits_of,
)
from stochvi.engine.parts import generic
from stochvi.engine.pushes import BINOMIAL, MOMENTS, MOST_TERMS, Responses, next_moments
from stochvi.engine.sums import ENDED, IMPULSE, LOSS, PEAK, ROWS_OF_PAIR, ROWS_OF_STOP, TIME

EVENT_ERROR = 1e-9
"""Error of the time of an event, as a share of a sub-step, before the last Newton step to it."""

MOST_TRIES = 20
"""Largest number of Newton steps to an event."""

MOST_SUB_STEPS = 100_000
"""Largest number of sub-steps of a contact in a step."""

SHORTEST_SPAN = 1e-50
"""Smallest divisor in the place of what is left of a step, s, so that nothing is divided by 0."""

MOST_ROUNDS = 50
"""Largest number of events of a lane in a step; a lane with more finishes alone."""

RUNNING, OVER, LASTING = 0.0, 1.0, 2.0
"""States of the contact of a lane."""

(
    LEFT, SPEED, TOP, Y, V, T, H, LONGEST, WHOLE, TRIES, PUSHING, STATE, PEAKS, LOST, LASTED, ALONE,
    Q0, Q1, Q2, Q3,
) = range(20)  # fmt: skip
NOW = 20
LATER = NOW + MOMENTS
OUT = LATER + MOST_TERMS
SCRATCH = OUT + 1
"""Rows of numbers that are used within a round: what is left of the step, impact speed, largest
distance beyond a stop; state of a contact; curvature of the gap without forces by powers of time;
moments of a push now and at the end of the step; a sum."""

LANE, SPAN, EVENT, WHEN, FAST, GAPS = range(6)
"""Rows of a batch: the lane, what is left of its step (s), the stop that it touches first, after
which share of that, at which speed; six rows of ends for each gap."""

NO_STOP = -1.0
"""The event of a lane that touches no stop in what is left of its step."""


@kernel
def rows_needed(pairs):
    """Number of rows of memory for that number of pairs: scratch, and two batches."""
    return SCRATCH + 2 * (GAPS + 6 * pairs)


# ---- which stop a lane touches first ----------------------------------------------------------


@kernel
def hull_beyond(memory, batch, count, j, stop, side):
    """Write how far the hull of the quintic of gap j reaches beyond a stop into row TOP."""
    w = rows_of(memory)
    first = batch + GAPS + 6 * j
    for i in range(count):
        span = w[batch + SPAN, i]
        start, end = side * (w[first, i] - stop), side * (w[first + 3, i] - stop)
        leaving, coming = 0.2 * span * side * w[first + 1, i], 0.2 * span * side * w[first + 4, i]
        bend = 0.05 * span * span * side
        c2 = start + 2.0 * leaving + bend * w[first + 2, i]
        c3 = end - 2.0 * coming + bend * w[first + 5, i]
        highest = max(max(start + leaving, c2), max(c3, end - coming))
        highest = max(highest, max(start, end))
        w[TOP, i] = highest if span > 0.0 else -1.0


@kernel
def find_touches(memory, batch, count, stops, gaps, stack):
    """Write the first touch of each lane that has no event yet into its rows."""
    w = rows_of(memory)
    for i in range(count):
        w[batch + WHEN, i] = 2.0 if w[batch + EVENT, i] == NO_STOP else 0.0
    for j in range(stops.places.shape[0]):
        first = batch + GAPS + 6 * j
        for which in range(2):
            stop, side = stops.places[j, which], 2.0 * which - 1.0
            if not math.isfinite(stop):
                continue
            hull_beyond(memory, batch, count, j, stop, side)
            for i in range(count):
                if w[TOP, i] > 0.0 and w[batch + WHEN, i] != 0.0:
                    for k in range(6):
                        gaps[j, k] = w[first + k, i]
                    t, speed = find_crossing(gaps, j, w[batch + SPAN, i], stop, side, stack)
                    if t < w[batch + WHEN, i]:
                        w[batch + WHEN, i], w[batch + FAST, i] = t, speed
                        w[batch + EVENT, i] = 2.0 * j + which


@kernel
def sort_by_event(memory, batch, count, rows, other, starts):
    """Copy the lanes with an event to the other batch, sorted by it; returns how many they are.

    The lanes of the stop s are then those from starts[s] to starts[s + 1].
    """
    w = rows_of(memory)
    starts[:] = 0
    for i in range(count):
        starts[int(w[batch + EVENT, i]) + 2] += 1
    starts[1] = 0  # the lanes without an event
    for k in range(2, starts.shape[0]):
        starts[k] += starts[k - 1]
    kept = starts[starts.shape[0] - 1]
    for i in range(count):
        event = int(w[batch + EVENT, i])
        if event >= 0:
            place = starts[event + 1]
            starts[event + 1] += 1
            for row in range(rows):
                w[other + row, place] = w[batch + row, i]
    return kept


@kernel
def move_starts(memory, batch, low, high, pairs, row):
    """Let what is left of the step begin later, by the time in a row of scratch, s."""
    w = rows_of(memory)
    for j in range(pairs):
        first = batch + GAPS + 6 * j
        for i in range(low, high):
            span, s = max(w[batch + SPAN, i], SHORTEST_SPAN), w[row, i]
            t = s / span
            g0, v0, a0 = w[first, i], w[first + 1, i], w[first + 2, i]
            rise = w[first + 3, i] - g0 - v0 * span - 0.5 * a0 * span * span
            slope = (w[first + 4, i] - v0 - a0 * span) * span
            bend = (w[first + 5, i] - a0) * span * span
            k3 = 10.0 * rise - 4.0 * slope + 0.5 * bend
            k4 = -15.0 * rise + 7.0 * slope - bend
            k5 = 6.0 * rise - 3.0 * slope + 0.5 * bend
            w[first, i] = g0 + s * (v0 + 0.5 * s * a0) + t * t * t * (k3 + t * (k4 + t * k5))
            w[first + 1, i] = (
                v0 + s * a0 + t * t * (3.0 * k3 + t * (4.0 * k4 + t * 5.0 * k5)) / span
            )
            w[first + 2, i] = a0 + t * (6.0 * k3 + t * (12.0 * k4 + t * 20.0 * k5)) / (span * span)
    for i in range(low, high):
        w[batch + SPAN, i] -= w[row, i]


# ---- pushes -----------------------------------------------------------------------------------


@kernel
def weighted_sum(memory, low, high, first, weights):
    """Row OUT = the sum of rows from `first` on with these weights."""
    w = rows_of(memory)
    for i in range(low, high):
        w[OUT, i] = weights[0] * w[first, i]
    for k in range(1, weights.shape[0]):
        for i in range(low, high):
            w[OUT, i] += weights[k] * w[first + k, i]


@kernel
def moments_later(memory, batch, low, high, terms, moments):
    """Moments of pushes at the end of the step, from the first ones now."""
    w = rows_of(memory)
    for k in range(terms):
        for i in range(low, high):
            w[LATER + k, i] = 0.0
    for i in range(low, high):
        w[OUT, i] = 1.0
    for shift in range(terms):
        for m in range(min(moments, terms - shift)):
            weight = BINOMIAL[m + shift, m]
            for i in range(low, high):
                w[LATER + m + shift, i] += weight * w[OUT, i] * w[NOW + m, i]
        for i in range(low, high):
            w[OUT, i] *= w[batch + SPAN, i]


@kernel
def add_pushes(memory, batch, low, high, pair, moments, responses, new):
    """Add the responses to pushes on a pair, from their moments now, to gaps and states."""
    w = rows_of(memory)
    states, series, _ = responses
    terms = states.shape[2]
    moments_later(memory, batch, low, high, terms, moments)
    for other in range(series.shape[1]):
        first = batch + GAPS + 6 * other
        for what in range(3):
            weighted_sum(memory, low, high, NOW, series[pair, other, what, :moments])
            for i in range(low, high):
                w[first + what, i] += w[OUT, i]
            weighted_sum(memory, low, high, LATER, series[pair, other, what])
            for i in range(low, high):
                w[first + 3 + what, i] += w[OUT, i]
    for row in range(states.shape[1]):
        weighted_sum(memory, low, high, LATER, states[pair, row])
        for i in range(low, high):
            new[row, int(w[batch + LANE, i])] += w[OUT, i]


# ---- impacts and contacts of the lanes of one stop --------------------------------------------


@kernel
def add_touches(memory, batch, low, high, pair, upper, scene):
    """Count the touches of the lanes, and add their speeds.

    Contacts that last from the step before have no touch, and lanes that finish alone count
    theirs.
    """
    w = rows_of(memory)
    sums, threshold = scene.sums, scene.stops.thresholds[pair]
    row = scene.first_row + scene.rows_of_pair * pair + 3 * upper
    for i in range(low, high):
        lane, speed = int(w[batch + LANE, i]), w[batch + FAST, i]
        if (w[ALONE, i] == 0.0) & (speed >= 0.0):
            sums[row, lane] += 1.0 if speed >= threshold else 0.0
            sums[row + 1, lane] += speed
            sums[row + 2, lane] += speed * speed


@kernel
def turn_back(law, batch, low, high, pair, upper, scene):
    """Impacts of the lanes on a rigid stop; those at rest are marked, and left as they are."""
    w = rows_of(scene.memory)
    side, stop = 2.0 * upper - 1.0, scene.stops.places[pair, upper]
    first = batch + GAPS + 6 * pair
    own = scene.responses.gaps[pair, pair, 2, 0]
    for i in range(low, high):
        speed = w[batch + FAST, i]
        back = rebound(law, speed)
        # as slow as on a stop on which the mass rests
        pressing = side * w[first + 2, i] - own * (speed + back)
        w[ALONE, i] = 1.0 if (pressing > 0.0) & (back <= RESTING * pressing * scene.step) else 0.0
        w[SPEED, i] = -side * back
        w[NOW, i] = 0.0 if w[ALONE, i] > 0.0 else -side * (speed + back)
        w[V, i] = side * speed
    add_pushes(scene.memory, batch, low, high, pair, 1, scene.responses, scene.new)
    for i in range(low, high):
        w[first, i] = stop
        w[first + 1, i] = w[SPEED, i] if w[ALONE, i] == 0.0 else w[V, i]


@kernel
def start_contacts(law, batch, low, high, pair, upper, scene, fastest):
    """Write the contacts of the lanes with a stop as they begin into the rows of scratch."""
    w = rows_of(scene.memory)
    side, stop = 2.0 * upper - 1.0, scene.stops.places[pair, upper]
    first = batch + GAPS + 6 * pair
    for i in range(low, high):
        span = max(w[batch + SPAN, i], SHORTEST_SPAN)
        g0, v0, a0 = w[first, i] - stop, w[first + 1, i], w[first + 2, i]
        rise = w[first + 3, i] - stop - g0 - v0 * span - 0.5 * a0 * span * span
        slope = (w[first + 4, i] - v0 - a0 * span) * span
        bend = (w[first + 5, i] - a0) * span * span
        square = span * span
        w[Q0, i] = side * a0
        w[Q1, i] = side * 6.0 * (10.0 * rise - 4.0 * slope + 0.5 * bend) / (square * span)
        w[Q2, i] = side * 12.0 * (-15.0 * rise + 7.0 * slope - bend) / (square * square)
        w[Q3, i] = side * 20.0 * (6.0 * rise - 3.0 * slope + 0.5 * bend) / (square * square * span)
        w[Y, i], w[V, i], w[T, i] = side * g0, side * v0, 0.0
        w[LEFT, i], w[TRIES, i] = w[batch + SPAN, i], 0.0
        w[PEAKS, i], w[LOST, i], w[LASTED, i] = 0.0, 0.0, 0.0
        w[STATE, i] = RUNNING
    for k in range(MOMENTS):
        for i in range(low, high):
            w[NOW + k, i] = 0.0
    for i in range(low, high):
        y, v = w[Y, i], w[V, i]
        push = max(max(w[Q0, i], side * w[first + 5, i]), 0.0)
        own = rate(law, y, v, push)
        longest = CONTACT_ANGLE / math.sqrt(fastest * fastest + own * own)
        w[LONGEST, i] = longest
        w[PUSHING, i] = 1.0 if (y <= 0.0) | (margin(law, y, v) > 0.0) else 0.0
        w[H, i] = min(first_length(law, y, v, longest), w[LEFT, i])
        w[WHOLE, i] = w[H, i]


@kernel(inline="always")
def first_length(law, y, v, longest):
    """Length of a sub-step, s, shorter near the touch of a stop whose force is not smooth there."""
    if is_smooth(law):
        return longest
    there = y / v if v > 0.0 else -0.5 * y / v
    shorter = min(longest, max(FIRST_SHARE * longest, there))
    return shorter if v != 0.0 else longest


@kernel
def advance_contacts(law, memory, low, high, own, series):
    """One sub-step of the contacts of the lanes, or one try of it; returns how many go on.

    `own` is the immediate response of the speed to a push, `series` that of the curvature.
    """
    w = rows_of(memory)
    c0, c1, c2, c3 = series
    lossy, smooth = is_lossy(law), is_smooth(law)
    running = 0
    for i in range(low, high):
        y, v, t, h, on = w[Y, i], w[V, i], w[T, i], w[H, i], w[PUSHING, i]
        active = w[STATE, i] == RUNNING
        s0, s1, s2, s3 = w[NOW, i], w[NOW + 1, i], w[NOW + 2, i], w[NOW + 3, i]
        s4, s5 = w[NOW + 4, i], w[NOW + 5, i]
        q0, q1, q2, q3 = w[Q0, i], w[Q1, i], w[Q2, i], w[Q3, i]
        half, after = 0.5 * h, t + h
        middle = t + half
        b = q0 + t * (q1 + t * (q2 + t * q3))
        b -= c0 * s0 + c1 * s1 + c2 * s2 + c3 * s3
        f0 = on * max(force(law, y, v), 0.0)
        a0 = b - own * f0
        b = q0 + middle * (q1 + middle * (q2 + middle * q3))
        b -= c0 * s0 + c1 * (s1 + half * s0) + c2 * (s2 + half * (2.0 * s1 + half * s0))
        b -= c3 * (s3 + half * (3.0 * s2 + half * (3.0 * s1 + half * s0)))
        y1, v1 = y + half * (v + 0.5 * half * a0), v + half * a0
        f1 = on * max(force(law, y1, v1), 0.0)
        lag = half * (c0 + 0.5 * half * c1)
        a1 = b - own * f1 - lag * f0
        v2 = v + half * a1
        f2 = on * max(force(law, y1, v2), 0.0)
        a2 = b - own * f2 - lag * f1
        b = q0 + after * (q1 + after * (q2 + after * q3))
        b -= c0 * s0 + c1 * (s1 + h * s0) + c2 * (s2 + h * (2.0 * s1 + h * s0))
        b -= c3 * (s3 + h * (3.0 * s2 + h * (3.0 * s1 + h * s0)))
        v3 = v + h * a2
        f3 = on * max(force(law, y + h * (v + 0.5 * h * a2), v3), 0.0)
        a3 = b - own * f3 - h * (c0 + 0.5 * h * c1) * f2
        y_end = y + h * (v + h / 6.0 * (a0 + a1 + a2))
        v_end = v + h / 6.0 * (a0 + 2.0 * (a1 + a2) + a3)
        # where the stop ceases to push, pushes again, or is left
        left, rise = margin(law, y_end, v_end), margin(law, v_end, a3)
        leaves = y_end < -left
        distance = left if on > 0.0 else (y_end if leaves else -left)
        fall = -rise if on > 0.0 else (-v_end if leaves else rise)
        whole, tries = w[WHOLE, i], w[TRIES, i]
        looking = active & ((distance < 0.0) | (tries > 0.0))
        more = distance / fall if fall > 0.0 else -half
        found = looking & ((abs(more) <= EVENT_ERROR * whole) | (tries >= MOST_TRIES))
        again = looking & (not found)
        # sums
        y_half = 0.5 * (y + y_end) + 0.125 * h * (v - v_end)
        v_half = 0.5 * (v + v_end) + 0.125 * h * (a0 - a3)
        centre = on * max(force(law, y_half, v_half), 0.0)
        last = on * max(force(law, y_end, v_end), 0.0)
        slope, bend = 4.0 * centre - 3.0 * f0 - last, 2.0 * (f0 + last) - 4.0 * centre
        inner = (bend < 0.0) & (slope > 0.0) & (slope < -2.0 * bend)
        peak = max(max(f0, last), f0 - 0.25 * slope * slope / bend if inner else 0.0)
        work = h / 6.0 * (f0 * v + 2.0 * (f1 * v1 + f2 * v2) + f3 * v3)
        n0, n1, n2, n3, n4, n5 = next_moments(s0, s1, s2, s3, s4, s5, h, f0, 0.5 * (f1 + f2), f3)
        keep = not again
        w[PEAKS, i] = max(w[PEAKS, i], peak) if keep else w[PEAKS, i]
        w[LOST, i] += work if keep else 0.0
        w[LASTED, i] += on * h if keep else 0.0
        w[NOW, i], w[NOW + 1, i] = (n0, n1) if keep else (s0, s1)
        w[NOW + 2, i], w[NOW + 3, i] = (n2, n3) if keep else (s2, s3)
        w[NOW + 4, i], w[NOW + 5, i] = (n4, n5) if keep else (s4, s5)
        y_new, v_new = (y_end, v_end) if keep else (y, v)
        w[Y, i], w[V, i] = y_new, v_new
        # what follows
        until = w[LEFT, i]
        ends = active & keep & (not found) & (h >= until - t)
        # a stop that pulls follows the mass without a force
        withdraws = lossy & (on > 0.0) & (y_end > 0.0) & (v_end < 0.0)
        pushes_again = (on == 0.0) & (not leaves)
        over = found & (not withdraws) & (not pushes_again)
        w[PUSHING, i] = (1.0 - on) if found else on
        t_new = until if ends else (after if keep else t)
        w[T, i] = t_new
        state = OVER if over else (LASTING if ends else w[STATE, i])
        w[STATE, i] = state
        there = y_new / v_new if v_new > 0.0 else -0.5 * y_new / v_new
        shortest = FIRST_SHARE * w[LONGEST, i]
        share = w[LONGEST, i] if smooth else min(w[LONGEST, i], max(shortest, there))
        following = min(share, until - t_new)
        nearer = min(max(h + more, half), whole)
        going = state == RUNNING
        h_next = (nearer if again else following) if going else 0.0
        w[H, i] = h_next
        w[WHOLE, i] = whole if again else h_next
        w[TRIES, i] = tries + 1.0 if again else 0.0
        running += 1 if going else 0
    return running


@kernel
def press(law, batch, low, high, pair, upper, scene, fastest):
    """Contacts of the lanes with a compliant stop, until they are over or the step is."""
    memory, series = scene.memory, scene.responses.gaps
    w = rows_of(memory)
    side, stop = 2.0 * upper - 1.0, scene.stops.places[pair, upper]
    first = batch + GAPS + 6 * pair
    start_contacts(law, batch, low, high, pair, upper, scene, fastest)
    own = series[pair, pair]
    bends = own[2, 0], own[2, 1], own[2, 2], own[2, 3]
    for _ in range(MOST_SUB_STEPS):
        running = advance_contacts(law, memory, low, high, own[1, 0], bends)
        if running == 0:
            break
    for i in range(low, high):
        w[ALONE, i] = 0.0
    for other in range(series.shape[1]):
        if other != pair:
            mark_crowded(memory, batch, low, high, other, scene.stops, series[pair, other, 0])
    add_contacts(is_lossy(law), batch, low, high, pair, upper, scene)
    for k in range(MOMENTS):
        for i in range(low, high):
            w[NOW + k, i] *= 0.0 if w[ALONE, i] > 0.0 else -side
    for i in range(low, high):
        w[T, i] = 0.0 if w[ALONE, i] > 0.0 else w[T, i]
    move_starts(memory, batch, low, high, series.shape[1], T)
    add_pushes(memory, batch, low, high, pair, MOMENTS, scene.responses, scene.new)
    for i in range(low, high):
        alone, inside = w[ALONE, i] > 0.0, w[STATE, i] == LASTING
        place = stop + side * (w[Y, i] if inside else 0.0)
        w[first, i] = w[first, i] if alone else place
        w[first + 1, i] = w[first + 1, i] if alone else side * w[V, i]


@kernel
def add_contacts(lossy, batch, low, high, pair, upper, scene):
    """Add impulses, losses, durations and peak forces of contacts to the sums of their paths."""
    w = rows_of(scene.memory)
    sums, peaks = scene.sums, scene.peaks
    row = scene.first_row + scene.rows_of_pair * pair + ROWS_OF_PAIR + ROWS_OF_STOP * upper
    for i in range(low, high):
        if w[ALONE, i] > 0.0:
            continue
        lane = int(w[batch + LANE, i])
        peak = max(peaks[lane, pair, upper], w[PEAKS, i])
        sums[row + IMPULSE, lane] += w[NOW, i]
        sums[row + LOSS, lane] += w[LOST, i] if lossy else 0.0
        sums[row + TIME, lane] += w[LASTED, i]
        if w[STATE, i] == OVER:
            sums[row + PEAK, lane] += peak
            sums[row + ENDED, lane] += 1.0
            peak = 0.0
        peaks[lane, pair, upper] = peak


@kernel
def mark_crowded(memory, batch, low, high, other, stops, series):
    """Mark the lanes in which another gap may reach a stop during the contact.

    It moves by at most the sum of its responses, beyond the hull of its motion without the contact.
    """
    w = rows_of(memory)
    lower, upper = stops.places[other, 0], stops.places[other, 1]
    first = batch + GAPS + 6 * other
    s0, s1, s2 = abs(series[0]), abs(series[1]), abs(series[2])
    s3, s4, s5 = abs(series[3]), abs(series[4]), abs(series[5])
    for i in range(low, high):
        reach = s0 * w[NOW, i] + s1 * w[NOW + 1, i] + s2 * w[NOW + 2, i]
        reach += s3 * w[NOW + 3, i] + s4 * w[NOW + 4, i] + s5 * w[NOW + 5, i]
        span = max(w[batch + SPAN, i], SHORTEST_SPAN)
        x = w[T, i] / span
        u = 1.0 - x
        c0, c5 = w[first, i], w[first + 3, i]
        leaving, coming = 0.2 * span * w[first + 1, i], 0.2 * span * w[first + 4, i]
        bend = 0.05 * span * span
        c1, c2 = c0 + leaving, c0 + 2.0 * leaving + bend * w[first + 2, i]
        c4, c3 = c5 - coming, c5 - 2.0 * coming + bend * w[first + 5, i]
        # the hull of the part until the end of the contact, by de Casteljau
        highest, lowest = c0, c0
        c0, c1, c2, c3, c4 = (
            u * c0 + x * c1, u * c1 + x * c2, u * c2 + x * c3, u * c3 + x * c4, u * c4 + x * c5,
        )  # fmt: skip
        highest, lowest = max(highest, c0), min(lowest, c0)
        c0, c1, c2, c3 = u * c0 + x * c1, u * c1 + x * c2, u * c2 + x * c3, u * c3 + x * c4
        highest, lowest = max(highest, c0), min(lowest, c0)
        c0, c1, c2 = u * c0 + x * c1, u * c1 + x * c2, u * c2 + x * c3
        highest, lowest = max(highest, c0), min(lowest, c0)
        c0, c1 = u * c0 + x * c1, u * c1 + x * c2
        highest, lowest = max(highest, c0), min(lowest, c0)
        c0 = u * c0 + x * c1
        highest, lowest = max(highest, c0), min(lowest, c0)
        crowded = (highest + reach > upper) | (lowest - reach < lower)
        w[ALONE, i] = 1.0 if crowded else w[ALONE, i]


@generic
def meet(laws, kind, batch, low, high, pair, upper, scene, fastest):
    """The lanes from `low` to `high` meet a stop whose law is of the class `kind`."""


@meet.of(NoneType)
def _(laws, kind, batch, low, high, pair, upper, scene, fastest):
    pass


@meet.of(Laws)
def _(laws, kind, batch, low, high, pair, upper, scene, fastest):
    if kind == 0:
        law = read(laws.first, scene.stops.numbers, 2 * pair + upper)
        if is_rigid(law):
            turn_back(law, batch, low, high, pair, upper, scene)
        elif fastest is not None:
            press(law, batch, low, high, pair, upper, scene, fastest)
        add_touches(scene.memory, batch, low, high, pair, upper, scene)
    else:
        meet(laws.others, kind - 1, batch, low, high, pair, upper, scene, fastest)


# ---- the step of all lanes --------------------------------------------------------------------


class Scene(NamedTuple):
    """What the lanes of a kernel share, and what they write to.

    Parameters
    ----------
    step : s.
    stops, laws, responses : `Stops`, `Laws` and `Responses`.
    memory : rows for the lanes, as many as `rows_needed`.
    new : (states, lanes), states at the end of the step, changed.
    sums : (rows, lanes), added to from `first_row` on, `rows_of_pair` for each pair.
    peaks : (lanes, pairs, 2), the largest forces so far of contacts that last.
    """

    step: float
    stops: Stops
    laws: Laws
    responses: Responses
    memory: NDArray[np.float64]
    new: NDArray[np.float64]
    sums: NDArray[np.float64]
    first_row: int
    rows_of_pair: int
    peaks: NDArray[np.float64]


class Single(NamedTuple):
    """Arrays for a lane that finishes alone.

    Parameters
    ----------
    gaps, hits, change : (pairs, 6), (pairs, rows) and (states,).
    work : `Workspace`.
    """

    gaps: NDArray[np.float64]
    hits: NDArray[np.float64]
    change: NDArray[np.float64]
    work: Workspace


@kernel
def lasting_contacts(batch, count, scene):
    """Let the lanes begin with the contact that lasts from the step before; with several, alone."""
    w = rows_of(scene.memory)
    places = scene.stops.places
    for i in range(count):
        w[ALONE, i] = 0.0
    for j in range(places.shape[0]):
        for which in range(2):
            rigid, _, _ = traits_of(
                scene.laws, scene.stops.kinds[j, which], scene.stops.numbers, 2 * j + which
            )
            if rigid or not math.isfinite(places[j, which]):
                continue
            side, stop = 2.0 * which - 1.0, places[j, which]
            for i in range(count):
                if side * (w[batch + GAPS + 6 * j, i] - stop) > 0.0:
                    w[ALONE, i] = 1.0 if w[batch + EVENT, i] != NO_STOP else w[ALONE, i]
                    w[batch + EVENT, i], w[batch + WHEN, i] = 2.0 * j + which, 0.0
                    w[batch + FAST, i] = -1.0


@kernel
def finish_marked(batch, low, high, scene, fastest, single):
    """Finish the lanes that are marked for it one by one."""
    w = rows_of(scene.memory)
    gaps, hits, change, work = single
    pairs, width = gaps.shape[0], scene.rows_of_pair
    for i in range(low, high):
        if w[ALONE, i] == 0.0:
            continue
        lane = int(w[batch + LANE, i])
        for j in range(pairs):
            for k in range(6):
                gaps[j, k] = w[batch + GAPS + 6 * j + k, i]
        hits[:] = 0.0
        change[:] = 0.0
        finish_alone(
            scene.step, w[batch + SPAN, i], gaps, change, fastest, scene.stops, scene.laws,
            scene.responses, None, work, Tally(scene.peaks[lane], hits), None,
        )  # fmt: skip
        for row in range(change.shape[0]):
            scene.new[row, lane] += change[row]
        for j in range(pairs):
            for k in range(width):
                scene.sums[scene.first_row + width * j + k, lane] += hits[j, k]
            w[batch + GAPS + 6 * j + 3, i] = gaps[j, 3]
        w[batch + SPAN, i], w[batch + EVENT, i] = 0.0, NO_STOP


@kernel
def put_on_touched(batch, low, high, pair, upper, scene):
    """Put the gap of the lanes on the stop that they touch, at the speed of the touch."""
    w = rows_of(scene.memory)
    side, stop = 2.0 * upper - 1.0, scene.stops.places[pair, upper]
    first = batch + GAPS + 6 * pair
    for i in range(low, high):
        touched = w[batch + FAST, i] >= 0.0
        w[first, i] = stop if touched else w[first, i]
        w[first + 1, i] = side * w[batch + FAST, i] if touched else w[first + 1, i]
        w[ALONE, i] = 0.0


@kernel
def go_home(batch, i, scene, single, y1):
    """Write the ends of the gaps of a lane that has finished its step, between rigid stops."""
    w = rows_of(scene.memory)
    gaps, hits, change, _ = single
    lane, stops, width = int(w[batch + LANE, i]), scene.stops, scene.rows_of_pair
    beyond = False
    for j in range(y1.shape[0]):
        end = w[batch + GAPS + 6 * j + 3, i]
        y1[j, lane] = end
        beyond |= (end > stops.places[j, 1]) | (end < stops.places[j, 0])
    if not beyond:
        return
    hits[:] = 0.0
    change[:] = 0.0
    for j in range(y1.shape[0]):
        for k in range(6):
            gaps[j, k] = w[batch + GAPS + 6 * j + k, i]
    keep_between_stops(gaps, change, stops, scene.laws, scene.responses, hits)
    for row in range(change.shape[0]):
        scene.new[row, lane] += change[row]
    for j in range(y1.shape[0]):
        y1[j, lane] = gaps[j, 3]
        for k in range(ROWS_OF_PAIR):
            scene.sums[scene.first_row + width * j + k, lane] += hits[j, k]


@kernel
def finish_together(index, ends, scene, fastest, single):
    """The step of the lanes in `index`, at most LANES, in which a stop may be reached.

    Parameters
    ----------
    index : numbers of the lanes.
    ends : (y0, v0, a0, y1, v1, a1), each (pairs, lanes), of which the ends y1 are changed.
    scene, single : `Scene` and `Single`.
    fastest : fastest rate of the structure, rad/s; None where all stops are rigid.
    """
    w = rows_of(scene.memory)
    y0, v0, a0, y1, v1, a1 = ends
    pairs, count = y1.shape[0], index.shape[0]
    rows = GAPS + 6 * pairs
    starts = np.zeros(2 * pairs + 2, np.int64)
    for i in range(count):
        w[SCRATCH + LANE, i], w[SCRATCH + SPAN, i] = index[i], scene.step
        w[SCRATCH + EVENT, i], w[ALONE, i] = NO_STOP, 0.0
    for j in range(pairs):
        first = SCRATCH + GAPS + 6 * j
        for i in range(count):
            lane = index[i]
            w[first, i], w[first + 1, i], w[first + 2, i] = y0[j, lane], v0[j, lane], a0[j, lane]
            w[first + 3, i], w[first + 4, i] = y1[j, lane], v1[j, lane]
            w[first + 5, i] = a1[j, lane]
    if fastest is not None:
        lasting_contacts(SCRATCH, count, scene)
    rounds = 0
    while count > 0:
        batch, other = SCRATCH + rows * (rounds % 2), SCRATCH + rows * ((rounds + 1) % 2)
        if rounds == MOST_ROUNDS:
            for i in range(count):
                w[ALONE, i] = 1.0 if w[batch + SPAN, i] > 0.0 else 0.0
        finish_marked(batch, 0, count, scene, fastest, single)
        find_touches(scene.memory, batch, count, scene.stops, single.gaps, single.work.stack)
        for i in range(count):
            if w[batch + EVENT, i] == NO_STOP:
                go_home(batch, i, scene, single, y1)
        count = sort_by_event(scene.memory, batch, count, rows, other, starts)
        for i in range(count):
            w[T, i] = w[other + WHEN, i] * w[other + SPAN, i]
        move_starts(scene.memory, other, 0, count, pairs, T)
        for pair in range(pairs):
            for upper in range(2):
                low, high = starts[2 * pair + upper], starts[2 * pair + upper + 1]
                if low < high:
                    put_on_touched(other, low, high, pair, upper, scene)
                    kind = scene.stops.kinds[pair, upper]
                    meet(scene.laws, kind, other, low, high, pair, upper, scene, fastest)
        for i in range(count):
            w[other + EVENT, i] = NO_STOP
        rounds += 1
