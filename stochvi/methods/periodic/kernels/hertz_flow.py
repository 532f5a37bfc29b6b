"""Flow while a stop of Hertz's law presses, in a time of its own in which all is a power series.

The force h d^(3/2) of a depth d = e^2 is h e^3. With dt = e dtau, the state z, the generator G of
the motion without that force, and v = d' = row . q',

    de/dtau = v / 2,    dz/dtau = e (G z - h e^3 row),    dt/dtau = e

are polynomials, also where contact begins and ends, e = 0: there the series in t itself have no
sixth derivative. Where several such stops press, the pace dt/dtau is the product of their roots e.

Symbols as in `contact_flow`; k is the order of a coefficient.
"""

from typing import NamedTuple

import numpy as np

from stochvi.engine.compiling import kernel
from stochvi.methods.periodic.kernels.solver import (
    TERMS,
    put,
    root_between,
    sum_terms,
    value_at,
)

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
