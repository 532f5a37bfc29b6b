"""Distributions of displacement and impact speed, and rates of crossings. Chapters: the beta
distribution; the density C exp(slope x - curvature x^2 / 2) between stops; many of them at once;
impact speeds, crossing rates and their balances; passages of a level at equal samples."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple, overload

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv, gammaln, ndtr, ndtri, psi

from stochvi.mathematics.numerics import (
    Booleans,
    Matrix,
    Vector,
    gauss_legendre,
    gauss_panels,
    root_between,
)

# ------------------------------------------------------------------------------
# The beta distribution on [0, 1] of a given mean and standard deviation: moments, and rules that
# stand for it.
# ------------------------------------------------------------------------------


CELL_NODES = 8
"""Number of Gauss-Legendre nodes in each cell of probability."""

CONCENTRATED = 1e8
"""alpha + beta beyond which the distribution counts as normal: its skewness is below 1e-4."""


class BetaDistribution(NamedTuple):
    """The distribution with the density r^(alpha - 1) (1 - r)^(beta - 1) / B(alpha, beta).

    alpha = mean k and beta = (1 - mean) k with k = mean (1 - mean) / std^2 - 1, which needs
    0 < std < sqrt(mean (1 - mean)).

    >>> law = BetaDistribution(0.7, 0.1)
    >>> round(law.alpha, 9), round(law.beta, 9)
    (14.0, 6.0)
    """

    mean: float
    std: float

    @property
    def concentration(self) -> float:
        """alpha + beta."""
        return self.mean * (1.0 - self.mean) / self.std**2 - 1.0

    @property
    def alpha(self) -> float:
        """Exponent of r, plus 1."""
        return self.mean * self.concentration

    @property
    def beta(self) -> float:
        """Exponent of 1 - r, plus 1."""
        return (1.0 - self.mean) * self.concentration

    @property
    def mean_logarithm(self) -> float:
        """E ln r."""
        if self.concentration > CONCENTRATED:
            return math.log(self.mean) - 0.5 * (self.std / self.mean) ** 2
        return float(psi(self.alpha) - psi(self.alpha + self.beta))

    def moment(self, power: float) -> float:
        """E r^power for any real power; infinite up to -alpha.

        >>> law = BetaDistribution(0.7, 0.1)
        >>> round(law.moment(2.0), 12), law.moment(-14.0)
        (0.5, inf)
        """
        a, b = self.alpha, self.beta
        if a + power <= 0.0:
            return math.inf
        if self.concentration > CONCENTRATED:
            share = 0.5 * power * (power - 1.0) * (self.std / self.mean) ** 2
            return float(self.mean**power * (1.0 + share))
        return math.exp(gammaln(a + power) + gammaln(a + b) - gammaln(a) - gammaln(a + b + power))

    def rule(self, count: int) -> tuple[Vector, Vector]:
        """Nodes and weights of Gauss's rule, exact for polynomials of degree 2 count - 1."""
        return _rule(self, count)

    def cells(self, count: int) -> tuple[Vector, Vector]:
        """Middles and widths of uniform distributions whose equal mixture stands for this one.

        Each has the mean and, within [0, 1], the variance of one of `count` cells of equal
        probability. Mean and variance of the mixture are exact. Ends of a cell may lie in the next.
        """
        return _cells(self, count)


@cache
def _rule(law: BetaDistribution, count: int) -> tuple[Vector, Vector]:
    """Gauss's rule from the recurrence of Jacobi polynomials (Golub and Welsch 1969)."""
    p, q, n = law.beta - 1.0, law.alpha - 1.0, np.arange(1.0, count)
    size = 2.0 * n + p + q
    first = (q - p) / (p + q + 2.0)
    diagonal = np.append(first, (q - p) * (q + p) / (size * (size + 2.0)))
    square = 4.0 * n * (n + p) * (n + q) / (size**2 * (size + 1.0))
    # (n + p + q) / (size - 1) is 1 for n = 1, where p + q may be -1
    square[1:] *= (n[1:] + p + q) / (size[1:] - 1.0)
    nodes, vectors = scipy.linalg.eigh_tridiagonal(diagonal, np.sqrt(square))
    return np.clip((1.0 + nodes) / 2.0, 0.0, 1.0), vectors[0] ** 2


@cache
def _cells(law: BetaDistribution, count: int) -> tuple[Vector, Vector]:
    u, weights = gauss_panels(np.linspace(0.0, 1.0, count + 1), CELL_NODES)
    normal = law.concentration > CONCENTRATED
    quantiles = law.mean + law.std * ndtri(u) if normal else betaincinv(law.alpha, law.beta, u)
    r: Matrix = quantiles.reshape(count, CELL_NODES)
    share = weights.reshape(count, CELL_NODES) * count
    middles = np.sum(share * r, axis=1)
    variances = np.sum(share * (r - middles[:, None]) ** 2, axis=1)
    room = 2.0 * np.minimum(middles, 1.0 - middles)
    widths = np.minimum(np.sqrt(12.0 * variances), room)
    # what quadrature and the ends of the range leave, in one shift and one stretch
    mean = middles.mean()
    spread = math.sqrt(float(np.mean((middles - mean) ** 2 + widths**2 / 12.0)))
    stretch = law.std / spread
    return np.clip(law.mean + stretch * (middles - mean), 0.0, 1.0), stretch * widths


# ------------------------------------------------------------------------------
# The density C exp(slope x - curvature x^2 / 2) between two stops, and its moments.
#
# With curvature > 0 it is a truncated normal distribution, cut at the stops; with curvature <= 0 it
# is largest at a stop. Everything is computed relative to the largest value of the density. Results
# therefore keep all their digits also for stops far out in the tail and for very small gaps.
# ------------------------------------------------------------------------------


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


# ------------------------------------------------------------------------------
# Many laws C exp(slope x - curvature x^2 / 2) between stops at once: masses, moments, ends.
#
# They do for arrays what `TruncatedNormal` does for one law. All numbers are relative to the
# largest value of each density; panels end where it has fallen by e^-CUT. So tails and narrow gaps
# keep their digits.
# ------------------------------------------------------------------------------


PANEL_NODES, PANEL_WEIGHTS = gauss_legendre(32)
POWERS = PANEL_WEIGHTS[:, None] * PANEL_NODES[:, None] ** np.arange(3)
"""Nodes of the two panels of each law, and the matrix that turns densities there into moments 0 to
2. A normal distribution out to ten deviations keeps 1e-12."""


class TruncatedNormals(NamedTuple):
    """Moments of many laws, in the units of x.

    `lower` and `upper` are the densities at the stops (0 where there is none), `at_mean` that at
    the mean.
    """

    mean: Vector
    variance: Vector
    lower: Vector
    upper: Vector
    at_mean: Vector


def cut_laws(slope: Vector, curvature: Vector, lower: Vector, upper: Vector) -> TruncatedNormals:
    """The laws of these slopes (1/m) and curvatures (1/m^2); stops in m, infinite for none.

    A law that cannot be normalised, or whose digits do not suffice, is not a number.

    Examples
    --------
    >>> one = np.ones(1)
    >>> print(f"{cut_laws(0.0 * one, one, -one, one).variance[0]:.12f}")
    0.291125094773
    """
    with np.errstate(all="ignore"):
        peak = _peak(slope, curvature, lower, upper)
        inside = (curvature > 0.0) & (peak == slope / curvature)
        tilt = np.where(inside, 0.0, slope - curvature * peak)
        raw = np.zeros((3, len(slope)))
        for start, end in _panels(peak, slope, curvature, lower, upper):
            raw += _panel_moments(start, np.maximum(end, start), tilt, curvature)
        mass = raw[0]
        first, second = raw[1:] / mass
        held = np.isfinite(mass) & (mass > 0.0) & _integrable(slope, curvature, lower, upper)
        mass = np.where(held, mass, np.nan)
        variance = second - first**2

        def density(offset: Vector) -> Vector:
            return np.asarray(np.exp(offset * (tilt - curvature * offset / 2.0)) / mass)

        return TruncatedNormals(
            mean=peak + first,
            variance=np.where(variance > 0.0, variance, np.nan),
            lower=np.where(np.isfinite(lower), density(lower - peak), 0.0),
            upper=np.where(np.isfinite(upper), density(upper - peak), 0.0),
            at_mean=density(first),
        )


def _integrable(slope: Vector, curvature: Vector, lower: Vector, upper: Vector) -> Booleans:
    falls_left = np.isfinite(lower) | (slope > 0.0)
    falls_right = np.isfinite(upper) | (slope < 0.0)
    both = np.isfinite(lower) & np.isfinite(upper)
    held: Booleans = (curvature > 0.0) | both | ((curvature == 0.0) & falls_left & falls_right)
    return held


def _peak(slope: Vector, curvature: Vector, lower: Vector, upper: Vector) -> Vector:
    """Place of the largest value of each density, m."""
    rise = (upper - lower) * (slope - curvature * (lower + upper) / 2.0)
    higher = np.where(rise > 0.0, upper, lower)
    only = np.where(np.isfinite(lower), lower, upper)
    end = np.where(np.isfinite(upper - lower), higher, only)
    return np.where(curvature > 0.0, np.clip(slope / curvature, lower, upper), end)


def _panels(
    peak: Vector, slope: Vector, curvature: Vector, lower: Vector, upper: Vector
) -> tuple[tuple[Vector, Vector], tuple[Vector, Vector]]:
    """Two intervals outside which each density is negligible, as offsets from its peak.

    On either side of an inner peak; or at either stop, where a density leans on both.
    """
    low, high = lower - peak, upper - peak
    left = np.maximum(-_reach(peak, -1.0, slope, curvature), low)
    right = np.minimum(_reach(peak, 1.0, slope, curvature), high)
    leaning = (curvature <= 0.0) & np.isfinite(high - low)
    flat = np.where(slope <= 0.0, high, low)
    valley = np.clip(slope / curvature - peak, low, high)
    turn = np.where(curvature == 0.0, flat, valley)
    from_lower = np.minimum(low + _reach(lower, 1.0, slope, curvature), turn)
    from_upper = np.maximum(high - _reach(upper, -1.0, slope, curvature), turn)
    none = np.zeros_like(peak)
    first = (np.where(low == 0.0, 0.0, left), none)
    second = (none, np.where(high == 0.0, 0.0, right))
    return (
        (np.where(leaning, low, first[0]), np.where(leaning, from_lower, first[1])),
        (np.where(leaning, from_upper, second[0]), np.where(leaning, high, second[1])),
    )


def _reach(start: Vector, direction: float, slope: Vector, curvature: Vector) -> Vector:
    """How far from `start` each density has fallen by e^-CUT; infinite if it never does."""
    fall = np.maximum(-direction * (slope - curvature * start), 0.0)
    bend = 2.0 * curvature * CUT
    concave = fall + np.hypot(fall, np.sqrt(np.maximum(bend, 0.0)))
    hollow = fall * (1.0 + np.sqrt(1.0 + bend / fall / fall))
    total = np.where(bend >= 0.0, concave, hollow)
    return np.where(total > 0.0, 2.0 * CUT / total, np.inf)


def _panel_moments(start: Vector, end: Vector, tilt: Vector, curvature: Vector) -> Vector:
    """Integrals of offset^k times the density relative to its peak, k = 0 to 2, as rows."""
    half, centre = (end - start) / 2.0, (end + start) / 2.0
    # log density at centre + half t: a quadratic in t
    constant = centre * (tilt - curvature * centre / 2.0)
    linear = half * (tilt - curvature * centre)
    square = -curvature * half**2 / 2.0
    log = square[:, None] * PANEL_NODES
    log += linear[:, None]
    log *= PANEL_NODES
    log += constant[:, None]
    local = half[:, None] * (np.exp(log, out=log) @ POWERS)
    # t^k about the centre -> offset^k, by the binomial theorem
    t0, t1, t2 = (local[:, k] * half**k for k in range(3))
    return np.array([t0, t1 + centre * t0, t2 + centre * (2.0 * t1 + centre * t0)])


# ------------------------------------------------------------------------------
# Impact statistics: distributions of impact speed, crossing rates, and the balances they must obey.
# ------------------------------------------------------------------------------


COLLAPSE_RESTITUTION = math.exp(-math.pi / math.sqrt(3.0))
"""At and below this restitution the rate of impacts under white noise is infinite (S. J. Cornell,
M. R. Swift and A. J. Bray, Phys. Rev. Lett. 81 (1998) 1142)."""


class StopStatistics(NamedTuple):
    """Impacts on one stop per second, and sums of their speeds w and of w^2 per second (F1, F2)."""

    rate: float
    speed_rate: float
    speed_square_rate: float


NO_STOP = StopStatistics(0.0, 0.0, 0.0)


ROUNDING = 1e-9
"""Relative rounding error of sums of impact speeds."""


def more_than_counted(rate: float, speed_rate: float, speed_square_rate: float) -> bool:
    """Whether F1 is more than the counted impacts have, so that F1 over their rate is no mean
    speed: a mean is at most the rms.

    A mass at rest on its stop has part in F1, and impacts slower than the threshold of the rate.

    >>> more_than_counted(1.0, 3.0, 5.0), more_than_counted(2.0, 3.0, 5.0)
    (True, False)
    """
    if rate <= 0.0:
        return speed_rate > 0.0
    return (speed_rate / rate) ** 2 > (1.0 + ROUNDING) * speed_square_rate / rate


class ContactStatistics(NamedTuple):
    """Statistics of the contacts with a compliant stop, besides the rate at which they begin.

    `probability` is the share of time in contact: the mass is beyond the stop, and the damper of
    the stop, if it has one, has not brought the force back to zero. `force` is the mean force over
    all time. `peak_force` is the mean over contacts of their largest force, None if the method has
    no law for it. `power` is the mean power that the stop takes.
    """

    probability: float
    force: float
    peak_force: float | None
    power: float = 0.0


def gaussian_stop(density: float, velocity_mean_square: float) -> StopStatistics:
    """Statistics of a stop where x has the density p, and v is N(0, s^2) and independent of x.

    Impact speeds are Rayleigh distributed: rate = p s / sqrt(2 pi), F1 = p s^2 / 2,
    F2 = p s^3 sqrt(2 / pi). Exact for elastic stops (B 13.44).

    >>> round(gaussian_stop(0.3544374526, 1.0).rate, 6)
    0.1414
    """
    s = math.sqrt(velocity_mean_square)
    return StopStatistics(
        density * s / math.sqrt(2.0 * math.pi),
        density * s**2 / 2.0,
        density * s**3 * math.sqrt(2.0 / math.pi),
    )


@cache
def corner_exponent(restitution: float) -> float:
    """Exponent beta of the density at a stop under white noise, p(stop, v) ~ |v|^-beta near v = 0.

    The root of R^(beta - 2) = 2 sin((1 + 2 beta) pi / 6) other than 2, which solves it for every
    R: below 2 for R > exp(-pi / sqrt 3), above 2 for smaller R, 5/2 at R = 0. Impact speeds have
    the density w^(1 - beta) near 0. From beta = 2 on, the rate of impacts faster than w therefore
    grows without limit, like w^(2 - beta), as w decreases. Beta = 5/2 follows from the reflected
    motion at R = 0 that leaves the stop at once (J. Bertoin, Ann. Probab. 35 (2007) 2021): if it
    starts at the speed u, it meets the stop again at a speed above w with a probability
    ~ (u / w)^(1/2).

    >>> [round(corner_exponent(r), 4) for r in (0.0, 0.1, 0.3, 0.5, 0.8, 1.0)]
    [2.5, 2.1733, 1.6009, 1.0, 0.2857, 0.0]
    """
    if restitution == 0.0:
        return 2.5
    if restitution == 1.0:
        return 0.0

    def balance(beta: float) -> float:
        sine = 2.0 * math.sin((1.0 + 2.0 * beta) * math.pi / 6.0)
        return (beta - 2.0) * math.log(restitution) - math.log(sine)

    # beta = 2 solves the equation for every R: the bracket excludes that root
    if restitution > COLLAPSE_RESTITUTION:
        low, high = 0.0, 2.0 - 1e-9
    else:
        low, high = 2.0 + 1e-9, 2.5 - 1e-12
    if balance(low) * balance(high) > 0.0:
        return 2.0 if abs(restitution / COLLAPSE_RESTITUTION - 1.0) < 1e-3 else high
    return root_between(balance, low, high)


@cache
def equivalent_restitution(law: BetaDistribution) -> float:
    """The constant restitution with the same exponent beta as one that scatters.

    A random R, drawn at each impact, turns the equation of `corner_exponent` into
    E R^(beta - 2) = 2 sin((1 + 2 beta) pi / 6): slow impacts that leave at v have arrived at v / R.
    The rate of impacts is therefore infinite where E ln R <= -pi / sqrt 3, and there the result is
    the geometric mean of R.

    >>> round(equivalent_restitution(BetaDistribution(0.7, 0.1)), 4)
    0.6801
    """

    def balance(beta: float) -> float:
        return math.log(law.moment(beta - 2.0) / (2.0 * math.sin((1.0 + 2.0 * beta) * math.pi / 6)))

    typical = math.exp(law.mean_logarithm)
    if typical <= COLLAPSE_RESTITUTION:
        low, high = 2.0 + 1e-9, 2.5 - 1e-12
    else:
        low, high = max(0.0, 2.0 - law.alpha) + 1e-9, 2.0 - 1e-9
    if not balance(low) * balance(high) < 0.0:
        return typical
    beta = root_between(balance, low, high)
    sine = 2.0 * math.sin((1.0 + 2.0 * beta) * math.pi / 6.0)
    return float(sine ** (1.0 / (beta - 2.0)))


@overload
def rice_rate(distance: float, displacement_std: float, velocity_std: float) -> float: ...
@overload
def rice_rate(
    distance: Vector, displacement_std: float | Vector, velocity_std: float | Vector
) -> Vector: ...
def rice_rate(
    distance: float | Vector, displacement_std: float | Vector, velocity_std: float | Vector
) -> float | Vector:
    """Rate at which a Gaussian process crosses a level outwards, one side, 1/s (Rice 1944).

    nu = s_v / (2 pi s_x) exp(-d^2 / (2 s_x^2)), d from the mean; numbers, or arrays of one shape.

    >>> round(rice_rate(3.0, 1.0, 2 * math.pi * 10.0) * 3600.0, 2)
    399.92
    """
    shape = np.exp(-0.5 * (distance / displacement_std) ** 2)
    rate = velocity_std / (2.0 * math.pi * displacement_std) * shape
    return rate if np.ndim(rate) else float(rate)


# ------------------------------------------------------------------------------
# Passages of a level by a stationary normal process that is sampled at equal steps.
# ------------------------------------------------------------------------------


WIDEST = 9.0
"""Upper limit of the integral over the rise between two samples, in its standard deviations."""

NODES_OF_PASSAGES = 128
"""Number of nodes of the integral over the rise: half as many give the same 12 digits for levels up
to 8 sigma."""


def moments_of_rises(level: float, variance: float, change: float) -> tuple[float, float, float]:
    """Moments of order 0, 1 and 2 of the rise between two samples, over upward passages of a level.

    A sample y1 and the one before it, y0, contribute where y0 < u <= y1, u the level; otherwise 0.
    The rise d = y1 - y0 and the middle m = (y0 + y1) / 2 of two successive samples are independent
    normal variables. The level u lies between the samples if |m - u| <= d / 2:

        E d^k = int_0^inf d^k p(d) [Phi((u + d / 2) / s_m) - Phi((u - d / 2) / s_m)] dd.

    Parameters
    ----------
    level
        u, from the mean of the process, m.
    variance
        Variance of the process, m^2.
    change
        1 less the correlation of two successive samples, dimensionless, in (0, 2).

    Examples
    --------
    E d has the closed form sigma phi(u / sigma) (1 - rho):

    >>> _, rise, _ = moments_of_rises(2.0, 1.0, 0.1)
    >>> round(rise / (0.1 * math.exp(-2.0) / math.sqrt(2.0 * math.pi)), 12)
    1.0
    """
    spread = math.sqrt(2.0 * change * variance)
    middle = math.sqrt(0.5 * (2.0 - change) * variance)
    nodes, weights = gauss_legendre(NODES_OF_PASSAGES)
    rise = 0.5 * WIDEST * spread * (nodes + 1.0)
    density = np.exp(-0.5 * (rise / spread) ** 2) / (math.sqrt(2.0 * math.pi) * spread)
    # computed from upper tails, which keep their digits at high levels
    between = ndtr(-(level - 0.5 * rise) / middle) - ndtr(-(level + 0.5 * rise) / middle)
    share = 0.5 * WIDEST * spread * weights * density * between
    found = [float(share @ rise**power) for power in range(3)]
    return found[0], found[1], found[2]
