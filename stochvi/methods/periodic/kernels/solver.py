"""Flights between rigid stops under a periodic force, regimes that repeat, and their branches.

In coordinates q with unit masses, and in units that make all numbers of order one,

    q'' + C q' + K q = B w,    w = (cos p, sin p, cos 2 p, sin 2 p, ..., 1),

p = omega t the phase of the force. A stop s is met where the distance d = row . q - position comes
from below to 0; an impact takes q' to q' - (1 + R) (row . q') row / (row . row). That is linear:
the phases of the impacts of a regime determine its motion by linear algebra alone.

Symbols: n coordinates, m stops, h harmonics; z = (q, q', w) of size N = 2 n + 2 h + 1, and G its
generator; K impacts with the phases theta in P periods of the force; sigma in [0, 1], the parameter
of a branch over its range.
"""

import math
from typing import NamedTuple

import numpy as np

from stochvi.engine.compiling import kernel

TERMS = 15
"""Number of terms of a Taylor series over a step; the last is 0.5^15 / 15! = 2e-17 of the first."""

NORM = 0.5
"""Largest 1-norm of a generator times its step for which the series are used."""

ANGLE = 0.25
"""Longest step times the fastest frequency, rad: no distance turns twice within a step."""

PARTS = 4
"""Number of parts of a step in which the first root of a distance is looked for."""

MOST_ITERATIONS = 16
"""Largest number of Newton steps to a regime."""

LONGEST_CHANGE = 0.7
"""Largest change of a phase in one Newton step, rad."""

CONVERGED = 3e-13
"""Change of a phase, rad, at which Newton's iteration has converged; rounding leaves some 1e-15."""

SHRINKING, ROUNDED = 0.75, 1e-7
"""A Newton step shrinks where it is less than this share of the one before. One that does not, and
is smaller than this (rad), is rounding: that of 1e-16 is divided by the loss in a period."""

APART = 1e-3
"""Largest distance from its stop at an impact of a regime. Where phases leave the motion all but
undetermined distances are without bound, and Newton's iteration may end there."""

WEIGHT = 6.0
"""Weight of the parameter against the phases in the length of arc of a branch, rad."""

FREE = -1
"""State of a motion in which no stop is rested on."""

NONE = -2
"""Number of the stop of the next event where there is none."""

MOST_IMPACTS = 4000
"""Largest number of impacts in one period that a simulation follows."""

STILL = 1e-9
"""A coordinate that its forces press onto a stop rests there below this speed after an impact. It
is relative to the largest speed of the same path. Otherwise chatter would go on for ever."""


class Motion(NamedTuple):
    """Numbers of one scene, scaled: G (N, N), rows (m, n), positions and restitutions (m,), the
    frequency, and the output: its row (n,) and the acceleration of the base per unit of w."""

    generator: np.ndarray
    rows: np.ndarray
    positions: np.ndarray
    restitutions: np.ndarray
    omega: float
    output: np.ndarray
    base: np.ndarray


class Expansion(NamedTuple):
    """Numbers of one scene over the range of a branch.

    Parameters
    ----------
    coefficients : (terms, numbers), Chebyshev series in 2 sigma - 1 of the numbers of a `Motion`,
        in the order in which `motion_at` takes them.
    n, m, h : numbers of coordinates, stops and harmonics.
    """

    coefficients: np.ndarray
    n: int
    m: int
    h: int


class Pattern(NamedTuple):
    """The impacts of a regime: numbers (K,) of the stops in the order in which they are struck, and
    number of periods of the force after which it repeats itself."""

    stops: np.ndarray
    periods: int


class Touch(NamedTuple):
    """State of a flight besides its motion: `on` (3,) holds the stop that is rested on, the last
    stop that was struck, and the stop to be passed over. `fastest` (1,) is the largest impact
    speed."""

    on: np.ndarray
    fastest: np.ndarray


@kernel
def motion_at(expansion, sigma):
    """The motion at a parameter."""
    series, n, m, h = expansion
    terms, count = series.shape
    x = 2.0 * sigma - 1.0
    flat = series[0].copy()
    before, now = 1.0, x
    for k in range(1, terms):
        for i in range(count):
            flat[i] += now * series[k, i]
        before, now = now, 2.0 * x * now - before
    w, square = 2 * h + 1, n * n
    g = np.zeros((2 * n + w, 2 * n + w))
    for i in range(n):
        g[i, n + i] = 1.0
        for j in range(n):
            g[n + i, j] = -flat[i * n + j]
            g[n + i, n + j] = -flat[square + i * n + j]
        put(flat[2 * square + i * w : 2 * square + (i + 1) * w], g[n + i, 2 * n :])
    # the other numbers, one after another
    ends = 2 * square + n * w + np.cumsum(np.array([m * n, m, m, 1, n, w]))
    rows = flat[ends[0] - m * n : ends[0]].copy().reshape(m, n)
    positions, restitutions = flat[ends[0] : ends[1]].copy(), flat[ends[1] : ends[2]].copy()
    omega, output = flat[ends[2]], flat[ends[3] : ends[4]].copy()
    base = flat[ends[4] : ends[5]].copy()
    for k in range(h):
        i = 2 * n + 2 * k
        g[i, i + 1] = -(k + 1) * omega
        g[i + 1, i] = (k + 1) * omega
    return Motion(g, rows, positions, restitutions, omega, output, base)


@kernel
def norm_of(g):
    """1-norm of a matrix."""
    largest = 0.0
    for j in range(g.shape[1]):
        total = 0.0
        for i in range(g.shape[0]):
            total += abs(g[i, j])
        largest = max(largest, total)
    return largest


@kernel
def multiply(a, b, out):
    """out = a b."""
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            out[i, j] = 0.0
        for k in range(a.shape[1]):
            value = a[i, k]
            if value != 0.0:
                for j in range(b.shape[1]):
                    out[i, j] += value * b[k, j]


@kernel
def put(values, out):
    """Copy a vector. The loop compiles within a hundredth of the time of `out[:] = values`, for
    which numba compiles broadcasting and the text of its error messages."""
    for i in range(len(values)):
        out[i] = values[i]


@kernel
def set_all(out, value):
    """Give all elements of a vector one value."""
    for i in range(len(out)):
        out[i] = value


@kernel
def identity(size):
    """The identity matrix."""
    found = np.zeros((size, size))
    for i in range(size):
        found[i, i] = 1.0
    return found


@kernel
def dot(a, b):
    """Scalar product."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@kernel
def apply(matrix, z, out):
    """out = matrix z."""
    for i in range(len(matrix)):
        total = 0.0
        for j in range(len(z)):
            total += matrix[i, j] * z[j]
        out[i] = total


@kernel
def apply_and_add(matrix, z, constant, out):
    """out = constant + matrix z."""
    for i in range(len(matrix)):
        total = constant[i]
        for j in range(len(z)):
            total += matrix[i, j] * z[j]
        out[i] = total


@kernel
def project(row, position, terms, out):
    """Taylor coefficients of a displacement less a position, from those of a state."""
    for k in range(len(terms)):
        out[k] = dot(row, terms[k])
    out[0] -= position


@kernel
def turn_column(generator, time, perturbations, column, out):
    """Take a small perturbation of a state, (2 n, number), over a time."""
    two = len(perturbations)
    put(perturbations[:, column], out)
    fresh = np.empty(two)
    for k in range(1, TERMS):
        apply(generator[:two, :two], out, fresh)
        for i in range(two):
            out[i] = fresh[i] * time / k
            perturbations[i, column] += out[i]


@kernel
def transition(g, time):
    """exp(G time) by a Taylor series of a part of the time, squared."""
    size = len(g)
    norm = norm_of(g) * abs(time)
    squarings = 0
    while norm > NORM:
        norm *= 0.5
        squarings += 1
    part = time / 2.0**squarings
    powers, found, other = np.empty((3, size, size)), np.zeros((size, size)), np.empty((size, size))
    for i in range(size):
        for j in range(size):
            powers[0, i, j] = g[i, j] * part
    multiply(powers[0], powers[0], powers[1])
    multiply(powers[0], powers[1], powers[2])
    fourth = np.empty((size, size))
    multiply(powers[1], powers[1], fourth)
    # sum of X^k / k! to the power 15, by fours
    inverse = 1.0
    for k in range(2, 16):
        inverse /= k
    for start in (12, 8, 4, 0):
        if start < 12:
            multiply(fourth, found, other)
            found, other = other, found
        factor = inverse
        for k in range(3, 0, -1):
            for i in range(size):
                for j in range(size):
                    found[i, j] += factor * powers[k - 1, i, j]
            factor *= start + k
        for i in range(size):
            found[i, i] += factor
        inverse = factor * start
    for _ in range(squarings):
        multiply(found, found, other)
        found, other = other, found
    return found


@kernel
def solve(a, b):
    """a^-1 b in place of b; False where a is singular. Changes a."""
    size = len(a)
    for i in range(size):
        pivot = i
        for k in range(i + 1, size):
            if abs(a[k, i]) > abs(a[pivot, i]):
                pivot = k
        if not abs(a[pivot, i]) > 1e-300:
            return False
        if pivot != i:
            for j in range(size):
                a[i, j], a[pivot, j] = a[pivot, j], a[i, j]
            for j in range(b.shape[1]):
                b[i, j], b[pivot, j] = b[pivot, j], b[i, j]
        for k in range(i + 1, size):
            factor = a[k, i] / a[i, i]
            if factor != 0.0:
                for j in range(i, size):
                    a[k, j] -= factor * a[i, j]
                for j in range(b.shape[1]):
                    b[k, j] -= factor * b[i, j]
    for i in range(size - 1, -1, -1):
        for j in range(b.shape[1]):
            for k in range(i + 1, size):
                b[i, j] -= a[i, k] * b[k, j]
            b[i, j] /= a[i, i]
    return True


@kernel
def force_state(motion, phase, out):
    """w at a phase of the force."""
    h = (len(out) - 1) // 2
    for k in range(h):
        out[2 * k] = math.cos((k + 1) * phase)
        out[2 * k + 1] = math.sin((k + 1) * phase)
    out[2 * h] = 1.0


@kernel
def rate(motion, z, out):
    """(q', q'') of a state z."""
    apply(motion.generator[: 2 * motion.rows.shape[1]], z, out)


@kernel
def strike(motion, stop, y):
    """Take the velocities of y = (q, q') before an impact to those after it; its incident speed."""
    n = motion.rows.shape[1]
    row = motion.rows[stop]
    speed, square = dot(row, y[n:]), dot(row, row)
    for i in range(n):
        y[n + i] -= (1.0 + motion.restitutions[stop]) * speed / square * row[i]
    return speed


@kernel
def residual(motion, pattern, theta, states, left, jacobian):
    """Distance of each impact of a regime from its stop, and its derivative by the phases.

    A motion starts in the state y and has its impacts at the given phases. Let M y + c be the state
    after its periods. Let d_k be the distance from the stop at impact k, and v_k a change of the
    state along the row of that stop. The state at the first impact is the solution of y = M y + c -
    sum of v_k d_k. Where all d_k are 0 that motion is periodic. Without the sum, y would be
    undetermined for a loose mass, and nearly so where little energy is lost.

    The displacements in the v_k differ in size, because equal ones may cancel each other. So do the
    velocities, because a motion that loses little would otherwise be determined by rounding alone.
    The velocities add up to 0, so that a loose mass keeps its own.

    Writes the states (K, 2 n) before each impact, `left` (K,) and the Jacobian (K, K), which is not
    computed if its array has the shape (0, 0); False where the phases do not determine the motion.
    """
    stops = pattern.stops
    count, n = len(stops), motion.rows.shape[1]
    two, size = 2 * n, len(motion.generator)
    ways, struck = np.empty((count, two, two)), np.empty((count, two, two))
    forced, w = np.empty((count, two)), np.empty(size - two)
    whole, other = identity(two), np.empty((two, two))
    start, unit = np.zeros(two), np.empty(two)
    pulls, held_ = np.zeros((count, two)), np.zeros((two, two))
    pulled = np.zeros(two)
    for k in range(count):
        row = motion.rows[stops[k]]
        square, (distance, _) = dot(row, row), distance_of(motion, stops[k], start)
        for i in range(n):
            pulls[k, i] = row[i] / square / (k + 1)
            pulls[k, n + i] = row[i] / square * (count - 1 - 2 * k) / count
        for i in range(two):
            pulled[i] -= pulls[k, i] * distance
            for j in range(two):
                held_[i, j] += pulls[k, i] * dot(row, whole[:n, j])
        flight = transition(motion.generator, duration_of(motion, pattern, theta, k))
        force_state(motion, theta[k], w)
        apply(flight[:two, two:], w, forced[k])
        for i in range(two):
            put(flight[i, :two], ways[k, i])
        for j in range(two):
            set_all(unit, 0.0)
            unit[j] = 1.0
            strike(motion, stops[k], unit)
            apply(ways[k], unit, struck[k, :, j])
        multiply(struck[k], whole, other)
        whole, other = other, whole
        apply_and_add(struck[k], start, forced[k], unit)
        start, unit = unit, start
    inverse = identity(two)
    for i in range(two):
        for j in range(two):
            other[i, j] = (1.0 if i == j else 0.0) - whole[i, j] + held_[i, j]
        start[i] += pulled[i]
    if not solve(other, inverse):
        return False
    apply(inverse, start, states[0])
    for k in range(count - 1):
        apply_and_add(struck[k], states[k], forced[k], states[k + 1])
    for k in range(count):
        left[k], _ = distance_of(motion, stops[k], states[k])
    if len(jacobian) == 0:
        return True
    arriving, leaving = np.empty((count, two)), np.empty((count, two))
    z = np.empty(size)
    for k in range(count):
        put(states[k], z[:two])
        force_state(motion, theta[k], z[two:])
        rate(motion, z, arriving[k])
        strike(motion, stops[k], z[:two])
        rate(motion, z, unit)
        apply(ways[k], unit, leaving[k])
        for i in range(two):
            leaving[k, i] /= motion.omega
            arriving[k, i] /= motion.omega
    moved, next_ = np.empty(two), np.empty(two)
    for column in range(count):
        # first with the state at the first impact as it is, then with its change
        set_all(moved, 0.0)
        for turn in range(2):
            set_all(pulled, 0.0)
            for k in range(count):
                change = dot(motion.rows[stops[k]], moved)
                jacobian[k, column] = change
                apply(struck[k], moved, next_)
                for i in range(two):
                    pulled[i] -= pulls[k, i] * change
                    if k == column:
                        next_[i] -= leaving[k, i]
                    if (k + 1) % count == column:
                        next_[i] += arriving[column, i]
                moved, next_ = next_, moved
            if turn == 0:
                for i in range(two):
                    moved[i] += pulled[i]
                apply(inverse, moved, next_)
                moved, next_ = next_, moved
    return True


@kernel
def duration_of(motion, pattern, theta, k):
    """Time from an impact of a regime to the next one."""
    end = theta[k + 1] if k + 1 < len(theta) else theta[0] + 2.0 * math.pi * pattern.periods
    return (end - theta[k]) / motion.omega


@kernel(inline="always")
def bordered(expansion, pattern, u, states, left, matrix):
    """Residual at u = (theta, WEIGHT sigma) and its derivatives, without the last row."""
    count = len(pattern.stops)
    there, change = np.empty_like(states), 1e-6
    none, jacobian = np.empty((0, 0)), np.empty((count, count))
    for turn in range(3):
        # on either side, for the derivative by sigma, and last at u itself
        shift = 0.0 if turn == 2 else (change if turn == 1 else -change)
        motion = motion_at(expansion, u[count] / WEIGHT + shift)
        own = states if turn == 2 else there
        wanted = jacobian if turn == 2 else none
        if not residual(motion, pattern, u[:count], own, left, wanted):
            return False
        for k in range(count):
            if turn == 0:
                matrix[k, count] = -left[k]
            elif turn == 1:
                matrix[k, count] = (matrix[k, count] + left[k]) / (2.0 * change * WEIGHT)
            else:
                for j in range(count):
                    matrix[k, j] = jacobian[k, j]
    return True


@kernel
def largest_of(values):
    """The largest modulus; infinite where one is NaN."""
    largest = 0.0
    for i in range(len(values)):
        largest = max(largest, abs(values[i])) if abs(values[i]) < np.inf else np.inf
    return largest


@kernel
def has_converged(change, before, phase):
    """Whether the last change of Newton's iteration, after the one before, is rounding."""
    return change < CONVERGED * (1.0 + abs(phase)) or SHRINKING * before <= change < ROUNDED


@kernel
def step_by(place, change):
    """Take a Newton step, which is limited, in the place of the phases; the change as it was."""
    largest = largest_of(change)
    factor = min(1.0, LONGEST_CHANGE / max(largest, 1e-300))
    for k in range(len(place)):
        place[k] += factor * change[k]
    return largest


@kernel
def settle(motion, pattern, theta, states):
    """Newton's iteration to a regime of one motion, in place of theta; False where it fails."""
    count = len(pattern.stops)
    left, jacobian, right = np.empty(count), np.empty((count, count)), np.empty((count, 1))
    none = np.empty((0, 0))
    converged, before = False, np.inf
    for _ in range(MOST_ITERATIONS + 1):
        wanted = none if converged else jacobian
        if not residual(motion, pattern, theta, states, left, wanted):
            return False
        if converged:
            return largest_of(left) < APART
        for k in range(count):
            right[k, 0] = -left[k]
        if not solve(jacobian, right):
            return False
        largest = step_by(theta, right[:, 0])
        if not largest < 1e6:
            return False
        converged, before = has_converged(largest, before, theta[0]), largest
    return False


@kernel
def slowest(motion, pattern, theta, states):
    """The smallest impact speed, or the shortest flight, whichever is less: both are above 0."""
    least = np.inf
    for k in range(len(theta)):
        _, speed = distance_of(motion, pattern.stops[k], states[k])
        least = min(least, speed, motion.omega * duration_of(motion, pattern, theta, k))
    return least


@kernel
def expand(g, z, out):
    """Taylor coefficients (TERMS, N) of exp(G tau) z."""
    size = len(g)
    put(z, out[0])
    for k in range(1, TERMS):
        for i in range(size):
            total = 0.0
            for j in range(size):
                total += g[i, j] * out[k - 1, j]
            out[k, i] = total / k


@kernel
def value_at(c, time):
    """A polynomial."""
    total = 0.0
    for k in range(len(c) - 1, -1, -1):
        total = total * time + c[k]
    return total


@kernel
def slope_at(c, time):
    """Derivative of a polynomial."""
    total = 0.0
    for k in range(len(c) - 1, 0, -1):
        total = total * time + k * c[k]
    return total


@kernel
def root_between(c, low, high, derivative):
    """A root of a polynomial, or of its derivative, between two times at which signs differ."""
    rising = (slope_at(c, high) if derivative else value_at(c, high)) > 0.0
    time = 0.5 * (low + high)
    for _ in range(80):
        value = slope_at(c, time) if derivative else value_at(c, time)
        if (value > 0.0) == rising:
            high = time
        else:
            low = time
        if derivative:
            slope = 0.0
            for k in range(len(c) - 1, 1, -1):
                slope = slope * time + k * (k - 1) * c[k]
        else:
            slope = slope_at(c, time)
        fresh = time - value / slope if slope != 0.0 else low
        if not low < fresh < high:
            fresh = 0.5 * (low + high)
        if abs(fresh - time) <= 1e-16 * abs(time) or high - low <= 1e-16 * abs(high):
            return fresh
        time = fresh
    return time


@kernel
def first_rise(c, length):
    """The first time in [0, length] at which a polynomial is above 0; -1 where none."""
    if c[0] > 0.0:
        return 0.0
    start = 0.0
    for part in range(1, PARTS + 1):
        end = length * part / PARTS
        if value_at(c, end) > 0.0:
            return root_between(c, start, end, False)
        if slope_at(c, start) > 0.0 and slope_at(c, end) < 0.0:
            top = root_between(c, start, end, True)
            if value_at(c, top) > 0.0:
                return root_between(c, start, top, False)
        start = end
    return -1.0


@kernel
def step_of(motion):
    """The longest step in which no distance turns twice and the series converge."""
    n = motion.rows.shape[1]
    h = (len(motion.generator) - 2 * n - 1) // 2
    fastest = max(h, 1) * motion.omega
    stiffness = 0.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += abs(motion.generator[n + i, j])
        stiffness = max(stiffness, total)
    fastest = max(fastest, math.sqrt(stiffness))
    return min(ANGLE / fastest, NORM / norm_of(motion.generator))


@kernel
def correct(expansion, pattern, u, normal):
    """Newton's iteration from u to a regime on the plane through u with a normal, in place of
    u; the tangent of the branch there is written to `normal`. The smallest impact speed there, or
    the shortest flight, as of `slowest`; NaN where the iteration fails."""
    count = len(pattern.stops)
    states = np.empty((count, 2 * expansion.n))
    matrix, left = np.empty((count + 1, count + 1)), np.empty(count)
    at, right = u.copy(), np.empty((count + 1, 1))
    converged, before = False, np.inf
    for _ in range(MOST_ITERATIONS):
        if not bordered(expansion, pattern, u, states, left, matrix):
            return np.nan
        for k in range(count):
            right[k, 0] = 0.0 if converged else -left[k]
        right[count, 0] = 1.0 if converged else 0.0
        for k in range(count + 1):
            matrix[count, k] = normal[k]
            if not converged:
                right[count, 0] -= normal[k] * (u[k] - at[k])
        if not solve(matrix, right):
            return np.nan
        if converged:
            converged = largest_of(left) < APART
            break
        largest = step_by(u, right[:, 0])
        if not largest < 1e6:
            return np.nan
        converged, before = has_converged(largest, before, u[0]), largest
    if not converged:
        return np.nan
    length = dot(right[:, 0], right[:, 0])
    for k in range(count + 1):
        normal[k] = right[k, 0] / math.sqrt(length)
    motion = motion_at(expansion, u[count] / WEIGHT)
    return slowest(motion, pattern, u[:count], states)


@kernel
def survey(motion, pattern, theta, states):
    """Margin to further impacts, largest displacement and acceleration of the output, and the
    factors by which perturbations grow, over a regime; without impacts, theta holds the phase at
    which it starts.

    The margin is the smallest distance to a stop where the motion turns back without an impact,
    below 0 where it would pass; the acceleration is the absolute one, between impacts.
    """
    stops = pattern.stops
    two, size, m = 2 * motion.rows.shape[1], len(motion.generator), len(motion.positions)
    longest = step_of(motion)
    margin, displacement, acceleration, speed = np.inf, 0.0, 0.0, 0.0
    z, last = np.empty(size), np.empty(size)
    terms, c = np.empty((TERMS, size)), np.empty(TERMS)
    pull = acceleration_row(motion, motion.generator)
    slope = times_generator(pull, motion.generator)
    factors, other = identity(two), np.empty((two, two))
    for k in range(max(len(stops), 1)):
        time = duration_of(motion, pattern, theta, k)
        steps = max(1, math.ceil(time / longest))
        part = time / steps
        matrix = transition(motion.generator, part)
        put(states[k], z[:two])
        force_state(motion, theta[k], z[two:])
        if len(stops):
            turn_at_impact(motion, stops[k], z, factors)
            speed = strike(motion, stops[k], z[:two])
        whole = transition(motion.generator, time)
        multiply(whole[:two, :two], factors, other)
        factors, other = other, factors
        for number in range(steps):
            put(z, last)
            apply(matrix, last, z)
            expanded = False
            for s in range(-1, m):
                # the output, or the distance to a stop
                start, start_rate = output_of(motion, last)
                finish, finish_rate = output_of(motion, z)
                if s < 0:
                    displacement = max(displacement, abs(start), abs(finish))
                else:
                    start, start_rate = distance_of(motion, s, last)
                    finish, finish_rate = distance_of(motion, s, z)
                if len(stops) > 0 and s >= 0 and number == 0:
                    if s != stops[k]:
                        margin = min(margin, -start)
                    elif abs(start_rate) <= 1e-12 * speed:
                        # a restitution of 0 leaves a rate of rounding: pressed on, it is passed
                        start_rate = push_of(motion, s, last)
                if start_rate * finish_rate >= 0.0 or (s >= 0 and start_rate < 0.0):
                    continue
                if not expanded:
                    expand(motion.generator, last, terms)
                    expanded = True
                if s < 0:
                    project(motion.output, 0.0, terms, c)
                else:
                    project(motion.rows[s], motion.positions[s], terms, c)
                top = value_at(c, root_between(c, 0.0, part, True))
                if s < 0:
                    displacement = max(displacement, abs(top))
                else:
                    margin = min(margin, -top)
            ends, rates = (dot(pull, last), dot(pull, z)), (dot(slope, last), dot(slope, z))
            acceleration = max(acceleration, swing(ends, rates, part))
    return margin, displacement, acceleration, factors


@kernel
def acceleration_row(motion, generator):
    """The row (N,) whose product with a state is the absolute acceleration of the output. It
    belongs to a generator: of the free motion, or at rest on a stop."""
    n, size = motion.rows.shape[1], len(motion.generator)
    found = np.zeros(size)
    for j in range(size):
        found[j] = dot(motion.output, generator[n:, j])
    for j in range(size - 2 * n):
        found[2 * n + j] += motion.base[j]
    return found


@kernel
def times_generator(row, generator):
    """The row whose product with a state is the rate of the product with another row."""
    found = np.empty(len(row))
    for j in range(len(row)):
        found[j] = dot(row, generator[:, j])
    return found


@kernel
def turns_of(ends, rates, time):
    """The cubic ends[0] + p s + c2 s^2 + c3 s^3 over the share s of a step, by values and rates at
    its ends. Returns p, c2, c3, and the shares within the step at which it turns, or 2."""
    p, q, rise = rates[0] * time, rates[1] * time, ends[1] - ends[0]
    c2, c3 = 3.0 * rise - 2.0 * p - q, p + q - 2.0 * rise
    root = math.sqrt(max(c2 * c2 - 3.0 * c3 * p, 0.0))
    one = -p / (c2 - root) if c2 - root != 0.0 else 2.0
    other = -p / (c2 + root) if c2 + root != 0.0 else 2.0
    return p, c2, c3, one if 0.0 < one < 1.0 else 2.0, other if 0.0 < other < 1.0 else 2.0


@kernel
def swing(ends, rates, time):
    """Largest size within a step of a quantity whose values and rates at its ends are known, by a
    cubic."""
    largest = max(abs(ends[0]), abs(ends[1]))
    if rates[0] * rates[1] < 0.0:
        p, c2, c3, one, other = turns_of(ends, rates, time)
        for s in (one, other):
            if s < 1.0:
                largest = max(largest, abs(ends[0] + s * (p + s * (c2 + s * c3))))
    return largest


@kernel
def held(motion):
    """Generators (m, N, N) of the motion at rest on each stop."""
    n, m, size = motion.rows.shape[1], len(motion.positions), len(motion.generator)
    found = np.empty((m, size, size))
    for s in range(m):
        for i in range(size):
            put(motion.generator[i], found[s, i])
        row = motion.rows[s]
        for j in range(size):
            total = dot(row, motion.generator[n:, j])
            for i in range(n):
                found[s, n + i, j] -= total * row[i] / dot(row, row)
    return found


@kernel
def sum_terms(terms, time, out):
    """The state whose Taylor coefficients are known, after a time."""
    for i in range(terms.shape[1]):
        total = 0.0
        for k in range(TERMS - 1, -1, -1):
            total = total * time + terms[k, i]
        out[i] = total


@kernel
def turn_at_impact(motion, stop, z, perturbations):
    """Take small perturbations over an impact, before it turns the state z: a perturbed flight is
    struck at another moment. The old rates act before it, the new ones after it."""
    n = motion.rows.shape[1]
    before, after, moved = np.empty(2 * n), np.empty(2 * n), np.empty(len(z))
    put(z, moved)
    rate(motion, z, before)
    speed = strike(motion, stop, moved[: 2 * n])
    rate(motion, moved, after)
    strike(motion, stop, before)
    for column in range(perturbations.shape[1]):
        distance = 0.0
        for i in range(n):
            distance += motion.rows[stop, i] * perturbations[i, column]
        strike(motion, stop, perturbations[:, column])
        for i in range(2 * n):
            perturbations[i, column] += (after[i] - before[i]) * distance / speed


@kernel
def distance_of(motion, stop, z):
    """The distance d of a state to a stop, below 0 where it is clear of it, and its rate."""
    n = motion.rows.shape[1]
    distance, speed = -motion.positions[stop], 0.0
    for i in range(n):
        distance += motion.rows[stop, i] * z[i]
        speed += motion.rows[stop, i] * z[n + i]
    return distance, speed


@kernel
def output_of(motion, z):
    """The displacement of the output, and its rate."""
    return dot(motion.output, z), dot(motion.output, z[motion.rows.shape[1] :])


@kernel
def push_of(motion, stop, z):
    """Acceleration towards a stop that the forces of a state give."""
    n = motion.rows.shape[1]
    total = 0.0
    for i in range(n):
        for j in range(len(z)):
            total += motion.rows[stop, i] * motion.generator[n + i, j] * z[j]
    return total


@kernel
def rest_on(motion, stop, z):
    """Take the rest of the speed towards a stop from a state."""
    remove_part(motion.rows[stop], z[motion.rows.shape[1] :])


@kernel
def remove_part(direction, vector):
    """Take from a vector, in its place, its part along a direction."""
    share = dot(direction, vector) / dot(direction, direction)
    for i in range(len(direction)):
        vector[i] -= share * direction[i]


@kernel
def free_touch():
    """A flight that rests on no stop and has struck none."""
    return Touch(np.full(3, FREE), np.zeros(1))


@kernel
def may_meet(motion, stop, z, later, time):
    """Whether a stop may be met between two states of a flight, a time apart."""
    start, speed = distance_of(motion, stop, z)
    end, end_speed = distance_of(motion, stop, later)
    return not max(start, end) + 0.5 * time * (abs(speed) + abs(end_speed)) < 0.0


@kernel
def next_event(motion, touch, z, later, left, terms):
    """Time and stop of the next event of a flight from the state z to the one `later`, the time
    left after it: an impact, or the release from the stop that is rested on. Without an event the
    stop is NONE. `terms` holds the Taylor coefficients of z."""
    c = np.empty(TERMS)
    resting, touched, skipped = touch.on[0], touch.on[1], touch.on[2]
    sooner, event = left, np.int64(NONE)
    for s in range(len(motion.positions)):
        if s in (resting, skipped):
            continue
        if not may_meet(motion, s, z, later, left):
            continue
        project(motion.rows[s], motion.positions[s], terms, c)
        # from the stop itself, or from beyond it by rounding: the next touch
        on = s == touched or c[0] > 0.0
        at = first_rise(c[1:], sooner) if on else first_rise(c, sooner)
        if at >= 0.0 and (at < sooner or event == NONE):
            sooner, event = at, s
    if resting != FREE:
        for k in range(TERMS):
            c[k] = -push_of(motion, resting, terms[k])
        at = first_rise(c, sooner)
        if at >= 0.0:
            sooner, event = at, resting
    return sooner, event


@kernel
def strike_or_rest(motion, stop, touch, z):
    """An impact of a flight, in place of z, after which it may rest on the stop; its speed."""
    speed = strike(motion, stop, z[: 2 * motion.rows.shape[1]])
    touch.fastest[0] = max(touch.fastest[0], speed)
    touch.on[0], touch.on[1] = FREE, stop
    if motion.restitutions[stop] * speed <= STILL * touch.fastest[0]:
        if push_of(motion, stop, z) > 0.0:
            touch.on[0] = stop
            rest_on(motion, stop, z)
        else:
            touch.on[2] = stop
    return speed


@kernel
def march(motion, start, periods, phase, ends, log):
    """Simulate from impact to impact: `start` (2 n,) at a phase of the force, over whole periods.

    `ends` (periods + 1, 2 n) takes the state at the start and after each period. `log` (most, 3)
    takes the phase, stop and speed of impacts; for each release after a rest its phase and -1 less
    the stop. Where they are too many, the last ones stand in place of the first. Returns the
    number of rows, or -1 where impacts came too fast to be followed. Then come the largest
    displacement and absolute acceleration of the output over the last period. The last is the stop
    that is rested on at the end, or FREE.
    """
    two, size, m = 2 * motion.rows.shape[1], len(motion.generator), len(motion.positions)
    steps = math.ceil(2.0 * math.pi / motion.omega / step_of(motion))
    part = 2.0 * math.pi / motion.omega / steps
    resting = held(motion)
    # by stop, the last one of free motion: the row of the acceleration, and that of its rate
    pulls, slopes = np.empty((m + 1, size)), np.empty((m + 1, size))
    for s in range(m + 1):
        generator = motion.generator if s == m else resting[s]
        put(acceleration_row(motion, generator), pulls[s])
        put(times_generator(pulls[s], generator), slopes[s])
    matrix = transition(motion.generator, part)
    z, fresh = np.empty(size), np.empty(size)
    last, terms, touch = np.empty(size), np.empty((TERMS, size)), free_touch()
    put(start, z[:two])
    put(start, ends[0])
    hits, displacement, acceleration = 0, 0.0, 0.0
    last_hits = -1
    for period in range(periods):
        before = hits
        last_place, last_moving = output_of(motion, z)
        # rounding of the turning force does not add up over many periods
        force_state(motion, phase, z[two:])
        kept = period == periods - 1
        for number in range(steps):
            left = part
            put(z, last)
            while left > 0.0:
                state = touch.on[0]
                whole = left == part and state == FREE
                clear = whole
                if whole:
                    apply(matrix, z, fresh)
                    for s in range(m):
                        if s != touch.on[2] and may_meet(motion, s, z, fresh, left):
                            clear = False
                sooner, event = left, np.int64(NONE)
                if not clear:
                    expand(motion.generator if state == FREE else resting[state], z, terms)
                    if not whole:
                        sum_terms(terms, left, fresh)
                    sooner, event = next_event(motion, touch, z, fresh, left, terms)
                if event == NONE:
                    put(fresh, z)
                    touch.on[1], touch.on[2], left = FREE, FREE, 0.0
                    continue
                sum_terms(terms, sooner, z)
                left = max(left - sooner, 0.0)
                if kept:
                    acceleration = max(acceleration, abs(dot(pulls[state], z)))
                slot = hits % len(log)
                log[slot, 0] = (
                    phase + 2.0 * math.pi * period + motion.omega * ((number + 1) * part - left)
                )
                hits += 1
                if event == state:
                    touch.on[0], touch.on[1], touch.on[2] = FREE, FREE, state
                    log[slot, 1], log[slot, 2] = -1 - state, 0.0
                    continue
                log[slot, 1], log[slot, 2] = event, strike_or_rest(motion, event, touch, z)
                if kept:
                    displacement = max(displacement, abs(output_of(motion, z)[0]))
                    acceleration = max(acceleration, abs(dot(pulls[touch.on[0]], z)))
                if hits - before > MOST_IMPACTS:
                    return -1, displacement, acceleration, touch.on[0]
            if kept:
                place, moving = output_of(motion, z)
                displacement = max(displacement, abs(place))
                pull, slope = pulls[touch.on[0]], slopes[touch.on[0]]
                if hits == last_hits:
                    ends_ = dot(pull, last), dot(pull, z)
                    rates = dot(slope, last), dot(slope, z)
                    acceleration = max(acceleration, swing(ends_, rates, part))
                else:
                    acceleration = max(acceleration, abs(dot(pull, z)))
                if hits == last_hits and touch.on[0] == FREE:
                    ends_, rates = (last_place, place), (last_moving, moving)
                    displacement = max(displacement, swing(ends_, rates, part))
                last_hits, last_place, last_moving = hits, place, moving
        put(z[:two], ends[period + 1])
    return hits, displacement, acceleration, touch.on[0]
