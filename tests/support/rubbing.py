"""An impact with friction, integrated over its impulse in small steps: Coulomb's law, and the work
of the normal force for the end. It shares nothing with `engine.friction`."""

from __future__ import annotations

import math

import numpy as np


def small_steps(
    inverse: np.ndarray, w: float, u: float, restitution: float, friction: float, steps: int = 20000
) -> tuple[float, float]:
    """Speeds into the stop and along it after an impact at w > 0 and u.

    `inverse` (2, 2) is the inverse mass matrix of the motions into the stop and along it, 1/kg.
    """
    a, b, c = inverse[0, 0], inverse[0, 1], inverse[1, 1]
    dp = 4.0 * w / a / steps
    taken = given = 0.0
    for _ in range(100 * steps):
        sticks = u == 0.0 and abs(b / c) <= friction  # a force within the cone holds it
        if u == 0.0:
            share = math.copysign(min(abs(b / c), friction), b / c)
        else:
            share = -math.copysign(friction, u)
        before, slid = w, u
        w += dp * (-a + b * share)
        u += dp * (-b + c * share)
        if slid * u < 0.0 or sticks:
            u = 0.0
        if before > 0.0:
            taken += 0.5 * (before + w) * dp
        else:
            given -= 0.5 * (before + w) * dp
        if w < 0.0 and given >= restitution**2 * taken:
            return w, u
        if w < 0.0 and restitution == 0.0:
            return w, u
    raise AssertionError("the impact has no end")
