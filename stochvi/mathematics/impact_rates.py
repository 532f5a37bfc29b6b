"""Impact statistics: distributions of impact speed, crossing rates, and the balances they must
obey."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple, overload

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.beta_distribution import BetaDistribution
from stochvi.mathematics.brent import root_between

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
