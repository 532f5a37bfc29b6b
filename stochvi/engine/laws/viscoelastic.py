"""A linear spring, alone or with a damper beside it."""

from __future__ import annotations

import math
from typing import NamedTuple

from stochvi.engine.law import force, is_lossy, margin, rate, read


class Viscoelastic(NamedTuple):
    """F = K y + c y' while it is positive, with the `stiffness` K (1/s^2) and `damping` c (1/s)."""

    stiffness: float
    damping: float


@force.of(Viscoelastic)
def _(law, y, v):
    return law.stiffness * y + law.damping * v


@margin.of(Viscoelastic)
def _(law, y, v):
    return y + law.damping / law.stiffness * v


@rate.of(Viscoelastic)
def _(law, y, v, push):
    return max(math.sqrt(law.stiffness), law.damping)


@is_lossy.of(Viscoelastic)
def _(law):
    return law.damping > 0.0


@read.of(Viscoelastic)
def _(law, numbers, row):
    return Viscoelastic(numbers[row, 0], numbers[row, 1])
