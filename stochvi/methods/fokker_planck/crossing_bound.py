"""How many passages there can be at most, before any equation is solved.

A path that passes before t crosses a barrier outwards at least once. Its probability is therefore
at most the mean number of such crossings. Sources: S. O. Rice, Bell Syst. Tech. J. 24 (1945) 46;
for a distribution that changes in time M. R. Leadbetter and H. Cramer, Stationary and Related
Stochastic Processes, 1967, ch. 13.
"""

from __future__ import annotations

import math

import numpy as np

from stochvi.mathematics.arrays import Array
from stochvi.mathematics.state_space import step_covariance, transition
from stochvi.methods.fokker_planck.initial_states import InitialState, Start
from stochvi.model.model import Model

PANELS = 64
"""Number of panels into which a time is divided; the bound holds for any number, and decreases with
it."""

FALLING = math.sqrt(2.0)
"""Number of standard deviations from where on z^2 exp(-z^2 / 2), and with it the bound, falls
with z."""


def passages_at_most(model: Model, start: Start, lower: float, upper: float, times: Array) -> Array:
    """A bound on P(a barrier is passed before t) of an oscillator that starts at a point.

    The crossings of x = B per unit time, p_x(B) E[max(v, 0) | x = B], are at most

        exp(-z^2 / 2) / (sqrt(2 pi) s_x) (r + (1 + z) s_v),    z = (d - r / omega) / s_x >= sqrt 2,

    where d is the distance of B from the position of rest. r^2 = v^2 + omega^2 x^2 of the mean
    motion never grows; the standard deviations s_x, s_v of a path from a point never fall. Each
    panel of time takes r from where it begins and the deviations from where it ends.

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
    >>> from stochvi.model.model import model_of
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import Scene
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.04)],
    ... )
    >>> times = np.array([6.28, 1e6])
    >>> bound = passages_at_most(model_of(scene), InitialState(0.0, 0.0), -5.0, 5.0, times)
    >>> [f"{value:.0e}" for value in bound]
    ['6e-46', '1e+00']
    """
    if model.omega == 0.0 or not isinstance(start, InitialState):
        return np.ones(len(times))
    rest = model.rest
    distances = np.array([rest - lower, upper - rest])
    state = np.array([start.x - rest, start.v])
    crossings = [_crossings(model, state, distances[np.isfinite(distances)], t) for t in times]
    return np.minimum(crossings, 1.0)


def _crossings(model: Model, state: Array, distances: Array, duration: float) -> float:
    """Bound on the crossings of all barriers together; infinite where there is no bound."""
    step = duration / PANELS
    generator = np.array([[0.0, 1.0], [-(model.omega**2), -model.damping_rate]])
    move = transition(generator, step)
    noise = step_covariance(generator, np.diag([0.0, model.intensity]), step)
    spread = np.zeros((2, 2))
    total = 0.0
    for _ in range(PANELS if duration > 0.0 else 0):
        spread = move @ spread @ move.T + noise
        fastest = math.hypot(model.omega * state[0], state[1])
        s_x, s_v = np.sqrt(np.diag(spread))
        z = (distances - fastest / model.omega) / s_x
        if (z < FALLING).any():
            return math.inf
        density = np.exp(-(z**2) / 2.0) / (math.sqrt(2.0 * math.pi) * s_x)
        total += step * float(np.sum(density * (fastest + (1.0 + z) * s_v)))
        state = move @ state
    return total
