"""Statistics of independent paths: merged exactly, turned into estimates with their errors."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stochvi.monte_carlo.kernels.flight import (
    F1_LOWER,
    F1_UPPER,
    F2_LOWER,
    F2_UPPER,
    N_LOWER,
    N_UPPER,
    SUMS,
    VV,
    XX,
    X,
)

Vector = NDArray[np.float64]

ROWS = {
    "x": X,
    "xx": XX,
    "vv": VV,
    "n_lower": N_LOWER,
    "f1_lower": F1_LOWER,
    "f2_lower": F2_LOWER,
    "n_upper": N_UPPER,
    "f1_upper": F1_UPPER,
    "f2_upper": F2_UPPER,
}
"""Names of the time averages that a path yields: moments and, per second, sums over impacts."""


GRADIENT_STEP = 1e-3
"""Of a standard error."""


@dataclass(frozen=True, kw_only=True)
class PathStatistics:
    """Count, mean vector and scatter matrix of the time averages of independent paths.

    Merging is exact up to rounding and does not depend on how the paths were grouped, as long
    as groups are merged in the same order (T. F. Chan, G. H. Golub and R. J. LeVeque 1983).
    """

    count: int
    mean: Vector
    scatter: NDArray[np.float64]
    origin: float = 0.0

    @classmethod
    def of(cls, averages: NDArray[np.float64], origin: float = 0.0) -> PathStatistics:
        """Statistics of an array (SUMS, paths), positions from `origin`."""
        mean = averages.mean(axis=1)
        centred = averages - mean[:, None]
        # einsum sums in a fixed order, where a threaded matrix product may not
        scatter = np.einsum("ip,jp->ij", centred, centred)
        return cls(count=averages.shape[1], mean=mean, scatter=scatter, origin=origin)

    @classmethod
    def none(cls) -> PathStatistics:
        """Of no paths at all."""
        return cls(count=0, mean=np.zeros(SUMS), scatter=np.zeros((SUMS, SUMS)))

    def merge(self, other: PathStatistics) -> PathStatistics:
        """Statistics of both groups of paths together."""
        count = self.count + other.count
        shift = other.mean - self.mean
        weight = self.count * other.count / count
        return PathStatistics(
            count=count,
            mean=self.mean + shift * (other.count / count),
            scatter=self.scatter + other.scatter + np.outer(shift, shift) * weight,
            origin=other.origin,
        )

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of the mean vector."""
        return self.scatter / (self.count * max(self.count - 1, 1))

    def evaluate(self, quantity: Callable[[dict[str, float]], float]) -> tuple[float, float]:
        """Value and standard error of a smooth function of the means (delta method).

        The gradient is taken by central differences over a small part of one standard error each
        way: the whole would reach rate 0 where a single path holds all the impacts.
        """
        value = quantity(self._named(self.mean))
        steps = GRADIENT_STEP * np.sqrt(np.diag(self.covariance))
        gradient = np.zeros(SUMS)
        for row in np.flatnonzero(steps):
            offset = np.zeros(SUMS)
            offset[row] = steps[row]
            above = quantity(self._named(self.mean + offset))
            below = quantity(self._named(self.mean - offset))
            gradient[row] = (above - below) / (2.0 * steps[row])
        variance = float(gradient @ self.covariance @ gradient)
        return value, math.sqrt(max(variance, 0.0))

    def _named(self, mean: Vector) -> dict[str, float]:
        """The means by name, positions from the unloaded spring; and the variance of x, which is
        taken from `origin`, as a far one would cost its digits."""
        named = {name: float(mean[row]) for name, row in ROWS.items()}
        offset, square = named["x"], named["xx"]
        return named | {
            "x": self.origin + offset,
            "xx": max(self.origin * (self.origin + 2.0 * offset) + square, 0.0),
            "variance": max(square - offset**2, 0.0),
        }
