"""The linear system with added stiffness and damping, and the units in which it is solved."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
from scipy.optimize import brentq

from stochvi.mathematics.cut_normal import CutNormal
from stochvi.mathematics.impact_rates import ContactStatistics, StopStatistics
from stochvi.mathematics.spectra import Filter, Table, response_moments
from stochvi.methods.linearisation.trial import ROOT_TWO_PI, Trial, restitutions, soft_stops
from stochvi.model.gibbs_law import GibbsLaw
from stochvi.scenes.impact_laws import Elastic, ForceTable, Hertz, Law, Viscoelastic
from stochvi.scenes.scene import System

SCAN = (-6.9, 4.6)
"""Logarithms of speeds, relative to one that balances, among which others are looked for."""

LOOKED_AT = 75
"""Speeds looked at: some fifteen a decade."""


def linear_moments(system: System, stiffness: float, damping: float) -> tuple[float, float]:
    """Variances of x and v with stiffness and damping added (B 13.8-13.11)."""
    total_stiffness = system.omega**2 + stiffness
    total_damping = system.damping_rate + damping
    displacement = velocity = 0.0
    if system.intensity > 0.0:
        velocity = system.intensity / (2.0 * total_damping) if total_damping > 0.0 else math.inf
        displacement = velocity / total_stiffness if total_stiffness > 0.0 else math.inf
    if system.tables:
        coloured = response_moments(system.tables, math.sqrt(total_stiffness), total_damping)
        displacement += coloured.displacement
        velocity += coloured.velocity
    for filtered in system.filters:
        moments = filtered.response_moments(math.sqrt(total_stiffness), total_damping)
        displacement += moments[0]
        velocity += moments[1]
    return displacement, velocity


@dataclass(frozen=True, kw_only=True)
class Frame:
    """Origin and units in which the elastic law at speed s has mean 0 and deviation 1, s = 1.

    A single stop is made the upper one by mirroring x.
    """

    mirrored: bool
    origin: float
    length: float
    speed: float

    @classmethod
    def of(cls, system: System, speed: float) -> Self:
        """The frame of a scene at a speed, m/s."""
        mirrored = system.upper is None
        law = gibbs_law(_mirror(system) if mirrored else system, speed)
        return cls(mirrored=mirrored, origin=law.mean, length=math.sqrt(law.variance), speed=speed)

    def shrink(self, system: System) -> System:
        """The same scene in the units of the frame."""
        if self.mirrored:
            system = _mirror(system)
        time = self.length / self.speed
        lower, upper = (
            None if stop is None else (stop - self.origin) / self.length
            for stop in (system.lower, system.upper)
        )
        return system._replace(
            omega=system.omega * time,
            damping_rate=system.damping_rate * time,
            intensity=system.intensity * time / self.speed**2,
            tables=tuple(
                Table(
                    frequency_hz=table.frequency_hz * time,
                    density=table.density * time / self.speed**2,
                )
                for table in system.tables
            ),
            filters=tuple(
                Filter(
                    filtered.omega * time,
                    filtered.damping_rate * time,
                    filtered.intensity * time / self.speed**2,
                )
                for filtered in system.filters
            ),
            load=(system.load - system.omega**2 * self.origin) * time / self.speed,
            lower=lower,
            upper=upper,
            law_lower=_shrunk(system.law_lower, self.length, time),
            law_upper=_shrunk(system.law_upper, self.length, time),
        )

    def grow(self, trial: Trial) -> Trial:
        """A response back in SI units."""
        frequency = self.speed / self.length
        sign = -1.0 if self.mirrored else 1.0
        lower, upper = (
            StopStatistics(
                hits.rate * frequency,
                # the book's form "force" has None here
                hits.speed_rate and hits.speed_rate * frequency * self.speed,
                hits.speed_square_rate * frequency * self.speed**2,
            )
            for hits in (trial.lower, trial.upper)
        )
        contacts = [
            hits
            and ContactStatistics(
                probability=hits.probability,
                force=hits.force * self.speed * frequency,
                peak_force=None,
                power=hits.power * self.speed**2 * frequency,
            )
            for hits in (trial.contact_lower, trial.contact_upper)
        ]
        if self.mirrored:
            lower, upper = upper, lower
            contacts.reverse()
        return trial._replace(
            mean=sign * (self.origin + self.length * trial.mean),
            variance=trial.variance * self.length**2,
            velocity_mean_square=trial.velocity_mean_square * self.speed**2,
            density_at_mean=trial.density_at_mean / self.length,
            stop_force=sign * trial.stop_force * self.speed * frequency,
            stiffness=trial.stiffness * frequency**2,
            damping=trial.damping * frequency,
            lower=lower,
            upper=upper,
            contact_lower=contacts[0],
            contact_upper=contacts[1],
        )


def _shrunk(law: Law | None, length: float, time: float) -> Law | None:
    """The law of a stop, per unit mass, in other units of length and time."""
    match law:
        case Elastic() | Viscoelastic():
            return law.model_copy(update={"stiffness": law.stiffness * time**2})
        case Hertz():
            coefficient = law.coefficient * time**2 * math.sqrt(length)
            return law.model_copy(update={"coefficient": coefficient})
        case ForceTable():
            deflection = tuple(y / length for y in law.deflection)
            force = tuple(push * time**2 / length for push in law.force)
            return law.model_copy(update={"deflection": deflection, "force": force})
    return law


def _mirror(system: System) -> System:
    return system._replace(
        load=-system.load,
        lower=None if system.upper is None else -system.upper,
        upper=None if system.lower is None else -system.lower,
        restitution_lower=system.restitution_upper,
        restitution_upper=system.restitution_lower,
        law_lower=system.law_upper,
        law_upper=system.law_lower,
    )


def gibbs_law(system: System, speed: float) -> CutNormal | GibbsLaw:
    """exp(-U / speed^2), the exact law for stops that lose nothing (B 13.38)."""
    if soft_stops(system):
        return GibbsLaw(
            theta=speed**2,
            omega=system.omega,
            load=system.load,
            stop_lower=system.lower,
            stop_upper=system.upper,
            law_lower=system.law_lower,
            law_upper=system.law_upper,
        )
    return CutNormal(
        slope=system.load / speed**2,
        curvature=(system.omega / speed) ** 2,
        lower=system.lower,
        upper=system.upper,
    )


def _gibbs_stops(system: System, speed: float) -> tuple[float, float]:
    """Stiffness and damping of stops under the elastic law at a speed s.

    s^2 = (omega^2 + k) Var x, and the loss of a stop is (1 - R^2) p_c s^3 / sqrt(2 pi) with
    p_c = 2 p / (1 + R), the density at the stop that the balance of forces then calls for; of a
    viscoelastic stop c s^2 P(contact).
    """
    law = gibbs_law(system, speed)
    stiffness = max(speed**2 / law.variance - system.omega**2, 0.0)
    r_lower, r_upper = restitutions(system)
    loss = (1.0 - r_lower) * law.density_at(system.lower)
    loss += (1.0 - r_upper) * law.density_at(system.upper)
    damping = 2.0 * loss * speed / ROOT_TWO_PI
    for side, contact in soft_stops(system).items():
        if isinstance(contact, Viscoelastic) and isinstance(law, GibbsLaw):
            touching = law.contact(side)
            assert touching is not None
            damping += contact.damping(1.0) * touching.probability
    return stiffness, damping


def speed_scale(system: System) -> float:
    """The speed s at which the elastic law takes up the power that the noise supplies, m/s.

    Exact for elastic stops and white noise, where s^2 = S0 / (2 b); else near the answer. Of
    several such speeds the one that is found from above.
    """

    def surplus(log_speed: float) -> float:
        return _surplus(system, log_speed)

    # half a step above, so that no end of the bracket is a root
    high = math.log(_rough_speed(system)) + 0.5
    ceiling, floor = high + 100.0, high - 25.0
    while surplus(high) > 0.0 and high < ceiling:
        high += 1.0
    low = best = high - 1.0
    while surplus(low) <= 0.0 and low > floor:
        high, low = low, low - 1.0
        best = max(low, best, key=surplus)
    if low <= floor:
        # no balance: a preload holds the mass on a stop. A form may still find one of its own
        return math.exp(best)
    log_speed: float = brentq(surplus, low, high, xtol=1e-14, rtol=1e-14)
    return math.exp(log_speed)


def balanced_speeds(system: System, near: float) -> list[float]:
    """All speeds within three decades below and two above `near` at which the elastic law takes
    up the power supplied, m/s; in coloured noise there may be several, where the linearised
    resonance passes through a peak or an edge of the density."""
    logs = math.log(near) + np.linspace(*SCAN, LOOKED_AT)
    values = [_surplus(system, log_speed) for log_speed in logs.tolist()]
    return [
        math.exp(brentq(lambda log_speed: _surplus(system, log_speed), low, high, xtol=1e-9))
        for (low, one), (high, two) in pairwise(zip(logs.tolist(), values, strict=True))
        if one * two < 0.0
    ]


def _surplus(system: System, log_speed: float) -> float:
    """log of the mean square speed that the noise supplies to the elastic law of a speed, over
    that of the law."""
    speed = math.exp(log_speed)
    try:
        supplied = linear_moments(system, *_gibbs_stops(system, speed))[1]
    except ValueError:
        # so slow that the mass lies on a stop within rounding
        return -1e3
    if not 0.0 < supplied < math.inf:
        # no loss at all, as far below the first impact; or no noise left to follow
        return 1e3 if supplied > 0.0 else -1e3
    return math.log(supplied) - 2.0 * log_speed


def _rough_speed(system: System) -> float:
    """Any speed that scales as it should, m/s."""
    rate = system.damping_rate or system.omega
    if rate > 0.0:
        return math.sqrt(linear_moments(system._replace(damping_rate=rate), 0.0, 0.0)[1])
    assert system.lower is not None and system.upper is not None
    gap = system.upper - system.lower
    squares = [table.mean_square() for table in system.tables]
    squares += [
        each.omega**2 * each.intensity / (2.0 * each.damping_rate) for each in system.filters
    ]
    rms = math.sqrt(sum(squares))
    return max(math.sqrt(gap * rms), math.cbrt(gap * system.intensity))
