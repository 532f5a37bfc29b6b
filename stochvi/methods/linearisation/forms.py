"""Forms of statistical linearisation of one gap. Chapters: averages within a compliant stop;
closure for compliant stops; the form "motion"; the form "force";
choice of the form."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy
from scipy.special import ndtr

from stochvi.mathematics.impact_rates import (
    CUT,
    NODES,
    WEIGHTS,
    ContactStatistics,
    StopStatistics,
    TruncatedNormal,
    gaussian_stop,
    rice_rate,
)
from stochvi.mathematics.kelvin_voigt import half_contact
from stochvi.mathematics.numerics import Vector
from stochvi.methods.linearisation.array_closure import least_curvature, rigid_closure
from stochvi.methods.linearisation.linear_system import ROOT_TWO_PI, Candidate, Form, Unknowns
from stochvi.model.gap import Gap
from stochvi.model.model import Stop
from stochvi.scenes.impact_laws import CompliantLaw, Law, Viscoelastic

# ------------------------------------------------------------------------------
# Averages over the motion within a compliant stop, relative to the density at its surface.
#
# The density at a deflection y is that at the surface times e^L(y), L(0) = 0. L may rise to a peak
# within the stop, where a load presses the mass in, and may be narrow there; everything is computed
# relative to its largest value, so that no tail is lost and no pressing overflows.
# ------------------------------------------------------------------------------


DISTANCES = 2.0 ** np.arange(-100.0, 101.0)
"""Deflections at which the density within a stop is evaluated first, in units in which the motion
is of order 1."""

SHRINKAGE = 32
"""Number of intervals into which the stretch between the two neighbours of a peak is divided in the
next round of the search for it."""

LOOKS = 5
"""Number of rounds of the search for a peak. 16^5 times finer than `DISTANCES` is enough to place
the panels of a quadrature."""


class Layer(NamedTuple):
    """Deflections y, and weights that hold e^(L - log_scale); their sum is the mass of the layer.

    `log_mass` is the logarithm of the integral of e^L over the deflections, in units of length.
    """

    deflection: Vector
    weight: Vector
    log_mass: float

    def expect(self, values: Vector) -> float:
        """Mean of values at the nodes over the layer."""
        return float(values @ self.weight) / float(self.weight.sum())


def layer(log_density: Callable[[Vector], Vector], law: CompliantLaw) -> Layer:
    """Quadrature over y > 0 of a density with one peak, by panels that end at knots of a table.

    Raises
    ------
    ValueError
        If the density does not fall off within the stop.
    """
    peak, top = _peak(log_density)
    right = peak + _fall(log_density, peak, top, 1.0)
    left = max(peak - _fall(log_density, peak, top, -1.0), 0.0)
    knots = law.knots()
    edges = np.unique([left, peak, right, *knots[(knots > left) & (knots < right)]])
    # in the root of the deflection the energy of a Hertz stop is a polynomial
    roots = np.sqrt(edges)
    half = np.diff(roots)[:, None] / 2.0
    t = (roots[:-1, None] + half * (1.0 + NODES)).ravel()
    y = t * t
    weight = 2.0 * t * (half * WEIGHTS).ravel() * np.exp(log_density(y) - top)
    return Layer(y, weight, top + math.log(float(weight.sum())))


def _peak(log_density: Callable[[Vector], Vector]) -> tuple[float, float]:
    """Place of the largest density, and L there."""
    places = np.concatenate([[0.0], DISTANCES])
    for _ in range(LOOKS):
        values = log_density(places)
        best = int(np.argmax(values))
        if best == len(places) - 1 or not math.isfinite(values[best]):
            raise ValueError("the density does not fall off within the stop")
        if best == 0 and places[0] == 0.0:
            return 0.0, 0.0
        ends = places[max(best - 1, 0)], places[best + 1]
        places = np.append(np.linspace(*ends, SHRINKAGE), places[best])
        places.sort()
    values = log_density(places)
    best = int(np.argmax(values))
    return float(places[best]), float(values[best])


def _fall(
    log_density: Callable[[Vector], Vector], peak: float, top: float, direction: float
) -> float:
    """How far from the peak the density has fallen by e^-CUT, to a factor of 2."""
    distances = DISTANCES if direction > 0.0 else DISTANCES[peak > DISTANCES]
    if len(distances) == 0:
        return peak
    fallen = log_density(peak + direction * distances) < top - CUT
    if not fallen.any():
        if direction > 0.0:
            raise ValueError("the density does not fall off within the stop")
        return peak
    return float(distances[int(np.argmax(fallen))])


# ------------------------------------------------------------------------------
# The moment closure for compliant stops, alone or opposite a rigid one.
#
# Between the stops x has the density C exp(lambda x - kappa x^2 / 2). Within a stop this is
# multiplied by exp(-V(y) / tau), V the energy stored at the deflection y. x' is Gaussian with the
# mean square s^2. lambda, kappa and s obey the balances of force, virial and energy. tau is s^2 for
# an elastic stop: with white noise the law is then the Gibbs distribution exp(-U / s^2), and exact
# (B 13.38).
#
# A viscoelastic stop loses energy. A brief contact leaves with R = exp(-2 z arccos z / sqrt(1 -
# z^2)) times its speed (B App. I); the mean push of such contacts is (1 + R) / 2 p s^2, p the
# density at the surface, and that of the layer p tau: hence tau = (1 + R) / 2 s^2. They lose (1 -
# R^2) / 2 F2 = (1 - R^2) p s^3 / sqrt(2 pi). The damper alone, c = 2 z sqrt(K), would take c s^2
# P(contact), P = p sqrt(pi tau / (2 K)). Its power is therefore multiplied by
#
#     g = (1 - R^2) / (pi z sqrt(2 (1 + R))),
#
# which is 1 for a small z. Where a load keeps the mass within the stop the damper acts all the time
# as it is: tau = s^2 and g = 1, and the law is a Gibbs distribution again. In between the two are
# mixed by
#
#     r = sqrt(pi s^2 / (2 K)) / (time in contact per density at the surface), at most 1,
#
# 1 for a stop that nothing presses, 0 for one that is never left. So the closure is exact in white
# noise where no stop takes energy, and where the mass never leaves the stop. As stops stiffen it
# tends to that of rigid ones of the same restitution.
#
# Where a mass is pressed onto an inelastic stop there may be no such law: chatter keeps the mass
# close to the stop. Then kappa is kept at its limit, and a factor from 1 upwards takes its place as
# the unknown. Where contacts are brief it multiplies the densities at and within the stop, as for
# rigid stops; where they are not it multiplies tau.
# ------------------------------------------------------------------------------


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
    least = _least_curvature(gap, coloured)
    one_stop = Form(_start, lambda gap, x: _candidate(gap, x, math.inf))
    stretched = Form(_start_stretched, _stretched)
    others = (stretched,) if math.isinf(least) else (one_stop, stretched)
    return Form(_start, lambda gap, x: _candidate(gap, x, least), others)


def _least_curvature(gap: Gap, coloured: bool = False) -> float:
    """Least kappa between two stops, below which the density at the stops rises instead."""
    if len(gap.stops) < 2:
        return math.inf
    restitutions = [stop.law.restitution for stop in gap.stops]
    if coloured or gap.coloured:
        # a narrow band makes x dwell near its turning points, whatever the restitution
        restitutions = [0.0, 0.0]
    return float(least_curvature(gap.width, restitutions))


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


# ------------------------------------------------------------------------------
# The form "motion": x has a normal distribution truncated at rigid stops (B 8.58-8.77) and at no
# others.
#
# With the force Phi of a stop as a function of x (B 8.46, 8.47),
#
#     m_F = E Phi(x),        k = E Phi(x) (x - E x) / s^2,
#
# s the deviation of the normal distribution: where it is not cut, k = E Phi'(x). At a rigid stop
# the mean force is A p s_v^2. p is the density of the truncated distribution at the stop, A the
# factor of `motion_factor`. For an elastic stop Phi = K (x - c)+ and u = (c - m) / s this is (B
# 8.48, 8.49)
#
#     m_F = K [s phi(u) - (c - m) Q(u)],        k = K Q(u),
#
# Q the upper tail of the normal distribution, and two stops add (B 8.50, 8.51); for a Hertz stop
# m_F = C s^(3/2) Gamma(5/2) / sqrt(2 pi) exp(-u^2 / 4) D_(-5/2)(u), D the parabolic cylinder
# function. Here all of them are quadratures relative to the density at the stop, which keep their
# digits in the tail. The loss is that of impacts with the restitution that a free mass sees, at the
# rate f at which x crosses the stop (B 8.54, 8.55): beta = (1 - R^2) f / 2 where the mean square
# impact speed is E v^2, as in the book, and twice that for Rayleigh speeds.
# ------------------------------------------------------------------------------


STIFFENED = 2.0
"""Deviation of the mass on its spring alone, in deviations of the elastic law, above which the
stops govern the motion and set its start: narrow gaps and deep preloads."""


def motion_form(book: bool) -> Form:
    """The form with the factors of the book, or with consistent ones."""

    def candidate(gap: Gap, unknowns: Unknowns) -> Candidate:
        return _candidate_by_motion(gap, unknowns, book)

    elastic = Form(_elastic_start, candidate)
    return Form(lambda gap: _start_by_motion(gap, book), candidate, (elastic,))


def _start_by_motion(gap: Gap, book: bool) -> Unknowns:
    """The start of rigid stops that govern the motion, or else that of the elastic law.

    Rigid stops govern in a narrow gap, and where a stop is far inside the rest position r. The stop
    force then has the slope k = A s_v^2 / s_x^2 and the mean k (m - c). A is its factor, c the mean
    between the stops. In a narrow gap the truncated distribution is even, under a deep preload
    exponential. The balances are then m = c + (1 - A) (r - c) and s_x^2 = (1 - A) s_v^2 / omega^2.
    Here c = 0 and s_v = 1.
    """
    if gap.soft:
        return np.zeros(3)
    factors = [motion_factor(stop.law, book) for stop in gap.stops]
    left = 1.0 - sum(factors) / len(factors)
    if left > 0.0 and gap.omega * STIFFENED < 1.0:
        deviation = math.sqrt(left) / gap.omega
        mean = left * gap.load / gap.omega**2
        return np.array([math.asinh(mean / deviation), math.log(deviation), 0.0])
    return _elastic_start(gap)


def _elastic_start(gap: Gap) -> Unknowns:
    """The deviation that balances at unit speed, with the mean of the elastic law."""
    if gap.soft:
        return np.zeros(3)
    low = min(motion_factor(stop.law, book=False) for stop in gap.stops)

    def imbalance(log_deviation: float) -> float:
        deviation = math.exp(log_deviation)
        law = normal_law(gap, 0.0, deviation)
        return (gap.omega * deviation) ** 2 - 1.0 + low * (1.0 - law.variance / deviation**2)

    if imbalance(0.0) >= 0.0:
        return np.zeros(3)
    return np.array([0.0, scipy.optimize.brentq(imbalance, 0.0, 1.0 - math.log(gap.omega)), 0.0])


def normal_law(gap: Gap, mean: float, deviation: float) -> TruncatedNormal:
    """The normal distribution of a mean and a deviation, cut at rigid stops."""
    lower, upper = gap.walls
    return TruncatedNormal(
        slope=mean / deviation**2, curvature=deviation**-2, lower=lower, upper=upper
    )


def motion_factor(law: Law, book: bool) -> float:
    """Mean stop force over p(stop) E v^2: (1 + R) / 2, or as printed (B 8.75), and in the stiffness
    of that force (B 13.12)."""
    return (1.0 + law.restitution_mean_square) / 4.0 if book else (1.0 + law.restitution) / 2.0


def _candidate_by_motion(gap: Gap, unknowns: Unknowns, book: bool) -> Candidate:
    """Unknowns asinh(m / s_x), log s_x and log s_v: m may lie thousands of s_x beyond a stop.

    At a rigid stop k is d m_F / d m at fixed s_x: the derivative of the cut density p at a stop c
    is p (c - mean of the truncated distribution) / s_x^2.
    """
    bend, log_deviation, log_speed = unknowns.tolist()
    deviation, speed = math.exp(log_deviation), math.exp(log_speed)
    mean = deviation * math.sinh(bend)
    law = normal_law(gap, mean, deviation)
    force = covariance = power = 0.0
    hits: dict[int, StopStatistics] = {}
    contacts: dict[int, ContactStatistics] = {}
    for stop in gap.stops:
        own = gaussian_stop(law.density_at(stop.position), speed**2)
        arm = stop.side * (stop.position - law.mean)
        if book and not stop.rigid:
            own = book_speeds(own, speed)
        lost = (1.0 - stop.law.restitution_mean_square) / 2.0 * own.speed_square_rate
        if isinstance(stop.law, CompliantLaw):
            shape = stop.side * (mean - stop.position) / deviation**2, deviation**-2, arm
            share, push, moment = _within(stop.law, law.log_density_at(stop.position), shape)
            contacts[stop.side] = ContactStatistics(share, push, None, lost)
        else:
            push = 2.0 * motion_factor(stop.law, book) * own.speed_rate
            moment = push * arm
        hits[stop.side] = own
        force += stop.side * push
        covariance += moment
        power += lost
    return Candidate(
        mean=mean,
        variance=deviation**2,
        velocity_mean_square=speed**2,
        # that of the truncated distribution at its own mean, since m may lie beyond a stop (B 13.20
        # where m = 0)
        density_at_mean=law.density_at(law.mean),
        stop_force=force,
        stiffness=covariance / deviation**2,
        damping=power / speed**2,
        hits=hits,
        contacts=contacts,
    )


def _within(
    law: CompliantLaw, log_surface: float, shape: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Probability of contact, mean force, and covariance of force and x outwards, of one stop.

    `shape` holds slope and curvature of the log density within the stop, and how far outwards of
    the mean the stop lies.
    """
    slope, curvature, arm = shape
    inside = layer(lambda y: y * (slope - curvature * y / 2.0), law)
    share = math.exp(log_surface + inside.log_mass)
    force = law.force_at(inside.deflection)
    moment = inside.expect(force * (arm + inside.deflection))
    return share, share * inside.expect(force), share * moment


def book_speeds(hits: StopStatistics, speed: float) -> StopStatistics:
    """Impacts at the same rate whose mean square speed is E v^2 (B 8.52); nothing else is known of
    that speed."""
    return StopStatistics(hits.rate, None, hits.rate * speed**2)  # type: ignore[arg-type]


# ------------------------------------------------------------------------------
# The form "force": spring and stops together push with a Gaussian force.
#
# The force F of spring and stops is N(load, s_F^2). x = X(F) is the inverse of the characteristic
# F(x) = omega^2 x + Phi(x), which rigid stops cut off (B 8.79, 8.80):
#
#     E x = E X(F),        1 / k = E X'(F) = int p_F(F(x)) dx,
#
# the integral over all x that the mass can take. With rigid stops on both sides and no spring this
# is (B 7.76, 8.82, 8.83), 1 / k = (upper - lower) p_F(0); with a spring and one stop (B 7.77, 8.86,
# 8.87); with two (B 7.78, 8.84, 8.85, 13.24-13.33). A stop of stiffness K adds P(F beyond it) /
# (omega^2 + K).
# ------------------------------------------------------------------------------


def force_form(book: bool) -> Form:
    """The form with impact speeds of the book, or with Rayleigh ones."""
    return Form(_start_by_force, lambda gap, x: _candidate_by_force(gap, x, book))


def _start_by_force(gap: Gap) -> Unknowns:
    """The deviation of the force that balances at unit speed without losses."""

    def imbalance(log_force: float) -> float:
        return 2.0 * log_force + inverse(gap, math.exp(log_force)).log_compliance

    low, high = -1.0, 1.0
    while imbalance(low) > 0.0:
        low *= 2.0
    while imbalance(high) < 0.0:
        high *= 2.0
    return np.array([scipy.optimize.brentq(imbalance, low, high), 0.0])


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


def _candidate_by_force(gap: Gap, unknowns: Unknowns, book: bool) -> Candidate:
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


# ------------------------------------------------------------------------------
# Choice of the form that linearises a gap, by its name, its variant and the stops.
# ------------------------------------------------------------------------------


def form_of(name: str, variant: str, gap: Gap) -> Form:
    """The form for a gap."""
    if name == "motion":
        return motion_form(book=variant == "book")
    if name == "force":
        return force_form(book=variant == "book")
    return soft_closure(gap) if gap.soft else rigid_closure(variant == "box")
