"""The form "motion" for stops that give way: x has a normal law, cut at rigid stops alone.

With the force Phi of a stop as a function of x (B 8.46, 8.47),

    m_F = E Phi(x),        k = E Phi(x) (x - E x) / s^2,

s the deviation of the normal law: where it is not cut, k = E Phi'(x). For an elastic stop
Phi = K (x - c)+ and u = (c - m) / s this is (B 8.48, 8.49)

    m_F = K [s phi(u) - (c - m) Q(u)],        k = K Q(u),

Q the upper tail of the normal law, and two stops add (B 8.50, 8.51); for a Hertz stop m_F =
C s^(3/2) Gamma(5/2) / sqrt(2 pi) exp(-u^2 / 4) D_(-5/2)(u), D the parabolic cylinder function.
Here all of them are quadratures relative to the density at the stop, which keep their digits in
the tail. The loss is that of impacts with the restitution that a free mass sees, at the rate f at
which x crosses the stop (B 8.54, 8.55): beta = (1 - R^2) f / 2 where the mean square impact speed
is E v^2, as in the book, and twice that for Rayleigh speeds.
"""

from __future__ import annotations

import math

import numpy as np

from stochvi.mathematics.impact_rates import (
    NO_STOP,
    ContactStatistics,
    StopStatistics,
    gaussian_stop,
)
from stochvi.methods.linearisation.layers import layer
from stochvi.methods.linearisation.motion import motion_factor, normal_law
from stochvi.methods.linearisation.trial import (
    SIGNS,
    Form,
    Trial,
    Unknowns,
    restitutions,
    soft_stops,
)
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.scene import System


def soft_motion(book: bool) -> Form:
    """The form where at least one stop gives way."""
    return Form(lambda system: np.zeros(3), lambda system, x: _trial(system, x, book))


def _trial(system: System, unknowns: Unknowns, book: bool) -> Trial:
    """Unknowns asinh(m / s), log s and log s_v."""
    bend, log_deviation, log_speed = unknowns.tolist()
    deviation, speed = math.exp(log_deviation), math.exp(log_speed)
    mean = deviation * math.sinh(bend)
    softs = soft_stops(system)
    cut = system._replace(
        lower=None if "lower" in softs else system.lower,
        upper=None if "upper" in softs else system.upper,
    )
    law = normal_law(cut, mean, deviation)
    force = covariance = power = 0.0
    hits: dict[str, StopStatistics] = {}
    contacts: dict[str, ContactStatistics | None] = {"lower": None, "upper": None}
    for (side, sign), restitution in zip(SIGNS.items(), restitutions(system), strict=True):
        stop = getattr(system, side)
        if stop is None:
            hits[side] = NO_STOP
            continue
        own = gaussian_stop(law.density_at(stop), speed**2)
        push, arm = 2.0 * motion_factor(restitution, book) * own.speed_rate, stop - law.mean
        moment, lost = sign * push * arm, (1.0 - restitution**2) / 2.0 * own.speed_square_rate
        if side in softs:
            own = book_speeds(own, speed) if book else own
            shape = sign * (mean - stop) / deviation**2, deviation**-2, sign * arm
            share, push, moment = _within(softs[side], law.log_density_at(stop), shape)
            lost = (1.0 - softs[side].restitution ** 2) / 2.0 * own.speed_square_rate
            contacts[side] = ContactStatistics(share, push, None, lost)
        hits[side] = own
        force += sign * push
        covariance += moment
        power += lost
    return Trial(
        mean=mean,
        variance=deviation**2,
        velocity_mean_square=speed**2,
        density_at_mean=law.density_at(law.mean),
        stop_force=force,
        stiffness=covariance / deviation**2,
        damping=power / speed**2,
        lower=hits["lower"],
        upper=hits["upper"],
        contact_lower=contacts["lower"],
        contact_upper=contacts["upper"],
    )


def _within(
    law: CompliantLaw, log_surface: float, shape: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Probability of contact, E Phi, and E Phi (x - mean) outwards, of one stop.

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
    """Hits at the same rate whose mean square speed is E v^2 (B 8.52), of no known law."""
    return StopStatistics(hits.rate, None, hits.rate * speed**2)  # type: ignore[arg-type]
