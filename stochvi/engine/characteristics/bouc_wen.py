"""Hysteresis of Bouc and Wen."""

from __future__ import annotations

import math
from typing import NamedTuple

from stochvi.engine.characteristic import moved, pull, read, remembers, slope
from stochvi.engine.compiling import kernel

LONGEST_WAY = 0.25
"""Longest way, in yield displacements, of one step of the memory's equation; its relative error is
then below 1e-6."""


class BoucWen(NamedTuple):
    """F = force z per unit mass, with length dz/dx = 1 - (gamma + beta sign(z dx)) abs(z)^exponent.

    Parameters
    ----------
    force, length : largest force, m/s^2, and yield displacement, m.
    exponent, beta : dimensionless; gamma = 1 - beta.
    """

    force: float
    length: float
    exponent: float
    beta: float


@kernel
def relative_slope(part, z, step):
    """length dz/dx of a way in the direction of `step`."""
    side = part.beta if z * step > 0.0 else -part.beta
    return 1.0 - (1.0 - part.beta + side) * abs(z) ** part.exponent


@pull.of(BoucWen)
def _(part, x, v, z):
    return part.force * z


@remembers.of(BoucWen)
def _(part):
    return True


@moved.of(BoucWen)
def _(part, z, way):
    count = math.ceil(abs(way) / (part.length * LONGEST_WAY))
    for _ in range(count):
        step = way / part.length / count
        a = relative_slope(part, z, step)
        b = relative_slope(part, z + 0.5 * step * a, step)
        c = relative_slope(part, z + 0.5 * step * b, step)
        d = relative_slope(part, z + step * c, step)
        z += step * (a + 2.0 * b + 2.0 * c + d) / 6.0
    return z


@slope.of(BoucWen)
def _(part, z, way):
    return relative_slope(part, z, way) / part.length


@read.of(BoucWen)
def _(part, numbers, row):
    return BoucWen(numbers[row, 0], numbers[row, 1], numbers[row, 2], numbers[row, 3])
