"""The density C exp(slope x - curvature x^2 / 2) between two stops, and its moments.

With curvature > 0 it is a truncated normal distribution, cut at the stops; with curvature <= 0 it
is largest at a stop. Everything is computed relative to the largest value of the density. Results
therefore keep all their digits also for stops far out in the tail and for very small gaps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.quadrature import gauss_legendre

NODES, WEIGHTS = gauss_legendre(64)
"""Nodes and weights of the Gauss-Legendre rule in each panel of the integral over a density."""

CUT = 50.0
"""Panels end where the density has fallen to e^-CUT of its largest value, far below rounding."""


@dataclass(frozen=True, kw_only=True)
class TruncatedNormal:
    """Density proportional to exp(slope x - curvature x^2 / 2) on lower <= x <= upper.

    Parameters
    ----------
    slope, curvature
        1/m and 1/m^2; a normal distribution N(m, s^2) has slope m / s^2 and curvature 1 / s^2.
    lower, upper
        Stops, m; None for no stop. On a side without a stop the density must fall towards
        infinity: curvature > 0, or curvature = 0 with a slope of the right sign.

    Examples
    --------
    >>> law = TruncatedNormal(slope=0.0, curvature=1.0, lower=-1.0, upper=1.0)
    >>> round(law.variance, 12)
    0.291125094773
    """

    slope: float
    curvature: float
    lower: float | None = None
    upper: float | None = None

    def __post_init__(self) -> None:
        if not self._integrable():
            raise ValueError(
                f"the density must fall towards a side without a stop, got slope {self.slope:g}, "
                f"curvature {self.curvature:g} and stops {self.lower} and {self.upper}"
            )

    def _integrable(self) -> bool:
        if not (math.isfinite(self.slope) and math.isfinite(self.curvature)):
            return False
        if self.curvature > 0.0 or (self.lower is not None and self.upper is not None):
            return True
        falls_left = self.slope > 0.0 or self.lower is not None
        falls_right = self.slope < 0.0 or self.upper is not None
        return self.curvature == 0.0 and falls_left and falls_right

    @cached_property
    def peak(self) -> float:
        """Place of the largest density, m: the origin of the centred quantities below."""
        low = -math.inf if self.lower is None else self.lower
        high = math.inf if self.upper is None else self.upper
        if self.curvature > 0.0:
            return min(max(self.slope / self.curvature, low), high)
        if math.isinf(low) or math.isinf(high):
            return low if math.isinf(high) else high
        # log density at `high` less that at `low`
        rise = (high - low) * (self.slope - self.curvature * (low + high) / 2.0)
        return high if rise > 0.0 else low

    def _relative_log(self, offset: NDArray[np.float64]) -> NDArray[np.float64]:
        """Log density at peak + offset, less that at the peak."""
        return offset * (self._slope_at(self.peak) - self.curvature * offset / 2.0)

    def _slope_at(self, x: float) -> float:
        """Derivative of the log density, without rounding errors at a peak between the stops."""
        if self.curvature > 0.0 and x == self.slope / self.curvature:
            return 0.0
        return self.slope - self.curvature * x

    @cached_property
    def _quadrature(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Offsets of the nodes from the peak, and weights that include the density."""
        edges = [(start, end) for start, end in self._panels() if end > start]
        starts, ends = (np.array(column)[:, None] for column in zip(*edges, strict=True))
        offset = ((starts + ends) / 2.0 + (ends - starts) / 2.0 * NODES).ravel()
        weight = ((ends - starts) / 2.0 * WEIGHTS).ravel() * np.exp(self._relative_log(offset))
        return offset, weight

    def _panels(self) -> list[tuple[float, float]]:
        """Intervals, as offsets from the peak, in which the density is monotone; outside all of
        them it is negligible."""
        low = -math.inf if self.lower is None else self.lower - self.peak
        high = math.inf if self.upper is None else self.upper - self.peak
        if self.curvature > 0.0 or self.lower is None or self.upper is None:
            left = 0.0 if low == 0.0 else max(-self._reach(self.peak, -1.0), low)
            right = 0.0 if high == 0.0 else min(self._reach(self.peak, 1.0), high)
            return [(left, 0.0), (0.0, right)]
        if self.curvature == 0.0:
            turn = high if self.slope <= 0.0 else low
        else:
            turn = min(max(self.slope / self.curvature - self.peak, low), high)
        left = min(low + self._reach(self.lower, 1.0), turn)
        right = max(high - self._reach(self.upper, -1.0), turn)
        return [(low, left), (right, high)]

    def _reach(self, start: float, direction: float) -> float:
        """Distance from `start` at which the density has fallen to e^-CUT of its largest value;
        infinite if there is none."""
        fall = max(-direction * self._slope_at(start), 0.0)
        bend = 2.0 * self.curvature * CUT
        if bend >= 0.0:
            total = fall + math.hypot(fall, math.sqrt(bend))
        elif fall == 0.0 or bend / fall / fall < -1.0:
            return math.inf
        else:
            total = fall * (1.0 + math.sqrt(1.0 + bend / fall / fall))
        return 2.0 * CUT / total if total > 0.0 else math.inf

    @cached_property
    def _mass(self) -> float:
        return float(self._quadrature[1].sum())

    def expect(self, values: NDArray[np.float64]) -> float:
        """Mean of `values`, given at the nodes `peak + offset`."""
        return float(values @ self._quadrature[1]) / self._mass

    @cached_property
    def mean(self) -> float:
        """Mean of x, m."""
        return self.peak + self.expect(self._quadrature[0])

    @cached_property
    def variance(self) -> float:
        """Variance of x, m^2."""
        offset = self._quadrature[0]
        return self.expect((offset - self.expect(offset)) ** 2)

    @cached_property
    def mean_square(self) -> float:
        """Mean square of x, m^2."""
        return self.expect((self.peak + self._quadrature[0]) ** 2)

    def density(self, x: ArrayLike) -> NDArray[np.float64]:
        """Probability density at x, 1/m; zero outside the stops."""
        x = np.asarray(x, dtype=float)
        low = -math.inf if self.lower is None else self.lower
        high = math.inf if self.upper is None else self.upper
        inside = (x >= low) & (x <= high)
        with np.errstate(under="ignore"):
            log = self._relative_log(np.where(inside, x, self.peak) - self.peak)
            return np.where(inside, np.exp(log) / self._mass, 0.0)

    def density_at(self, x: float | None) -> float:
        """Density at one place; 0 for the place of a stop that does not exist."""
        return 0.0 if x is None else float(self.density(x))

    def log_density_at(self, x: float) -> float:
        """Logarithm of the density between the stops, also where the density itself underflows."""
        return float(self._relative_log(np.asarray(x - self.peak))) - math.log(self._mass)


def normal_density(x: ArrayLike, mean: float, deviation: float) -> NDArray[np.float64]:
    """Density of a normal distribution of this mean and standard deviation.

    >>> float(normal_density(1.0, 1.0, 2.0)) * 2.0 * math.sqrt(2.0 * math.pi)
    1.0
    """
    away = (np.asarray(x, dtype=float) - mean) / deviation
    return np.asarray(np.exp(-0.5 * away**2) / (deviation * math.sqrt(2.0 * math.pi)))
