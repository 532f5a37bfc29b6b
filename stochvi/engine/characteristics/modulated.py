"""A spring and damper whose strength a signal changes."""

from __future__ import annotations

from typing import NamedTuple

from stochvi.engine.characteristic import damps, kicked, pull, read
from stochvi.engine.characteristics.coulomb import growth


class Modulated(NamedTuple):
    """F = z (stiffness x + damping v) per unit mass, with z the relative change at this time.

    Parameters
    ----------
    stiffness, damping : 1/s^2 and 1/s.
    """

    stiffness: float
    damping: float


@pull.of(Modulated)
def _(part, x, v, z):
    return z * (part.stiffness * x + part.damping * v)


@damps.of(Modulated)
def _(part):
    return True


@kicked.of(Modulated)
def _(part, x, v, z, push, damping, h):
    rate = damping - z * part.damping
    return v + (push - z * part.stiffness * x + rate * v) * growth(rate, h)


@read.of(Modulated)
def _(part, numbers, row):
    return Modulated(numbers[row, 0], numbers[row, 1])
