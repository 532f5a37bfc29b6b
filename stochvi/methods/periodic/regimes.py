"""The states of one periodic regime, from the phases of its impacts."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.periodic.kernels import solver


def pattern_of(stops: Sequence[int], periods: int) -> solver.Pattern:
    """Impacts on the stops of these numbers, in this order, in periods of the force."""
    return solver.Pattern(np.array(stops, np.int64), periods)


def states_of(motion: solver.Motion, pattern: solver.Pattern, theta: Vector) -> Matrix | None:
    """The states (impacts, 2 n) before impacts at the phases theta, or without impacts the one
    (1, 2 n) at the phase 0; None where there is no such motion, or no single one."""
    count = len(pattern.stops)
    if not count:
        state = unstruck(motion)
        return None if state is None else state[None]
    states, left = np.empty((count, 2 * motion.rows.shape[1])), np.empty(count)
    found = solver.residual(motion, pattern, theta, states, left, np.empty((0, 0)))
    return states if found else None


def unstruck(motion: solver.Motion) -> Vector | None:
    """The state (2 n,) at the phase 0 of the motion without impacts; None where there is none, or
    no single one."""
    two = 2 * motion.rows.shape[1]
    whole = solver.transition(motion.generator, 2.0 * math.pi / motion.omega)
    w, driven = np.empty(len(whole) - two), np.empty(two)
    solver.force_state(motion, 0.0, w)
    solver.apply(np.ascontiguousarray(whole[:two, two:]), w, driven)
    state = driven[:, None].copy()
    return state[:, 0] if solver.solve(np.eye(two) - whole[:two, :two], state) else None
