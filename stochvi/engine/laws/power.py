"""A force that grows as a power of the deflection, with a loss that does so too."""

from __future__ import annotations

import math
from typing import NamedTuple

from stochvi.engine.law import energy, force, is_lossy, is_smooth, rate, read


class Power(NamedTuple):
    """F = k y^n + c y^m y' while it is positive: `coefficient` k, `exponent` n >= 1, `loss` c and
    `loss_exponent` m >= 0, per unit mass."""

    coefficient: float
    exponent: float
    loss: float
    loss_exponent: float


@force.of(Power)
def _(law, y, v):
    y = max(y, 0.0)
    return law.coefficient * y**law.exponent + law.loss * y**law.loss_exponent * v


@energy.of(Power)
def _(law, y):
    n = law.exponent + 1.0
    return law.coefficient / n * max(y, 0.0) ** n


@rate.of(Power)
def _(law, y, v, push):
    # where k y^(n+1) / (n + 1) = E + push y, one of the two terms is at least half of it
    k, n = law.coefficient, law.exponent
    kinetic = 0.5 * v * v + k / (n + 1.0) * max(y, 0.0) ** (n + 1.0)
    scale = 2.0 * (n + 1.0) / k
    deepest = max((scale * kinetic) ** (1.0 / (n + 1.0)), (scale * max(push, 0.0)) ** (1.0 / n))
    spring = math.sqrt(n * k * deepest ** (n - 1.0))
    return max(spring, law.loss * deepest**law.loss_exponent)


@is_lossy.of(Power)
def _(law):
    return law.loss > 0.0


@is_smooth.of(Power)
def _(law):
    return False


@read.of(Power)
def _(law, numbers, row):
    return Power(numbers[row, 0], numbers[row, 1], numbers[row, 2], numbers[row, 3])
