"""The contact of two round bodies."""

from __future__ import annotations

import math
from typing import NamedTuple

from stochvi.engine.law import energy, force, is_smooth, rate, read


class Hertz(NamedTuple):
    """F = k y^(3/2), with the `coefficient` k (m^-1/2 s^-2, per unit mass)."""

    coefficient: float


@force.of(Hertz)
def _(law, y, v):
    y = max(y, 0.0)
    return law.coefficient * y * math.sqrt(y)


@energy.of(Hertz)
def _(law, y):
    return 0.4 * law.coefficient * y * y * math.sqrt(y)


@rate.of(Hertz)
def _(law, y, v, push):
    # where (2/5) k y^(5/2) = E + push y, one of the two terms is at least half of it
    k, y = law.coefficient, max(y, 0.0)
    kinetic = 0.5 * v * v + 0.4 * k * y * y * math.sqrt(y)
    deepest = max((5.0 * kinetic / k) ** 0.4, (5.0 * max(push, 0.0) / k) ** (2.0 / 3.0))
    return math.sqrt(1.5 * k * math.sqrt(deepest))


@is_smooth.of(Hertz)
def _(law):
    return False


@read.of(Hertz)
def _(law, numbers, row):
    return Hertz(numbers[row, 0])
