"""The form "motion": x has a normal distribution truncated at rigid stops (B 8.58-8.77) and at no
others.

With the force Phi of a stop as a function of x (B 8.46, 8.47),

    m_F = E Phi(x),        k = E Phi(x) (x - E x) / s^2,

s the deviation of the normal distribution: where it is not cut, k = E Phi'(x). At a rigid stop the
mean force is A p s_v^2. p is the density of the truncated distribution at the stop, A the factor of
`motion_factor`. For an elastic stop Phi = K (x - c)+ and u = (c - m) / s this is (B 8.48, 8.49)

    m_F = K [s phi(u) - (c - m) Q(u)],        k = K Q(u),

Q the upper tail of the normal distribution, and two stops add (B 8.50, 8.51); for a Hertz stop m_F
= C s^(3/2) Gamma(5/2) / sqrt(2 pi) exp(-u^2 / 4) D_(-5/2)(u), D the parabolic cylinder function.
Here all of them are quadratures relative to the density at the stop, which keep their digits in the
tail. The loss is that of impacts with the restitution that a free mass sees, at the rate f at which
x crosses the stop (B 8.54, 8.55): beta = (1 - R^2) f / 2 where the mean square impact speed is E
v^2, as in the book, and twice that for Rayleigh speeds.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from stochvi.mathematics.impact_rates import ContactStatistics, StopStatistics, gaussian_stop
from stochvi.mathematics.truncated_normal import TruncatedNormal
from stochvi.methods.linearisation.candidate import Candidate, Form, Unknowns
from stochvi.methods.linearisation.layers import layer
from stochvi.model.gap import Gap
from stochvi.scenes.impact_laws import CompliantLaw, Law

STIFFENED = 2.0
"""Deviation of the mass on its spring alone, in deviations of the elastic law, above which the
stops govern the motion and set its start: narrow gaps and deep preloads."""


def motion_form(book: bool) -> Form:
    """The form with the factors of the book, or with consistent ones."""

    def candidate(gap: Gap, unknowns: Unknowns) -> Candidate:
        return _candidate(gap, unknowns, book)

    elastic = Form(_elastic_start, candidate)
    return Form(lambda gap: _start(gap, book), candidate, (elastic,))


def _start(gap: Gap, book: bool) -> Unknowns:
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
    return np.array([0.0, brentq(imbalance, 0.0, 1.0 - math.log(gap.omega)), 0.0])


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


def _candidate(gap: Gap, unknowns: Unknowns, book: bool) -> Candidate:
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
