"""Tallies of the impacts of each path, and estimates from independent paths."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.monte_carlo.impact_logs import ImpactLog
from stochvi.results.estimates import Estimate, of_events
from stochvi.results.intervals import (
    GAUSSIAN_95,
    jackknife_error,
    logarithmic_interval,
    poisson_interval,
    ratio_and_error,
    reach,
    upper_limit_unseen,
)

WINDOWS = 8
"""Number of windows of a path in which impacts are counted for the dispersion."""

BINS = 40
"""Number of bins of a histogram, equally wide in the logarithm."""

LARGEST_DISPERSION = 1.25
"""Counts pass for Poisson's where the upper limit of their dispersion lies between the inverse of
this number and this number: an interval is then at most 12 % too narrow or too wide."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """The classes in which the impacts of a pair are counted. `speeds` (m/s) and `intervals` (s,
    shorter than a path) are edges of bins. `fits` are the two ranges of speeds, with one start, to
    which exponents are fitted. `window` is a length (s)."""

    speeds: Vector
    intervals: Vector
    fits: tuple[tuple[float, float], tuple[float, float]]
    window: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Tally:
    """Sums over the impacts of each path. The first axis are the paths, the second the lower and
    the upper stop.

    `fits` are numbers, sums of ln(w / start) and of w in both ranges, (paths, 2, 2 ranges, 3).

    `intervals` are weights. Take an interval of length t after an impact, in a stationary motion.
    It ends within a path of length T if the impact falls into the first T - t seconds: a share 1 -
    t / T of such intervals is seen. Each counts T / (T - t)-fold (D. G. Horvitz and D. J. Thompson,
    J. Am. Stat. Assoc. 47 (1952) 663). The weights of a bin then have the mean of the number of
    impacts that such an interval follows. This holds however short the paths are, and however
    intervals depend on each other.
    """

    numbers: Matrix
    squares: Matrix
    energies: Matrix
    fits: NDArray[np.float64]
    speeds: Matrix
    intervals: Matrix
    windows: Matrix

    @classmethod
    def of(cls, log: ImpactLog, paths: int, grid: Grid) -> Tally:
        """The tally of the impacts of a block of paths."""
        side = (log.speed > 0.0).astype(np.int64)
        speed = np.abs(log.speed)

        def total(weight: Vector, place: NDArray[np.int64], size: int) -> Matrix:
            flat = np.bincount(log.path * size + place, weights=weight, minlength=paths * size)
            return np.asarray(flat.reshape(paths, size), dtype=float)

        assert log.lost is not None
        one = np.ones_like(speed)
        fits = np.empty((paths, 2, 2, 3))
        for number, (low, high) in enumerate(grid.fits):
            inside = ((speed >= low) & (speed < high)).astype(float)
            fits[:, :, number, 0] = total(inside, side, 2)
            logs = inside * np.log(np.maximum(speed, low) / low)
            fits[:, :, number, 1] = total(logs, side, 2)
            fits[:, :, number, 2] = total(inside * speed, side, 2)
        window = np.minimum((log.time / grid.window).astype(np.int64), WINDOWS - 1)
        # between impacts of one path that follow each other
        waited, same = np.diff(log.time), np.diff(log.path) == 0
        same &= waited <= grid.intervals[-1]
        places = log.path[1:][same] * (BINS + 2) + np.searchsorted(grid.intervals, waited[same])
        weights = 1.0 / (1.0 - waited[same] / (WINDOWS * grid.window))
        intervals = np.bincount(places, weights, minlength=paths * (BINS + 2)).reshape(paths, -1)
        return cls(
            numbers=total(one, side, 2),
            squares=total(speed**2, side, 2),
            energies=total(log.lost, side, 2),
            fits=fits,
            speeds=total(one, np.searchsorted(grid.speeds, speed), BINS + 2),
            intervals=np.asarray(intervals, dtype=float),
            windows=total(one, window, WINDOWS),
        )

    def rows(self, first: int, paths: int) -> Tally:
        """The tally of some of the paths."""
        names = [each.name for each in fields(Tally)]
        return Tally(**{name: getattr(self, name)[first : first + paths] for name in names})


def merged(tallies: list[Tally]) -> Tally:
    """The tally of all paths together, in the order of the tallies."""
    names = [each.name for each in fields(Tally)]
    return Tally(**{name: np.concatenate([getattr(t, name) for t in tallies]) for name in names})


@dataclass(frozen=True, kw_only=True)
class Rate:
    """Impacts per second, and their 95 % interval, widened by the bias of the step if it is known.

    Parameters
    ----------
    estimate
        The rate, 1/s; the mean time between impacts is one over it.
    lower, upper
        Ends of the interval, 1/s.
    interval
        Its source: "Poisson" for counts that scatter like Poisson's, else "paths".

    See Also
    --------
    stochvi.statistics.PairStatistics : The statistics that hold it.
    """

    estimate: Estimate
    lower: float
    upper: float
    interval: str


def rate(
    counts: Vector, duration: float, poisson: bool, how: str, cluster: float = 1.0,
    bias: float | None = None, bias_error: float = 0.0,
) -> Rate:  # fmt: skip
    """The rate from counts of impacts in independent paths of `duration` seconds; where none was
    seen, with as many impacts in a `cluster` as there may be. A bias that is known widens the
    interval."""
    value, error = ratio_and_error(counts, np.full(len(counts), duration))
    seen = Estimate(value=value, standard_error=error, bias=bias, bias_error=bias_error, how=how)
    if value == 0.0:
        most = cluster * upper_limit_unseen(duration * len(counts))
        found, low, high = replace(seen, bias=None, bias_error=0.0, upper_95=most), 0.0, most
    elif poisson:
        found = seen
        low, high = poisson_interval(round(counts.sum()), duration * len(counts))
    else:
        found = of_events(seen, len(counts))
        low, high = logarithmic_interval(value, error, len(counts) - 1)
        low, high = (low, high) if found.upper_95 is None else (0.0, found.upper_95)
    if found.upper_95 is None:
        low = max(value - reach(1.0, [value - low, GAUSSIAN_95 * bias_error], [bias or 0.0]), 0.0)
        high = value + reach(1.0, [high - value, GAUSSIAN_95 * bias_error], [bias or 0.0])
    exact = poisson or value == 0.0
    return Rate(estimate=found, lower=low, upper=high, interval="Poisson" if exact else "paths")


def dispersion(windows: Matrix, window: float) -> Estimate:
    """Variance over mean of the counts (paths, windows); jackknife over paths.

    1 for Poisson's process, more for impacts that come in clusters, less for regular ones.
    """
    paths, count = windows.shape

    def index(sums: Vector, squares: Vector, size: int) -> Vector:
        mean = sums / size
        return np.asarray((squares - size * mean**2) / (size - 1) / mean)

    sums, squares = windows.sum(axis=1), (windows**2).sum(axis=1)
    value = float(index(sums.sum(), squares.sum(), paths * count))
    others = index(sums.sum() - sums, squares.sum() - squares, (paths - 1) * count)
    error = jackknife_error(others)
    return Estimate(
        value=value, standard_error=error, how=f"{paths * count} windows of {window:.4g} s"
    )


def passes_for_poisson(found: Estimate | None) -> bool:
    """Whether counts of this dispersion may pass for those of Poisson's process; not where nothing
    is known of it, since a few impacts may be those of one cluster."""
    if found is None:
        return False
    low, high = (found.value + side * 2.0 * found.standard_error for side in (-1.0, 1.0))
    return low <= 1.0 and 1.0 / LARGEST_DISPERSION <= high <= LARGEST_DISPERSION


@dataclass(frozen=True, kw_only=True, eq=False)
class Histogram:
    """A density on bins with its standard error.

    Parameters
    ----------
    edges
        Edges of the bins (bins + 1,), m/s for speeds and s for times.
    density, standard_error
        Mean density in each bin and its standard error (bins,), per unit of the edges. The density
        of a bin has no bias but that of the step.
    outside
        Share of what lies beyond the bins.

    See Also
    --------
    stochvi.statistics.PairStatistics : The statistics that hold it.
    """

    edges: Vector
    density: Vector
    standard_error: Vector
    outside: float

    @property
    def middles(self) -> Vector:
        """Geometric means of the edges."""
        return np.asarray(np.sqrt(self.edges[1:] * self.edges[:-1]))


def histogram(counts: Matrix, edges: Vector, all_of: Vector) -> Histogram:
    """The histogram of counts (paths, BINS + 2), whose first and last columns lie outside of the
    bins, of `all_of` (paths,) that there are."""
    inside = counts[:, 1:-1]
    shares = [ratio_and_error(column, all_of) for column in inside.T]
    width = np.diff(edges)
    return Histogram(
        edges=edges,
        density=np.array([value for value, _ in shares]) / width,
        standard_error=np.array([error for _, error in shares]) / width,
        outside=max(1.0 - float(inside.sum() / all_of.sum()), 0.0),
    )


def fitted_exponent(fits: NDArray[np.float64], ranges: tuple[tuple[float, float], ...]) -> Estimate:
    """Exponent a of a density w^a by maximum likelihood, from impacts within a range of speeds.

    In u = ln(w / start), 0 <= u < L, the density is proportional to e^((a + 1) u). Its mean m(a) =
    L / (1 - e^(-(a + 1) L)) - 1 / (a + 1) is put equal to that seen; the error is that of the mean
    over independent paths. The density is a pure power only in the limit of slow impacts. The bias
    is the distance to that limit, if the fitted exponent changes in proportion to the mean speed of
    the impacts in the range. The second, shorter range shows this change.
    """
    (value, error), (other, _) = (
        _exponent(fits[:, number, 0], fits[:, number, 1], math.log(high / low))
        for number, (low, high) in enumerate(ranges)
    )
    low, high = ranges[0]
    long, short = (ratio_and_error(fits[:, k, 2], fits[:, k, 0])[0] for k in range(2))
    # where all impacts lie in the shorter range, the two fits do not differ
    bias = abs(value - other) * long / (long - short) if long > short else None
    return Estimate(
        value=value, standard_error=error, bias=bias,
        how=f"{fits[:, 0, 0].sum():.0f} impacts of {low:.3g} to {high:.3g} m/s; bias from "
        "the slower half of that",
    )  # fmt: skip


STEEPEST = 50.0
"""Largest magnitude of an exponent that is looked for."""

SMALL = 1e-6
"""Slope times range up to which the mean is taken as that of an even density, to first order."""


def _exponent(numbers: Vector, sums: Vector, length: float) -> tuple[float, float]:
    mean, error = ratio_and_error(sums, numbers)

    def centre(slope: float) -> float:
        t = slope * length
        if abs(t) < SMALL:
            return length * (0.5 + t / 12.0)
        return length * (1.0 / -math.expm1(-t) - 1.0 / t)

    slope = float(brentq(lambda s: centre(s) - mean, -STEEPEST, STEEPEST))
    step = 1e-4
    derivative = (centre(slope + step) - centre(slope - step)) / (2.0 * step)
    return slope - 1.0, error / derivative
