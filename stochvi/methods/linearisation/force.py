"""The form "force" between rigid stops: spring and stops together push with a Gaussian force."""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import log_ndtr, logsumexp, ndtr

from stochvi.mathematics.impact_rates import NO_STOP, StopStatistics, rice_rate
from stochvi.mathematics.quadrature import gauss_legendre
from stochvi.methods.linearisation.trial import ROOT_TWO_PI, Form, Trial, Unknowns, restitutions
from stochvi.scenes.scene import System

NODES, WEIGHTS = gauss_legendre(16)
"""Gauss-Legendre rule across a gap that is narrow in the law of the force."""


def rigid_force(book: bool) -> Form:
    """The form between rigid stops, with impact speeds of the book or Rayleigh ones."""
    return Form(_force_start, lambda system, x: _force_trial(system, x, book))


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
