"""Averages over the motion within a compliant stop, relative to the density at its surface.

The density at a deflection y is that at the surface times e^L(y), L(0) = 0. L may rise to a peak
within the stop, where a load presses the mass in, and may be narrow there; everything is computed
relative to its largest value, so that no tail is lost and no pressing overflows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.truncated_normal import CUT, NODES, WEIGHTS
from stochvi.scenes.impact_laws import CompliantLaw

DISTANCES = 2.0 ** np.arange(-100.0, 101.0)
"""Deflections at which the density within a stop is evaluated first, in units in which the motion
is of order 1."""

SHRINKAGE = 32
"""Number of intervals into which the stretch between the two neighbours of a peak is divided in the
next round of the search for it."""

LOOKS = 5
"""Number of rounds of the search for a peak. 16^5 times finer than `DISTANCES` is enough to place
the panels of a quadrature."""


class Layer(NamedTuple):
    """Deflections y, and weights that hold e^(L - log_scale); their sum is the mass of the layer.

    `log_mass` is the logarithm of the integral of e^L over the deflections, in units of length.
    """

    deflection: Vector
    weight: Vector
    log_mass: float

    def expect(self, values: Vector) -> float:
        """Mean of values at the nodes over the layer."""
        return float(values @ self.weight) / float(self.weight.sum())


def layer(log_density: Callable[[Vector], Vector], law: CompliantLaw) -> Layer:
    """Quadrature over y > 0 of a density with one peak, by panels that end at knots of a table.

    Raises
    ------
    ValueError
        If the density does not fall off within the stop.
    """
    peak, top = _peak(log_density)
    right = peak + _fall(log_density, peak, top, 1.0)
    left = max(peak - _fall(log_density, peak, top, -1.0), 0.0)
    knots = law.knots()
    edges = np.unique([left, peak, right, *knots[(knots > left) & (knots < right)]])
    # in the root of the deflection the energy of a Hertz stop is a polynomial
    roots = np.sqrt(edges)
    half = np.diff(roots)[:, None] / 2.0
    t = (roots[:-1, None] + half * (1.0 + NODES)).ravel()
    y = t * t
    weight = 2.0 * t * (half * WEIGHTS).ravel() * np.exp(log_density(y) - top)
    return Layer(y, weight, top + math.log(float(weight.sum())))


def _peak(log_density: Callable[[Vector], Vector]) -> tuple[float, float]:
    """Place of the largest density, and L there."""
    places = np.concatenate([[0.0], DISTANCES])
    for _ in range(LOOKS):
        values = log_density(places)
        best = int(np.argmax(values))
        if best == len(places) - 1 or not math.isfinite(values[best]):
            raise ValueError("the density does not fall off within the stop")
        if best == 0 and places[0] == 0.0:
            return 0.0, 0.0
        ends = places[max(best - 1, 0)], places[best + 1]
        places = np.append(np.linspace(*ends, SHRINKAGE), places[best])
        places.sort()
    values = log_density(places)
    best = int(np.argmax(values))
    return float(places[best]), float(values[best])


def _fall(
    log_density: Callable[[Vector], Vector], peak: float, top: float, direction: float
) -> float:
    """How far from the peak the density has fallen by e^-CUT, to a factor of 2."""
    distances = DISTANCES if direction > 0.0 else DISTANCES[peak > DISTANCES]
    if len(distances) == 0:
        return peak
    fallen = log_density(peak + direction * distances) < top - CUT
    if not fallen.any():
        if direction > 0.0:
            raise ValueError("the density does not fall off within the stop")
        return peak
    return float(distances[int(np.argmax(fallen))])
