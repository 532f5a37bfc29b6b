"""The moment closure between rigid stops, for arrays. Chapters: the closure of many gaps; arrays of
oscillators under white noise."""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from stochvi.mathematics.impact_rates import StopStatistics, cut_laws
from stochvi.mathematics.numerics import Booleans, Vector, newton
from stochvi.methods.linearisation.linear_system import (
    ACCEPTED,
    ROOT_TWO_PI,
    Candidate,
    Form,
    Frame,
    Unknowns,
    imbalances,
)
from stochvi.model.gap import Gap, OscillatorArrays
from stochvi.model.model import LOWER, UPPER
from stochvi.results.errors import NotApplicable
from stochvi.sampling.calculations import calculation

# ------------------------------------------------------------------------------
# The moment closure between rigid stops, for many gaps at once; one gap is an array of one.
#
# The density is C exp(lambda x - kappa x^2 / 2) between the stops and v is Gaussian, with the mean
# square s^2. Below its floor kappa stays there, and the density right at the stops rises instead.
#
# In the variant "box" the distribution of impact speeds is that of a free mass in a box. Without
# spring and damper, under white noise, a mass between two stops of restitution R has one
# distribution up to units. There F1 = A p s^2 / 2 and F2 = A g p s^3 sqrt(2 / pi), p the density at
# the stop in the family of this closure. A and g depend on R alone: the slow rebounds of an
# inelastic stop fill the density near it, but hardly add to the force. Both fade where damping
# makes the speeds Gaussian. Where impacts take the share h of all losses, A^sqrt(h) stands in place
# of A; g, which belongs to the distribution of speeds, becomes g^h. With A itself in any gap, the
# mean error of F1 for zeta > .05 in gaps above a deviation is 9.1 % (2.5 % with sqrt(h)); with A to
# the power of h, that of sigma_x in narrower gaps is .7 % (.4 %), on the grid of the atlas.
# ------------------------------------------------------------------------------


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

FLOOR_STEPS, FLOOR_DEGREE = 8, 40
"""Number of Newton steps that reach rounding, and degree of the polynomial that interpolates to
rounding."""


@cache
def _of_box(values: tuple[float, ...]) -> scipy.interpolate.PchipInterpolator:
    """A table of boxes as a function of the restitution."""
    return scipy.interpolate.PchipInterpolator(BOX_RESTITUTION, values)


@cache
def _floor() -> np.polynomial.Chebyshev:
    """kappa D^2 of a gap of half width D by the density at its stops, in units of 1 / D."""

    def solved(wanted: Vector) -> Vector:
        one = np.ones_like(wanted)
        found = 4.5 * (0.5 - wanted)
        for _ in range(FLOOR_STEPS):
            law = cut_laws(0.0 * one, found, -one, one)
            found -= (law.upper - wanted) / (law.upper * (law.variance - 1.0) / 2.0)
        return found

    return np.polynomial.Chebyshev.interpolate(solved, FLOOR_DEGREE, domain=[0.5, 1.3])


def least_curvature(width: ArrayLike, restitutions: ArrayLike, box: bool = False) -> Vector:
    """The least kappa that is needed: that of an evenly filled, very narrow gap of its width.

    There the balance of forces asks for a density 1 / ((1 + R) A D) at the stops, D half the width
    and A = 1 but for the variant "box"; restitutions are (stops, gaps). A law that is more hollow
    than this would heap up mass at a far stop that nothing drives there. It is 0 for one stop.
    """
    r = np.asarray(restitutions, dtype=float)
    strength = np.minimum(_of_box(BOX_DENSITY)(r), 1.0) if box else 1.0
    # for R = 0 the floor is -3.53, or -5.5 of a box; for R = 1 it is 0
    floor = np.minimum(_floor()(np.max(1.0 / ((1.0 + r) * strength), axis=0)), 0.0)
    return np.asarray(floor / (np.asarray(width) / 2.0) ** 2)


class RigidGaps(NamedTuple):
    """Many gaps between rigid stops; rows of two for the lower and the upper ones.

    `positions` are infinite for no stop, whose R is 1; `squares` are E R^2, and `least` the least
    kappa.
    """

    positions: Vector
    restitutions: Vector
    squares: Vector
    damping_rate: Vector
    least: Vector

    def take(self, places: Any) -> RigidGaps:
        """Some of the gaps."""
        return RigidGaps._make(column[..., places] for column in self)


def closed(gaps: RigidGaps, unknowns: Unknowns, box: bool = False) -> Candidate:
    """Candidates of the unknowns lambda, kappa and log s_v, with an entry for each gap.

    With F1 and F2 of the law: m_F = (1 + R_u) F1_u - (1 + R_l) F1_l, k = covariance of the stop
    force with x / Var x, beta = impact loss / E v^2. Together with the exact variances of the
    linear system these are the balances of force, virial and energy.
    """
    slope, curvature, log_speed = unknowns
    with np.errstate(all="ignore"):
        law = cut_laws(slope, np.maximum(curvature, gaps.least), *gaps.positions)
        rise = 1.0 + np.maximum(gaps.least - curvature, 0.0)
        speed = np.exp(log_speed)
        density = rise * np.stack([law.lower, law.upper])
        rate, f1 = density * speed / ROOT_TWO_PI, density * speed**2 / 2.0
        f2 = 2.0 * rate * speed**2
        if box:
            strength = _of_box(BOX_DENSITY)(gaps.restitutions)
            loss = np.sum((1.0 - gaps.squares) * strength * f2, axis=0) / (2.0 * speed**2)
            share = np.where(loss > 0.0, loss / (gaps.damping_rate + loss), 0.0)
            number = strength ** np.sqrt(share)
            rate, f1 = number * rate, number * f1
            f2 = number * _of_box(BOX_SPEED)(gaps.restitutions) ** share * f2
        push = (1.0 + gaps.restitutions) * f1
        away = np.where(np.isfinite(gaps.positions), np.abs(gaps.positions - law.mean), 0.0)
        found: Any = {
            "mean": law.mean,
            "variance": law.variance,
            "velocity_mean_square": speed**2,
            "density_at_mean": law.at_mean,
            "stop_force": push[1] - push[0],
            "stiffness": np.sum(push * away, axis=0) / law.variance,
            "damping": np.sum((1.0 - gaps.squares) * f2, axis=0) / (2.0 * speed**2),
            "rise": rise,
        }
    hits: Any = {s: StopStatistics(*row) for s, *row in zip(SIDES, rate, f1, f2, strict=True)}
    return Candidate(**found, hits=hits, contacts={})


SIDES = LOWER, UPPER


def rigid_closure(box: bool = False) -> Form:
    """The closure of a gap between rigid stops, as an array of one."""

    def candidate(gap: Gap, unknowns: Unknowns) -> Candidate:
        stops = {stop.side: stop for stop in gap.stops}
        rows: Any = [
            (stop.position, stop.law.restitution, stop.law.restitution_mean_square)
            if (stop := stops.get(side))
            else (side * math.inf, 1.0, 1.0)
            for side in SIDES
        ]
        positions, restitutions, squares = np.array(rows).T[..., None]
        least = least_curvature([gap.width], restitutions, box)
        gaps = RigidGaps(positions, restitutions, squares, np.array([gap.damping_rate]), least)
        found: Any = closed(gaps, unknowns[:, None], box)
        numbers = [each if isinstance(each, dict) else float(each[0]) for each in found]
        hits = {
            side: StopStatistics(*(float(each[0]) for each in found.hits[side])) for side in stops
        }
        return Candidate._make(numbers)._replace(hits=hits)

    return Form(lambda gap: np.array([gap.load, gap.omega**2, 0.0]), candidate)


# ------------------------------------------------------------------------------
# The closure for arrays of oscillators between rigid stops under white noise.
# ------------------------------------------------------------------------------


CHUNK = 8192
"""Number of oscillators that are solved together: so many that the cost of a call does not
matter."""

SPEED_ACCEPTED = 0.1
"""Imbalance of the power of the elastic law that is accepted: its speed only sets units and a
start."""

START_SPEEDS = (1.0, 2.0, 0.5, 1.4, 0.7, 4.0, 0.25, 3.0, 8.0)
"""Speeds of the elastic law to start from, relative to the one that balances its power. Each is
tried where the one before led to no answer."""


class Linearised(NamedTuple):
    """Answer of the closure for many oscillators, SI units per unit mass.

    Rates are 0 where there is no stop. `stiffness` (1/s^2) and `damping` (1/s) are what the stops
    add on average; `rise` is the factor by which a density exceeds its law right at a stop (1
    where the family holds the answer). Everything is nan where `converged` is False.

    See Also
    --------
    stochvi.methods.linearisation.linearise_many : The calculation.
    """

    mean: Vector
    variance: Vector
    velocity_mean_square: Vector
    upcrossing_rate: Vector
    rate_lower: Vector
    rate_upper: Vector
    speed_rate_lower: Vector
    speed_rate_upper: Vector
    speed_square_rate_lower: Vector
    speed_square_rate_upper: Vector
    stiffness: Vector
    damping: Vector
    rise: Vector
    converged: Booleans


@calculation
def linearise_many(
    *,
    omega: ArrayLike,
    damping_rate: ArrayLike,
    intensity: ArrayLike,
    load: ArrayLike = 0.0,
    lower: ArrayLike = -math.inf,
    upper: ArrayLike = math.inf,
    restitution_lower: ArrayLike = 1.0,
    restitution_upper: ArrayLike = 1.0,
    budget: float | None = None,
) -> Linearised:
    """The closure of `linearise` for arrays of oscillators, some 10^5 per second and core.

    Parameters
    ----------
    omega, damping_rate, intensity, load
        x'' + damping_rate x' + omega^2 x = white noise of intensity S0 + load, per unit mass:
        1/s, 1/s, m^2/s^3, m/s^2. Everything is broadcast to one shape.
    lower, upper, restitution_lower, restitution_upper
        Rigid stops in metres from the position of the unloaded spring, infinite for none; their R.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    Linearised
        Arrays of the common shape; exact where no stop loses energy. An oscillator without a
        solution is nan and not `converged`.

    Raises
    ------
    NotApplicable, ValueError
        If any oscillator has no stationary state; if a number is out of range.

    See Also
    --------
    stochvi.linearise : One scene, with a bound on the error.

    Examples
    --------
    >>> found = linearise_many(
    ...     omega=1.0, damping_rate=0.1, intensity=0.2, lower=-1.0, upper=1.0,
    ...     restitution_lower=[1.0, 0.8], restitution_upper=[1.0, 0.8],
    ... )
    >>> [f"{math.sqrt(variance):.4f}" for variance in found.variance]
    ['0.5396', '0.5231']
    """
    whole = OscillatorArrays.broadcast(
        omega=omega,
        damping_rate=damping_rate,
        intensity=intensity,
        load=load,
        lower=lower,
        upper=upper,
        restitution_lower=restitution_lower,
        restitution_upper=restitution_upper,
    )
    shape, oscillators = whole.omega.shape, whole.flat()
    oscillators.check()
    unmet = oscillators.unmet()
    if unmet:
        raise NotApplicable("linearise", unmet)
    size = len(oscillators.omega)
    parts = [
        _chunk(oscillators.take(slice(start, start + CHUNK))) for start in range(0, size, CHUNK)
    ] or [_chunk(oscillators)]
    joined = [np.concatenate(rows).reshape(shape) for rows in zip(*parts, strict=True)]
    return Linearised(*joined)


# One chunk --------------------------------------------------------------------------------


def _chunk(oscillators: OscillatorArrays) -> Linearised:
    speed = oscillators.speed_scale(enough=SPEED_ACCEPTED)
    found = _solved_from(oscillators, speed)
    for factor in START_SPEEDS[1:]:
        failed = ~found.converged
        if not failed.any():
            break
        again = _solved_from(oscillators.take(failed), factor * speed[failed])
        for column, renewed in zip(found, again, strict=True):
            column[failed] = renewed
    return found


def _solved_from(oscillators: OscillatorArrays, speed: Vector) -> Linearised:
    """Newton's method from the elastic law at a speed, in its units."""
    with np.errstate(all="ignore"):
        law = cut_laws(
            oscillators.load / speed**2, (oscillators.omega / speed) ** 2, *oscillators.positions
        )
        frame = Frame._make([law.mean, np.sqrt(law.variance), speed])
        scaled = oscillators.scaled(law.mean, np.sqrt(law.variance), speed)
    restitutions = np.where(np.isfinite(scaled.positions), scaled.restitutions, 1.0)
    least = least_curvature(scaled.upper - scaled.lower, restitutions)
    gaps = RigidGaps(scaled.positions, restitutions, restitutions**2, scaled.damping_rate, least)

    def imbalance(unknowns: Unknowns, some: Any) -> Vector:
        o, candidate = scaled.take(some), closed(gaps.take(some), unknowns)
        with np.errstate(all="ignore"):
            square = o.intensity / (2.0 * (o.damping_rate + candidate.damping))
            moments: Any = square / (o.omega**2 + candidate.stiffness), square
            return imbalances(o, candidate, moments)

    start = np.array([scaled.load, scaled.omega**2, np.zeros_like(speed)])
    unknowns, left = newton(imbalance, start)
    good = left < ACCEPTED
    with np.errstate(all="ignore"):
        found: Any = frame.grow(closed(gaps, unknowns))
        speed = np.sqrt(found.velocity_mean_square)
        hits = [row for pair in zip(found.lower, found.upper, strict=True) for row in pair]
        columns = (
            found.mean, found.variance, found.velocity_mean_square,
            found.density_at_mean * speed / ROOT_TWO_PI, *hits,
            np.maximum(speed**2 / found.variance - oscillators.omega**2, 0.0),
            found.damping, found.rise,
        )  # fmt: skip
    return Linearised._make([*(np.where(good, column, np.nan) for column in columns), good])
