"""Statistics of independent paths: merging of blocks, and estimates with standard errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.methods.monte_carlo.quantities import Key, Means, Quantity
from stochvi.results.intervals import PathMoments, neighbours

Quantities = Callable[[Means], Sequence[float]]
"""Several quantities of a response that are computed together."""


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Meaning of the rows of a table of time averages, and the origins of their positions.

    `rows` are keys of `Means`. For each coordinate in `origins`, the rows "x" and "xx" hold moments
    of x less its origin, m. `thresholds` hold for each pair the speed of the slowest impact that
    its rates count, m/s. `controls` are rows whose expected values are known.
    """

    rows: tuple[Key, ...]
    origins: Mapping[str, float]
    thresholds: Mapping[str, float]
    controls: Mapping[Key, float] = field(default_factory=dict)


FEWEST_SHARING = 50.0
"""Number of paths that must share in a control, (sum c)^2 / sum c^2, for it to be used: a
regression on the one or two passages that were seen would fit them without any error."""

PATHS_PER_CONTROL = 8
"""Number of paths for each control that is used, the first ones of the layout: a regression of n
paths on k controls costs 1 / (1 - k / n) of the variance that it leaves, at most 1.14."""

COLLINEAR = 1e-9
"""Eigenvalue of the correlation matrix of the controls, relative to the largest, below which a
combination of them is left out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PathStatistics(PathMoments):
    """Count, mean vector and scatter matrix of the time averages of independent paths.

    The means and errors of quantities use the controls: with c the averages of rows whose expected
    values mu are known, the mean of any row m is m - B (c - mu), with B the regression of m on c
    over the paths. That has the same expected value up to 1 / paths of an error, and only the
    variance that is left beside the regression (S. S. Lavenberg, P. D. Welch 1981).
    """

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

    def evaluate_all(self, quantities: Quantities) -> list[tuple[float, float]]:
        """Values and standard errors of several functions of the means that are computed
        together."""
        gradient = self.gradient(quantities)
        _, covariance = self._controlled
        variances = np.maximum(np.sum(gradient * (covariance @ gradient), axis=0), 0.0)
        return list(zip(quantities(self.means()), np.sqrt(variances).tolist(), strict=True))

    def gradient(self, quantities: Quantities) -> Vector:
        """Derivatives (rows, quantities) of several functions of the means by each mean."""
        gradient = np.zeros((len(self.mean), len(quantities(self.means()))))
        if self._neighbours:
            rows, steps, above, below = zip(*self._neighbours, strict=True)
            higher, lower = ([quantities(means) for means in side] for side in (above, below))
            gradient[list(rows)] = np.subtract(higher, lower) / (2.0 * np.array(steps)[:, None])
        return gradient

    @cached_property
    def _neighbours(self) -> list[tuple[int, float, Means, Means]]:
        """Neighbouring means at which the delta method evaluates all quantities; see `neighbours`
        of `results.intervals`."""
        return [
            (row, float(step), self._named(above), self._named(below))
            for row, step, above, below in neighbours(*self._controlled)
        ]

    def means(self) -> Means:
        """The means by key."""
        return self._named(self._controlled[0])

    @property
    def uncontrolled(self) -> PathStatistics:
        """The same statistics as the paths have them, without the controls."""
        return replace(self, layout=replace(self.layout, controls={}))

    @cached_property
    def with_noise_alone(self) -> PathStatistics:
        """The same statistics with those controls alone whose expected value is 0: they are the
        same at any step."""
        controls = {key: value for key, value in self.layout.controls.items() if value == 0.0}
        return replace(self, layout=replace(self.layout, controls=controls))

    @cached_property
    def _controlled(self) -> tuple[Vector, Vector]:
        """The means, and the covariance of their errors, by the regression on the controls."""
        used, slopes, inverse = self.regression
        if not used:
            return self.mean, self.covariance
        off = self.mean[used] - [self.layout.controls[self.layout.rows[row]] for row in used]
        left = self.scatter - slopes @ self.scatter[used]
        freedom = self.count - 1 - len(used)
        covariance = left / freedom * (1.0 / self.count + off @ inverse @ off)
        # where the controls leave nothing, rounding may leave less
        covariance[np.diag_indices_from(covariance)] = np.maximum(np.diag(covariance), 0.0)
        return self.mean - slopes @ off, covariance

    @cached_property
    def regression(self) -> tuple[list[int], Vector, Vector]:
        """The rows of the controls that are used, the slopes of all rows on them, and the inverse
        of their scatter."""
        used = [row for row, key in enumerate(self.layout.rows) if self._usable(key, row)]
        used = used[: self.count // PATHS_PER_CONTROL]
        size = np.sqrt(np.diag(self.scatter)[used])
        within = self.scatter[np.ix_(used, used)] / np.outer(size, size)
        inverse = np.linalg.pinv(within, rcond=COLLINEAR, hermitian=True) / np.outer(size, size)
        return used, self.scatter[:, used] @ inverse, inverse

    def _usable(self, key: Key, row: int) -> bool:
        """Whether a row is a control in which many paths share; noise is shared by all."""
        mean, scatter = self.mean[row], self.scatter[row, row]
        if key not in self.layout.controls or scatter <= 0.0:
            return False
        if self.layout.controls[key] == 0.0:
            return self.count >= FEWEST_SHARING
        squares = scatter + self.count * mean**2
        return bool((self.count * mean) ** 2 >= FEWEST_SHARING * squares)

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


@dataclass(frozen=True, kw_only=True, eq=False)
class StepPairs(PathMoments):
    """Moments of the time averages of paths that are simulated at the step and at twice the step:
    the rows of the layout at the step, then the same rows at twice the step."""

    layout: Layout

    @classmethod
    def of(cls, averages: NDArray[np.float64], layout: Layout) -> StepPairs:
        """Moments of an array (2 rows, paths)."""
        found = PathStatistics.of(averages, layout)
        return cls(count=found.count, mean=found.mean, scatter=found.scatter, layout=layout)

    @classmethod
    def none(cls, layout: Layout) -> StepPairs:
        """Moments of no paths."""
        size = 2 * len(layout.rows)
        return cls(count=0, mean=np.zeros(size), scatter=np.zeros((size, size)), layout=layout)

    def half(self, rows: slice) -> PathStatistics:
        """The paths at one of the steps, without controls."""
        return PathStatistics(
            count=self.count,
            mean=self.mean[rows],
            scatter=self.scatter[rows, rows],
            layout=self.layout,
        ).uncontrolled

    def differences(
        self, quantities: Quantities, whole: PathStatistics
    ) -> list[tuple[float, float]]:
        """Quantities at twice the step less those at the step, with the standard errors of the
        differences.

        These n paths are some of the N paths of `whole` at the step, which know the quantity
        better. With c, f and g the values at twice the step, at the step, and at the step of all N
        paths, the difference is c - beta f - (1 - beta) g, f - g being a control variate of zero
        mean. Its variance is least at beta = cov(c, f) / var(f), for paths that share their noise
        near 1 and for independent ones 0.
        """
        rows = len(self.layout.rows)
        fine, coarse, covariance = at_both_steps(self, whole)
        whole = whole.with_noise_alone
        of_fine, of_coarse = fine.gradient(quantities), coarse.gradient(quantities)

        def shared(left: Vector, right: Vector, block: Vector) -> Vector:
            return np.asarray(np.sum(left * (block @ right), axis=0))

        var_fine = shared(of_fine, of_fine, covariance[:rows, :rows])
        var_coarse = shared(of_coarse, of_coarse, covariance[rows:, rows:])
        both = shared(of_fine, of_coarse, covariance[:rows, rows:])
        beta = np.divide(both, var_fine, out=np.ones_like(both), where=var_fine > 0.0).clip(
            0.0, 1.0
        )
        here = var_coarse + beta**2 * var_fine - 2.0 * beta * both
        elsewhere = (1.0 - beta) * ((1.0 + beta) * var_fine - 2.0 * both)
        errors = np.sqrt(np.maximum(here / self.count + elsewhere / whole.count, 0.0))
        values = (
            np.array(quantities(coarse.means()))
            - beta * quantities(fine.means())
            - (1.0 - beta) * quantities(whole.means())
        )
        return list(zip(values.tolist(), errors.tolist(), strict=True))


@lru_cache(maxsize=2)
def at_both_steps(
    pairs: StepPairs, whole: PathStatistics
) -> tuple[PathStatistics, PathStatistics, Vector]:
    """Return the pairs at the step and at twice the step, and their covariance over the paths.

    The covariance has the shape (2 rows, 2 rows). The regression on noise takes the slopes of the
    `whole`, which knows them best.

    They are kept, as is what their derivatives need, since many quantities are asked for in a row.
    """
    rows = len(pairs.layout.rows)
    used, slopes, _ = whole.with_noise_alone.regression
    one = np.eye(rows)
    one[:, used] -= slopes
    both = np.kron(np.eye(2), one)
    found = replace(pairs, mean=both @ pairs.mean, scatter=both @ pairs.scatter @ both.T)
    covariance = found.scatter / max(pairs.count - 1, 1)
    return found.half(slice(rows)), found.half(slice(rows, None)), covariance
