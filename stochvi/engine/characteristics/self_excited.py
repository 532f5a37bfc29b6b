"""Dampers that put energy into small motions and take it from large ones: Rayleigh, van der Pol."""

from __future__ import annotations

import math
from typing import NamedTuple

from stochvi.engine.characteristic import damps, kicked, pull, read


class Rayleigh(NamedTuple):
    """F = linear v + cubic v^3 per unit mass.

    Parameters
    ----------
    linear, cubic : 1/s and s/m^2.
    """

    linear: float
    cubic: float


class VanDerPol(NamedTuple):
    """F = damping ((x / amplitude)^2 - 1) v per unit mass.

    Parameters
    ----------
    damping, amplitude : 1/s and m.
    """

    damping: float
    amplitude: float


@pull.of(Rayleigh)
def _(part, x, v, z):
    return (part.linear + part.cubic * v * v) * v


@damps.of(Rayleigh)
def _(part):
    return True


@kicked.of(Rayleigh)
def _(part, x, v, z, push, damping, h):
    # half of the push before and after the exact solution of v' = a v - cubic v^3
    v, a = v + 0.5 * h * push, damping - part.linear
    growth = math.exp(2.0 * a * h)
    way = (growth - 1.0) / a if a != 0.0 else 2.0 * h
    return v * math.sqrt(growth / (1.0 + part.cubic * v * v * way)) + 0.5 * h * push


@read.of(Rayleigh)
def _(part, numbers, row):
    return Rayleigh(numbers[row, 0], numbers[row, 1])


@pull.of(VanDerPol)
def _(part, x, v, z):
    return part.damping * ((x / part.amplitude) ** 2 - 1.0) * v


@damps.of(VanDerPol)
def _(part):
    return True


@kicked.of(VanDerPol)
def _(part, x, v, z, push, damping, h):
    v, a = v + 0.5 * h * push, damping - part.damping * ((x / part.amplitude) ** 2 - 1.0)
    return v * math.exp(a * h) + 0.5 * h * push


@read.of(VanDerPol)
def _(part, numbers, row):
    return VanDerPol(numbers[row, 0], numbers[row, 1])
