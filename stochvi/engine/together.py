"""What is left of a step of many paths side by side, as far as each meets one stop at a time.

Most lanes in which a stop may be reached meet it alone: there is no impact, one after the other,
or one contact during which no other stop is near. In rounds, all lanes look for their first touch
and are sorted by the stop that they touch. All lanes whose stops have laws of one class go on
together: at once from rigid stops, in sub-steps side by side on compliant ones. The other lanes
finish their step one by one (`alone`), with the same equations: those with several contacts at
once, or at rest on a stop.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.alone import (
    Workspace,
    find_crossing,
    finish_alone,
    keep_between_stops,
)
from stochvi.engine.batch import (
    ALONE,
    BACK,
    C0,
    C1,
    C2,
    C3,
    EVENT,
    FAST,
    GAPS,
    LANE,
    LASTED,
    LASTING,
    LATER,
    LEFT,
    LOST,
    NOW,
    NUMBERS,
    OUT,
    OVER,
    OWN,
    PEAKS,
    PUSH,
    Q0,
    Q1,
    Q2,
    Q3,
    RUNNING,
    SCRATCH,
    SHORTEST_SPAN,
    SPAN,
    STATE,
    TOP,
    TRIES,
    WHEN,
    T,
    V,
    Y,
)  # fmt: skip
from stochvi.engine.bounces import RESTING
from stochvi.engine.compiled_laws import Stops
from stochvi.engine.compiling import kernel
from stochvi.engine.contacts import Tally
from stochvi.engine.lanes import lanes_from, rows_of
from stochvi.engine.law import MOST_NUMBERS
from stochvi.engine.law_calls import press_all, rebound_of
from stochvi.engine.pushes import BINOMIAL, MOMENTS, Responses
from stochvi.engine.sums import ENDED, IMPULSE, LOSS, PEAK, ROWS_OF_PAIR, ROWS_OF_STOP, TIME

MOST_ROUNDS = 50
"""Largest number of events of a lane in a step; a lane with more finishes alone."""

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
def sort_by_event(memory, batch, count, rows, other, starts, stops):
    """Copy the lanes with an event to the other batch, sorted by it; returns how many they are.

    The lanes of the stop `stops.order[s]` are then those from starts[s] to starts[s + 1].
    """
    w = rows_of(memory)
    starts[:] = 0
    for i in range(count):
        event = int(w[batch + EVENT, i])
        if event >= 0:
            starts[stops.ranks[event] + 2] += 1
    for k in range(2, starts.shape[0]):
        starts[k] += starts[k - 1]
    kept = starts[starts.shape[0] - 1]
    for i in range(count):
        event = int(w[batch + EVENT, i])
        if event >= 0:
            place = starts[stops.ranks[event] + 1]
            starts[stops.ranks[event] + 1] += 1
            for row in range(rows):
                w[other + row, place] = w[batch + row, i]
    return kept


@kernel
def move_starts(memory, batch, low, high, pairs, row):
    """Let what is left of the step begin later, by the time in a row of scratch, s."""
    w = rows_of(memory)
    for j in range(pairs):
        first = batch + GAPS + 6 * j
        for i in lanes_from(low, high):
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
    for i in lanes_from(low, high):
        w[batch + SPAN, i] -= w[row, i]


# ---- pushes -----------------------------------------------------------------------------------


@kernel
def weighted_sum(memory, low, high, first, weights):
    """Row OUT = the sum of rows from `first` on with these weights."""
    w = rows_of(memory)
    for i in lanes_from(low, high):
        w[OUT, i] = weights[0] * w[first, i]
    for k in range(1, weights.shape[0]):
        for i in lanes_from(low, high):
            w[OUT, i] += weights[k] * w[first + k, i]


@kernel
def moments_later(memory, batch, low, high, terms, moments):
    """Moments of pushes at the end of the step, from the first ones now."""
    w = rows_of(memory)
    for k in range(terms):
        for i in lanes_from(low, high):
            w[LATER + k, i] = 0.0
    for i in lanes_from(low, high):
        w[OUT, i] = 1.0
    for shift in range(terms):
        for m in range(min(moments, terms - shift)):
            weight = BINOMIAL[m + shift, m]
            for i in lanes_from(low, high):
                w[LATER + m + shift, i] += weight * w[OUT, i] * w[NOW + m, i]
        for i in lanes_from(low, high):
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
            for i in lanes_from(low, high):
                w[first + what, i] += w[OUT, i]
            weighted_sum(memory, low, high, LATER, series[pair, other, what])
            for i in lanes_from(low, high):
                w[first + 3 + what, i] += w[OUT, i]
    for row in range(states.shape[1]):
        weighted_sum(memory, low, high, LATER, states[pair, row])
        for i in lanes_from(low, high):
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
    for i in lanes_from(low, high):
        lane, speed = int(w[batch + LANE, i]), w[batch + FAST, i]
        if (w[ALONE, i] == 0.0) & (speed >= 0.0):
            sums[row, lane] += 1.0 if speed >= threshold else 0.0
            sums[row + 1, lane] += speed
            sums[row + 2, lane] += speed * speed


@kernel
def take_numbers(memory, low, high, numbers, stop):
    """Write the numbers of the law of a stop beside its lanes, then the row of that law."""
    w = rows_of(memory)
    for i in lanes_from(low, high):
        w[NUMBERS + MOST_NUMBERS, i] = stop
    for k in range(min(MOST_NUMBERS, numbers.shape[1])):
        for i in lanes_from(low, high):
            w[NUMBERS + k, i] = numbers[stop, k]


@kernel
def turn_back(batch, low, high, pair, upper, scene):
    """Turn the lanes at a rigid stop; those at rest on it are marked, and left as they are."""
    w = rows_of(scene.memory)
    side, stop = 2.0 * upper - 1.0, scene.stops.places[pair, upper]
    first = batch + GAPS + 6 * pair
    own = scene.responses.gaps[pair, pair, 2, 0]
    for i in lanes_from(low, high):
        speed, back = w[batch + FAST, i], w[BACK, i]
        # as slow as on a stop on which the mass rests
        pressing = side * w[first + 2, i] - own * (speed + back)
        rests = (pressing > 0.0) & (back <= RESTING * pressing * scene.step)
        w[ALONE, i] = 1.0 if rests else 0.0
        w[NOW, i] = 0.0 if rests else -side * (speed + back)
    add_pushes(scene.memory, batch, low, high, pair, 1, scene.responses, scene.new)
    for i in lanes_from(low, high):
        w[first, i] = stop
        w[first + 1, i] = side * (w[batch + FAST, i] if w[ALONE, i] > 0.0 else -w[BACK, i])


@kernel
def start_contacts(batch, low, high, pair, upper, scene):
    """Write the contacts of the lanes with a stop as they begin into the rows of scratch."""
    w = rows_of(scene.memory)
    side, stop = 2.0 * upper - 1.0, scene.stops.places[pair, upper]
    first = batch + GAPS + 6 * pair
    own = scene.responses.gaps[pair, pair]
    speed, c0, c1, c2, c3 = own[1, 0], own[2, 0], own[2, 1], own[2, 2], own[2, 3]
    for i in lanes_from(low, high):
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
        w[PUSH, i] = max(max(side * a0, side * w[first + 5, i]), 0.0)
        w[LEFT, i], w[TRIES, i] = w[batch + SPAN, i], 0.0
        w[PEAKS, i], w[LOST, i], w[LASTED, i] = 0.0, 0.0, 0.0
        w[STATE, i] = RUNNING
        w[OWN, i], w[C0, i], w[C1, i], w[C2, i], w[C3, i] = speed, c0, c1, c2, c3
    for k in range(MOMENTS):
        for i in lanes_from(low, high):
            w[NOW + k, i] = 0.0


@kernel
def end_contacts(lossy, batch, low, high, pair, upper, scene):
    """Mark the lanes in which another stop is near during the contact; add up the others, and turn
    their moments to the direction of the gap."""
    w, side = rows_of(scene.memory), 2.0 * upper - 1.0
    series = scene.responses.gaps
    for i in lanes_from(low, high):
        w[ALONE, i] = 0.0
    for other in range(series.shape[1]):
        if other != pair:
            mark_crowded(scene.memory, batch, low, high, other, scene.stops, series[pair, other, 0])
    add_contacts(lossy, batch, low, high, pair, upper, scene)
    for k in range(MOMENTS):
        for i in lanes_from(low, high):
            w[NOW + k, i] *= 0.0 if w[ALONE, i] > 0.0 else -side
    for i in lanes_from(low, high):
        w[T, i] = 0.0 if w[ALONE, i] > 0.0 else w[T, i]


@kernel
def leave_contacts(batch, low, high, pair, upper, scene):
    """Add the pushes of the contacts to all gaps; put the gap where the contact left it."""
    w = rows_of(scene.memory)
    side, stop = 2.0 * upper - 1.0, scene.stops.places[pair, upper]
    first = batch + GAPS + 6 * pair
    add_pushes(scene.memory, batch, low, high, pair, MOMENTS, scene.responses, scene.new)
    for i in lanes_from(low, high):
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
    for i in lanes_from(low, high):
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
    for i in lanes_from(low, high):
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


@kernel
def rebound_together(kind, batch, starts, first, last, scene):
    """Impacts of the lanes of the stops from `first` to `last` in their order, which are rigid."""
    w, stops = rows_of(scene.memory), scene.stops
    for s in range(first, last):
        low, high, stop = starts[s], starts[s + 1], stops.order[s]
        for i in lanes_from(low, high):
            w[BACK, i] = rebound_of(scene.laws, kind, stops.numbers, stop, w[batch + FAST, i])
        if low < high:
            turn_back(batch, low, high, stop // 2, stop % 2, scene)
            add_touches(scene.memory, batch, low, high, stop // 2, stop % 2, scene)


@kernel
def press_together(kind, batch, starts, first, last, scene, fastest):
    """Contacts of the lanes of the stops from `first` to `last` in their order, until they are over
    or the step is."""
    stops, memory, pairs = scene.stops, scene.memory, scene.stops.places.shape[0]
    for s in range(first, last):
        low, high, stop = starts[s], starts[s + 1], stops.order[s]
        take_numbers(memory, low, high, stops.numbers, stop)
        start_contacts(batch, low, high, stop // 2, stop % 2, scene)
    low, high = starts[first], starts[last]
    press_all(scene.laws, kind, memory, low, high, stops.numbers, fastest)
    for s in range(first, last):
        stop = stops.order[s]
        lossy = stops.lossy[stop // 2, stop % 2]
        end_contacts(lossy, batch, starts[s], starts[s + 1], stop // 2, stop % 2, scene)
    move_starts(memory, batch, low, high, pairs, T)
    for s in range(first, last):
        low, high, stop = starts[s], starts[s + 1], stops.order[s]
        if low < high:
            leave_contacts(batch, low, high, stop // 2, stop % 2, scene)
            add_touches(memory, batch, low, high, stop // 2, stop % 2, scene)


# ---- the step of all lanes --------------------------------------------------------------------


class Scene(NamedTuple):
    """What the lanes of a kernel share, and what they write to.

    Parameters
    ----------
    step : s.
    stops, laws, responses : `Stops`, `functions_of` the classes of laws, and `Responses`.
    memory : rows for the lanes, as many as `rows_needed`.
    new : (states, lanes), states at the end of the step, changed.
    sums : (rows, lanes), added to from `first_row` on, `rows_of_pair` for each pair.
    peaks : (lanes, pairs, 2), the largest forces so far of contacts that last.
    """

    step: float
    stops: Stops
    laws: NDArray[np.int64]
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
    gaps, impacts, change : (pairs, 6), (pairs, rows) and (states,).
    work : `Workspace`.
    """

    gaps: NDArray[np.float64]
    impacts: NDArray[np.float64]
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
            if scene.stops.rigid[j, which] or not math.isfinite(places[j, which]):
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
    gaps, impacts, change, work = single
    pairs, width = gaps.shape[0], scene.rows_of_pair
    for i in lanes_from(low, high):
        if w[ALONE, i] == 0.0:
            continue
        lane = int(w[batch + LANE, i])
        for j in range(pairs):
            for k in range(6):
                gaps[j, k] = w[batch + GAPS + 6 * j + k, i]
        impacts[:] = 0.0
        change[:] = 0.0
        finish_alone(
            scene.step, w[batch + SPAN, i], gaps, change, fastest, scene.stops, scene.laws,
            scene.responses, None, work, Tally(scene.peaks[lane], impacts), None,
        )  # fmt: skip
        for row in range(change.shape[0]):
            scene.new[row, lane] += change[row]
        for j in range(pairs):
            for k in range(width):
                scene.sums[scene.first_row + width * j + k, lane] += impacts[j, k]
            w[batch + GAPS + 6 * j + 3, i] = gaps[j, 3]
        w[batch + SPAN, i], w[batch + EVENT, i] = 0.0, NO_STOP


@kernel
def put_on_touched(batch, low, high, pair, upper, scene):
    """Put the gap of the lanes on the stop that they touch, at the speed of the touch."""
    w = rows_of(scene.memory)
    side, stop = 2.0 * upper - 1.0, scene.stops.places[pair, upper]
    first = batch + GAPS + 6 * pair
    for i in lanes_from(low, high):
        touched = w[batch + FAST, i] >= 0.0
        w[first, i] = stop if touched else w[first, i]
        w[first + 1, i] = side * w[batch + FAST, i] if touched else w[first + 1, i]
        w[ALONE, i] = 0.0


@kernel
def go_home(batch, i, scene, single, y1):
    """Write the ends of the gaps of a lane that has finished its step, between rigid stops."""
    w = rows_of(scene.memory)
    gaps, impacts, change, _ = single
    lane, stops, width = int(w[batch + LANE, i]), scene.stops, scene.rows_of_pair
    beyond = False
    for j in range(y1.shape[0]):
        end = w[batch + GAPS + 6 * j + 3, i]
        y1[j, lane] = end
        beyond |= (end > stops.places[j, 1]) | (end < stops.places[j, 0])
    if not beyond:
        return
    impacts[:] = 0.0
    change[:] = 0.0
    for j in range(y1.shape[0]):
        for k in range(6):
            gaps[j, k] = w[batch + GAPS + 6 * j + k, i]
    keep_between_stops(gaps, change, stops, scene.laws, scene.responses, impacts)
    for row in range(change.shape[0]):
        scene.new[row, lane] += change[row]
    for j in range(y1.shape[0]):
        y1[j, lane] = gaps[j, 3]
        for k in range(ROWS_OF_PAIR):
            scene.sums[scene.first_row + width * j + k, lane] += impacts[j, k]


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
    pairs, count, stops = y1.shape[0], index.shape[0], scene.stops
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
        find_touches(scene.memory, batch, count, stops, single.gaps, single.work.stack)
        for i in range(count):
            if w[batch + EVENT, i] == NO_STOP:
                go_home(batch, i, scene, single, y1)
        count = sort_by_event(scene.memory, batch, count, rows, other, starts, stops)
        for i in range(count):
            w[T, i] = w[other + WHEN, i] * w[other + SPAN, i]
        move_starts(scene.memory, other, 0, count, pairs, T)
        first = 0
        while first < 2 * pairs:
            kind = stops.kinds[stops.order[first] // 2, stops.order[first] % 2]
            last = first
            while last < 2 * pairs:
                pair, upper = stops.order[last] // 2, stops.order[last] % 2
                if stops.kinds[pair, upper] != kind:
                    break
                put_on_touched(other, starts[last], starts[last + 1], pair, upper, scene)
                last += 1
            if starts[first] < starts[last]:
                if stops.rigid[stops.order[first] // 2, stops.order[first] % 2]:
                    rebound_together(kind, other, starts, first, last, scene)
                elif fastest is not None:
                    press_together(kind, other, starts, first, last, scene, fastest)
            first = last
        for i in range(count):
            w[other + EVENT, i] = NO_STOP
        rounds += 1
