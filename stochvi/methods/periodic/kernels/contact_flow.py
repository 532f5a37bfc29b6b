"""Flow of a structure with compliant stops. Chapters: Hertz's law by power series; stops of
straight pieces or with a damper."""

import math
from typing import NamedTuple

import numpy as np

from stochvi.engine.compiling import kernel
from stochvi.methods.periodic.kernels.solver import (
    ANGLE,
    MOST_IMPACTS,
    NORM,
    TERMS,
    Motion,
    acceleration_row,
    distance_of,
    dot,
    expand,
    first_rise,
    force_state,
    identity,
    multiply,
    output_of,
    put,
    rate,
    root_between,
    strike,
    sum_terms,
    swing,
    times_generator,
    transition,
    value_at,
)

# ------------------------------------------------------------------------------
# Flow while a stop of Hertz's law presses, in a time of its own in which all is a power series.
#
# The force h d^(3/2) of a depth d = e^2 is h e^3. With dt = e dtau, the state z, the generator G of
# the motion without that force, and v = d' = row . q',
#
#     de/dtau = v / 2,    dz/dtau = e (G z - h e^3 row),    dt/dtau = e
#
# are polynomials, also where contact begins and ends, e = 0: there the series in t itself have no
# sixth derivative. Where several such stops press, the pace dt/dtau is the product of their roots
# e.
#
# Symbols as below; k is the order of a coefficient.
# ------------------------------------------------------------------------------


SERIES_END = 1e-16
"""Size of the last terms of a series at the end of a step, in the units of the kernels: motions are
of order one."""

FAINT = 1e-30
"""Root of the depth at which contact begins: at 0, a motion that arrives without any speed would
stay there for ever."""


class Contacts(NamedTuple):
    """How the stops are touched: their states (m,), and the roots of depths (m,) in stops of
    Hertz's law that press, 1 of every other stop."""

    states: np.ndarray
    roots: np.ndarray


class Curves(NamedTuple):
    """Taylor coefficients of a motion; in tau while a stop of Hertz's law presses, else in t, and
    then of the state alone.

    Parameters
    ----------
    terms : (TERMS, N), of the state.
    bends : (m, TERMS), of the roots of the depths, 1 of every stop that does not press.
    pace, clock : (TERMS,), of the pace dt/dtau and of the time.
    """

    terms: np.ndarray
    bends: np.ndarray
    pace: np.ndarray
    clock: np.ndarray


@kernel
def presses(hertz, states, stop):
    """Whether a stop is one of Hertz's law, and presses."""
    return hertz[stop] > 0.0 and states[stop] >= 0


@kernel
def any_presses(hertz, states):
    """Whether any stop of Hertz's law presses."""
    found = False
    for s in range(len(states)):
        found = found or presses(hertz, states, s)
    return found


@kernel
def product(a, b, k):
    """Coefficient k of the product of two series."""
    total = 0.0
    for j in range(k + 1):
        total += a[j] * b[k - j]
    return total


@kernel
def curve(now, hertz, contacts, z, curves):
    """Write the coefficients in tau of the motion from a state."""
    states, roots = contacts
    terms, bends, pace, clock = curves
    m, n = now.rows.shape
    size = len(now.generator)
    # products of the roots: of the stops before a stop, and from it on
    until, onwards = np.zeros((m + 1, TERMS)), np.zeros((m + 1, TERMS))
    until[0, 0], onwards[m, 0] = 1.0, 1.0
    squares, others = np.zeros((m, TERMS)), np.zeros((m, TERMS))
    speeds, rates = np.zeros((m, TERMS)), np.zeros((size, TERMS))
    for s in range(m):
        for k in range(TERMS):
            bends[s, k] = 0.0
        bends[s, 0] = roots[s]
    put(z, terms[0])
    clock[0] = 0.0
    for k in range(TERMS):
        for s in range(m):
            until[s + 1, k] = product(until[s], bends[s], k)
        for s in range(m - 1, -1, -1):
            onwards[s, k] = product(bends[s], onwards[s + 1], k)
        pace[k] = until[m, k]
        if k == TERMS - 1:
            break
        clock[k + 1] = pace[k] / (k + 1)
        for i in range(size):
            for j in range(size):
                rates[i, k] += now.generator[i, j] * terms[k, j]
        for s in range(m):
            if not presses(hertz, states, s):
                continue
            squares[s, k] = product(bends[s], bends[s], k)
            push = hertz[s] * product(squares[s], bends[s], k)
            for i in range(n):
                rates[n + i, k] -= push * now.rows[s, i]
                speeds[s, k] += now.rows[s, i] * terms[k, n + i]
            others[s, k] = product(until[s], onwards[s + 1], k)
            bends[s, k + 1] = 0.5 * product(others[s], speeds[s], k) / (k + 1)
        for i in range(size):
            terms[k + 1, i] = product(pace, rates[i], k) / (k + 1)


@kernel
def curved_step(curves, left):
    """The longest step of tau in which the series converge, at most to the end of the time left."""
    terms, bends, clock = curves.terms, curves.bends, curves.clock
    step = np.inf
    for k in range(TERMS - 2, TERMS):
        largest = 0.0
        for i in range(terms.shape[1]):
            largest = max(largest, abs(terms[k, i]))
        for s in range(len(bends)):
            largest = max(largest, abs(bends[s, k]))
        step = min(step, (SERIES_END / max(largest, 1e-300)) ** (1.0 / k))
    if value_at(clock, step) <= left:
        return step
    ahead = np.empty(TERMS)
    put(clock, ahead)
    ahead[0] = -left
    return root_between(ahead, 0.0, step, False)


@kernel
def turn_curved(now, hertz, contacts, curves, step, perturbations):
    """Take small perturbations (2 n, number) of the state at one time, in their place, over a step
    of tau."""
    states, bends, pace = contacts.states, curves.bends, curves.pace
    m, n = now.rows.shape
    two = 2 * n
    terms, out = np.empty((TERMS, two)), np.empty(two)
    for column in range(perturbations.shape[1]):
        rates, depths = np.zeros((two, TERMS)), np.zeros((m, TERMS))
        put(perturbations[:, column], terms[0])
        for k in range(TERMS - 1):
            for i in range(two):
                for j in range(two):
                    rates[i, k] += now.generator[i, j] * terms[k, j]
            for s in range(m):
                if not presses(hertz, states, s):
                    continue
                for i in range(n):
                    depths[s, k] += now.rows[s, i] * terms[k, i]
                push = 1.5 * hertz[s] * product(bends[s], depths[s], k)
                for i in range(n):
                    rates[n + i, k] -= push * now.rows[s, i]
            for i in range(two):
                terms[k + 1, i] = product(pace, rates[i], k) / (k + 1)
        sum_terms(terms, step, out)
        for i in range(two):
            perturbations[i, column] = out[i]


@kernel
def add_forces(now, hertz, contacts, rates):
    """Add what stops of Hertz's law press to the rates (2 n,) of a state."""
    states, roots = contacts
    m, n = now.rows.shape
    for s in range(m):
        if presses(hertz, states, s):
            for i in range(n):
                rates[n + i] -= hertz[s] * roots[s] ** 3 * now.rows[s, i]


@kernel
def added_acceleration(now, hertz, contacts, z, pull):
    """Contribution of stops of Hertz's law to the acceleration of the output, and to its rate by
    time."""
    states, roots = contacts
    m, n = now.rows.shape
    value, slope = 0.0, 0.0
    for s in range(m):
        if not presses(hertz, states, s):
            continue
        along, pushed, speed = 0.0, 0.0, 0.0
        for i in range(n):
            along += now.output[i] * now.rows[s, i]
            pushed += pull[n + i] * now.rows[s, i]
            speed += now.rows[s, i] * z[n + i]
        value -= hertz[s] * roots[s] ** 3 * along
        slope -= hertz[s] * roots[s] * (roots[s] ** 2 * pushed + 1.5 * speed * along)
    return value, slope


# ------------------------------------------------------------------------------
# Flow of a structure with compliant stops: linear between the events of each contact.
#
# The force of a stop is made of straight pieces over the depth d = row . q - position > 0: in piece
# p it is f_p + k_p (d - b_p), and q'' changes by minus that times the row. It passes from piece to
# piece at b_p, and contact ends at d = 0. A stop with a damper has one piece, k d + c d' where that
# is positive: contact ends at zero force, before d is 0 again, and the stop follows without a
# force. Entering it the force jumps from 0 to c d'; everywhere else it is continuous, and so are
# perturbations. Stops of Hertz's law are above; rigid ones may stand beside, as in `solver`.
#
# Symbols as in `solver`.
# ------------------------------------------------------------------------------


AWAY, FOLLOWING = -1, -2
"""States of a stop: the gap is open; the mass is beyond it, and it follows without a force. Where
it presses the state is the number of the piece, from 0 on."""

TOUCHED = 1e-12
"""Size of a quantity, relative to its largest Taylor term in a step, up to which it is 0 at an
event of its own stop."""


class Laws(NamedTuple):
    """The stops.

    Parameters
    ----------
    counts : (m,), number of straight pieces of the force, 0 of a rigid stop.
    pieces : (m, most, 3), depth b and force f at which each piece begins, and its slope k.
    dampers : (m,), coefficient c of the damper.
    hertz : (m,), coefficient h of Hertz's law, 0 of a stop of another law.
    """

    counts: np.ndarray
    pieces: np.ndarray
    dampers: np.ndarray
    hertz: np.ndarray


class Record(NamedTuple):
    """Record of a motion.

    Parameters
    ----------
    ends : (periods + 1, 2 n), the state at the start and after each period.
    log : (most, 3 + 2 n), phase, stop, speed and state of each contact that begins; the last ones
        in place of the first where they are too many.
    factors : (2 n, 2 n), the factors of small perturbations; (0, 0) where they are not asked for.
    """

    ends: np.ndarray
    log: np.ndarray
    factors: np.ndarray


@kernel
def linear_motion(motion, laws, states):
    """The linear motion between two events, for the states of the stops. Returns the motion with
    the springs and dampers of the stops that press, its longest step, and its matrix over that
    step. The last two are rows: their products with a state are the absolute acceleration of the
    output and its rate.
    """
    now = pressed(motion, laws, states)
    part = step_between(now)
    pull = acceleration_row(now, now.generator)
    return now, part, transition(now.generator, part), pull, times_generator(pull, now.generator)


@kernel
def pressed(motion, laws, states):
    """The motion with the springs and dampers of the stops that press."""
    n, size = motion.rows.shape[1], len(motion.generator)
    g = np.empty((size, size))
    for i in range(size):
        put(motion.generator[i], g[i])
    for s in range(len(states)):
        if states[s] < 0:
            continue
        piece = laws.pieces[s, states[s]]
        b, f, k = piece[0], piece[1], piece[2]
        c = laws.dampers[s]
        for i in range(n):
            push = motion.rows[s, i]
            for j in range(n):
                g[n + i, j] -= k * push * motion.rows[s, j]
                g[n + i, n + j] -= c * push * motion.rows[s, j]
            g[n + i, size - 1] -= (f - k * (b + motion.positions[s])) * push
    return Motion(
        g, motion.rows, motion.positions, motion.restitutions, motion.omega, motion.output,
        motion.base,
    )  # fmt: skip


@kernel
def step_between(now):
    """The longest step in which no distance turns twice and the series converge: speeds are taken
    in units of the fastest frequency, which a stiff stop raises."""
    n = now.rows.shape[1]
    h = (len(now.generator) - 2 * n - 1) // 2
    stiffness, damping = 0.0, 0.0
    for i in range(n):
        stiff, damped = 0.0, 0.0
        for j in range(n):
            stiff += abs(now.generator[n + i, j])
            damped += abs(now.generator[n + i, n + j])
        stiffness, damping = max(stiffness, stiff), max(damping, damped)
    fastest = max(max(h, 1) * now.omega, math.sqrt(stiffness))
    return min(ANGLE / fastest, NORM / (fastest + damping))


@kernel
def first_states(motion, laws, contacts, z):
    """Set the contacts at the state of a motion."""
    states, roots = contacts
    for s in range(len(states)):
        deep, speed = distance_of(motion, s, z)
        states[s], roots[s] = AWAY, 1.0
        if laws.counts[s] == 0 or deep <= 0.0:
            continue
        states[s] = 0
        while states[s] + 1 < laws.counts[s] and laws.pieces[s, states[s] + 1, 0] < deep:
            states[s] += 1
        if laws.pieces[s, 0, 2] * deep + laws.dampers[s] * speed < 0.0:
            states[s] = FOLLOWING
        if laws.hertz[s] > 0.0:
            roots[s] = math.sqrt(deep)


@kernel
def first_rise_after(series, length, own):
    """The first time in [0, length] at which a series is above 0, after one at which it is 0 if
    the last event was its own; -1 where none."""
    largest, power = 0.0, 1.0
    for t in range(TERMS):
        largest = max(largest, abs(series[t]) * power)
        power *= length
    if series[0] > 0.0 or (own and series[0] > -TOUCHED * largest):
        return first_rise(series[1:], length)
    return first_rise(series, length)


@kernel
def next_event(motion, laws, states, curves, length, touched):
    """Time of the next event, -1 where there is none, its stop, and the state that follows."""
    terms, n = curves.terms, motion.rows.shape[1]
    depth, series = np.empty(TERMS), np.empty(TERMS)
    at, stop, following = -1.0, -1, AWAY
    for s in range(len(states)):
        state, c = states[s], laws.dampers[s]
        for t in range(TERMS):
            depth[t] = 0.0
            for i in range(n):
                depth[t] += motion.rows[s, i] * terms[t, i]
        depth[0] -= motion.positions[s]
        for up in range(2):
            if state == AWAY and up == 0:
                # touched
                put_line(depth, 1.0, 0.0, series)
                after = 0
            elif state == FOLLOWING and up == 0:
                # the gap opens
                put_line(depth, -1.0, 0.0, series)
                after = AWAY
            elif c > 0.0 and up == (0 if state >= 0 else 1) and state != AWAY:
                # pressing ends without force, or begins again
                sign, k = (-1.0 if state >= 0 else 1.0), laws.pieces[s, 0, 2]
                put_line(depth, sign * k, 0.0, series)
                for t in range(TERMS):
                    for i in range(n):
                        series[t] += sign * c * motion.rows[s, i] * terms[t, n + i]
                after = FOLLOWING if state >= 0 else 0
            elif c == 0.0 and state >= 0 and up == 0:
                # the piece before, or the end of contact
                put_line(depth, -1.0, laws.pieces[s, state, 0], series)
                if presses(laws.hertz, states, s):
                    put_line(curves.bends[s], -1.0, 0.0, series)
                after = state - 1
            elif c == 0.0 and 0 <= state < laws.counts[s] - 1 and up == 1:
                put_line(depth, 1.0, -laws.pieces[s, state + 1, 0], series)
                after = state + 1
            else:
                continue
            found = first_rise_after(series, length, s == touched)
            if found >= 0.0 and (stop < 0 or found < at):
                at, stop, following = found, s, after
    return at, stop, following


@kernel
def put_line(series, factor, constant, out):
    """out = factor * series + constant."""
    for t in range(TERMS):
        out[t] = factor * series[t]
    out[0] += constant


@kernel
def rates_of(now, hertz, contacts, z, out):
    """(q', q'') of a state, with the forces of all stops."""
    rate(now, z, out)
    add_forces(now, hertz, contacts, out)


@kernel
def acceleration_of(now, hertz, contacts, z, pull, slope):
    """Absolute acceleration of the output, and its rate by time."""
    value, change = dot(pull, z), dot(slope, z)
    more, faster = added_acceleration(now, hertz, contacts, z, pull)
    return value + more, change + faster


@kernel
def pace_of(roots):
    """dt / dtau: 1 where no stop of Hertz's law presses."""
    pace = 1.0
    for s in range(len(roots)):
        pace *= roots[s]
    return pace


@kernel
def flow(motion, laws, start, phase, record):
    """Follow a motion over whole periods of the force from a phase of it.

    Returns the number of contacts, or -1 where events come too fast to be followed. Then come the
    largest displacement and acceleration of the output, and the amplitude of its first harmonic.
    """
    ends, log, factors = record
    hertz, periods, with_factors = laws.hertz, len(ends) - 1, len(factors) > 0
    n, m = motion.rows.shape[1], len(motion.positions)
    two, size = 2 * n, len(motion.generator)
    z, fresh = np.empty(size), np.empty(size)
    contacts = Contacts(np.zeros(m, np.int64), np.empty(m))
    states, roots = contacts
    before, after, other = np.empty(two), np.empty(two), np.empty((two, two))
    salt, grown = np.empty((two, two)), identity(two)
    curves = Curves(np.empty((TERMS, size)), np.empty((m, TERMS)), np.empty(TERMS), np.empty(TERMS))
    terms, bends, clock = curves.terms, curves.bends, curves.clock
    put(start, z[:two])
    put(start, ends[0])
    first_states(motion, laws, contacts, z)
    now, part, matrix, pull, slope = linear_motion(motion, laws, states)
    most = MOST_IMPACTS * (1 + laws.pieces.shape[1])
    # stated types: numba would compile `next_event` once more for the literal -1
    touched, hits, displacement, acceleration = np.int64(-1), 0, 0.0, 0.0
    even, odd = 0.0, 0.0
    for period in range(periods):
        events = 0
        force_state(motion, phase, z[two:])
        left = 2.0 * math.pi / motion.omega
        while left > 0.0:
            curved = any_presses(hertz, states)
            if curved:
                curve(now, hertz, contacts, z, curves)
                step = curved_step(curves, left)
            else:
                expand(now.generator, z, terms)
                step = min(part, left)
            at, stop, following = next_event(motion, laws, states, curves, step, touched)
            length = at if stop >= 0 else step
            sum_terms(terms, length, fresh)
            place, moving = output_of(motion, z)
            place_, moving_ = output_of(motion, fresh)
            push, jerk = acceleration_of(now, hertz, contacts, z, pull, slope)
            pace, time = 1.0, length
            if curved:
                pace, time = pace_of(roots), value_at(clock, length)
                for s in range(m):
                    roots[s] = value_at(bends[s], length)
            pace_ = pace_of(roots)
            push_, jerk_ = acceleration_of(now, hertz, contacts, fresh, pull, slope)
            displacement = max(
                displacement, swing((place, place_), (pace * moving, pace_ * moving_), length)
            )
            acceleration = max(
                acceleration, swing((push, push_), (pace * jerk, pace_ * jerk_), length)
            )
            # cosine and sine of the force are states; each product by its values and slopes
            for number in range(2):
                wave, wave_ = z[two + number], fresh[two + number]
                turning = -motion.omega * z[two + 1] if number == 0 else motion.omega * z[two]
                turning_ = (
                    -motion.omega * fresh[two + 1] if number == 0 else motion.omega * fresh[two]
                )
                bend = moving * wave + place * turning - moving_ * wave_ - place_ * turning_
                part_ = 0.5 * time * (place * wave + place_ * wave_) + time**2 / 12.0 * bend
                if number == 0:
                    even += part_
                else:
                    odd += part_
            put(fresh, z)
            left -= time
            if left < 1e-13:
                left = 0.0
            if with_factors:
                if curved:
                    turn_curved(now, hertz, contacts, curves, length, grown)
                else:
                    known = length == part
                    whole = matrix if known else transition(now.generator, length)
                    multiply(whole[:two, :two], grown, other)
                    grown, other = other, grown
            if stop < 0:
                touched = -1
                continue
            touched = stop
            events += 1
            if events > most:
                return -1, displacement, acceleration, 0.0
            _, speed = distance_of(motion, stop, z)
            entering = states[stop] == AWAY
            rates_of(now, hertz, contacts, z, before)
            for j in range(two):
                for i in range(two):
                    salt[i, j] = 1.0 if i == j else 0.0
            if entering:
                slot = hits % len(log)
                log[slot, 0] = phase + 2.0 * math.pi * (period + 1) - motion.omega * left
                log[slot, 1], log[slot, 2] = stop, speed
                put(z[:two], log[slot, 3:])
                hits += 1
            rigid = laws.counts[stop] == 0
            if rigid:
                strike(motion, stop, z[:two])
                strike(motion, stop, before)
                for j in range(two):
                    strike(motion, stop, salt[:, j])
            else:
                states[stop] = following
                if hertz[stop] > 0.0:
                    roots[stop] = FAINT if following >= 0 else 1.0
                now, part, matrix, pull, slope = linear_motion(motion, laws, states)
            if with_factors and entering:
                rates_of(now, hertz, contacts, z, after)
                # a perturbed path enters at another moment, by the old and the new rates
                for i in range(two):
                    for j in range(n):
                        salt[i, j] += (after[i] - before[i]) * motion.rows[stop, j] / speed
                multiply(salt, grown, other)
                grown, other = other, grown
        put(z[:two], ends[period + 1])
    for i in range(len(factors)):
        put(grown[i], factors[i])
    amplitude = motion.omega / (math.pi * periods) * math.hypot(even, odd)
    return hits, displacement, acceleration, amplitude
