"""The march of a structure through samples of what shakes it, with its stops, by power series.

In modal coordinates with unit masses, under forces f that are linear in time between samples,

    q'' + D q' + W q = f(t) - sum over stops of side F w,    d = side (phi . q - place),

w = phi / (phi . phi), so that F is the force of a stop per reduced mass. While no stop changes its
state, the coefficients of q = sum of q_k t^k follow from each other, whatever the number of modes:
the motion is exact but for rounding. Steps are short against the fastest motion. Every condition
for a change of state (a stop is met, is left, ...) is then a series with few turns, whose first
root is found.

States of a stop, FREE (d < 0) or
    rigid       0: at rest on the stop, phi . q'' = 0, while the stop has to push
    pieces      k: F = force_k + slope_k (d - start_k), in piece k of the table
    damped      0: F = K d + c d' > 0;  1: no force, until d = 0 or F > 0 again
    Hertz       0: no force, d below a depth that holds no energy;  1: F = k d^(3/2)
    function    0: as for Hertz;  1: F(d, d'), a polynomial through its values in the step

Symbols: n modes, m stops, c coordinates.
"""

import math
from typing import NamedTuple

import numpy as np

from stochvi.engine.arithmetic import uniform_of
from stochvi.engine.calls import force_of, rate_of, rebound_of
from stochvi.engine.compiling import kernel

ROUNDING = 2.0**-52
"""Relative spacing of floating-point numbers at 1."""

MOST_STEPS = 120
"""Largest number of steps to a root: each halves the bracket at least every second time."""


RIGID, PIECES, DAMPED, HERTZ, FUNCTION = range(5)
"""Kinds of stops. From HERTZ on, the force may be singular at the touch."""

FREE = -1
"""State of a stop that is not touched."""

ANGLE = 0.5
"""Longest step times the fastest rate of the motion, rad: series converge in 15 terms, and no
condition bends twice within a step."""

MOST_TERMS = 26
"""Highest power of a series, that of a Hertz contact, whose series converge like 1 / 4^k."""

APPROACH = 0.25
"""Longest step in a contact with a singular touch, in units of the time to that."""

NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(9) / 8.0)
FROM_VALUES = np.linalg.inv(np.vander(NODES, increasing=True))
"""Times, as shares of a step, at which a force that is a function is taken; and the matrix from the
values there to the coefficients by powers of the share. The force is then known to 1e-11."""

MOST_ROUNDS = 60
"""Largest number of rounds in which motion and force of a step are made to agree."""

AGREEMENT = 1e-13
"""Change of a force, relative to its size, at which motion and force agree."""

SHALLOW = 1e-5
"""Depth of a contact with a singular touch, relative to its largest, below which the force is left
out: the energy there is SHALLOW^(5/2) = 3e-13 of the whole."""

MOST_PASSES = 64
"""Largest number of passes over stops that pass an impact on to each other before they rest."""

MOST_CHANGES = 1_000_000
"""Largest number of changes of the state of stops within one sampling interval."""

TIME, STOP, SPEED, PEAK = range(4)
"""Columns of the log of impacts: time (s), number of the stop, speed (m/s), and the largest force
of the contact per reduced mass (N/kg), 0 for a rigid stop."""

HIGHEST, LOWEST, ACCELERATION = range(3)
"""Columns of the extremes of a coordinate: largest and smallest displacement (m), largest size of
the absolute acceleration (m/s^2)."""

CONTACT, RESTS, LOST = range(3)
"""Columns of the tally of a stop: time in which it pushes (s), and how often the mass came to rest
on it (rigid stops). The last one is the work of its force, per reduced mass (J/kg)."""

DONE, TOO_MANY, PAUSED, FULL = range(4)
"""Status: the march came to its end; it met more impacts than it may; it has taken the steps of one
call; its log is full. It goes on from the last two."""

BEGUN, SAMPLE, KEPT, CHANGES, LOGGED = range(5)
"""Counts of a march: whether it has begun, the sample at which it is, whether that was kept, the
changes of state since then, and the impacts so far."""


class Structure(NamedTuple):
    """omega^2 (n,), the modal damping matrix (n, n), and the displacements = shapes q (c, n)."""

    squares: np.ndarray
    damping: np.ndarray
    shapes: np.ndarray


class Stops(NamedTuple):
    """Numbers of the m stops: phi (m, n), phi . phi (m,), side, place (m), kind, and the numbers of
    the law per reduced mass (m, rows, 3): rigid (R), pieces (start, force, slope) with unused rows
    that start at infinity, damped (K, c), Hertz (k). Forces that are functions, and restitutions
    that are asked of each impact (m,), have addresses and numbers of their own, (m, 4) and
    (m, columns); see `engine.calls`. `laws` then holds a restitution that stands for all."""

    gaps: np.ndarray
    levers: np.ndarray
    sides: np.ndarray
    places: np.ndarray
    kinds: np.ndarray
    laws: np.ndarray
    functions: np.ndarray
    numbers: np.ndarray
    asked: np.ndarray


class Series(NamedTuple):
    """Coefficients by power: modal displacements and accelerations (powers, n), deflections and
    forces of the stops (m, powers). For a Hertz stop d^(3/2) stands in place of the force."""

    x: np.ndarray
    a: np.ndarray
    d: np.ndarray
    f: np.ndarray


class Touch(NamedTuple):
    """How the m stops are touched: their states (m,); `zeros` (m, 2), the number of roots of each
    way out of the state when a step begins; `depth` (m,) of a Hertz contact below which there is no
    force; `entry` (m,), the row in the log of impacts; `speed` (m,) inwards when a step begins; the
    tally (m, 3); and the word of the seed and the number of restitutions drawn so far, (2,)."""

    state: np.ndarray
    zeros: np.ndarray
    depth: np.ndarray
    entry: np.ndarray
    speed: np.ndarray
    tally: np.ndarray
    draws: np.ndarray


class Moving(NamedTuple):
    """Modal displacements and velocities (n,) of the structure."""

    q: np.ndarray
    v: np.ndarray


class Samples(NamedTuple):
    """What shakes the structure.

    Parameters
    ----------
    step : sampling interval, s.
    forces : (samples, n), modal forces, constant loads included.
    base : (samples, c), what is added to the accelerations of the coordinates, m/s^2: those with
        which they follow the base where displacements are relative to it, else 0.
    """

    step: float
    forces: np.ndarray
    base: np.ndarray


class Limits(NamedTuple):
    """Where chatter ends, and where the integration does.

    Parameters
    ----------
    tick : a mass whose chatter on a rigid stop would end within this time (s) rests on it.
    most_impacts : number of impacts at which the march is given up.
    most_steps : number of steps of one call.
    """

    tick: float
    most_impacts: int
    most_steps: int


class Course(NamedTuple):
    """How far a march has come, and what it has found.

    Parameters
    ----------
    counts : (5,), see BEGUN.
    passed : (1,), time since the sample, s.
    x, v, a, push : displacements, velocities and accelerations (samples, c) and forces of the stops
        per reduced mass (samples, m), empty unless kept.
    powers : (c, 4), sums of the powers 1 to 4 of the displacements.
    extremes : (c, 3).
    log : (rows, 4), log of impacts.
    """

    counts: np.ndarray
    passed: np.ndarray
    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    push: np.ndarray
    powers: np.ndarray
    extremes: np.ndarray
    log: np.ndarray


class Scratch(NamedTuple):
    """Work space: a series with its derivatives (4, powers), and the times at which it turns."""

    p: np.ndarray
    found: np.ndarray


# Power series over a short time: row 0 of an array p holds the coefficients, p(t) = sum of
# p[0, k] t^k for k <= last, rows 1 to 3 those of its derivatives.


@kernel
def value_of(p, order, last, t):
    """A derivative (order 0: the value) of a series at t."""
    total = 0.0
    for k in range(last - order, -1, -1):
        total = total * t + p[order, k]
    return total


@kernel
def differentiate(p, last):
    """Write the coefficients of the derivatives below those of the series."""
    for order in range(1, 4):
        for k in range(last - order + 1):
            p[order, k] = (k + 1) * p[order - 1, k + 1]


@kernel
def reach_of(p, first, last, span):
    """A bound of |p(t) / t^first - p[0, first]| for t in [0, span]."""
    reach, power = 0.0, 1.0
    for k in range(first + 1, last + 1):
        power *= span
        reach += abs(p[0, k]) * power
    return reach


@kernel
def root_between(p, order, last, low, high):
    """Time in (low, high) at which a derivative changes its sign, by Newton within a bracket.

    The derivative has a different sign at the two ends, or is 0 at the first.
    """
    rising = value_of(p, order, last, high) > 0.0
    t = 0.5 * (low + high)
    for _ in range(MOST_STEPS):
        value = value_of(p, order, last, t)
        if (value > 0.0) == rising:
            high = t
        else:
            low = t
        slope = value_of(p, order + 1, last, t)
        following = t - value / slope if slope != 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
        moved = abs(following - t)
        t = following
        if moved <= ROUNDING * t or high - low <= ROUNDING * high:
            break
    return t


@kernel
def turning_times(p, last, span, found):
    """Write the zeros of p' in (0, span), and then `span`, into `found`; returns how many.

    p'' may change its sign once: `span` is short against the motion. Derivatives are known.
    """
    count, low = 0, 0.0
    bend = -1.0
    if value_of(p, 2, last, 0.0) * value_of(p, 2, last, span) < 0.0:
        bend = root_between(p, 2, last, 0.0, span)
    for high in (bend, span):
        if high > low:
            if value_of(p, 1, last, low) * value_of(p, 1, last, high) < 0.0:
                found[count] = root_between(p, 1, last, low, high)
                count += 1
            low = high
    found[count] = span
    return count + 1


@kernel
def first_rise(p, first, last, span, found):
    """First time in [0, span] at which the series rises through 0; -1 where it does not.

    `first` zeros at t = 0 are known (a mass that has just left its stop) and divided out, so that
    rounding cannot find them again. A series that begins above 0 and falls has just passed 0.
    """
    if p[0, first] >= 0.0:
        if p[0, first + 1] > 0.0:
            return 0.0
        first += 1
    if p[0, first] + reach_of(p, first, last, span) <= 0.0:
        return -1.0
    for k in range(first, last + 1):
        p[0, k - first] = p[0, k]
    last -= first
    differentiate(p, last)
    low = 0.0
    for number in range(turning_times(p, last, span, found)):
        high = found[number]
        if value_of(p, 0, last, high) > 0.0:
            return root_between(p, 0, last, low, high)
        low = high
    return -1.0


@kernel
def widened(p, last, span, found, low, high):
    """The interval [low, high], widened by the values of the series over [0, span]."""
    reach = reach_of(p, 0, last, span)
    if p[0, 0] + reach <= high and p[0, 0] - reach >= low:
        return low, high
    differentiate(p, last)
    low, high = min(low, p[0, 0]), max(high, p[0, 0])
    for number in range(turning_times(p, last, span, found)):
        value = value_of(p, 0, last, found[number])
        low, high = min(low, value), max(high, value)
    return low, high


@kernel
def terms_for(angle):
    """Highest power that a series of exp(angle) needs for its last digit, 5 at least."""
    term, k = 1.0, 0
    while term > 0.1 * ROUNDING or k < 5:
        k += 1
        term *= angle / k
    return k


@kernel
def three_halves(d, p, k):
    """Coefficient k of p = d^(3/2), from d[0..k] and p[0..k-1]; d[0] > 0."""
    if k == 0:
        return d[0] * math.sqrt(d[0])
    total = 0.0
    for j in range(1, k + 1):
        total += (2.5 * j - k) * d[j] * p[k - j]
    return total / (k * d[0])


# The motion.


@kernel
def dot(a, b):
    """Sum of the products of two rows."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@kernel
def longest_step(left, slowest, stops, touch, d):
    """Length of the next step, at most `left`, and the highest power that its series need."""
    stiff, loss, singular = 0.0, 0.0, False
    for s in range(len(touch.state)):
        if touch.state[s] == FREE or stops.kinds[s] == RIGID:
            continue
        if stops.kinds[s] == PIECES:
            stiff += stops.laws[s, touch.state[s], 2]
        elif stops.kinds[s] == DAMPED:
            stiff += stops.laws[s, 0, 0]
            loss += stops.laws[s, 0, 1]
        elif touch.state[s] == 1:
            singular = True
            deep = max(d[s, 0], touch.depth[s])
            if stops.kinds[s] == FUNCTION:
                stiff += (
                    rate_of(stops.functions, s, stops.numbers, s, deep, touch.speed[s], 0.0) ** 2
                )
            else:
                stiff += 1.5 * stops.laws[s, 0, 0] * math.sqrt(2.0 * deep)
            if touch.speed[s] != 0.0:
                left = min(left, APPROACH * deep / abs(touch.speed[s]))
    rate = slowest + math.sqrt(stiff) + loss
    span = min(left, ANGLE / rate) if rate > 0.0 else left
    return span, (MOST_TERMS if singular else terms_for(span * rate))


@kernel
def hold(power, state, stops, series):
    """Take from the accelerations what the rigid stops do not let pass on which the mass rests."""
    held = np.empty(len(state), np.int64)
    count = 0
    for s in range(len(state)):
        if stops.kinds[s] == RIGID and state[s] == 0:
            held[count] = s
            count += 1
    # reactions on directions that are made orthogonal, then on those of the stops themselves
    a = series.a[power]
    n = len(a)
    rows, sizes = np.empty((count, n)), np.empty(count)
    mixed, found = np.zeros((count, count)), np.empty(count)
    for row in range(count):
        for i in range(n):
            rows[row, i] = stops.gaps[held[row], i]
        for other in range(row):
            mixed[row, other] = dot(rows[row], rows[other]) / sizes[other]
            for i in range(n):
                rows[row, i] -= mixed[row, other] * rows[other, i]
        sizes[row] = dot(rows[row], rows[row])
        found[row] = dot(rows[row], a) / sizes[row]
        for i in range(n):
            a[i] -= found[row] * rows[row, i]
    for row in range(count - 1, -1, -1):
        for later in range(row + 1, count):
            found[row] -= mixed[later, row] * found[later]
        s = held[row]
        series.f[s, power] = stops.sides[s] * found[row] * stops.levers[s]


@kernel
def expand(last, force, slope, structure, stops, state, series):
    """Coefficients up to `last` (accelerations) from q, q', d and d' in those of powers 0 and 1."""
    n, m = series.x.shape[1], len(state)
    resting = False
    for s in range(m):
        resting = resting or (stops.kinds[s] == RIGID and state[s] == 0)
    for power in range(last + 1):
        a = series.a[power]
        for i in range(n):
            total = force[i] if power == 0 else slope[i] if power == 1 else 0.0
            total -= structure.squares[i] * series.x[power, i]
            for j in range(n):
                total -= structure.damping[i, j] * (power + 1) * series.x[power + 1, j]
            a[i] = total
        for s in range(m):
            kind, law, f = stops.kinds[s], stops.laws[s], 0.0
            if state[s] != FREE and kind != RIGID:
                if kind == PIECES:
                    start, push, stiffness = law[state[s]]
                    f = stiffness * series.d[s, power]
                    if power == 0:
                        f += push - stiffness * start
                elif kind == DAMPED:
                    f = law[0, 0] * series.d[s, power]
                    f += law[0, 1] * (power + 1) * series.d[s, power + 1]
                elif kind == HERTZ and state[s] == 1:
                    f = three_halves(series.d[s], series.f[s], power)
                elif kind == FUNCTION and state[s] == 1:
                    f = series.f[s, power]
            series.f[s, power] = f
            if kind == HERTZ:
                f *= law[0, 0]
            if f != 0.0 and not (kind == DAMPED and state[s] == 1):
                for i in range(n):
                    a[i] -= stops.sides[s] * f * stops.gaps[s, i] / stops.levers[s]
        if resting:
            hold(power, state, stops, series)
        for i in range(n):
            series.x[power + 2, i] = a[i] / ((power + 1) * (power + 2))
        for s in range(m):
            d = 0.0
            for i in range(n):
                d += stops.gaps[s, i] * series.x[power + 2, i]
            series.d[s, power + 2] = stops.sides[s] * d


@kernel
def expand_with_functions(span, last, force, slope, structure, stops, state, series):
    """`expand` for a step in which forces may be functions of deflection and rate.

    Each round takes the motion with the forces of the round before, and gives the polynomials
    through the new forces: Picard's iteration, whose error falls faster than any geometric one.
    """
    waiting = False
    for s in range(len(state)):
        if stops.kinds[s] == FUNCTION and state[s] == 1:
            waiting = True
            for power in range(last + 1):
                series.f[s, power] = 0.0
            series.f[s, 0] = max(
                force_of(
                    stops.functions, s, stops.numbers, s, series.d[s, 0], series.d[s, 1]
                ),
                0.0,
            )  # fmt: skip
    expand(last, force, slope, structure, stops, state, series)
    values, before = np.zeros((2, len(state), len(NODES)))
    for _ in range(MOST_ROUNDS if waiting else 0):
        change = size = 0.0
        for s in range(len(state)):
            if stops.kinds[s] != FUNCTION or state[s] != 1:
                continue
            for node in range(len(NODES)):
                t, y, v = NODES[node] * span, 0.0, 0.0
                for power in range(last + 2, 0, -1):
                    y, v = (y + series.d[s, power]) * t, v * t + power * series.d[s, power]
                push = force_of(stops.functions, s, stops.numbers, s, series.d[s, 0] + y, v)
                values[s, node] = max(push, 0.0)
                change = max(change, abs(values[s, node] - before[s, node]))
                size = max(size, values[s, node])
                before[s, node] = values[s, node]
            unit = 1.0
            for power in range(len(NODES)):
                series.f[s, power] = dot(FROM_VALUES[power], values[s]) / unit
                unit *= span
        expand(last, force, slope, structure, stops, state, series)
        if change <= AGREEMENT * size:
            break


@kernel
def next_change(span, last, stops, touch, series, scratch):
    """Time, stop and way (0: back, towards free; 1: on, further in) of the first change of state
    within a step; a time of -1 where there is none."""
    when, which, way = -1.0, -1, 0
    for s in range(len(touch.state)):
        kind, d, f = stops.kinds[s], series.d[s], series.f[s]
        for direction in range(2):
            offset = 0.0
            if direction == 1:
                if touch.state[s] == FREE:
                    sign, source = 1.0, d
                elif kind == PIECES and touch.state[s] + 1 < stops.laws.shape[1]:
                    sign, source = 1.0, d
                    offset = -stops.laws[s, touch.state[s] + 1, 0]
                elif kind == DAMPED and touch.state[s] == 1:
                    sign, source = 1.0, f
                elif kind >= HERTZ and touch.state[s] == 0:
                    sign, source = 1.0, d
                    offset = -touch.depth[s]
                else:
                    continue
            elif touch.state[s] == FREE:
                continue
            elif kind == RIGID or (kind == DAMPED and touch.state[s] == 0):
                sign, source = -1.0, f
            else:
                sign, source = -1.0, d
                if kind == PIECES:
                    offset = stops.laws[s, touch.state[s], 0]
                elif kind >= HERTZ and touch.state[s] == 1:
                    offset = touch.depth[s]
            for k in range(last + 1):
                scratch.p[0, k] = sign * source[k]
            scratch.p[0, 0] += offset
            if kind == RIGID and touch.state[s] == 0 and scratch.p[0, 0] > 0.0:
                time = 0.0
            else:
                time = first_rise(scratch.p, touch.zeros[s, direction], last, span, scratch.found)
            if time >= 0.0 and (when < 0.0 or time < when):
                when, which, way = time, s, direction
    return when, which, way


@kernel
def push_on(r, structure, stops, force, moving):
    """Acceleration onto stop r of a motion that the stop does not hold."""
    q, v = moving
    push = 0.0
    for i in range(len(q)):
        a = force[i] - structure.squares[i] * q[i] - dot(structure.damping[i], v)
        push += stops.sides[r] * stops.gaps[r, i] * a
    return push


@kernel
def take_off(r, speed, stops, v):
    """Take a speed onto stop r off the velocities, by an impulse of the stop."""
    for i in range(len(v)):
        v[i] -= stops.sides[r] * speed / stops.levers[r] * stops.gaps[r, i]


@kernel
def strike(s, structure, stops, touch, force, tick, moving):
    """An impact on rigid stop s, and on those at which it throws a mass that rested on them."""
    v = moving.v
    moved = True
    for attempt in range(MOST_PASSES):
        for r in range(len(touch.state)):
            if stops.kinds[r] != RIGID or not (r == s or touch.state[r] == 0):
                continue
            speed = stops.sides[r] * dot(stops.gaps[r], v)
            if r != s:
                if 2.0 * abs(speed) <= tick * push_on(r, structure, stops, force, moving):
                    take_off(r, speed, stops, v)  # back within a tick: rounding moved it
                    continue
                if speed <= 0.0:
                    if speed < 0.0:  # pulled off by the impact on another stop
                        touch.state[r] = FREE
                        touch.zeros[r, 1] = 1
                    continue
            if r == s and attempt > 0 and speed <= 0.0:
                continue
            restitution = stops.laws[r, 0, 0]
            speed = max(speed, 0.0)
            rebound = restitution * speed
            if stops.asked[r]:
                uniform = uniform_of(touch.draws[0], touch.draws[1])
                touch.draws[1] += np.uint64(1)
                rebound = rebound_of(stops.functions, r, stops.numbers, r, speed, uniform)
            take_off(r, speed + rebound, stops, v)
            push = push_on(r, structure, stops, force, moving)
            ends = push > 0.0 and 2.0 * rebound <= tick * push * (1.0 - restitution)
            rests = ends or (rebound == 0.0 and push >= 0.0) or attempt == MOST_PASSES - 1
            if rests:
                touch.tally[r, RESTS] += 1.0 if touch.state[r] != 0 else 0.0
                take_off(r, -rebound, stops, v)
            touch.state[r] = 0 if rests else FREE
            touch.zeros[r, 0] = 0
            touch.zeros[r, 1] = 1 if rebound > 0.0 else 2
            moved = True
        if not moved:
            break
        moved = False


@kernel
def add_coordinates(last, span, base, rate, structure, series, extremes, scratch):
    """Add a step to the extremes of the coordinates; `base` (c,) is what is added to their
    accelerations at its begin, and `rate` how fast that grows."""
    p, found = scratch
    for j in range(len(extremes)):
        for power in range(last + 1):
            p[0, power] = dot(structure.shapes[j], series.a[power])
        p[0, 0] += base[j]
        p[0, 1] += rate[j]
        known = extremes[j, ACCELERATION]
        low, high = widened(p, last, span, found, -known, known)
        extremes[j, ACCELERATION] = max(-low, high)
        for power in range(last + 1):
            p[0, power] = dot(structure.shapes[j], series.x[power])
        extremes[j, LOWEST], extremes[j, HIGHEST] = widened(
            p, last, span, found, extremes[j, LOWEST], extremes[j, HIGHEST]
        )


@kernel
def force_at(t, s, last, stops, series):
    """Force of a stop that is a function at the time t of a step, before it is cut off at 0."""
    d, rate = 0.0, 0.0
    for power in range(last, -1, -1):
        rate = rate * t + d
        d = d * t + series.d[s, power]
    return force_of(stops.functions, s, stops.numbers, s, d, rate)


@kernel
def time_of_push(s, last, span, stops, series):
    """How long a stop that is a function pushes in a step, s; that may end, or begin, once."""
    low, high = 0.0, span
    pushes = force_at(low, s, last, stops, series) > 0.0
    if (force_at(high, s, last, stops, series) > 0.0) == pushes:
        return span if pushes else 0.0
    for _ in range(MOST_STEPS):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if (force_at(middle, s, last, stops, series) > 0.0) == pushes:
            low = middle
        else:
            high = middle
    return high if pushes else span - high


@kernel
def work_of(s, last, span, stops, series):
    """Work of the force of a stop in a step, per reduced mass."""
    total, powers = 0.0, 1.0
    factor = stops.laws[s, 0, 0] if stops.kinds[s] == HERTZ else 1.0
    for power in range(2 * last + 1):
        powers *= span
        term = 0.0
        for k in range(max(0, power - last), min(power, last) + 1):
            term += series.f[s, k] * (power - k + 1) * series.d[s, power - k + 1]
        total += term * powers / (power + 1)
    return factor * total


@kernel
def add_contacts(last, span, stops, touch, series, log, scratch):
    """Add a step to the times in contact, the work and the peak forces of contacts."""
    p, found = scratch
    for s in range(len(touch.state)):
        if touch.state[s] == FREE:
            continue
        if stops.kinds[s] == DAMPED and touch.state[s] == 1:
            continue  # beyond the stop, which does not push: the contact has ended
        pushing = span
        if stops.kinds[s] == FUNCTION and touch.state[s] == 1:
            pushing = time_of_push(s, last, span, stops, series)
        touch.tally[s, CONTACT] += pushing
        if stops.kinds[s] == RIGID:
            continue
        touch.tally[s, LOST] += work_of(s, last, span, stops, series)
        entry = touch.entry[s]
        if entry >= 0:
            factor = stops.laws[s, 0, 0] if stops.kinds[s] == HERTZ else 1.0
            for power in range(last + 1):
                p[0, power] = factor * series.f[s, power]
            log[entry, PEAK] = widened(p, last, span, found, 0.0, log[entry, PEAK])[1]


@kernel
def touch_first(structure, stops, touch, force, tick, moving):
    """Let a mass that starts on a stop, or beyond one, touch it from the start."""
    for s in range(len(touch.state)):
        d = stops.sides[s] * (dot(stops.gaps[s], moving.q) - stops.places[s])
        if d < 0.0:
            continue
        if stops.kinds[s] == RIGID:
            strike(s, structure, stops, touch, force, tick, moving)
        elif stops.kinds[s] == PIECES:
            touch.state[s] = 0
            while (
                touch.state[s] + 1 < stops.laws.shape[1]
                and d >= stops.laws[s, touch.state[s] + 1, 0]
            ):
                touch.state[s] += 1
        elif stops.kinds[s] >= HERTZ:
            touch.state[s] = 1
            touch.depth[s] = SHALLOW * d
        else:
            touch.state[s] = 0


@kernel
def march(samples, structure, stops, limits, moving, touch, course):
    """March through the samples, for some steps at a time.

    Parameters
    ----------
    samples
        What shakes the structure.
    structure, stops
        What moves, and what it can hit.
    limits
        Where chatter ends, and where the integration does.
    moving, touch, course
        Where the march is, which is gone on from; and what it has found.

    Returns
    -------
    int
        Status.
    """
    step, forces, base = samples
    tick, most_impacts, most_steps = limits
    counts, log, extremes = course.counts, course.log, course.extremes
    number, n = forces.shape
    m, c = len(stops.sides), len(structure.shapes)
    keep = len(course.x) > 0
    q, v = moving
    state, zeros, depth, entry, speed, _, _ = touch
    powers = MOST_TERMS + 4
    series = Series(
        np.zeros((powers, n)), np.zeros((powers, n)), np.zeros((m, powers)), np.zeros((m, powers))
    )
    scratch = Scratch(np.zeros((4, powers)), np.zeros(4))
    force, slope = np.zeros(n), np.zeros(n)
    slowest = 0.0
    for i in range(n):
        damping = 0.0
        for j in range(n):
            damping += abs(structure.damping[i, j])
        slowest = max(slowest, math.sqrt(structure.squares[i]) + damping)

    if counts[BEGUN] == 0:
        counts[BEGUN] = 1
        touch_first(structure, stops, touch, forces[0], tick, moving)
        for j in range(c):
            extremes[j, HIGHEST] = extremes[j, LOWEST] = dot(structure.shapes[j], q)
    base_rate, begin = np.empty(c), np.empty(c)
    steps = 0
    for k in range(counts[SAMPLE], number):
        following = min(k + 1, number - 1)
        for i in range(n):
            slope[i] = (forces[following, i] - forces[k, i]) / step
        for j in range(c):
            base_rate[j] = (base[following, j] - base[k, j]) / step
        passed = course.passed[0]
        while passed < step:
            if steps == most_steps or counts[LOGGED] == len(log):
                counts[SAMPLE], course.passed[0] = k, passed
                return PAUSED if steps == most_steps else FULL
            steps += 1
            for i in range(n):
                series.x[0, i], series.x[1, i] = q[i], v[i]
                force[i] = forces[k, i] + passed * slope[i]
            for s in range(m):
                place, rate = 0.0, 0.0
                for i in range(n):
                    place += stops.gaps[s, i] * q[i]
                    rate += stops.gaps[s, i] * v[i]
                series.d[s, 0] = stops.sides[s] * (place - stops.places[s])
                series.d[s, 1] = speed[s] = stops.sides[s] * rate
                if stops.kinds[s] >= HERTZ and state[s] == 1:
                    series.d[s, 0] = max(series.d[s, 0], depth[s])
            left = step - passed
            span, last = longest_step(left, slowest, stops, touch, series.d)
            expand_with_functions(span, last, force, slope, structure, stops, state, series)
            if counts[KEPT] == 0:
                counts[KEPT] = 1
                for j in range(c):
                    x, power = 0.0, 1.0
                    for i in range(n):
                        x += structure.shapes[j, i] * q[i]
                    for order in range(4):
                        power *= x
                        course.powers[j, order] += power
                    if keep:
                        course.x[k, j] = x
                        course.v[k, j] = dot(structure.shapes[j], v)
                        course.a[k, j] = base[k, j] + dot(structure.shapes[j], series.a[0])
                if keep:
                    for s in range(m):
                        if not (stops.kinds[s] == DAMPED and state[s] == 1):
                            factor = stops.laws[s, 0, 0] if stops.kinds[s] == HERTZ else 1.0
                            course.push[k, s] = factor * series.f[s, 0]
            if k == number - 1:
                return DONE

            when, which, way = next_change(span, last, stops, touch, series, scratch)
            taken = span if when < 0.0 else when

            for j in range(c):
                begin[j] = base[k, j] + passed * base_rate[j]
            add_coordinates(last, taken, begin, base_rate, structure, series, extremes, scratch)
            add_contacts(last, taken, stops, touch, series, log, scratch)

            # the end of the step
            for i in range(n):
                position, velocity = 0.0, 0.0
                for power in range(last + 2, 0, -1):
                    position = (position + series.x[power, i]) * taken
                    velocity = velocity * taken + power * series.x[power, i]
                q[i], v[i] = series.x[0, i] + position, velocity
            if taken > 0.0:
                for s in range(m):
                    zeros[s, 0] = zeros[s, 1] = 0
            passed = step if taken == left else passed + taken
            if when < 0.0:
                continue
            counts[CHANGES] += 1
            s = which
            zeros[s, 0] = zeros[s, 1] = 0
            kind = stops.kinds[s]
            for i in range(n):
                force[i] = forces[k, i] + passed * slope[i]
            if state[s] == FREE:
                rate = stops.sides[s] * dot(stops.gaps[s], v)
                logged = counts[LOGGED]
                log[logged, TIME] = k * step + passed
                log[logged, STOP], log[logged, SPEED], log[logged, PEAK] = s, rate, 0.0
                entry[s] = logged
                counts[LOGGED] += 1
                if kind == RIGID:
                    # the mass is on the stop, without the rounding of the time of the impact
                    off = dot(stops.gaps[s], q) - stops.places[s]
                    for i in range(n):
                        q[i] -= off * stops.gaps[s, i] / stops.levers[s]
                    strike(s, structure, stops, touch, force, tick, moving)
                else:
                    state[s] = 0
                    if kind != DAMPED:
                        zeros[s, 0] = 1
                    push = abs(dot(stops.gaps[s], series.a[0]))
                    if kind == FUNCTION:
                        fast = rate_of(stops.functions, s, stops.numbers, s, 0.0, rate, push)
                        depth[s] = SHALLOW * max(rate / fast, push / fast**2)
                    elif kind == HERTZ:
                        k_hertz = stops.laws[s, 0, 0]
                        deepest = max(
                            (1.25 * rate**2 / k_hertz) ** 0.4, (push / k_hertz) ** (2.0 / 3.0)
                        )
                        depth[s] = SHALLOW * deepest
            elif kind == RIGID:
                state[s] = FREE
                zeros[s, 1] = 2
            elif way == 1:
                state[s] += 1 if kind != DAMPED else -1
                zeros[s, 0] = 1
            elif kind == DAMPED and state[s] == 0:
                state[s] = 1
                zeros[s, 1] = 1
            else:
                state[s] = FREE if kind == DAMPED else state[s] - 1
                zeros[s, 1] = 1
            if counts[LOGGED] > most_impacts or counts[CHANGES] > MOST_CHANGES:
                return TOO_MANY
        course.passed[0] = 0.0
        counts[KEPT] = counts[CHANGES] = 0
    return DONE
