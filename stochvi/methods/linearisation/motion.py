"""The form "motion" between rigid stops: x has a normal law cut at the stops (B 8.58-8.77)."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from stochvi.mathematics.cut_normal import CutNormal
from stochvi.mathematics.impact_rates import gaussian_stop
from stochvi.methods.linearisation.trial import Form, Trial, Unknowns, restitutions
from stochvi.scenes.scene import System

STIFFENED = 2.0
"""Deviation of the mass on its spring alone, in those of the elastic law, from which the stops are
taken to govern the motion: narrow gaps and deep preloads."""


def rigid_motion(book: bool) -> Form:
    """The form between rigid stops, with the factors of the book or consistent ones."""

    def trial(system: System, unknowns: Unknowns) -> Trial:
        return _motion_trial(system, unknowns, book)

    elastic = Form(_elastic_start, trial)
    return Form(lambda system: _motion_start(system, book), trial, (elastic,))


def _motion_start(system: System, book: bool) -> Unknowns:
    """That of stops which govern the motion, or of the elastic law.

    In a narrow gap, and at a stop far inside the rest position r, the stop force has the slope
    k = A s_v^2 / s_x^2 and the mean k (m - c), A its factor and c the mean between the stops: of a
    narrow gap the cut law is even, of a deep preload exponential. The balances are then
    m = c + (1 - A) (r - c) and s_x^2 = (1 - A) s_v^2 / omega^2. Here c = 0 and s_v = 1.
    """
    stops = zip((system.lower, system.upper), restitutions(system), strict=True)
    factors = [motion_factor(r, book) for stop, r in stops if stop is not None]
    left = 1.0 - sum(factors) / len(factors)
    if left > 0.0 and system.omega * STIFFENED < 1.0:
        deviation = math.sqrt(left) / system.omega
        mean = left * system.load / system.omega**2
        return np.array([math.asinh(mean / deviation), math.log(deviation), 0.0])
    return _elastic_start(system)


def _elastic_start(system: System) -> Unknowns:
    """The deviation that balances at unit speed, with the mean of the elastic law."""
    low = motion_factor(min(restitutions(system)), book=False)

    def imbalance(log_deviation: float) -> float:
        deviation = math.exp(log_deviation)
        law = normal_law(system, 0.0, deviation)
        return (system.omega * deviation) ** 2 - 1.0 + low * (1.0 - law.variance / deviation**2)

    if imbalance(0.0) >= 0.0:
        return np.zeros(3)
    return np.array([0.0, brentq(imbalance, 0.0, 1.0 - math.log(system.omega)), 0.0])


def normal_law(system: System, mean: float, deviation: float) -> CutNormal:
    return CutNormal(
        slope=mean / deviation**2,
        curvature=deviation**-2,
        lower=system.lower,
        upper=system.upper,
    )


def motion_factor(restitution: float, book: bool) -> float:
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
    law = normal_law(system, mean, deviation)
    r_lower, r_upper = restitutions(system)
    force = stiffness = damping = 0.0
    stops = []
    for stop, restitution, sign in ((system.lower, r_lower, -1.0), (system.upper, r_upper, 1.0)):
        hits = gaussian_stop(law.density_at(stop), speed**2)
        stops.append(hits)
        if stop is not None:
            push = 2.0 * motion_factor(restitution, book) * hits.speed_rate
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
