"""The moment closure between rigid stops.

In the variant "box" the distribution of impact speeds is that of a free mass in a box. Without
spring and damper, under white noise, a mass between two stops of restitution R has one distribution
up to units. There F1 = A p s^2 / 2 and F2 = A g p s^3 sqrt(2 / pi), p the density at the stop in
the family of this closure. A and g depend on R alone: the slow rebounds of an inelastic stop fill
the density near it, but hardly add to the force. Both fade where damping makes the speeds Gaussian.
Where impacts take the share h of all losses, A^sqrt(h) stands in place of A; g, which belongs to
the distribution of speeds, becomes g^h. With A itself in any gap, the mean error of F1 for zeta >
.05 in gaps above a deviation is 9.1 % (2.5 % with sqrt(h)); with A to the power of h, that of
sigma_x in narrower gaps is .7 % (.4 %), on the grid of the atlas.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from stochvi.mathematics.impact_rates import StopStatistics, gaussian_stop
from stochvi.mathematics.truncated_normal import TruncatedNormal
from stochvi.methods.linearisation.candidate import Candidate, Form, Unknowns
from stochvi.model.gap import Gap
from stochvi.model.model import Stop

BOX_RESTITUTION = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
"""Restitutions of the two tables below, between which cubics (PCHIP) interpolate."""

BOX_DENSITY = (
    0.7974, 0.7515, 0.7564, 0.7933, 0.8483, 0.9093, 0.9650, 1.0061, 1.0269, 1.0253, 1.0160, 1.0,
)  # fmt: skip
"""A of a box by restitution, found by `fokker_planck` to four digits from the balance of virial, A
= 1 / ((1 + R) D p). D is the half width; p follows from the displacement variance there. A is 1 for
elastic stops, where x is uniform."""

BOX_SPEED = (
    0.9554, 1.0382, 1.0935, 1.1217, 1.1262, 1.1121, 1.0845, 1.0480, 1.0061, 0.9615, 0.9388, 0.9154,
)  # fmt: skip
"""g of a box by restitution, found by `fokker_planck` to four digits from the balance of energy, g
= S0 D / ((1 - R) s^3) sqrt(pi / 8). Towards R = 1 it goes to the value of speeds with the density
exp(-c |v|^3). The last entry continues the slope before it; it has no effect, since elastic stops
have no share in the losses."""

_DENSITY = PchipInterpolator(BOX_RESTITUTION, BOX_DENSITY)
_SPEED = PchipInterpolator(BOX_RESTITUTION, BOX_SPEED)


def rigid_closure(gap: Gap, box: bool = False) -> Form:
    """The closure of a gap; a single stop must be the upper one."""
    if len(gap.stops) == 1:
        return Form(_one_stop_start, _one_stop_candidate)
    floor = curvature_floor((stop.law.restitution for stop in gap.stops), box)
    return Form(_closure_start, lambda gap, x: _closure_candidate(gap, x, floor, box))


def _closure_start(gap: Gap) -> Unknowns:
    return np.array([gap.load, gap.omega**2, 0.0])


def curvature_floor(restitutions: Iterable[float], box: bool = False) -> float:
    """kappa D^2 of an evenly filled, very narrow gap of half width D, the least that is needed.

    There the balance of forces asks for a density 1 / ((1 + R) A D) at the stops, A = 1 but for
    the variant "box". A law that is more hollow than this would heap up mass at a far stop that
    nothing drives there.
    """
    wanted = max(
        1.0 / ((1.0 + r) * (min(float(_DENSITY(r)), 1.0) if box else 1.0)) for r in restitutions
    )

    def excess(curvature: float) -> float:
        law = TruncatedNormal(slope=0.0, curvature=curvature, lower=-1.0, upper=1.0)
        return law.density_at(1.0) - wanted

    # for R = 0 the floor is -3.53, or -5.5 of a box; for R = 1 it is 0
    floor: float = brentq(excess, -8.0, 0.5)
    return floor


def _closure_candidate(gap: Gap, unknowns: Unknowns, floor: float, box: bool) -> Candidate:
    """Candidate of the unknowns lambda, kappa and log s_v, between two stops.

    Below its floor kappa stays there, and the density right at the stops rises instead, as for
    a single stop.
    """
    slope, curvature, log_speed = unknowns.tolist()
    least = floor / (gap.width / 2.0) ** 2
    rise = 1.0 + max(least - curvature, 0.0)
    lower, upper = gap.ends
    law = TruncatedNormal(slope=slope, curvature=max(curvature, least), lower=lower, upper=upper)
    return _closed(
        gap,
        mean=law.mean,
        variance=law.variance,
        speed=math.exp(log_speed),
        densities=[rise * law.density_at(stop.position) for stop in gap.stops],
        density_at_mean=law.density_at(law.mean),
        rise=rise,
        box=box,
    )


def _closed(
    gap: Gap,
    *,
    mean: float,
    variance: float,
    speed: float,
    densities: list[float],
    density_at_mean: float,
    rise: float = 1.0,
    box: bool = False,
) -> Candidate:
    """m_F = mean stop force, k = its covariance with x / Var x, beta = impact loss / E v^2.

    With F1 and F2 of the law, whose `densities` at the stops are given: m_F = (1 + R_u) F1_u -
    (1 + R_l) F1_l, and so on. Together with the exact variances of the linear system these are
    the balances of force, virial and energy.
    """
    hits = [gaussian_stop(density, speed**2) for density in densities]
    if box:
        hits = _boxed(gap, hits, speed)
    force = covariance = loss = 0.0
    for stop, own in zip(gap.stops, hits, strict=True):
        push = (1.0 + stop.law.restitution) * own.speed_rate
        force += stop.side * push
        covariance += push * (stop.side * (stop.position - mean))
        loss += (1.0 - stop.law.restitution_mean_square) * own.speed_square_rate
    return Candidate(
        mean=mean,
        variance=variance,
        velocity_mean_square=speed**2,
        density_at_mean=density_at_mean,
        stop_force=force,
        stiffness=covariance / variance,
        damping=loss / (2.0 * speed**2),
        hits={stop.side: own for stop, own in zip(gap.stops, hits, strict=True)},
        contacts={},
        rise=rise,
    )


def _boxed(gap: Gap, hits: list[StopStatistics], speed: float) -> list[StopStatistics]:
    """Statistics of the stops, by the law of a box as far as impacts take the energy."""
    strengths = [float(_DENSITY(stop.law.restitution)) for stop in gap.stops]
    loss = sum(
        (1.0 - stop.law.restitution_mean_square)
        * strength
        * own.speed_square_rate
        / (2.0 * speed**2)
        for stop, strength, own in zip(gap.stops, strengths, hits, strict=True)
    )
    share = loss / (gap.damping_rate + loss) if loss > 0.0 else 0.0

    def boxed(stop: Stop, strength: float, own: StopStatistics) -> StopStatistics:
        number = strength ** math.sqrt(share)
        speeds = float(_SPEED(stop.law.restitution)) ** share
        return StopStatistics(
            number * own.rate,
            number * own.speed_rate,
            number * speeds * own.speed_square_rate,
        )

    return [boxed(*each) for each in zip(gap.stops, strengths, hits, strict=True)]


class OneStopLaw(NamedTuple):
    """Density of the distance y >= 0 from a single stop, scaled to unit deviation.

    The truncated normal distributions are a one-parameter family. It ends in the exponential
    distribution, as their mean before the cut moves far beyond the stop. It is continued by
    exponential distributions that stand `rise` times higher right at the stop: a thin layer, made
    by chatter on an inelastic stop.
    """

    mean: float
    density_at_stop: float
    density_at_mean: float
    rise: float


def _one_stop_law(shape: float) -> OneStopLaw:
    """The law of one shape number t, a smooth scale through the whole family.

    Mean over deviation before the cut is e^t - 1 where t >= 0 (it may be thousands), and
    t / sqrt(1 + t) down to t = -1, the exponential distribution; below that, the rise is -t.
    """
    if shape < -1.0 + 1e-12:
        return OneStopLaw(1.0, max(-shape, 1.0), math.exp(-1.0), max(-shape, 1.0))
    mean = math.expm1(shape) if shape >= 0.0 else shape / math.sqrt(1.0 + shape)
    law = TruncatedNormal(slope=mean, curvature=1.0, lower=0.0)
    deviation = math.sqrt(law.variance)
    return OneStopLaw(
        law.mean / deviation,
        law.density_at(0.0) * deviation,
        law.density_at(law.mean) * deviation,
        1.0,
    )


def _one_stop_start(gap: Gap) -> Unknowns:
    """Shape of the law of an elastic stop, of unit speed and deviation."""
    (stop,) = gap.stops
    shape = -1.0
    if gap.omega > 0.0:
        ratio = stop.position * gap.omega - gap.load / gap.omega
        if ratio >= 0.0:
            shape = math.log1p(ratio)
        else:
            shape = 2.0 * ratio / (math.hypot(ratio, 2.0) - ratio)
    return np.array([shape, 0.0, 0.0])


def _one_stop_candidate(gap: Gap, unknowns: Unknowns) -> Candidate:
    """Candidate of the unknowns shape, log s_x and log s_v, with an upper stop alone."""
    (stop,) = gap.stops
    shape, log_deviation, log_speed = unknowns.tolist()
    law, deviation = _one_stop_law(shape), math.exp(log_deviation)
    return _closed(
        gap,
        mean=stop.position - law.mean * deviation,
        variance=deviation**2,
        speed=math.exp(log_speed),
        densities=[law.density_at_stop / deviation],
        density_at_mean=law.density_at_mean / deviation,
        rise=law.rise,
    )
