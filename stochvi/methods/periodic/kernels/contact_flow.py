"""Flow of a structure whose stops give way as springs and dampers do: linear in each contact.

A stop s presses with k d + c d', d = row . q - position, while d > 0 and that is positive; then
q'' changes by -(k d + c d') row. Contact ends at zero force, mostly before d is 0 again: the stop
follows without a force. Entering a stop with a damper, the force jumps from 0 to c d'; everywhere
else it is continuous, and so are disturbances. Rigid stops may stand beside, as in `solver`.

Symbols as in `solver`.
"""

import math

import numba
import numpy as np

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
    multiply,
    output_of,
    rate,
    strike,
    sum_terms,
    swing,
    transition,
)

AWAY, PRESSED, FOLLOWING = range(3)
"""States of a stop: the gap is open; it presses; the mass is beyond it, and it follows without a
force."""

TOUCHED = 1e-12
"""Size of a quantity, relative to its largest Taylor term in a step, up to which it is 0 at an
event of its own stop."""


@numba.njit(cache=True, error_model="numpy", nogil=True)
def pressed_generator(motion, laws, states):
    """The generator with the springs and dampers of the stops that press."""
    n, size = motion.rows.shape[1], len(motion.generator)
    g = motion.generator.copy()
    for s in range(len(states)):
        if states[s] != PRESSED:
            continue
        k, c = laws[s]
        for i in range(n):
            push = motion.rows[s, i]
            for j in range(n):
                g[n + i, j] -= k * push * motion.rows[s, j]
                g[n + i, n + j] -= c * push * motion.rows[s, j]
            g[n + i, size - 1] += k * push * motion.positions[s]
    return g


@numba.njit(cache=True, error_model="numpy", nogil=True)
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


@numba.njit(cache=True, error_model="numpy", nogil=True)
def first_states(motion, laws, z, states):
    """The state of each stop, from that of the motion."""
    for s in range(len(states)):
        deep, speed = distance_of(motion, s, z)
        states[s] = AWAY
        if laws[s, 0] > 0.0 and deep > 0.0:
            force = laws[s, 0] * deep + laws[s, 1] * speed
            states[s] = PRESSED if force > 0.0 else FOLLOWING


@numba.njit(cache=True, error_model="numpy", nogil=True)
def next_event(motion, laws, states, terms, time, touched):
    """Time of the next event, -1 where there is none, its stop, and the state that follows."""
    n = motion.rows.shape[1]
    depth, force = np.empty(TERMS), np.empty(TERMS)
    at, stop, following = -1.0, -1, AWAY
    for s in range(len(states)):
        k, c = laws[s]
        for t in range(TERMS):
            depth[t], force[t] = 0.0, 0.0
            for i in range(n):
                depth[t] += motion.rows[s, i] * terms[t, i]
                force[t] += motion.rows[s, i] * (k * terms[t, i] + c * terms[t, n + i])
        depth[0] -= motion.positions[s]
        force[0] -= k * motion.positions[s]
        for way in range(3):
            # away: touched; pressed: without force; following: away, or pressed again
            if states[s] == AWAY and way == 0:
                series, after = depth, PRESSED
            elif states[s] == PRESSED and way == 0:
                series, after = -force, FOLLOWING
            elif states[s] == FOLLOWING and way == 1:
                series, after = -depth, AWAY
            elif states[s] == FOLLOWING and way == 2:
                series, after = force, PRESSED
            else:
                continue
            largest, power = 0.0, 1.0
            for t in range(TERMS):
                largest = max(largest, abs(series[t]) * power)
                power *= time
            zero = series[0] > 0.0 or (s == touched and series[0] > -TOUCHED * largest)
            found = first_rise(series[1:], time) if zero else first_rise(series, time)
            if found >= 0.0 and (stop < 0 or found < at):
                at, stop, following = found, s, after
    return at, stop, following


@numba.njit(cache=True, error_model="numpy", nogil=True)
def flow(motion, laws, start, periods, phase, ends, log, factors, with_factors):
    """Follow a motion over whole periods of the force from a phase of it.

    `laws` (m, 2) holds stiffness and damping of each stop, of a rigid one zeros. `ends` (periods +
    1, 2 n) takes the state after each period; `log` (most, 3 + 2 n) phase, stop, speed and state of
    each contact that begins, the last ones in the place of the first where they are too many;
    `factors` (2 n, 2 n) the factors of small disturbances. Returns the number of contacts, -1 where
    they come too fast to be followed, and of the output the largest displacement and acceleration
    and the amplitude of the first harmonic.
    """
    n, m = motion.rows.shape[1], len(motion.positions)
    two, size = 2 * n, len(motion.generator)
    z, fresh, w = np.empty(size), np.empty(size), np.empty(size - two)
    terms, states = np.empty((TERMS, size)), np.zeros(m, np.int64)
    before, after, other = np.empty(two), np.empty(two), np.empty((two, two))
    salt, grown = np.empty((two, two)), np.eye(two)
    force_state(motion, phase, w)
    z[:two], z[two:] = start, w
    ends[0] = start
    first_states(motion, laws, z, states)
    now = Motion(
        pressed_generator(motion, laws, states), motion.rows, motion.positions,
        motion.restitutions, motion.omega, motion.output, motion.base,
    )  # fmt: skip
    part = step_between(now)
    matrix = transition(now.generator, part)
    touched, hits, displacement, acceleration = -1, 0, 0.0, 0.0
    even, odd = 0.0, 0.0
    for period in range(periods):
        begun = hits
        force_state(motion, phase, w)
        z[two:] = w
        left = 2.0 * math.pi / motion.omega
        pull = acceleration_row(now)
        slope = pull @ now.generator
        while left > 0.0:
            time = min(part, left)
            expand(now.generator, z, terms)
            at, stop, following = next_event(motion, laws, states, terms, time, touched)
            length = at if stop >= 0 else time
            sum_terms(terms, length, fresh)
            place, moving = output_of(motion, z)
            place_, moving_ = output_of(motion, fresh)
            displacement = max(displacement, swing((place, place_), (moving, moving_), length))
            bends = (dot(pull, z), dot(pull, fresh))
            acceleration = max(
                acceleration, swing(bends, (dot(slope, z), dot(slope, fresh)), length)
            )
            # cosine and sine of the force are states; each product by its values and slopes
            for number in range(2):
                wave, wave_ = z[two + number], fresh[two + number]
                turning = -motion.omega * z[two + 1] if number == 0 else motion.omega * z[two]
                turning_ = (
                    -motion.omega * fresh[two + 1] if number == 0 else motion.omega * fresh[two]
                )
                bend = moving * wave + place * turning - moving_ * wave_ - place_ * turning_
                part_ = 0.5 * length * (place * wave + place_ * wave_) + length**2 / 12.0 * bend
                if number == 0:
                    even += part_
                else:
                    odd += part_
            z[:] = fresh
            left -= length
            if left < 1e-13:
                left = 0.0
            if with_factors:
                whole = matrix if length == part else transition(now.generator, length)
                multiply(whole[:two, :two], grown, other)
                grown[:] = other
            if stop < 0:
                touched = -1
                continue
            touched = stop
            _, speed = distance_of(motion, stop, z)
            rate(now, z, before)
            rigid = laws[stop, 0] == 0.0
            if following == PRESSED and states[stop] == AWAY:
                slot = hits % len(log)
                log[slot, 0] = phase + 2.0 * math.pi * (period + 1) - motion.omega * left
                log[slot, 1], log[slot, 2] = stop, speed
                log[slot, 3:] = z[:two]
                hits += 1
                if hits - begun > MOST_IMPACTS:
                    return -1, displacement, acceleration, 0.0
            entering = following == PRESSED and states[stop] == AWAY
            if rigid:
                strike(motion, stop, z[:two])
                for j in range(two):
                    for i in range(two):
                        salt[i, j] = 1.0 if i == j else 0.0
                    strike(motion, stop, salt[:, j])
            else:
                states[stop] = following
                now = Motion(
                    pressed_generator(motion, laws, states), motion.rows, motion.positions,
                    motion.restitutions, motion.omega, motion.output, motion.base,
                )  # fmt: skip
                part = step_between(now)
                matrix = transition(now.generator, part)
                pull = acceleration_row(now)
                slope = pull @ now.generator
                for j in range(two):
                    for i in range(two):
                        salt[i, j] = 1.0 if i == j else 0.0
            if with_factors and entering:
                rate(now, z, after)
                if rigid:
                    strike(motion, stop, before)
                # a disturbed path enters at another moment, by the old and the new rates
                for i in range(two):
                    for j in range(n):
                        salt[i, j] += (after[i] - before[i]) * motion.rows[stop, j] / speed
                multiply(salt, grown, other)
                grown[:] = other
        ends[period + 1] = z[:two]
    if with_factors:
        factors[:] = grown
    amplitude = motion.omega / (math.pi * periods) * math.hypot(even, odd)
    return hits, displacement, acceleration, amplitude
