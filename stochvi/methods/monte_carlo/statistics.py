"""Statistics of independent paths: merging of blocks, and estimates with standard errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stochvi.methods.monte_carlo.quantities import Key, Means, Quantity
from stochvi.results.intervals import PathMoments, neighbours

Vector = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Meaning of the rows of a table of time averages, and the origins of their positions.

    `rows` are keys of `Means`. For each coordinate in `origins`, the rows "x" and "xx" hold moments
    of x less its origin, m. `thresholds` hold for each pair the speed of the slowest impact that
    its rates count, m/s.
    """

    rows: tuple[Key, ...]
    origins: Mapping[str, float]
    thresholds: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class PathStatistics(PathMoments):
    """Count, mean vector and scatter matrix of the time averages of independent paths."""

    layout: Layout

    @classmethod
    def of(cls, averages: NDArray[np.float64], layout: Layout) -> PathStatistics:
        """Statistics of an array (rows, paths)."""
        mean = averages.mean(axis=1)
        centred = averages - mean[:, None]
        # einsum sums in a fixed order, where a threaded matrix product may not
        scatter = np.einsum("ip,jp->ij", centred, centred)
        return cls(count=averages.shape[1], mean=mean, scatter=scatter, layout=layout)

    @classmethod
    def none(cls, layout: Layout) -> PathStatistics:
        """Statistics of no paths."""
        size = len(layout.rows)
        return cls(count=0, mean=np.zeros(size), scatter=np.zeros((size, size)), layout=layout)

    def evaluate(self, quantity: Quantity) -> tuple[float, float]:
        """Value and standard error of a smooth function of the means (delta method)."""
        ((value, error),) = self.evaluate_all(lambda means: (quantity(means),))
        return value, error

    def evaluate_all(
        self, quantities: Callable[[Means], Sequence[float]]
    ) -> list[tuple[float, float]]:
        """Values and standard errors of several functions of the means that are computed
        together."""
        values = quantities(self.means())
        gradient = np.zeros((len(self._neighbours), len(values)))
        for number, (_, step, above, below) in enumerate(self._neighbours):
            gradient[number] = np.subtract(quantities(above), quantities(below)) / (2.0 * step)
        rows = [row for row, *_ in self._neighbours]
        projected = self.covariance[np.ix_(rows, rows)] @ gradient
        variances = np.maximum(np.sum(gradient * projected, axis=0), 0.0)
        return list(zip(values, np.sqrt(variances).tolist(), strict=True))

    @cached_property
    def _neighbours(self) -> list[tuple[int, float, Means, Means]]:
        """What the delta method evaluates all quantities at; see `neighbours` of intervals."""
        return [
            (row, float(step), self._named(above), self._named(below))
            for row, step, above, below in neighbours(self.mean, self.covariance)
        ]

    def means(self) -> Means:
        """The means by key."""
        return self._named(self.mean)

    def _named(self, mean: Vector) -> Means:
        """The means by key, positions from the unloaded springs; and the variance of each x, which
        is taken from its origin, as a far one would cost its digits."""
        named = dict(zip(self.layout.rows, mean.tolist(), strict=True))
        for coordinate, origin in self.layout.origins.items():
            offset, square = named[coordinate, "x"], named[coordinate, "xx"]
            named[coordinate, "x"] = origin + offset
            named[coordinate, "xx"] = max(origin * (origin + 2.0 * offset) + square, 0.0)
            named[coordinate, "variance"] = max(square - offset**2, 0.0)
        return named
