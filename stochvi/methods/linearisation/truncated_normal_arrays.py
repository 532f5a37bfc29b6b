"""Many laws C exp(slope x - curvature x^2 / 2) between stops at once: masses, moments, ends.

They do for arrays what `TruncatedNormal` does for one law. All numbers are relative to the largest
value of each density; panels end where it has fallen by e^-CUT. So tails and narrow gaps keep their
digits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Booleans, Vector
from stochvi.mathematics.quadrature import gauss_legendre
from stochvi.mathematics.truncated_normal import CUT


class Rule(NamedTuple):
    """Gauss' rule of a panel: its nodes, and the matrix that turns densities there into moments 0
    to 4."""

    nodes: Vector
    powers: Vector

    @classmethod
    def of(cls, count: int) -> Rule:
        """The rule with this many nodes."""
        nodes, weights = gauss_legendre(count)
        return cls(nodes, weights[:, None] * nodes[:, None] ** np.arange(5))


FINE, ROUGH = Rule.of(32), Rule.of(16)
"""Rules of the two panels of each law. A normal distribution out to ten deviations keeps 1e-12 by
the fine rule, and 1e-4 by the rough one, which is enough for a scale."""


class TruncatedNormals(NamedTuple):
    """Moments of many laws, in the units of x; central ones from the second on.

    `lower` and `upper` are the densities at the stops (0 where there is none), `at_mean` that at
    the mean.
    """

    mean: Vector
    variance: Vector
    third: Vector
    fourth: Vector
    lower: Vector
    upper: Vector
    at_mean: Vector


def cut_laws(
    slope: Vector, curvature: Vector, lower: Vector, upper: Vector, rule: Rule = FINE
) -> TruncatedNormals:
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
        raw = np.zeros((5, len(slope)))
        for start, end in _panels(peak, slope, curvature, lower, upper):
            raw += _panel_moments(start, np.maximum(end, start), tilt, curvature, rule)
        mass = raw[0]
        first, second, third, fourth = raw[1:] / mass
        held = np.isfinite(mass) & (mass > 0.0) & _integrable(slope, curvature, lower, upper)
        mass = np.where(held, mass, np.nan)
        variance = second - first**2

        def density(offset: Vector) -> Vector:
            return np.asarray(np.exp(offset * (tilt - curvature * offset / 2.0)) / mass)

        return TruncatedNormals(
            mean=peak + first,
            variance=np.where(variance > 0.0, variance, np.nan),
            third=third - 3.0 * first * second + 2.0 * first**3,
            fourth=fourth - 4.0 * first * third + 6.0 * first**2 * second - 3.0 * first**4,
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


def _panel_moments(
    start: Vector, end: Vector, tilt: Vector, curvature: Vector, rule: Rule
) -> Vector:
    """Integrals of offset^k times the density relative to its peak, k = 0 to 4, as rows."""
    half, centre = (end - start) / 2.0, (end + start) / 2.0
    # log density at centre + half t: a quadratic in t
    constant = centre * (tilt - curvature * centre / 2.0)
    linear = half * (tilt - curvature * centre)
    square = -curvature * half**2 / 2.0
    log = square[:, None] * rule.nodes
    log += linear[:, None]
    log *= rule.nodes
    log += constant[:, None]
    local = half[:, None] * (np.exp(log, out=log) @ rule.powers)
    # t^k about the centre -> offset^k, by the binomial theorem
    t0, t1, t2, t3, t4 = (local[:, k] * half**k for k in range(5))
    c = centre
    return np.array(
        [
            t0,
            t1 + c * t0,
            t2 + c * (2.0 * t1 + c * t0),
            t3 + c * (3.0 * t2 + c * (3.0 * t1 + c * t0)),
            t4 + c * (4.0 * t3 + c * (6.0 * t2 + c * (4.0 * t1 + c * t0))),
        ]
    )
