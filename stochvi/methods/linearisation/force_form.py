"""The form "force": spring and stops together push with a Gaussian force.

The force F of spring and stops is N(load, s_F^2). x = X(F) is the inverse of the characteristic
F(x) = omega^2 x + Phi(x), which rigid stops cut off (B 8.79, 8.80):

    E x = E X(F),        1 / k = E X'(F) = int p_F(F(x)) dx,

the integral over all x that the mass can take. With rigid stops on both sides and no spring this
is (B 7.76, 8.82, 8.83), 1 / k = (upper - lower) p_F(0); with a spring and one stop (B 7.77, 8.86,
8.87); with two (B 7.78, 8.84, 8.85, 13.24-13.33). A stop of stiffness K adds
P(F beyond it) / (omega^2 + K).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.impact_rates import ContactStatistics, StopStatistics, rice_rate
from stochvi.mathematics.truncated_normal import TruncatedNormal
from stochvi.methods.linearisation.candidate import ROOT_TWO_PI, Candidate, Form, Unknowns
from stochvi.methods.linearisation.layers import layer
from stochvi.methods.linearisation.motion_form import book_speeds
from stochvi.model.gap import Gap
from stochvi.scenes.impact_laws import CompliantLaw


def force_form(book: bool) -> Form:
    """The form with impact speeds of the book, or with Rayleigh ones."""
    return Form(_start, lambda gap, x: _candidate(gap, x, book))


def _start(gap: Gap) -> Unknowns:
    """The deviation of the force that balances at unit speed without losses."""

    def imbalance(log_force: float) -> float:
        return 2.0 * log_force + inverse(gap, math.exp(log_force)).log_compliance

    low, high = -1.0, 1.0
    while imbalance(low) > 0.0:
        low *= 2.0
    while imbalance(high) < 0.0:
        high *= 2.0
    return np.array([brentq(imbalance, low, high), 0.0])


@dataclass(frozen=True, kw_only=True)
class Inverse:
    """Averages over the inverse characteristic, displacement against force.

    Parameters
    ----------
    log_compliance
        log 1 / k.
    mean
        Mean displacement, E x.
    contacts
        Share of time in contact and mean force, by the side of a compliant stop.
    """

    log_compliance: float
    mean: float
    contacts: dict[int, tuple[float, float]]


def inverse(gap: Gap, deviation: float) -> Inverse:
    """The averages over a force N(load, deviation^2)."""
    spring = gap.omega**2
    lower, upper = gap.ends
    between = TruncatedNormal(
        slope=spring * gap.load / deviation**2,
        curvature=(spring / deviation) ** 2,
        lower=lower,
        upper=upper,
    )
    z = (spring * between.peak - gap.load) / deviation
    top = -0.5 * z * z - math.log(ROOT_TWO_PI * deviation)
    logs = [top - between.log_density_at(between.peak)]
    mean = spring * between.mean * math.exp(logs[0])
    contacts = {}
    for stop in gap.stops:
        z = stop.side * (spring * stop.position - gap.load) / deviation
        beyond = float(ndtr(-z))
        if not isinstance(stop.law, CompliantLaw):
            mean += stop.position * beyond
            continue
        inside = layer(_log_density(stop.law, spring, deviation, z), stop.law)
        y = inside.deflection
        log_weight = -0.5 * z * z - math.log(ROOT_TWO_PI * deviation) + inside.log_mass
        slope = math.exp(log_weight) * (spring + stop.law.slope_at(y))
        logs.append(log_weight)
        mean += inside.expect((stop.position + stop.side * y) * slope)
        contacts[stop.side] = beyond, inside.expect(stop.law.force_at(y) * slope)
    return Inverse(log_compliance=float(np.logaddexp.reduce(logs)), mean=mean, contacts=contacts)


def _log_density(
    law: CompliantLaw, spring: float, deviation: float, z: float
) -> Callable[[Vector], Vector]:
    """log p_F within a stop less that at its surface, which lies z deviations outwards."""

    def log_density(y: Vector) -> Vector:
        more: Vector = (spring * y + law.force_at(y)) / deviation
        return -more * (z + 0.5 * more)

    return log_density


def _candidate(gap: Gap, unknowns: Unknowns, book: bool) -> Candidate:
    """Unknowns log s_F and log s_v; k is the total stiffness, s_F = k s_x (B 8.82-8.85, 13.24)."""
    log_force, log_speed = unknowns.tolist()
    speed = math.exp(log_speed)
    averages = inverse(gap, math.exp(log_force))
    deviation = math.exp(log_force + averages.log_compliance)
    stiffness = math.exp(-averages.log_compliance)
    damping = 0.0
    hits: dict[int, StopStatistics] = {}
    contacts: dict[int, ContactStatistics] = {}
    for stop in gap.stops:
        # Rice's rate of F through omega^2 stop, in lengths of F / k (B 13.33)
        distance = (gap.omega**2 * stop.position - gap.load) / stiffness
        rate = rice_rate(distance, deviation, speed)
        own = StopStatistics(rate, rate * math.sqrt(math.pi / 2.0) * speed, 2.0 * rate * speed**2)
        own = hits[stop.side] = book_speeds(own, speed) if book else own
        power = (1.0 - stop.law.restitution_mean_square) / 2.0 * own.speed_square_rate
        damping += power / speed**2
        if stop.side in averages.contacts:
            share, force = averages.contacts[stop.side]
            contacts[stop.side] = ContactStatistics(share, force, None, power)
    return Candidate(
        mean=averages.mean,
        variance=deviation**2,
        velocity_mean_square=speed**2,
        density_at_mean=1.0 / (ROOT_TWO_PI * deviation),
        # E F = load is satisfied by construction
        stop_force=gap.load - gap.omega**2 * averages.mean,
        stiffness=stiffness - gap.omega**2,
        damping=damping,
        hits=hits,
        contacts=contacts,
    )
