"""Any linear structure with rigid stops, for many paths at once, in modal coordinates.

State of a path: modal displacements q and velocities p (modal masses 1), then the states of
whatever signals drive the structure. One step is

    kick   p <- E p + L z                 damping and white noise, exact for the velocities
    flow   s' = A s + noise of signals    exact between impacts: s1 = F s0 + G z
    impact v_y <- -R v_y                  within the flow; y = phi . q is the gap of a pair

Without white noise the damping stands in A, and there is no kick. Kick and flow are one matrix
pass, row by row over the lanes of a block. A pair is looked at closer in the lanes where the hull
of the cubic through its end values reaches a stop: there y is the quintic through values, slopes
and curvatures at both ends, the impact its first upward root, and the end of the step changes by
-(1 + R) w T(remaining time), T the Taylor series of the response to a unit reset. The resets act
along M^-1 d, so elastic ones keep the energy.

Symbols: g0, v0, a0 and g1, v1, a1 are value, slope and curvature of a gap at the two ends of what
is left of the step; c0 ... c5 the Bernstein coefficients of the distance beyond a stop.
"""

import math

import numba
import numpy as np

from stochvi.methods.monte_carlo.kernels.random_numbers import normal_pairs

LANES = 1024
"""Paths that move together: many, for the loops over those that hit to be long enough."""

MOST_BOUNCES = 1000
"""In one step; after that what lies beyond a stop is put on it, with its impulse."""

MOST_SWEEPS = 1000
"""Over all stops, to bring ends that lie beyond one of them between all: each takes about the ratio
of the lightest mass to the heaviest off what is left."""

RESTING = 1e-8
"""A rebound this much slower than what presses takes back in a step rests on the stop."""

SHORTEST_PIECE = 2.0**-40
"""Of a step, in search of its first root: a passage that is out and in again within it is none."""

NEWTON_STEPS = 5
"""From the chord, for roots of smooth arcs; a lane where they do not suffice is done by itself."""

ROOT_ERROR = 1e-12
"""Relative change of a root by Newton's method at which it is taken: the next is exact."""

ROWS_OF_PAIR = 6
"""Sums over impacts of a pair: hits, w and w^2 on the lower stop, then on the upper."""


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def matrix_pass(out, keep, sources, table, width):
    """out = keep out + matrix . sources, `width` lanes; by rows: (starts, columns, weights).

    Four sources at a time, each row in one vectorised loop over the lanes.
    """
    starts, columns, weights = table
    for row in range(starts.shape[0] - 1):
        k, last = starts[row], starts[row + 1]
        kept = keep
        while k < last:
            if last - k >= 4:
                mix_four(
                    out, row, kept, sources, columns[k], weights[k], columns[k + 1],
                    weights[k + 1], columns[k + 2], weights[k + 2], columns[k + 3], weights[k + 3],
                    width,
                )  # fmt: skip
                k += 4
            elif last - k >= 2:
                mix_two(
                    out, row, kept, sources, columns[k], weights[k], columns[k + 1], weights[k + 1],
                    width,
                )  # fmt: skip
                k += 2
            else:
                mix_one(out, row, kept, sources, columns[k], weights[k], width)
                k += 1
            kept = 1.0


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def mix_one(out, row, keep, x, j, a, width):
    for i in range(width):
        out[row, i] = keep * out[row, i] + a * x[j, i]


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def mix_two(out, row, keep, x, j, a, k, b, width):
    for i in range(width):
        out[row, i] = keep * out[row, i] + a * x[j, i] + b * x[k, i]


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def mix_four(out, row, keep, x, j, a, k, b, m, c, n, d, width):
    for i in range(width):
        out[row, i] = keep * out[row, i] + a * x[j, i] + b * x[k, i] + c * x[m, i] + d * x[n, i]


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def mark(y0, v0, y1, v1, j, third, lower, upper, marks):
    """Mark the lanes where the hull of the cubic of a gap reaches a stop; third = step / 3."""
    for i in range(marks.shape[0]):
        leaving = y0[j, i] + third * v0[j, i]
        coming = y1[j, i] - third * v1[j, i]
        high = max(max(leaving, coming), y1[j, i]) - upper
        low = lower - min(min(leaving, coming), y1[j, i])
        marks[i] = max(marks[i], max(high, low))


@numba.njit(cache=True, error_model="numpy")
def gather(marks, lanes, index):
    """Numbers of the marked lanes into `index`; returns how many there are."""
    count = 0
    for i in range(lanes):
        index[count] = i
        count += 1 if marks[i] > 0.0 else 0
    return count


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def add_product(total, row, x, j, origin_j, k, origin_k):
    """total[row] += (x[j] - origin_j) (x[k] - origin_k)."""
    for i in range(total.shape[1]):
        total[row, i] += (x[j, i] - origin_j) * (x[k, i] - origin_k)


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def add_row(total, row, x, j, origin):
    """total[row] += x[j] - origin."""
    for i in range(total.shape[1]):
        total[row, i] += x[j, i] - origin


@numba.njit(cache=True, inline="always", error_model="numpy", fastmath={"contract"})
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


@numba.njit(cache=True, inline="always", error_model="numpy")
def rises_once(c1, c2, c3, c4, c5):
    """Whether Bernstein coefficients after a first one <= 0 change sign once, to positive."""
    early = ((c1 <= 0.0) | (c2 > 0.0)) & ((c2 <= 0.0) | (c3 > 0.0))
    return early & ((c3 <= 0.0) | (c4 > 0.0)) & (c5 > 0.0)


@numba.njit(cache=True, error_model="numpy")
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


@numba.njit(cache=True, error_model="numpy")
def first_root(c0, c1, c2, c3, c4, c5, stack):
    """First upward root in (0, 1] of a polynomial with c0 <= 0 and its slope, or 2 for none.

    By Descartes' rule in Bernstein form: no sign change, no root; one, one root; more: halve. The
    halves that wait are in `stack`, (coefficients, start, end) in a row.
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


@numba.njit(cache=True, error_model="numpy")
def passage(gaps, j, span, stop, side, stack):
    """Fraction of the span until side (y - stop) passes 0 upwards, 2 for never, and the speed."""
    start, end = side * (gaps[j, 0] - stop), side * (gaps[j, 3] - stop)
    leaving, coming = 0.2 * span * side * gaps[j, 1], 0.2 * span * side * gaps[j, 4]
    bend = 0.05 * span * span * side
    if start >= 0.0 and leaving > 0.0:
        return 0.0, side * gaps[j, 1]
    # what lies beyond the stop by rounding, or after a start there, is taken back to it linearly
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


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def advance(gaps, j, t, span):
    """Value, slope and curvature of a gap at the fraction t of the span become its start."""
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


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def reset(state, lane, gaps, pair, change, span, resets):
    """Change the speed of a pair by `change`, `span` before the end of the step."""
    series, at_once, later = resets
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


@numba.njit(cache=True, error_model="numpy")
def put_on_stop(state, lane, gaps, pair, stop, side, resets):
    """Take back what lies beyond a stop at the end of a step; the speed this takes, or 0.

    A force that holds y on the stop over the rest r of a step brings -a r of speed and -a r^2 / 2
    of distance along the same direction M^-1 d, which is what is taken back; and, where damping
    stands in the flow, what that took from a motion that was none.
    """
    series, at_once, _ = resets
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


@numba.njit(cache=True, error_model="numpy")
def bounce(state, lane, gaps, resting, step, stops, resets, sums, stack):
    """One step of one path with any number of impacts on any pair, added up in `sums` (pairs, 6).

    `gaps` (pairs, 6) holds the ends of every gap; `stops` (pairs, 2, 3) position (infinite for
    none), restitution and threshold of the lower and the upper stop of each pair.
    """
    span = step
    pairs = gaps.shape[0]
    resting[:] = 0.0
    for bounces in range(MOST_BOUNCES + 1):
        first, w, pair, upper = 2.0, 0.0, -1, 0
        for j in range(pairs):
            for which in range(2):
                stop = stops[j, which, 0]
                if resting[j, which] == 0.0 and math.isfinite(stop):
                    t, speed = passage(gaps, j, span, stop, 2.0 * which - 1.0, stack)
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
            advance(gaps, j, first, span)
        span *= 1.0 - first
        gaps[pair, 0], gaps[pair, 1] = stop, side * w
        reset(state, lane, gaps, pair, -side * (1.0 + restitution) * w, span, resets)
        gaps[pair, 1] = -side * restitution * w
        pressing = side * gaps[pair, 2]
        rests = (pressing > 0.0) & (restitution * w <= RESTING * pressing * step)
        if rests or bounces >= MOST_BOUNCES - 2 * pairs:
            resting[pair, upper] = 1.0
            taken = put_on_stop(state, lane, gaps, pair, stop, side, resets)
            sums[pair, 3 * upper + 1] += taken / (1.0 + restitution)
    # what rests on one stop may have been moved beyond another
    for _ in range(MOST_SWEEPS):
        moved = False
        for j in range(pairs):
            for which in range(2):
                side, stop = 2.0 * which - 1.0, stops[j, which, 0]
                if side * (gaps[j, 3] - stop) > 0.0:
                    taken = put_on_stop(state, lane, gaps, j, stop, side, resets)
                    sums[j, 3 * which + 1] += taken / (1.0 + stops[j, which, 1])
                    gaps[j, 3] = stop
                    moved = True
        if not moved:
            return


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def newton(c0, c1, c2, c3, c4, c5, t, count):
    """The root in each lane of a polynomial that is <= 0 at 0 and rises through 0 once."""
    for i in range(count):
        s = c0[i] / (c0[i] - c5[i])
        for _ in range(NEWTON_STEPS):
            value, slope = quintic(c0[i], c1[i], c2[i], c3[i], c4[i], c5[i], s)
            s = min(max(s - value / slope, 0.0), 1.0)
        t[i] = s if s >= 0.0 else 0.0  # never NaN: it would stay in the lanes of `response`


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def slopes(c0, c1, c2, c3, c4, c5, t, slope, count):
    """Slope of each polynomial at t, or -1 where t is no root."""
    for i in range(count):
        value, rise = quintic(c0[i], c1[i], c2[i], c3[i], c4[i], c5[i], t[i])
        slope[i] = rise if abs(value) <= ROOT_ERROR * rise else -1.0


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def bends(c0, c1, c2, c3, c4, c5, t, bend, count):
    """Second derivative of each polynomial at t."""
    for i in range(count):
        s, u = t[i], 1.0 - t[i]
        d0, d1 = c2[i] - 2.0 * c1[i] + c0[i], c3[i] - 2.0 * c2[i] + c1[i]
        d2, d3 = c4[i] - 2.0 * c3[i] + c2[i], c5[i] - 2.0 * c4[i] + c3[i]
        d0, d1, d2 = u * d0 + s * d1, u * d1 + s * d2, u * d2 + s * d3
        d0, d1 = u * d0 + s * d1, u * d1 + s * d2
        bend[i] = 20.0 * (u * d0 + s * d1)


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def remaining_powers(t, step, powers, count):
    """Powers of the time left after the root, one row each."""
    for i in range(count):
        powers[0, i] = 1.0
    for k in range(1, powers.shape[0]):
        for i in range(count):
            powers[k, i] = powers[k - 1, i] * ((1.0 - t[i]) * step)


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def single_impacts(ends, new, index, count, step, stops, table, sums, first_row, packed):
    """Impacts of one pair that are alone in their step, many lanes at once.

    A lane is done here if its end lies beyond one stop, its quintic rises through that stop once,
    and the hull of what follows stays between the stops; the others are left, in order, at the
    front of `index`. Returns how many. `sums` takes the impacts in rows from `first_row`, unless
    that is negative.
    """
    y0, v0, a0, y1, v1, a1 = ends
    c0, c1, c2, c3, c4, c5, t, slope, bend, side, powers, response = packed
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
    newton(c0, c1, c2, c3, c4, c5, t, count)
    slopes(c0, c1, c2, c3, c4, c5, t, slope, count)
    bends(c0, c1, c2, c3, c4, c5, t, bend, count)
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
        # Bernstein coefficients of what follows the impact
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
        if first_row >= 0:
            row = first_row + 3 * which
            sums[row, i] += 1.0 if w >= stops[0, which, 2] else 0.0
            sums[row + 1, i] += w
            sums[row + 2, i] += w * w
    return left


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def run_modes(
    state, streams, sums, step, modes, passes, stops, margins, resets, impact, origins,
    burn_in, steps, stride, record,
):  # fmt: skip
    """Fly every path for burn_in + steps steps; sums of the last `steps` go to `sums`.

    Parameters
    ----------
    state : (states, paths) q, p and signals at the start, replaced by the end.
    streams : (2, paths) random streams, advanced.
    sums : (rows, paths), added to: q; q q' and p p' by rows of the upper triangle; then six
        rows for each pair. Moments are taken every `stride` steps, before the kick, q from
        `origins` (modes,).
    step : s. passes : tables of `matrix_pass`, and the number of normals of a step: for the new
        state, from states and from normals; for the gaps' speeds after the kick, from both, and
        their curvatures from states; for gaps, speeds and curvatures from the new state.
    stops : (pairs, 2, 3). margins : (pairs,) by which hulls are widened.
    resets : Taylor series of the states (pairs, 2 modes, terms) after a unit change of a pair's
        speed; what every gap's slope and curvature change at once (pairs, pairs, 2), and its
        value, slope and curvature later (pairs, pairs, 3, terms).
    impact : the last and the first of these for a single pair, as a table of `matrix_pass`.
    record : None, or zeros (steps, paths, 2 modes + pairs) to take q, p and the signed impact
        speeds of every step; the burn-in must then be 0.
    """
    (from_states, from_normals, normals, speed_states, speed_normals, bend_states, to_gaps,
     to_speeds, to_bends) = passes  # fmt: skip
    states, paths = state.shape
    width = min(LANES, paths)
    pairs = stops.shape[0]
    moments = modes + modes * (modes + 1)
    third = step / 3.0
    old, new = np.zeros((states, width)), np.zeros((states, width))
    drawn = np.zeros((2 * normals, width))
    y0, y1 = np.zeros((pairs, width)), np.zeros((pairs, width))
    v0, v1 = np.zeros((pairs, width)), np.zeros((pairs, width))
    a0, a1 = np.zeros((pairs, width)), np.zeros((pairs, width))
    marks, index = np.zeros(width), np.zeros(width + 1, np.int64)
    local = np.zeros((moments + ROWS_OF_PAIR * pairs, width))
    hits = np.zeros((pairs, ROWS_OF_PAIR))
    gaps, resting = np.zeros((pairs, 6)), np.zeros((pairs, 2))
    stack = np.zeros((64, 8))
    work = np.zeros((10, width))
    packed = (
        work[0], work[1], work[2], work[3], work[4], work[5], work[6], work[7], work[8], work[9],
        np.zeros((resets[0].shape[2], width)), np.zeros((2 * modes + 3, width)),
    )  # fmt: skip
    words0, words1 = np.zeros(width, np.uint64), np.zeros(width, np.uint64)
    for start in range(0, paths, LANES):
        lanes = min(LANES, paths - start)
        local[:] = 0.0
        for i in range(lanes):
            words0[i], words1[i] = streams[0, start + i], streams[1, start + i]
            for row in range(states):
                old[row, i] = state[row, start + i]
        matrix_pass(y0, 0.0, old, to_gaps, width)
        for number in range(burn_in + steps):
            counted = number >= burn_in
            half = number % 2
            if half == 0:
                for row in range(normals):
                    normal_pairs(words0, words1, drawn[row], drawn[normals + row])
            z = drawn[half * normals : (half + 1) * normals]
            matrix_pass(new, 0.0, old, from_states, width)
            matrix_pass(new, 1.0, z, from_normals, width)
            if pairs > 0:
                matrix_pass(v0, 0.0, old, speed_states, width)
                matrix_pass(v0, 1.0, z, speed_normals, width)
                matrix_pass(y1, 0.0, new, to_gaps, width)
                matrix_pass(v1, 0.0, new, to_speeds, width)
                marks[:] = 0.0
                for j in range(pairs):
                    lower, upper = stops[j, 0, 0] + margins[j], stops[j, 1, 0] - margins[j]
                    mark(y0, v0, y1, v1, j, third, lower, upper, marks)
                count = gather(marks, lanes, index)
                if count > 0:
                    matrix_pass(a0, 0.0, old, bend_states, width)
                    matrix_pass(a1, 0.0, new, to_bends, width)
                if (pairs == 1) & (count > 0) & (record is None):
                    count = single_impacts(
                        (y0, v0, a0, y1, v1, a1), new, index, count, step, stops, impact, local,
                        moments if counted else -1, packed,
                    )  # fmt: skip
                for k in range(count):
                    i = index[k]
                    for j in range(pairs):
                        gaps[j, 0], gaps[j, 1], gaps[j, 2] = y0[j, i], v0[j, i], a0[j, i]
                        gaps[j, 3], gaps[j, 4], gaps[j, 5] = y1[j, i], v1[j, i], a1[j, i]
                    hits[:] = 0.0
                    bounce(new, i, gaps, resting, step, stops, resets, hits, stack)
                    for j in range(pairs):
                        y1[j, i] = gaps[j, 3]
                        if counted:
                            for m in range(ROWS_OF_PAIR):
                                local[moments + ROWS_OF_PAIR * j + m, i] += hits[j, m]
                            if record is not None:
                                record[number - burn_in, start + i, 2 * modes + j] = (
                                    hits[j, 4] - hits[j, 1]
                                )
                y0, y1 = y1, y0
            old, new = new, old
            if counted:
                if (number - burn_in) % stride == 0:
                    row = modes
                    for k in range(modes):
                        add_row(local, k, old, k, origins[k])
                        for m in range(k, modes):
                            add_product(local, row, old, k, origins[k], m, origins[m])
                            row += 1
                    for k in range(modes, 2 * modes):
                        for m in range(k, 2 * modes):
                            add_product(local, row, old, k, 0.0, m, 0.0)
                            row += 1
                if record is not None:
                    for i in range(lanes):
                        for row in range(2 * modes):
                            record[number - burn_in, start + i, row] = old[row, i]
        for i in range(lanes):
            streams[0, start + i], streams[1, start + i] = words0[i], words1[i]
            for row in range(states):
                state[row, start + i] = old[row, i]
            for row in range(local.shape[0]):
                sums[row, start + i] += local[row, i]
