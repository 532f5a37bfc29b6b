"""Many flights under a periodic force: to the regimes that they end in, with what perturbations do.

The symbols are those of `solver`. A period is divided into even steps at fixed phases of the force.
The part of the force in each step is then computed once for all flights. Where a stop may be met
within a step, the flight goes on from impact to impact by Taylor series.
"""

import math
from typing import NamedTuple

import numpy as np

from stochvi.engine.compiling import kernel
from stochvi.methods.periodic.kernels.solver import (
    FREE,
    MOST_IMPACTS,
    NONE,
    TERMS,
    Motion,
    apply,
    apply_and_add,
    distance_of,
    expand,
    force_state,
    free_touch,
    held,
    next_event,
    put,
    remove_part,
    rest_on,
    set_all,
    step_of,
    strike_or_rest,
    sum_terms,
    transition,
    turn_at_impact,
    turn_column,
)

NO_ATTRACTOR = -1
"""Number of the regime of a flight that has reached none."""

LOST = -2
"""Number of the regime of a flight whose impacts came too fast to be followed."""


VANISHED = 1e-12
"""Share of a perturbation up to which what is left after a period is the rounding of a rest."""


class Targets(NamedTuple):
    """States to which flights may come, once a period.

    Parameters
    ----------
    points : (targets, 2 n), states.
    forms, limits : (targets, 2 n, 2 n) and (targets,), a quadratic form of the difference from each
        state, and its value below which a flight has reached it.
    """

    points: np.ndarray
    forms: np.ndarray
    limits: np.ndarray


class Watched(NamedTuple):
    """Record of a flight that is watched.

    Parameters
    ----------
    log : (most, 3), phase, stop and speed of impacts, phases from the first watched period on; the
        last ones in place of the first where they are too many.
    ends : (periods, 2 n), the state after each period.
    growth : (periods,), the logarithm by which the length of a small perturbation has grown in each
        period, -inf where nothing of it is left.
    """

    log: np.ndarray
    ends: np.ndarray
    growth: np.ndarray


class Course(NamedTuple):
    """An interval of phases of the force, divided into steps: their number of seconds `part`; the
    matrix (2 n, 2 n) of a step; `forced` (steps, 2 n), what the force adds in each; `waves` (steps,
    W), w before each; the phase at the start; and `resting` (m, N, N), the generators at rest on
    each stop."""

    motion: Motion
    part: float
    matrix: np.ndarray
    forced: np.ndarray
    waves: np.ndarray
    phase: float
    resting: np.ndarray


@kernel
def course_of(motion, phase, angle):
    """The course over an angle of phases (rad) from one on."""
    n = motion.rows.shape[1]
    two, size = 2 * n, len(motion.generator)
    time = angle / motion.omega
    steps = max(1, math.ceil(time / step_of(motion)))
    part = time / steps
    whole = transition(motion.generator, part)
    forced, waves = np.empty((steps, two)), np.empty((steps, size - two))
    for k in range(steps):
        force_state(motion, phase + motion.omega * part * k, waves[k])
        apply(whole[:two, two:], waves[k], forced[k])
    matrix = np.empty((two, two))
    for i in range(two):
        put(whole[i, :two], matrix[i])
    return Course(motion, part, matrix, forced, waves, phase, held(motion))


@kernel
def fly(course, y, touch, perturbations, log, hits):
    """Simulate over a course from the state y (2 n,), in its place; returns the number of impacts
    so far, of which there were `hits`, or -1 where they came too fast to be followed.

    Parameters
    ----------
    perturbations : (2 n, number), small changes of the state, turned with it; there may be none.
    log : (most, 3), takes phase, stop and speed of impacts, the last ones in the place of the first
        where they are too many; (0, 3) for none.
    """
    motion, part = course.motion, course.part
    m, size = len(motion.positions), len(motion.generator)
    two = 2 * motion.rows.shape[1]
    columns = perturbations.shape[1]
    fresh, turned = np.empty(two), np.empty(two)
    z, later = np.empty(size), np.empty(size)
    terms, before = np.empty((TERMS, size)), hits
    distances, speeds = np.empty(m), np.empty(m)
    for s in range(m):
        distances[s], speeds[s] = distance_of(motion, s, y)
    for number in range(len(course.forced)):
        clear = touch.on[0] == FREE
        if clear:
            apply_and_add(course.matrix, y, course.forced[number], fresh)
            for s in range(m):
                start, speed = distances[s], speeds[s]
                end, end_speed = distance_of(motion, s, fresh)
                distances[s], speeds[s] = end, end_speed
                if max(start, end) + 0.5 * part * (abs(speed) + abs(end_speed)) >= 0.0:
                    clear = False
        if clear:
            put(fresh, y)
            for column in range(columns):
                apply(course.matrix, perturbations[:, column], turned)
                put(turned, perturbations[:, column])
            touch.on[1], touch.on[2] = FREE, FREE
            continue
        left = part
        put(y, z[:two])
        put(course.waves[number], z[two:])
        while left > 0.0:
            state = touch.on[0]
            generator = motion.generator if state == FREE else course.resting[state]
            expand(generator, z, terms)
            sum_terms(terms, left, later)
            sooner, event = next_event(motion, touch, z, later, left, terms)
            for column in range(columns):
                turn_column(generator, sooner, perturbations, column, turned)
            if event == NONE:
                put(later, z)
                touch.on[1], touch.on[2], left = FREE, FREE, 0.0
                continue
            sum_terms(terms, sooner, z)
            left = max(left - sooner, 0.0)
            if event == state:
                touch.on[0], touch.on[1], touch.on[2] = FREE, FREE, state
                continue
            if columns:
                turn_at_impact(motion, event, z, perturbations)
            speed = strike_or_rest(motion, event, touch, z)
            if len(log):
                slot = hits % len(log)
                log[slot, 0] = course.phase + motion.omega * ((number + 1) * part - left)
                log[slot, 1], log[slot, 2] = event, speed
            hits += 1
            if hits - before > MOST_IMPACTS:
                return -1
            if touch.on[0] != FREE:
                for column in range(columns):
                    settle_on(motion, event, perturbations[:, column])
        put(z[:two], y)
        for s in range(m):
            distances[s], speeds[s] = distance_of(motion, s, y)
    return hits


@kernel
def carry(course, y, touch, perturbations):
    """`fly` without a log, if the course takes any time."""
    # stated type: numba would compile `fly` once more for the literal 0
    hits = np.int64(0)
    if course.part > 0.0:
        hits = fly(course, y, touch, perturbations, np.empty((0, 3)), hits)
    return hits


@kernel
def settle_on(motion, stop, perturbation):
    """Project a small perturbation where the motion comes to rest on a stop."""
    remove_part(motion.rows[stop], perturbation[: motion.rows.shape[1]])
    rest_on(motion, stop, perturbation)


@kernel
def reached(y, targets):
    """The number of the target around which a state lies within the limit of its quadratic form;
    NO_ATTRACTOR where there is none."""
    points, forms, limits = targets
    two = len(y)
    for t in range(len(points)):
        total = 0.0
        for i in range(two):
            row = 0.0
            for j in range(two):
                row += forms[t, i, j] * (y[j] - points[t, j])
            total += (y[i] - points[t, i]) * row
        if total < limits[t]:
            return t
    return NO_ATTRACTOR


@kernel
def settle_flights(lead, course, states, most, targets, found):
    """Simulate states (number, 2 n), in their place, until each reaches a target, over `most`
    periods.

    First they pass the course `lead`, unless its angle is 0. `found` (number,) takes the target,
    NO_ATTRACTOR or LOST.
    """
    none = np.empty((states.shape[1], 0))
    for number in range(len(states)):
        y, touch = states[number], free_touch()
        hits = carry(lead, y, touch, none)
        found[number] = LOST
        for period in range(most + 1):
            if hits < 0:
                break
            resting = touch.on[0] != FREE
            found[number] = NO_ATTRACTOR if resting else reached(y, targets)
            if found[number] != NO_ATTRACTOR or period == most:
                break
            hits = carry(course, y, touch, none)
            found[number] = LOST


@kernel
def watch_flight(course, y, skipped, watched, perturbation):
    """Simulate a state y (2 n,), in its place, first over `skipped` periods. A small perturbation
    (2 n, 1) is followed with it over the periods that are watched. Returns the number of logged
    impacts, or -1."""
    log, ends, growth = watched
    touch, hits, none = free_touch(), np.int64(0), np.empty((0, 3))
    first = np.empty(len(y))
    put(perturbation[:, 0], first)
    for period in range(skipped + len(ends)):
        kept = period >= skipped
        before = hits
        hits = fly(course, y, touch, perturbation, log if kept else none, hits)
        if hits < 0:
            return -1
        square = 0.0
        for i in range(len(y)):
            square += perturbation[i, 0] ** 2
        size = math.sqrt(square)
        if size < VANISHED:
            size = 0.0
            set_all(perturbation[:, 0], 0.0)
        if size > 0.0:
            for i in range(len(y)):
                perturbation[i, 0] /= size
        elif not kept:
            # a rest on a stop on the way says nothing about the motion that is watched
            put(first, perturbation[:, 0])
        if not kept:
            hits = 0
            continue
        for k in range(max(before, hits - len(log)), hits):
            log[k % len(log), 0] += 2.0 * math.pi * (period - skipped)
        growth[period - skipped] = math.log(size) if size > 0.0 else -np.inf
        put(y, ends[period - skipped])
    return hits


@kernel
def count_impacts(course, y, periods, counts):
    """Simulate a state y (2 n,), in its place, and add its impacts to `counts` (windows, stops), in
    windows of so many periods; returns whether all could be followed."""
    touch, none = free_touch(), np.empty((len(y), 0))
    log = np.empty((MOST_IMPACTS + 1, 3))
    for window in range(len(counts)):
        for _ in range(periods):
            hits = fly(course, y, touch, none, log, np.int64(0))
            if hits < 0:
                return False
            for k in range(hits):
                counts[window, int(log[k, 1])] += 1.0
    return True
