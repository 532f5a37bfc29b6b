"""The linear system with added stiffness and damping, and the units in which it is solved."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np
from scipy.optimize import brentq

from stochvi.mathematics.impact_rates import ContactStatistics, StopStatistics
from stochvi.mathematics.spectra import response_moments
from stochvi.mathematics.truncated_normal import TruncatedNormal
from stochvi.methods.linearisation.candidate import ROOT_TWO_PI, Candidate
from stochvi.model.gap import Gap
from stochvi.model.gibbs_law import GibbsLaw
from stochvi.results.errors import NotConverged
from stochvi.scenes.impact_laws import CompliantLaw, Law

SCAN = (-6.9, 4.6)
"""Logarithms of the least and the largest speed among which further solutions are looked for,
relative to a speed that balances."""

SCANNED_SPEEDS = 75
"""Number of speeds within SCAN at which the balance is evaluated: about fifteen per decade."""


def linear_moments(gap: Gap, stiffness: float, damping: float) -> tuple[float, float]:
    """Variances of x and v with stiffness and damping added (B 13.8-13.11)."""
    total_stiffness = gap.omega**2 + stiffness
    total_damping = gap.damping_rate + damping
    displacement = velocity = 0.0
    if gap.intensity > 0.0:
        velocity = gap.intensity / (2.0 * total_damping) if total_damping > 0.0 else math.inf
        displacement = velocity / total_stiffness if total_stiffness > 0.0 else math.inf
    if gap.tables:
        coloured = response_moments(gap.tables, math.sqrt(total_stiffness), total_damping)
        displacement += coloured.displacement
        velocity += coloured.velocity
    for filtered in gap.filters:
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
    def of(cls, gap: Gap, speed: float) -> Self:
        """The frame of a gap at a speed, m/s."""
        mirrored = gap.upper is None
        law = gibbs_law(gap.mirrored() if mirrored else gap, speed)
        return cls(mirrored=mirrored, origin=law.mean, length=math.sqrt(law.variance), speed=speed)

    def shrink(self, gap: Gap) -> Gap:
        """The same gap in the units of the frame."""
        if self.mirrored:
            gap = gap.mirrored()
        return gap.scaled(origin=self.origin, length=self.length, speed=self.speed)

    def grow(self, candidate: Candidate) -> Candidate:
        """A candidate back in SI units."""
        frequency = self.speed / self.length
        sign = -1 if self.mirrored else 1
        return candidate._replace(
            mean=sign * (self.origin + self.length * candidate.mean),
            variance=candidate.variance * self.length**2,
            velocity_mean_square=candidate.velocity_mean_square * self.speed**2,
            density_at_mean=candidate.density_at_mean / self.length,
            stop_force=sign * candidate.stop_force * self.speed * frequency,
            stiffness=candidate.stiffness * frequency**2,
            damping=candidate.damping * frequency,
            hits={
                sign * side: StopStatistics(
                    hits.rate * frequency,
                    # the book's form "force" has None here
                    hits.speed_rate and hits.speed_rate * frequency * self.speed,
                    hits.speed_square_rate * frequency * self.speed**2,
                )
                for side, hits in candidate.hits.items()
            },
            contacts={
                sign * side: ContactStatistics(
                    probability=contact.probability,
                    force=contact.force * self.speed * frequency,
                    peak_force=None,
                    power=contact.power * self.speed**2 * frequency,
                )
                for side, contact in candidate.contacts.items()
            },
        )


def gibbs_law(gap: Gap, speed: float) -> TruncatedNormal | GibbsLaw:
    """exp(-U / speed^2), the exact law for elastic stops (B 13.38)."""
    if gap.soft:
        return GibbsLaw.of(gap, theta=speed**2)
    lower, upper = gap.ends
    return TruncatedNormal(
        slope=gap.load / speed**2, curvature=(gap.omega / speed) ** 2, lower=lower, upper=upper
    )


def _gibbs_stops(gap: Gap, speed: float) -> tuple[float, float]:
    """Stiffness and damping of stops under the elastic law at a speed s.

    The stiffness follows from s^2 = (omega^2 + k) Var x. The loss of a rigid stop is (1 - R^2) p_c
    s^3 / sqrt(2 pi), that of a viscoelastic one c s^2 P(contact). p_c = 2 p / (1 + R) is the
    density at the stop that the balance of forces then calls for.
    """
    law = gibbs_law(gap, speed)
    if not law.variance > 0.0:
        raise NotConverged(
            "linearise did not converge: the response is so small beside its distance from the "
            "stops that its variance is lost in rounding; check the units of damping and excitation"
        )
    stiffness = max(speed**2 / law.variance - gap.omega**2, 0.0)
    rigid = [stop for stop in gap.stops if stop.rigid]
    loss = sum(_loss(stop.law) * law.density_at(stop.position) for stop in rigid)
    damping = 2.0 * loss * speed / ROOT_TWO_PI
    for stop in gap.stops:
        if isinstance(stop.law, CompliantLaw) and isinstance(law, GibbsLaw):
            touching = law.contact(stop.name)
            assert touching is not None
            damping += stop.law.damping(1.0) * touching.probability
    return stiffness, damping


def _loss(law: Law) -> float:
    """(1 - E R^2) / (1 + E R) of a rigid stop, 1 - R where R does not scatter."""
    return (1.0 - law.restitution_mean_square) / (1.0 + law.restitution)


def speed_scale(gap: Gap) -> float:
    """The speed s at which the elastic law takes up the power that the noise supplies, m/s.

    Exact for elastic stops and white noise, where s^2 = S0 / (2 b); else near the answer. Of
    several such speeds the one that is found from above.
    """

    def surplus(log_speed: float) -> float:
        return _surplus(gap, log_speed)

    # half a step above, so that no end of the bracket is a root
    high = math.log(_rough_speed(gap)) + 0.5
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


def balanced_speeds(gap: Gap, near: float) -> list[float]:
    """All speeds within three decades below and two above `near` at which the elastic law takes
    up the power supplied, m/s; in coloured noise there may be several, where the linearised
    resonance passes through a peak or an edge of the density."""
    logs = math.log(near) + np.linspace(*SCAN, SCANNED_SPEEDS)
    values = [_surplus(gap, log_speed) for log_speed in logs.tolist()]
    return [
        math.exp(brentq(lambda log_speed: _surplus(gap, log_speed), low, high, xtol=1e-9))
        for (low, one), (high, two) in pairwise(zip(logs.tolist(), values, strict=True))
        if one * two < 0.0
    ]


def _surplus(gap: Gap, log_speed: float) -> float:
    """log of the mean square speed that the noise supplies to the elastic law of a speed, over
    that of the law."""
    speed = math.exp(log_speed)
    try:
        supplied = linear_moments(gap, *_gibbs_stops(gap, speed))[1]
    except ValueError:
        # so slow that the mass lies on a stop within rounding
        return -1e3
    if not 0.0 < supplied < math.inf:
        # no loss at all, as far below the first impact; or no noise left to follow
        return 1e3 if supplied > 0.0 else -1e3
    return math.log(supplied) - 2.0 * log_speed


def _rough_speed(gap: Gap) -> float:
    """A speed, m/s, that scales with units and strengths of the scene as the answer does."""
    rate = gap.damping_rate or gap.omega
    if rate > 0.0:
        return math.sqrt(linear_moments(replace(gap, damping_rate=rate), 0.0, 0.0)[1])
    squares = [table.mean_square() for table in gap.tables]
    squares += [each.omega**2 * each.intensity / (2.0 * each.damping_rate) for each in gap.filters]
    rms = math.sqrt(sum(squares))
    if math.isinf(gap.width):
        # a load presses the mass on its only stop, where it turns over load * speed per second
        return gap.intensity / abs(gap.load) + rms / _slowest_noise(gap)
    return max(math.sqrt(gap.width * rms), math.cbrt(gap.width * gap.intensity))


def _slowest_noise(gap: Gap) -> float:
    """Lowest frequency of the coloured noise, rad/s; 1 where there is none."""
    slowest = [2.0 * math.pi * float(table.frequency_hz[0]) for table in gap.tables]
    return min([*slowest, *(each.omega for each in gap.filters)], default=1.0)
