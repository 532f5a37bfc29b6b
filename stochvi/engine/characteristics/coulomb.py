"""Dry friction of Coulomb."""

from __future__ import annotations

import math
from typing import NamedTuple

from stochvi.engine.characteristic import damps, kicked, pull, read
from stochvi.engine.compiling import kernel


class Coulomb(NamedTuple):
    """F = force sign(v) per unit mass; at rest whatever holds the mass, up to `force`.

    Parameters
    ----------
    force : m/s^2.
    """

    force: float


@kernel
def growth(rate, h):
    """Integral of exp(rate t) over the time h, s."""
    return math.expm1(rate * h) / rate if rate != 0.0 else h


@pull.of(Coulomb)
def _(part, x, v, z):
    return math.copysign(part.force, v) if v != 0.0 else 0.0


@damps.of(Coulomb)
def _(part):
    return True


@kicked.of(Coulomb)
def _(part, x, v, z, push, damping, h):
    if v == 0.0 and abs(push) <= part.force:
        return v
    side = math.copysign(1.0, v if v != 0.0 else push)
    gain = push - side * part.force
    after = v + (gain + damping * v) * growth(damping, h)
    if after * side >= 0.0:
        return after
    if abs(push) <= part.force:
        return 0.0
    stopped = -v / gain if damping == 0.0 else -math.log1p(damping * v / gain) / damping
    return (push + side * part.force) * growth(damping, h - stopped)


@read.of(Coulomb)
def _(part, numbers, row):
    return Coulomb(numbers[row, 0])
