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

from stochvi.monte_carlo.kernels.random_numbers import normal_pairs

LANES = 256
"""Paths that move together: their rows stay in the caches."""

MOST_BOUNCES = 1000
"""In one step; after that what lies beyond a stop is put on it, with its impulse."""

RESTING = 1e-8
"""A rebound this much slower than what presses takes back in a step rests on the stop."""

DEEPEST = 40
"""Halvings of a step in search of the first root."""

ROWS_OF_PAIR = 6
"""Sums over impacts of a pair: hits, w and w^2 on the lower stop, then on the upper."""


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def accumulate(out, row, keep, sources, index, weight):
    """out[row] = keep out[row] + sum of weight[k] sources[index[k]], four sources at a time."""
    count = index.shape[0]
    k = 0
    while k < count:
        left = count - k
        if left >= 4:
            mix_four(
                out[row], keep, sources[index[k]], weight[k], sources[index[k + 1]], weight[k + 1],
                sources[index[k + 2]], weight[k + 2], sources[index[k + 3]], weight[k + 3],
            )  # fmt: skip
            k += 4
        elif left >= 2:
            mix_two(
                out[row], keep, sources[index[k]], weight[k], sources[index[k + 1]], weight[k + 1]
            )
            k += 2
        else:
            mix_one(out[row], keep, sources[index[k]], weight[k])
            k += 1
        keep = 1.0


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def mix_one(out, keep, x, a):
    for i in range(out.shape[0]):
        out[i] = keep * out[i] + a * x[i]


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def mix_two(out, keep, x, a, y, b):
    for i in range(out.shape[0]):
        out[i] = keep * out[i] + a * x[i] + b * y[i]


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def mix_four(out, keep, x, a, y, b, z, c, w, d):
    for i in range(out.shape[0]):
        out[i] = keep * out[i] + a * x[i] + b * y[i] + c * z[i] + d * w[i]


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def matrix_pass(out, keep, sources, table):
    """out = keep out + matrix . sources; the matrix by rows: (starts, columns, weights)."""
    starts, columns, weights = table
    for row in range(starts.shape[0] - 1):
        first, last = starts[row], starts[row + 1]
        accumulate(out, row, keep, sources, columns[first:last], weights[first:last])


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def mark(y0, v0, y1, v1, third, lower, upper, marks):
    """Mark the lanes where the hull of the cubic reaches a stop; third = step / 3."""
    for i in range(marks.shape[0]):
        leaving = y0[i] + third * v0[i]
        coming = y1[i] - third * v1[i]
        high = max(max(leaving, coming), y1[i])
        low = min(min(leaving, coming), y1[i])
        marks[i] = 1.0 if (high > upper) | (low < lower) else marks[i]


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def count_marks(marks):
    total = 0.0
    for i in range(marks.shape[0]):
        total += marks[i]
    return total


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def add_product(total, x, x_origin, y, y_origin):
    """total += (x - x_origin) (y - y_origin)."""
    for i in range(total.shape[0]):
        total[i] += (x[i] - x_origin) * (y[i] - y_origin)


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def add_row(total, x, origin):
    """total += x - origin."""
    for i in range(total.shape[0]):
        total[i] += x[i] - origin


@numba.njit(cache=True, inline="always", error_model="numpy")
def quintic(c, t):
    """Value and derivative at t of the polynomial with Bernstein coefficients c[0] ... c[5]."""
    u = 1.0 - t
    # one de Casteljau pass down to two points: their mean is the value, their distance the slope
    d0, d1, d2 = u * c[0] + t * c[1], u * c[1] + t * c[2], u * c[2] + t * c[3]
    d3, d4 = u * c[3] + t * c[4], u * c[4] + t * c[5]
    d0, d1, d2, d3 = u * d0 + t * d1, u * d1 + t * d2, u * d2 + t * d3, u * d3 + t * d4
    d0, d1, d2 = u * d0 + t * d1, u * d1 + t * d2, u * d2 + t * d3
    d0, d1 = u * d0 + t * d1, u * d1 + t * d2
    return u * d0 + t * d1, 5.0 * (d1 - d0)


@numba.njit(cache=True, error_model="numpy")
def bracketed_root(c):
    """The upward root in (0, 1] of a polynomial that has one: c[0] <= 0 < c[5]."""
    low, high = 0.0, 1.0
    t = c[0] / (c[0] - c[5])
    for _ in range(100):
        value, slope = quintic(c, t)
        if value > 0.0:
            high = t
        else:
            low = t
        following = t - value / slope if slope > 0.0 else low
        if not (low < following < high):
            following = 0.5 * (low + high)
        if abs(following - t) <= 1e-15 * t:
            return following
        t = following
    return t


@numba.njit(cache=True, error_model="numpy")
def sign_changes(c):
    """Of the coefficients, zeros left out and the first counted as negative."""
    changes = 0
    positive = False
    for k in range(1, 6):
        if c[k] != 0.0 and (c[k] > 0.0) != positive:
            positive = not positive
            changes += 1
    return changes


@numba.njit(cache=True, error_model="numpy")
def first_root(c, stack):
    """First upward root in (0, 1] of a polynomial with c[0] <= 0, or 2 for none.

    By Descartes' rule in Bernstein form: no sign change, no root; one, one root; more: halve.
    """
    if sign_changes(c) == 1:
        return bracketed_root(c)
    stack[0, :6] = c
    stack[0, 6], stack[0, 7] = 0.0, 1.0
    depth = 0
    while depth >= 0:
        piece = stack[depth]
        start, end = piece[6], piece[7]
        changes = sign_changes(piece)
        if changes == 1:
            return start + (end - start) * bracketed_root(piece)
        if changes == 0 or depth + 1 == stack.shape[0] or end - start < 2.0**-DEEPEST:
            depth -= 1
            continue
        # the right half replaces the piece, the left half goes on top and is looked at first
        left = stack[depth + 1]
        for k in range(6):
            left[k] = piece[0]
            for m in range(5 - k):
                piece[m] = 0.5 * (piece[m] + piece[m + 1])
        # what is left in `piece` is the last diagonal: the right half
        middle = 0.5 * (start + end)
        left[6], left[7] = start, middle
        piece[6] = middle
        depth += 1
    return 2.0


@numba.njit(cache=True, error_model="numpy")
def passage(gap, span, stop, side, c, stack):
    """Fraction of the span until side (y - stop) passes 0 upwards, 2 for never, and the speed."""
    g0, v0, a0, g1, v1, a1 = gap[0], gap[1], gap[2], gap[3], gap[4], gap[5]
    c[0] = side * (g0 - stop)
    c[1] = side * (g0 + 0.2 * span * v0 - stop)
    c[2] = side * (g0 + 0.4 * span * v0 + 0.05 * span * span * a0 - stop)
    c[3] = side * (g1 - 0.4 * span * v1 + 0.05 * span * span * a1 - stop)
    c[4] = side * (g1 - 0.2 * span * v1 - stop)
    c[5] = side * (g1 - stop)
    if c[0] > 0.0:  # by rounding, or after a start beyond the stop: from the stop, as fast
        beyond = c[0]
        for k in range(6):
            c[k] -= beyond * (1.0 - 0.2 * k)
    if c[0] == 0.0 and side * v0 > 0.0:
        return 0.0, side * v0
    if max(max(max(c[1], c[2]), max(c[3], c[4])), c[5]) <= 0.0:
        return 2.0, 0.0
    t = first_root(c, stack)
    if t > 1.0:
        return 2.0, 0.0
    _, slope = quintic(c, t)
    return t, max(slope / span, 0.0)


@numba.njit(cache=True, error_model="numpy")
def advance(gap, t, span):
    """Value, slope and curvature of a gap at the fraction t of the span become its start."""
    g0, v0, a0, g1, v1, a1 = gap[0], gap[1], gap[2], gap[3], gap[4], gap[5]
    # y = g0 + v0 s + a0 s^2 / 2 + k3 t^3 + k4 t^4 + k5 t^5 with s = t span
    rise = g1 - g0 - v0 * span - 0.5 * a0 * span * span
    slope = (v1 - v0 - a0 * span) * span
    bend = (a1 - a0) * span * span
    k3 = 10.0 * rise - 4.0 * slope + 0.5 * bend
    k4 = -15.0 * rise + 7.0 * slope - bend
    k5 = 6.0 * rise - 3.0 * slope + 0.5 * bend
    s = t * span
    gap[0] = g0 + s * (v0 + 0.5 * s * a0) + t * t * t * (k3 + t * (k4 + t * k5))
    gap[1] = v0 + s * a0 + t * t * (3.0 * k3 + t * (4.0 * k4 + t * 5.0 * k5)) / span
    gap[2] = a0 + t * (6.0 * k3 + t * (12.0 * k4 + t * 20.0 * k5)) / (span * span)


@numba.njit(cache=True, error_model="numpy")
def reset(state, lane, gaps, pair, change, span, resets):
    """Change the speed of a pair by `change`, `span` before the end of the step."""
    series, at_once, later = resets
    own = series[pair]
    for row in range(own.shape[0]):
        total = 0.0
        for k in range(own.shape[1] - 1, -1, -1):
            total = total * span + own[row, k]
        state[row, lane] += change * total
    for other in range(gaps.shape[0]):
        gaps[other, 1] += change * at_once[pair, other, 0]
        gaps[other, 2] += change * at_once[pair, other, 1]
        for what in range(3):
            coefficients = later[pair, other, what]
            total = 0.0
            for k in range(coefficients.shape[0] - 1, -1, -1):
                total = total * span + coefficients[k]
            gaps[other, 3 + what] += change * total


@numba.njit(cache=True, error_model="numpy")
def put_on_stop(state, lane, gaps, pair, stop, side, resets):
    """Take back what lies beyond a stop at the end of a step; the speed this takes, or 0.

    A force that holds y on the stop over the rest r of a step brings -a r of speed and -a r^2 / 2
    of distance along the same direction M^-1 d, which is what is taken back.
    """
    series, at_once, _ = resets
    beyond = side * (gaps[pair, 3] - stop)
    if beyond < 0.0:
        return 0.0
    outward = max(side * gaps[pair, 4], 0.0)
    modes = series.shape[1] // 2
    for k in range(modes):
        share = series[pair, modes + k, 0] * side
        state[k, lane] -= beyond * share
        state[modes + k, lane] -= outward * share
    for other in range(gaps.shape[0]):
        share = at_once[pair, other, 0] * side
        gaps[other, 3] -= beyond * share
        gaps[other, 4] -= outward * share
    return outward


@numba.njit(cache=True, error_model="numpy")
def bounce(state, lane, gaps, resting, step, stops, resets, sums, c, stack):
    """One step of one path with any number of impacts on any pair, added up in `sums` (pairs, 6).

    `gaps` (pairs, 6) holds the ends of every gap; `stops` (pairs, 2, 3) position (infinite for
    none), restitution and threshold of the lower and the upper stop of each pair.
    """
    span = step
    resting[:] = 0.0
    for bounces in range(MOST_BOUNCES + 1):
        first, w, pair, upper = 2.0, 0.0, -1, 0
        for j in range(gaps.shape[0]):
            for which in range(2):
                if resting[j, which] == 0.0 and math.isfinite(stops[j, which, 0]):
                    t, speed = passage(gaps[j], span, stops[j, which, 0], 2 * which - 1, c, stack)
                    if t < first:
                        first, w, pair, upper = t, speed, j, which
        if pair < 0:
            return
        side = 2.0 * upper - 1.0
        stop, restitution, threshold = stops[pair, upper]
        row = sums[pair, 3 * upper : 3 * upper + 3]
        row[0] += 1.0 if w >= threshold else 0.0
        row[1] += w
        row[2] += w * w
        for j in range(gaps.shape[0]):
            advance(gaps[j], first, span)
        span *= 1.0 - first
        gaps[pair, 0] = stop
        gaps[pair, 1] = side * w
        reset(state, lane, gaps, pair, -side * (1.0 + restitution) * w, span, resets)
        gaps[pair, 1] = -side * restitution * w
        pressing = side * gaps[pair, 2]
        rests = (pressing > 0.0) & (restitution * w <= RESTING * pressing * step)
        if rests or bounces >= MOST_BOUNCES - 2 * gaps.shape[0]:
            resting[pair, upper] = 1.0
            taken = put_on_stop(state, lane, gaps, pair, stop, side, resets)
            row[1] += taken / (1.0 + restitution)


@numba.njit(cache=True, error_model="numpy")
def close_look(old, new, z, lane, kick, curvatures, y0, y1, v1, gaps):
    """Fill the ends of every gap of one lane: the start after the kick, the end before the next."""
    decay, brought = kick
    modes = decay.shape[0]
    pairs = gaps.shape[0]
    for j in range(pairs):
        gaps[j, 0], gaps[j, 3], gaps[j, 4] = y0[j, lane], y1[j, lane], v1[j, lane]
        gaps[j, 1] = 0.0
        start, end = 0.0, 0.0
        for row in range(new.shape[0]):
            weight = curvatures[1, j, row]
            end += weight * new[row, lane]
            if row < modes or row >= 2 * modes:
                start += weight * old[row, lane]
        gaps[j, 2], gaps[j, 5] = start, end
    for k in range(modes):
        p = 0.0
        for m in range(modes):
            p += decay[k, m] * old[modes + m, lane]
        for m in range(brought.shape[1]):
            p += brought[k, m] * z[m, lane]
        for j in range(pairs):
            gaps[j, 1] += curvatures[0, j, k] * p
            gaps[j, 2] += curvatures[1, j, modes + k] * p


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def run_modes(
    state, streams, sums, step, passes, kick, curvatures, stops, margins, resets, origins,
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
    step : s. passes : tables of `matrix_pass` for the new state, from states and normals; for the
        gaps' speeds after the kick, from both; for gaps and their speeds from the new state.
    kick : (E, L). curvatures : (2, pairs, states), phi in q, and the row of y''.
    stops : (pairs, 2, 3). margins : (pairs,) by which hulls are widened.
    resets : Taylor series of the states (pairs, 2 modes, terms) after a unit change of a pair's
        speed; what every gap's slope and curvature change at once (pairs, pairs, 2), and its
        value, slope and curvature later (pairs, pairs, 3, terms).
    record : None, or zeros (steps, paths, 2 modes + pairs) to take q, p and the signed impact
        speeds of every step; the burn-in must then be 0.
    """
    from_states, from_normals, speed_states, speed_normals, to_gaps, to_speeds = passes
    states, paths = state.shape
    modes, pairs = kick[0].shape[0], stops.shape[0]
    normals = from_normals[3]
    moments = modes + modes * (modes + 1)
    third = step / 3.0
    old, new = np.zeros((states, LANES)), np.zeros((states, LANES))
    drawn = np.zeros((2 * normals, LANES))
    y0, y1 = np.zeros((pairs, LANES)), np.zeros((pairs, LANES))
    v0, v1 = np.zeros((pairs, LANES)), np.zeros((pairs, LANES))
    marks = np.zeros(LANES)
    local = np.zeros((moments + ROWS_OF_PAIR * pairs, LANES))
    hits = np.zeros((pairs, ROWS_OF_PAIR))
    gaps, resting = np.zeros((pairs, 6)), np.zeros((pairs, 2))
    c, stack = np.zeros(6), np.zeros((DEEPEST + 2, 8))
    words0, words1 = np.zeros(LANES, np.uint64), np.zeros(LANES, np.uint64)
    for start in range(0, paths, LANES):
        lanes = min(LANES, paths - start)
        local[:] = 0.0
        for i in range(lanes):
            words0[i], words1[i] = streams[0, start + i], streams[1, start + i]
            for row in range(states):
                old[row, i] = state[row, start + i]
        matrix_pass(y0, 0.0, old, to_gaps)
        for number in range(burn_in + steps):
            counted = number >= burn_in
            half = number % 2
            if half == 0:
                for row in range(normals):
                    normal_pairs(words0, words1, drawn[row], drawn[normals + row])
            z = drawn[half * normals : (half + 1) * normals]
            matrix_pass(new, 0.0, old, from_states)
            matrix_pass(new, 1.0, z, from_normals[:3])
            if pairs > 0:
                matrix_pass(v0, 0.0, old, speed_states)
                matrix_pass(v0, 1.0, z, speed_normals)
                matrix_pass(y1, 0.0, new, to_gaps)
                matrix_pass(v1, 0.0, new, to_speeds)
                marks[:] = 0.0
                for j in range(pairs):
                    lower, upper = stops[j, 0, 0] + margins[j], stops[j, 1, 0] - margins[j]
                    mark(y0[j], v0[j], y1[j], v1[j], third, lower, upper, marks)
                if count_marks(marks) > 0.0:
                    for i in range(lanes):
                        if marks[i] == 0.0:
                            continue
                        close_look(old, new, z, i, kick, curvatures, y0, y1, v1, gaps)
                        hits[:] = 0.0
                        bounce(new, i, gaps, resting, step, stops, resets, hits, c, stack)
                        for j in range(pairs):
                            y1[j, i] = gaps[j, 3]
                            if counted:
                                for k in range(ROWS_OF_PAIR):
                                    local[moments + ROWS_OF_PAIR * j + k, i] += hits[j, k]
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
                        add_row(local[k], old[k], origins[k])
                        for m in range(k, modes):
                            add_product(local[row], old[k], origins[k], old[m], origins[m])
                            row += 1
                    for k in range(modes):
                        for m in range(k, modes):
                            add_product(local[row], old[modes + k], 0.0, old[modes + m], 0.0)
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
