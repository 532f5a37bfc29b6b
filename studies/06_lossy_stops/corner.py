"""Slow impacts counted on paths whose steps shrink with the speed and the distance to a stop.

Near a stop at v = 0 nothing but noise sets a scale: a step of CAUTION max(v^2 / S0, (d^2 /
S0)^(1/3)), d the distance to the stop, follows ever slower impacts down for ever.
"""

import math

import numba
import numpy as np

LONGEST = 0.02
"""Step away from the stops, s, of an oscillator of omega = 1."""

SLOWEST = 1e-6
"""Speed, m/s, at which the step stops shrinking."""


@numba.njit(cache=True)
def impact_speeds(restitution, damping, intensity, caution, duration, burn_in, seed):
    """Speeds of all impacts on stops at -1 and 1 from `burn_in` to `duration`, omega = 1."""
    np.random.seed(seed)  # noqa: NPY002  (the generator that compiled code has)
    x, v, time = 0.0, 0.5, 0.0
    found = [0.0 for _ in range(0)]  # an empty list of numbers, for the compiler
    least = caution * SLOWEST**2 / intensity
    while time < duration:
        gap = max(1.0 - abs(x), 0.0)
        scale = max(v * v / intensity, (gap * gap / intensity) ** (1.0 / 3.0))
        h = max(min(LONGEST, caution * scale), least)
        one, two = np.random.standard_normal(), np.random.standard_normal()  # noqa: NPY002
        kick = math.sqrt(intensity * h) * one
        shift = 0.5 * h * kick + math.sqrt(intensity * h**3 / 12.0) * two
        pull = -x - damping * v
        x1, v1 = x + h * v + 0.5 * h * h * pull + shift, v + h * pull + kick
        if abs(x1) <= 1.0:
            x, v, time = x1, v1, time + h
            continue
        side = math.copysign(1.0, x1)
        # first place on the cubic through both ends; bisection, as it may pass the stop once only
        low, high = 0.0, 1.0
        for _ in range(40):
            s = 0.5 * (low + high)
            place = (1 + 2 * s) * (1 - s) ** 2 * x + s * (1 - s) ** 2 * h * v
            place += s * s * (3 - 2 * s) * x1 - s * s * (1 - s) * h * v1
            if side * place > 1.0:
                high = s
            else:
                low = s
        s = high
        slope = 6 * s * (1 - s) * (x1 - x) / h + (1 - s) * (1 - 3 * s) * v + s * (3 * s - 2) * v1
        x, v, time = side, -restitution * max(side * slope, 0.0) * side, time + s * h
        if time > burn_in:
            found.append(abs(side * max(side * slope, 0.0)))
    return np.array(found)
