"""The moment closure for compliant stops, alone or opposite a rigid one.

Between the stops x has the density C exp(lambda x - kappa x^2 / 2). Within a stop this is
multiplied by exp(-V(y) / tau), V the energy stored at the deflection y. x' is Gaussian with the
mean square s^2. lambda, kappa and s obey the balances of force, virial and energy. tau is s^2 for
an elastic stop: with white noise the law is then the Gibbs distribution exp(-U / s^2), and exact (B
13.38).

A viscoelastic stop loses energy. A brief contact leaves with R = exp(-2 z arccos z / sqrt(1 - z^2))
times its speed (B App. I); the mean push of such contacts is (1 + R) / 2 p s^2, p the density at
the surface, and that of the layer p tau: hence tau = (1 + R) / 2 s^2. They lose (1 - R^2) / 2 F2 =
(1 - R^2) p s^3 / sqrt(2 pi). The damper alone, c = 2 z sqrt(K), would take c s^2 P(contact), P = p
sqrt(pi tau / (2 K)). Its power is therefore multiplied by

    g = (1 - R^2) / (pi z sqrt(2 (1 + R))),

which is 1 for a small z. Where a load keeps the mass within the stop the damper acts all the time
as it is: tau = s^2 and g = 1, and the law is a Gibbs distribution again. In between the two are
mixed by

    r = sqrt(pi s^2 / (2 K)) / (time in contact per density at the surface), at most 1,

1 for a stop that nothing presses, 0 for one that is never left. So the closure is exact in white
noise where no stop takes energy, and where the mass never leaves the stop. As stops stiffen it
tends to that of rigid ones of the same restitution.

Where a mass is pressed onto an inelastic stop there may be no such law: chatter keeps the mass
close to the stop. Then kappa is kept at its limit, and a factor from 1 upwards takes its place as
the unknown. Where contacts are brief it multiplies the densities at and within the stop, as for
rigid stops; where they are not it multiplies tau.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.impact_rates import (
    ContactStatistics,
    StopStatistics,
    gaussian_stop,
)
from stochvi.mathematics.kelvin_voigt import half_contact
from stochvi.mathematics.truncated_normal import TruncatedNormal
from stochvi.methods.linearisation.candidate import Candidate, Form, Unknowns
from stochvi.methods.linearisation.layers import Layer, layer
from stochvi.methods.linearisation.rigid_closure import curvature_floor
from stochvi.model.gap import Gap
from stochvi.model.model import Stop
from stochvi.scenes.impact_laws import CompliantLaw, Viscoelastic

SOFTEST_CURVATURE = 1e-3
"""Least kappa of a law with one open side, in units of the kappa of the elastic law. A smaller one
calls for a density that is higher right at the stop."""


def soft_closure(gap: Gap, coloured: bool = False) -> Form:
    """The closure where at least one stop is compliant; `coloured` says that what shakes is not
    white, or reaches the mass through others.

    The law may not exist with a curvature above the least one between two stops. Two others are
    then tried: where the mass is pressed onto one of two stops, the law with the least curvature
    of a single stop; where it stays within stops for most of the time, the law with the curvature
    of the elastic one and another tau.
    """
    least = least_curvature(gap, coloured)
    one_stop = Form(_start, lambda gap, x: _candidate(gap, x, math.inf))
    stretched = Form(_start_stretched, _stretched)
    others = (stretched,) if math.isinf(least) else (one_stop, stretched)
    return Form(_start, lambda gap, x: _candidate(gap, x, least), others)


def least_curvature(gap: Gap, coloured: bool = False) -> float:
    """Least kappa between two stops, below which the density at the stops rises instead."""
    if len(gap.stops) < 2:
        return math.inf
    restitutions = [stop.law.restitution for stop in gap.stops]
    if coloured or gap.coloured:
        # a narrow band makes x dwell near its turning points, whatever the restitution
        restitutions = [0.0, 0.0]
    return curvature_floor(restitutions) / (gap.width / 2.0) ** 2


def _start(gap: Gap) -> Unknowns:
    return np.array([gap.load, 1.0 if gap.omega > 0.0 else 0.0, 0.0])


def _candidate(gap: Gap, unknowns: Unknowns, least: float) -> Candidate:
    """Unknowns lambda, kappa s^2 in units of omega^2 (of 1 without a spring), and log s."""
    slope, relative, log_speed = unknowns.tolist()
    speed = math.exp(log_speed)
    unit = (gap.omega**2 or 1.0) / speed**2
    least = min(least / unit, SOFTEST_CURVATURE if gap.omega > 0.0 else 0.0)
    law = SoftLaw(
        gap=gap,
        slope=slope,
        curvature=unit * max(relative, least),
        speed=speed,
        rise=1.0 + max(least - relative, 0.0),
    )
    return law.candidate()


def _start_stretched(gap: Gap) -> Unknowns:
    return np.array([gap.load, 0.0, 0.0])


def _stretched(gap: Gap, unknowns: Unknowns) -> Candidate:
    """Unknowns lambda, log of a factor on every tau, and log s."""
    slope, log_stretch, log_speed = unknowns.tolist()
    speed = math.exp(log_speed)
    law = SoftLaw(
        gap=gap,
        slope=slope,
        curvature=(gap.omega / speed) ** 2,
        speed=speed,
        stretch=math.exp(log_stretch),
    )
    return law.candidate()


@dataclass(frozen=True, kw_only=True)
class SoftLaw:
    """The distribution of x of this closure, and what it makes of the stops. Per unit mass.

    Parameters
    ----------
    gap
        Stops and their laws.
    slope, curvature
        lambda and kappa, 1/m and 1/m^2.
    speed
        s, m/s.
    rise
        Factor on the densities at and within the stops, or on their tau.
    stretch
        Factor on every tau.
    """

    gap: Gap
    slope: float
    curvature: float
    speed: float
    rise: float = 1.0
    stretch: float = 1.0

    @cached_property
    def between(self) -> TruncatedNormal:
        """The law between the stops alone."""
        return TruncatedNormal(
            slope=self.slope,
            curvature=self.curvature,
            lower=self.gap.ends[0],
            upper=self.gap.ends[1],
        )

    @cached_property
    def layers(self) -> dict[int, _Within]:
        """Layer within each stop that is compliant, by its side."""
        return {
            stop.side: self._layer(stop, stop.law)
            for stop in self.gap.stops
            if isinstance(stop.law, CompliantLaw)
        }

    def _rise_at(self, stop: Stop) -> float:
        """Factor on the density at a stop: `rise`. It is 1 at an elastic stop opposite an inelastic
        one, since the mass comes to rest on the latter."""
        return 1.0 if stop.law.conservative and not self.gap.elastic else self.rise

    def _layer(self, stop: Stop, law: CompliantLaw) -> _Within:
        push = stop.side * (self.slope - self.curvature * stop.position)
        square = self.stretch * self.speed**2

        def log_density(y: Vector, energy: float = square) -> Vector:
            shape: Vector = y * (push - self.curvature * y / 2.0) - law.potential_at(y) / energy
            return shape

        inside, energy, brief = layer(log_density, law), square, 1.0
        if isinstance(law, Viscoelastic) and not law.conservative:
            free = math.log(math.pi * square / (2.0 * law.stiffness)) / 2.0
            brief = math.exp(min(free - inside.log_mass, 0.0))
            energy *= 1.0 - brief * (1.0 - law.restitution) / 2.0
            energy *= self.rise ** (1.0 - brief)
            inside = layer(lambda y: log_density(y, energy), law)
        log_surface = brief * math.log(self._rise_at(stop))
        log_surface += self.between.log_density_at(stop.position)
        return _Within(
            law=law,
            stop=stop,
            log_density=lambda y: log_surface + log_density(y, energy),
            inside=inside,
            log_weight=log_surface + inside.log_mass,
            brief=brief,
        )

    @cached_property
    def log_total(self) -> float:
        """Logarithm of the integral of the density everywhere over that between the stops."""
        logs = [0.0, *(each.log_weight for each in self.layers.values())]
        return float(np.logaddexp.reduce(logs))

    def density_at(self, stop: Stop) -> float:
        """Density at the surface of a stop, 1/m."""
        rise = self._rise_at(stop)
        if stop.side in self.layers:
            rise **= self.layers[stop.side].brief
        log_density = self.between.log_density_at(stop.position)
        return rise * math.exp(log_density - self.log_total)

    @cached_property
    def regions(self) -> list[tuple[float, float, float]]:
        """Probability, mean and variance between the stops and within each."""
        found = [(math.exp(-self.log_total), self.between.mean, self.between.variance)]
        for each in self.layers.values():
            y = each.inside.deflection
            mean = each.inside.expect(y)
            variance = each.inside.expect((y - mean) ** 2)
            share = math.exp(each.log_weight - self.log_total)
            found.append((share, each.stop.position + each.stop.side * mean, variance))
        return found

    @cached_property
    def mean(self) -> float:
        """Mean of x, m."""
        return sum(share * mean for share, mean, _ in self.regions)

    @cached_property
    def variance(self) -> float:
        """Variance of x, m^2."""
        return sum(
            share * (variance + (mean - self.mean) ** 2) for share, mean, variance in self.regions
        )

    def _density_at_mean(self) -> float:
        for each in self.layers.values():
            y = float(each.stop.deflection(self.mean))
            if y > 0.0:
                return math.exp(float(each.log_density(np.asarray(y))) - self.log_total)
        return math.exp(self.between.log_density_at(self.mean) - self.log_total)

    def _contact(self, each: _Within) -> tuple[ContactStatistics, float]:
        """Contact statistics, and the covariance of force and x."""
        share = math.exp(each.log_weight - self.log_total)
        y = each.inside.deflection
        force = each.law.force_at(y)
        push = share * each.inside.expect(force)
        away = each.stop.side * (each.stop.position - self.mean)
        covariance = share * each.inside.expect(force * (away + y))
        power, touching = 0.0, share
        if isinstance(each.law, Viscoelastic):
            loss, time = brief_contact(each.law)
            power = each.law.damping(1.0) * self.speed**2 * share
            power *= 1.0 + each.brief * (loss - 1.0)
            touching *= 1.0 + each.brief * (time - 1.0)
        return ContactStatistics(touching, push, None, power), covariance

    def candidate(self) -> Candidate:
        """m_F = E F, k = E F (x - m) / Var x, beta = power of the stops / s^2."""
        force = covariance = power = 0.0
        hits: dict[int, StopStatistics] = {}
        contacts: dict[int, ContactStatistics] = {}
        for stop in self.gap.stops:
            own = hits[stop.side] = gaussian_stop(self.density_at(stop), self.speed**2)
            if stop.side in self.layers:
                contact, product = self._contact(self.layers[stop.side])
                contacts[stop.side] = contact
                force += stop.side * contact.force
                covariance += product
                power += contact.power
            else:
                push = (1.0 + stop.law.restitution) * own.speed_rate
                force += stop.side * push
                covariance += push * stop.side * (stop.position - self.mean)
                loss = (1.0 - stop.law.restitution_mean_square) / 2.0
                power += loss * own.speed_square_rate
        return Candidate(
            mean=self.mean,
            variance=self.variance,
            velocity_mean_square=self.speed**2,
            density_at_mean=self._density_at_mean(),
            stop_force=force,
            stiffness=covariance / self.variance,
            damping=power / self.speed**2,
            hits=hits,
            contacts=contacts,
            rise=self.rise,
        )


@dataclass(frozen=True, kw_only=True)
class _Within:
    """A stop, and the layer within it.

    `log_density` is that of x at a deflection, and `log_weight` the mass of the layer, in units of
    what lies between the stops; `brief` says how far contacts are brief ones.
    """

    law: CompliantLaw
    stop: Stop
    log_density: Callable[[Vector], Vector]
    inside: Layer
    log_weight: float
    brief: float


def brief_contact(law: Viscoelastic) -> tuple[float, float]:
    """g, and the time of a brief contact over that in which the deflection is positive."""
    if law.conservative:
        return 1.0, 1.0
    r, z = law.restitution, law.damping_ratio
    slowed = math.pi * math.sqrt(2.0 * (1.0 + r))
    return (1.0 - r * r) / (z * slowed), 4.0 * half_contact(z) / slowed
