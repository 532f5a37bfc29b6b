"""Shapes of pulses of finite length, straight between points that lie evenly.

A pulse is a s(t / D) with the peak a, the length D and a shape s that is 0 at both ends. With the
values s_k at the points t_k, a distance d apart, its Fourier transform is exactly

    S(w) = d sinc^2(w d / 2) sum_k s_k exp(-i w t_k).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stochvi.mathematics.arrays import Vector, Waves

POINTS = 401
"""Points of a shape that has a formula. Half a sine that is straight between them has 5e-6 less
area; a tooth falls within a 400th of its length."""

RAMP = 0.1
"""Share of a trapezoid's length in which it rises, and in which it falls (MIL-STD-810H 516.8)."""

AT_ONCE = 2**22
"""Largest number of terms of Fourier transforms that are made together, 64 MB."""


@dataclass(frozen=True, eq=False)
class PulseShape:
    """Values at even points from the start to the end of a pulse, and its length, s.

    Examples
    --------
    >>> shape = PulseShape(SHAPES["half-sine"], 0.011)
    >>> round(shape.area / 0.011 * math.pi / 2.0, 4)
    1.0
    """

    values: Vector
    duration: float

    @property
    def interval(self) -> float:
        """Distance of two points, s."""
        return self.duration / (len(self.values) - 1)

    @property
    def area(self) -> float:
        """Integral over time, s."""
        return float(np.trapezoid(self.values)) * self.interval

    @property
    def peak(self) -> float:
        """Largest absolute value."""
        return float(np.max(np.abs(self.values)))

    def transform(self, omega: Vector) -> Waves:
        """The Fourier transform at angular frequencies (n,), s."""
        times = self.interval * np.arange(len(self.values))
        found = np.empty(len(omega), complex)
        part = max(1, AT_ONCE // len(times))
        for first in range(0, len(omega), part):
            w = omega[first : first + part]
            found[first : first + part] = np.exp(-1j * w[:, None] * times) @ self.values
        straight = np.sinc(omega * self.interval / (2.0 * math.pi)) ** 2
        return np.asarray(self.interval * straight * found, complex)


def _half_sine(time: Vector) -> Vector:
    return np.asarray(np.sin(math.pi * time))


def _saw_tooth(time: Vector) -> Vector:
    return np.where(time < 1.0, time / time[-2], 0.0)


def _trapezoid(time: Vector) -> Vector:
    return np.asarray(np.minimum(np.minimum(time, 1.0 - time) / RAMP, 1.0))


SHAPES = {
    name: shape(np.linspace(0.0, 1.0, POINTS))
    for name, shape in (
        ("half-sine", _half_sine), ("saw-tooth", _saw_tooth), ("trapezoid", _trapezoid),
    )
}  # fmt: skip
"""Values of the shapes of shock tests: half a sine, a tooth that ends at its peak, a trapezoid."""
