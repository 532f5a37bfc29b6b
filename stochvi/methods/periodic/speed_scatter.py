"""Scatter of impact speeds where the restitution scatters from impact to impact."""

from __future__ import annotations

import math
from collections.abc import Callable

STEP = 1e-3
"""Relative step of the second derivative of the next speed."""

MOST_TURNS, SETTLED = 200, 1e-12
"""Largest number of turns of the iteration for the variance, and the change at which it ends."""


def speed_scatter(
    next_speed: Callable[[float], float], kept: float, speed: float, restitution: float, std: float
) -> float:
    """Standard deviation of the impact speeds w in the long run, m/s, to second order.

    A restitution acts by the rebound u = R w alone, whose variance is
    R^2 V + std^2 (w^2 + V), V that of w. The next speed w'(u) has the variance

        (dw' / du)^2 var u + (d^2 w' / du^2)^2 (var u)^2 / 2

    for a Gaussian u. The first term alone is the first order, which fails where dw' / du is near 0.

    Parameters
    ----------
    next_speed, kept
        The speed of the next impact, of that of one, and its derivative in the long run.
    """
    if not restitution > 0.0 or not std > 0.0:
        return 0.0
    step = STEP * speed
    bend = (next_speed(speed + step) - 2.0 * speed + next_speed(speed - step)) / step**2
    slope, curve = kept / restitution, bend / restitution**2
    variance = 0.0
    for _ in range(MOST_TURNS):
        of_rebound = restitution**2 * variance + std**2 * (speed**2 + variance)
        following = slope**2 * of_rebound + 0.5 * (curve * of_rebound) ** 2
        if abs(following - variance) <= SETTLED * following:
            break
        variance = following
    return math.sqrt(following)
