"""The three forms: from a trial response to the linearised stops that it calls for."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import log_ndtr, logsumexp, ndtr

from stochvi.collisions import NO_STOP, StopStatistics, gaussian_stop, rice_rate
from stochvi.cut_normal import CutNormal
from stochvi.scenes import System

ROOT_TWO_PI = math.sqrt(2.0 * math.pi)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)


class Trial(NamedTuple):
    """A response, and the linearised stops that it calls for, per unit mass.

    `stop_force`, `stiffness` and `damping` are m_F, k and beta; `density_at_mean` is that of x.
    `rise` is the factor by which the density right at a stop exceeds that of the family of laws.
    """

    mean: float
    variance: float
    velocity_mean_square: float
    density_at_mean: float
    stop_force: float
    stiffness: float
    damping: float
    lower: StopStatistics
    upper: StopStatistics
    rise: float = 1.0


Unknowns = NDArray[np.float64]


class Form(NamedTuple):
    """One way to linearise: where to start, and what a set of unknowns stands for."""

    start: Callable[[System], Unknowns]
    trial: Callable[[System, Unknowns], Trial]


def choose(form: str, variant: str, system: System) -> Form:
    """The form for a scene whose only stop, where it has one stop, is the upper one."""
    book = variant == "book"
    if form == "motion":
        return Form(_motion_start, lambda system, x: _motion_trial(system, x, book))
    if form == "force":
        return Form(_force_start, lambda system, x: _force_trial(system, x, book))
    if system.lower is None or system.upper is None:
        return Form(_one_stop_start, _one_stop_trial)
    floor = _curvature_floor(system)
    return Form(_closure_start, lambda system, x: _closure_trial(system, x, floor))


def restitutions(system: System) -> tuple[float, float]:
    """R at the lower and the upper stop; 1 (no loss) where there is none."""
    lower, upper = system.restitution_lower, system.restitution_upper
    return 1.0 if lower is None else lower, 1.0 if upper is None else upper


# The moment closure.


def _closure_start(system: System) -> Unknowns:
    return np.array([system.load, system.omega**2, 0.0])


def _curvature_floor(system: System) -> float:
    """kappa D^2 of an evenly filled, very narrow gap of half width D, the least that is needed.

    There the balance of forces asks for a density 1 / ((1 + R) D) at the stops. A law that is
    more hollow than this would heap up mass at a far stop that nothing drives there.
    """
    wanted = 1.0 / (1.0 + min(restitutions(system)))

    def excess(curvature: float) -> float:
        law = CutNormal(slope=0.0, curvature=curvature, lower=-1.0, upper=1.0)
        return law.density_at(1.0) - wanted

    # for R = 0 the floor is -3.53, for R = 1 it is 0
    floor: float = brentq(excess, -4.0, 0.5)
    return floor


def _closure_trial(system: System, unknowns: Unknowns, floor: float) -> Trial:
    """Unknowns lambda, kappa and log s_v; two stops.

    Below its floor kappa stays there, and the density right at the stops rises instead, as for
    a single stop.
    """
    assert system.lower is not None and system.upper is not None
    slope, curvature, log_speed = unknowns.tolist()
    least = floor / ((system.upper - system.lower) / 2.0) ** 2
    rise = 1.0 + max(least - curvature, 0.0)
    law = CutNormal(
        slope=slope,
        curvature=max(curvature, least),
        lower=system.lower,
        upper=system.upper,
    )
    return _closed(
        system,
        mean=law.mean,
        variance=law.variance,
        speed=math.exp(log_speed),
        density_lower=rise * law.density_at(system.lower),
        density_upper=rise * law.density_at(system.upper),
        density_at_mean=law.density_at(law.mean),
        rise=rise,
    )


def _closed(
    system: System,
    *,
    mean: float,
    variance: float,
    speed: float,
    density_lower: float,
    density_upper: float,
    density_at_mean: float,
    rise: float = 1.0,
) -> Trial:
    """m_F = mean stop force, k = its covariance with x / Var x, beta = impact loss / E v^2.

    With F1 and F2 of the law: m_F = (1 + R_u) F1_u - (1 + R_l) F1_l, and so on. Together with
    the exact variances of the linear system these are the balances of force, virial and energy.
    """
    r_lower, r_upper = restitutions(system)
    lower = gaussian_stop(density_lower, speed**2)
    upper = gaussian_stop(density_upper, speed**2)
    push = (1.0 + r_lower) * lower.speed_rate
    pull = (1.0 + r_upper) * upper.speed_rate
    covariance = 0.0
    if system.lower is not None:
        covariance += push * (mean - system.lower)
    if system.upper is not None:
        covariance += pull * (system.upper - mean)
    loss = (1.0 - r_lower**2) * lower.speed_square_rate
    loss += (1.0 - r_upper**2) * upper.speed_square_rate
    return Trial(
        mean=mean,
        variance=variance,
        velocity_mean_square=speed**2,
        density_at_mean=density_at_mean,
        stop_force=pull - push,
        stiffness=covariance / variance,
        damping=loss / (2.0 * speed**2),
        lower=lower,
        upper=upper,
        rise=rise,
    )


class OneStopLaw(NamedTuple):
    """Density of the distance y >= 0 from a single stop, scaled to unit deviation.

    The normal laws cut at the stop are a one-parameter family that ends in the exponential law,
    as their mean before the cut moves far beyond the stop. It is continued by exponential laws
    that stand `rise` times higher right at the stop: a thin layer, made of the ever lower
    bounces on an inelastic stop.
    """

    mean: float
    density_at_stop: float
    density_at_mean: float
    rise: float


def _one_stop_law(shape: float) -> OneStopLaw:
    """The law of one shape number t, a smooth scale through the whole family.

    Mean over deviation before the cut is e^t - 1 where t >= 0 (it may be thousands), and
    t / sqrt(1 + t) down to t = -1, the exponential law; below that, the rise is -t.
    """
    if shape < -1.0 + 1e-12:
        return OneStopLaw(1.0, max(-shape, 1.0), math.exp(-1.0), max(-shape, 1.0))
    mean = math.expm1(shape) if shape >= 0.0 else shape / math.sqrt(1.0 + shape)
    law = CutNormal(slope=mean, curvature=1.0, lower=0.0)
    deviation = math.sqrt(law.variance)
    return OneStopLaw(
        law.mean / deviation,
        law.density_at(0.0) * deviation,
        law.density_at(law.mean) * deviation,
        1.0,
    )


def _one_stop_start(system: System) -> Unknowns:
    """Shape of the law of an elastic stop, of unit speed and deviation."""
    assert system.upper is not None
    shape = -1.0
    if system.omega > 0.0:
        ratio = system.upper * system.omega - system.load / system.omega
        if ratio >= 0.0:
            shape = math.log1p(ratio)
        else:
            shape = 2.0 * ratio / (math.hypot(ratio, 2.0) - ratio)
    return np.array([shape, 0.0, 0.0])


def _one_stop_trial(system: System, unknowns: Unknowns) -> Trial:
    """Unknowns shape, log s_x and log s_v; an upper stop alone."""
    assert system.upper is not None
    shape, log_deviation, log_speed = unknowns.tolist()
    law, deviation = _one_stop_law(shape), math.exp(log_deviation)
    return _closed(
        system,
        mean=system.upper - law.mean * deviation,
        variance=deviation**2,
        speed=math.exp(log_speed),
        density_lower=0.0,
        density_upper=law.density_at_stop / deviation,
        density_at_mean=law.density_at_mean / deviation,
        rise=law.rise,
    )


# The form "motion".


def _motion_start(system: System) -> Unknowns:
    """The deviation that balances at unit speed, with the mean of the elastic law."""
    low = _motion_factor(min(restitutions(system)), book=False)

    def imbalance(log_deviation: float) -> float:
        deviation = math.exp(log_deviation)
        law = _normal_law(system, 0.0, deviation)
        return (system.omega * deviation) ** 2 - 1.0 + low * (1.0 - law.variance / deviation**2)

    if imbalance(0.0) >= 0.0:
        return np.zeros(3)
    return np.array([0.0, brentq(imbalance, 0.0, 1.0 - math.log(system.omega)), 0.0])


def _normal_law(system: System, mean: float, deviation: float) -> CutNormal:
    return CutNormal(
        slope=mean / deviation**2,
        curvature=deviation**-2,
        lower=system.lower,
        upper=system.upper,
    )


def _motion_factor(restitution: float, book: bool) -> float:
    """Mean stop force over p(stop) E v^2: (1 + R) / 2, or as printed (B 8.75, 13.12)."""
    return (1.0 + restitution**2) / 4.0 if book else (1.0 + restitution) / 2.0


def _motion_trial(system: System, unknowns: Unknowns, book: bool) -> Trial:
    """Unknowns asinh(m / s_x), log s_x and log s_v: m may lie thousands of s_x beyond a stop.

    m_F = s_v^2 (A_u p_u - A_l p_l), k = d m_F / d m, beta = sum (1 - R^2) p s_v / sqrt(2 pi), with
    A the factor above and p the cut density at a stop. The derivative of p at a stop c is
    p (c - mean of the cut law) / s_x^2.
    """
    bend, log_deviation, log_speed = unknowns.tolist()
    deviation, speed = math.exp(log_deviation), math.exp(log_speed)
    mean = deviation * math.sinh(bend)
    law = _normal_law(system, mean, deviation)
    r_lower, r_upper = restitutions(system)
    force = stiffness = damping = 0.0
    stops = []
    for stop, restitution, sign in ((system.lower, r_lower, -1.0), (system.upper, r_upper, 1.0)):
        hits = gaussian_stop(law.density_at(stop), speed**2)
        stops.append(hits)
        if stop is not None:
            push = 2.0 * _motion_factor(restitution, book) * hits.speed_rate
            force += sign * push
            stiffness += push * sign * (stop - law.mean) / deviation**2
            damping += (1.0 - restitution**2) * hits.rate
    return Trial(
        mean=mean,
        variance=deviation**2,
        velocity_mean_square=speed**2,
        # of the cut law at its own mean, since m may lie beyond a stop (B 13.20 where m = 0)
        density_at_mean=law.density_at(law.mean),
        stop_force=force,
        stiffness=stiffness,
        damping=damping,
        lower=stops[0],
        upper=stops[1],
    )


# The form "force".


def _force_start(system: System) -> Unknowns:
    """The deviation of the force that balances at unit speed without impact losses."""

    def imbalance(log_force: float) -> float:
        return 2.0 * log_force + _saturated(system, math.exp(log_force))[0]

    low, high = -1.0, 1.0
    while imbalance(low) > 0.0:
        low *= 2.0
    while imbalance(high) < 0.0:
        high *= 2.0
    return np.array([brentq(imbalance, low, high), 0.0])


def _saturated(system: System, force_deviation: float) -> tuple[float, float]:
    """Log of 1 / k = E dx/dF, and E x, for x = F / omega^2 held between the stops (B 8.79-8.87).

    F is N(load, s_F^2), so that k = omega^2 / P(F between omega^2 lower and omega^2 upper).
    """
    stiffness = system.omega**2
    low = -math.inf if system.lower is None else system.lower
    high = math.inf if system.upper is None else system.upper

    def reduced(x: float | NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray((stiffness * x - system.load) / force_deviation)

    if math.isfinite(high - low) and stiffness * (high - low) < force_deviation:
        # a narrow gap in the law of F: the difference of two tails would lose digits
        half = (high - low) / 2.0
        z = reduced(low + half * (1.0 + NODES))
        log_density = -0.5 * z * z - math.log(ROOT_TWO_PI * force_deviation)
        compliance = float(logsumexp(log_density, b=half * WEIGHTS))
        return compliance, high - half * float(WEIGHTS @ ndtr(z))
    below, above = float(reduced(low)), float(reduced(high))
    mean = system.load - force_deviation * (_mean_excess(above) - _mean_excess(-below))
    return _log_between(below, above) - math.log(stiffness), mean / stiffness


def _mean_excess(level: float) -> float:
    """E max(z - level, 0) of a standard normal z."""
    if math.isinf(level):
        return 0.0
    return math.exp(-0.5 * level**2) / ROOT_TWO_PI - level * float(ndtr(-level))


def _log_between(low: float, high: float) -> float:
    """Log of P(low < z < high) of a standard normal z, also far out in a tail."""
    if low > 0.0:
        low, high = -high, -low
    upper, lower = float(log_ndtr(high)), float(log_ndtr(low))
    return upper + math.log1p(-math.exp(lower - upper))


def _force_trial(system: System, unknowns: Unknowns, book: bool) -> Trial:
    """Unknowns log s_F and log s_v; k is the total stiffness, s_F = k s_x (B 8.82-8.85, 13.24)."""
    log_force, log_speed = unknowns.tolist()
    force_deviation, speed = math.exp(log_force), math.exp(log_speed)
    log_compliance, mean = _saturated(system, force_deviation)
    deviation = math.exp(log_force + log_compliance)
    stiffness = math.exp(-log_compliance)
    damping = 0.0
    stops = []
    for stop, restitution in zip((system.lower, system.upper), restitutions(system), strict=True):
        if stop is None:
            stops.append(NO_STOP)
            continue
        # Rice's rate of F through omega^2 stop, in lengths of F / k (B 13.33)
        distance = (system.omega**2 * stop - system.load) / stiffness
        rate = rice_rate(distance, deviation, speed)
        mean_square = speed**2 if book else 2.0 * speed**2
        # the book has no law of impact speeds, so no F1
        speed_rate = None if book else rate * math.sqrt(math.pi / 2.0) * speed
        stops.append(StopStatistics(rate, cast(float, speed_rate), rate * mean_square))
        damping += (1.0 - restitution**2) / 2.0 * rate * mean_square / speed**2
    return Trial(
        mean=mean,
        variance=deviation**2,
        velocity_mean_square=speed**2,
        density_at_mean=1.0 / (ROOT_TWO_PI * deviation),
        # E F = load holds by construction
        stop_force=system.load - system.omega**2 * mean,
        stiffness=stiffness - system.omega**2,
        damping=damping,
        lower=stops[0],
        upper=stops[1],
    )
