"""How many passages there can be at most, before any equation is solved.

A path that passes before t crosses a barrier outwards at least once, so its chance is at most the
mean number of such crossings (S. O. Rice, Bell Syst. Tech. J. 24 (1945) 46, for a law that changes
in time: M. R. Leadbetter and H. Cramer, Stationary and Related Stochastic Processes, 1967, ch. 13).
"""

from __future__ import annotations

import math

import numpy as np

from stochvi.mathematics.state_space import step_covariance, transition
from stochvi.methods.fokker_planck.mesh import Array
from stochvi.methods.fokker_planck.operators import LinearMotion
from stochvi.methods.fokker_planck.starts import Point, Start

PANELS = 64
"""Into which a time is cut; the bound holds for any number and sinks with it."""

FALLING = math.sqrt(2.0)
"""Standard deviations from where on z^2 exp(-z^2 / 2), and all else in the bound, falls with z."""


def passages_at_most(
    motion: LinearMotion, start: Start, lower: float, upper: float, times: Array
) -> Array:
    """A bound on P(a barrier is passed before t) of an oscillator that starts at a point.

    The crossings of x = B per unit time, p_x(B) E[max(v, 0) | x = B], are at most

        exp(-z^2 / 2) / (sqrt(2 pi) s_x) (r + (1 + z) s_v),    z = (d - r / omega) / s_x >= sqrt 2,

    where d is the distance of B from the position of rest, r^2 = v^2 + omega^2 x^2 of the mean
    motion, which never grows, and s_x, s_v the deviations, which never fall, of a path from a
    point. Each panel of time takes r from where it begins and the deviations from where it ends.

    Parameters
    ----------
    times
        Seconds, at least 0, (n,).

    Returns
    -------
    ndarray
        (n,), at most 1; 1 where nothing is known: other starts, no spring, barriers in reach.

    Examples
    --------
    >>> bound = passages_at_most(
    ...     LinearMotion(1.0, 0.02, 0.02, 0.0), Point(0.0, 0.0), -5.0, 5.0, np.array([6.28, 1e6])
    ... )
    >>> [f"{value:.0e}" for value in bound]
    ['6e-46', '1e+00']
    """
    if motion.omega == 0.0 or not isinstance(start, Point):
        return np.ones(len(times))
    rest = motion.load / motion.omega**2
    distances = np.array([rest - lower, upper - rest])
    state = np.array([start.x - rest, start.v])
    crossings = [_crossings(motion, state, distances[np.isfinite(distances)], t) for t in times]
    return np.minimum(crossings, 1.0)


def _crossings(motion: LinearMotion, state: Array, distances: Array, duration: float) -> float:
    """Of all barriers together, at most; infinite where the bound knows nothing."""
    step = duration / PANELS
    generator = np.array([[0.0, 1.0], [-(motion.omega**2), -motion.damping_rate]])
    move = transition(generator, step)
    noise = step_covariance(generator, np.diag([0.0, 2.0 * motion.diffusion]), step)
    spread = np.zeros((2, 2))
    total = 0.0
    for _ in range(PANELS if duration > 0.0 else 0):
        spread = move @ spread @ move.T + noise
        fastest = math.hypot(motion.omega * state[0], state[1])
        s_x, s_v = np.sqrt(np.diag(spread))
        z = (distances - fastest / motion.omega) / s_x
        if (z < FALLING).any():
            return math.inf
        density = np.exp(-(z**2) / 2.0) / (math.sqrt(2.0 * math.pi) * s_x)
        total += step * float(np.sum(density * (fastest + (1.0 + z) * s_v)))
        state = move @ state
    return total
