"""The form "force" for stops that give way: spring and stops together push with a Gaussian force.

The force F of spring and stops is N(load, s_F^2), and x = X(F) the inverse of the characteristic
F(x) = omega^2 x + Phi(x), which rigid stops cut off (B 8.79, 8.80):

    E x = E X(F),        1 / k = E X'(F) = int p_F(F(x)) dx,

the integral over all x that the mass can take. With rigid stops on both sides and no spring this
is (B 7.76, 8.82, 8.83), 1 / k = (upper - lower) p_F(0); with a spring and one stop (B 7.77, 8.86,
8.87); with two (B 7.78, 8.84, 8.85). A stop of stiffness K adds P(F beyond it) / (omega^2 + K).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from stochvi.mathematics.cut_normal import CutNormal
from stochvi.mathematics.impact_rates import NO_STOP, ContactStatistics, StopStatistics, rice_rate
from stochvi.methods.linearisation.layers import Vector, layer
from stochvi.methods.linearisation.soft_motion import book_speeds
from stochvi.methods.linearisation.trial import (
    ROOT_TWO_PI,
    SIGNS,
    Form,
    Trial,
    Unknowns,
    restitutions,
    soft_stops,
)
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.scene import System


def soft_force(book: bool) -> Form:
    """The form where at least one stop gives way."""
    return Form(_start, lambda system, x: _trial(system, x, book))


def _start(system: System) -> Unknowns:
    """The deviation of the force that balances at unit speed without losses."""

    def imbalance(log_force: float) -> float:
        return 2.0 * log_force + inverse(system, math.exp(log_force)).log_compliance

    low, high = -1.0, 1.0
    while imbalance(low) > 0.0:
        low *= 2.0
    while imbalance(high) < 0.0:
        high *= 2.0
    return np.array([brentq(imbalance, low, high), 0.0])


class Inverse:
    """What the inverse characteristic does on average.

    `log_compliance` is log 1 / k, `mean` E x, and `contacts` holds share of time and mean force
    of the stops that give way.
    """

    def __init__(self) -> None:
        self.logs: list[float] = []
        self.mean = 0.0
        self.contacts: dict[str, tuple[float, float]] = {}

    @property
    def log_compliance(self) -> float:
        """log 1 / k."""
        return float(np.logaddexp.reduce(self.logs))


def inverse(system: System, deviation: float) -> Inverse:
    """The averages over a force N(load, deviation^2)."""
    spring, found, softs = system.omega**2, Inverse(), soft_stops(system)
    between = CutNormal(
        slope=spring * system.load / deviation**2,
        curvature=(spring / deviation) ** 2,
        lower=system.lower,
        upper=system.upper,
    )
    z = (spring * between.peak - system.load) / deviation
    top = -0.5 * z * z - math.log(ROOT_TWO_PI * deviation)
    found.logs.append(top - between.log_density_at(between.peak))
    found.mean += spring * between.mean * math.exp(found.logs[0])
    for side, sign in SIGNS.items():
        stop = getattr(system, side)
        if stop is None:
            continue
        z = sign * (spring * stop - system.load) / deviation
        beyond = float(ndtr(-z))
        if side not in softs:
            found.mean += stop * beyond
            continue
        inside = layer(_log_density(softs[side], spring, deviation, z), softs[side])
        y = inside.deflection
        log_weight = -0.5 * z * z - math.log(ROOT_TWO_PI * deviation) + inside.log_mass
        slope = math.exp(log_weight) * (spring + softs[side].slope_at(y))
        found.logs.append(log_weight)
        found.mean += inside.expect((stop + sign * y) * slope)
        found.contacts[side] = beyond, inside.expect(softs[side].force_at(y) * slope)
    return found


def _log_density(
    law: CompliantLaw, spring: float, deviation: float, z: float
) -> Callable[[Vector], Vector]:
    """log p_F within a stop less that at its surface, which lies z deviations outwards."""

    def log_density(y: Vector) -> Vector:
        more: Vector = (spring * y + law.force_at(y)) / deviation
        return -more * (z + 0.5 * more)

    return log_density


def _trial(system: System, unknowns: Unknowns, book: bool) -> Trial:
    """Unknowns log s_F and log s_v; k is the total stiffness, s_F = k s_x (B 8.82-8.85)."""
    log_force, log_speed = unknowns.tolist()
    speed = math.exp(log_speed)
    averages = inverse(system, math.exp(log_force))
    deviation = math.exp(log_force + averages.log_compliance)
    stiffness = math.exp(-averages.log_compliance)
    softs = soft_stops(system)
    damping = 0.0
    stops: dict[str, StopStatistics] = {}
    contacts: dict[str, ContactStatistics | None] = {"lower": None, "upper": None}
    for side, restitution in zip(SIGNS, restitutions(system), strict=True):
        stop = getattr(system, side)
        if stop is None:
            stops[side] = NO_STOP
            continue
        rate = rice_rate((system.omega**2 * stop - system.load) / stiffness, deviation, speed)
        hits = StopStatistics(rate, rate * math.sqrt(math.pi / 2.0) * speed, 2.0 * rate * speed**2)
        stops[side] = book_speeds(hits, speed) if book else hits
        kept = softs[side].restitution if side in softs else restitution
        power = (1.0 - kept**2) / 2.0 * stops[side].speed_square_rate
        damping += power / speed**2
        if side in softs:
            share, force = averages.contacts[side]
            contacts[side] = ContactStatistics(share, force, None, power)
    return Trial(
        mean=averages.mean,
        variance=deviation**2,
        velocity_mean_square=speed**2,
        density_at_mean=1.0 / (ROOT_TWO_PI * deviation),
        stop_force=system.load - system.omega**2 * averages.mean,
        stiffness=stiffness - system.omega**2,
        damping=damping,
        lower=stops["lower"],
        upper=stops["upper"],
        contact_lower=contacts["lower"],
        contact_upper=contacts["upper"],
    )
