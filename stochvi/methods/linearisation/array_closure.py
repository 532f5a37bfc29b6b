"""The moment closure between rigid stops, for arrays. Chapters: many densities C exp(slope x -
curvature x^2 / 2) at once; the closure of many gaps; arrays of oscillators under white noise."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from stochvi.mathematics.impact_rates import CUT, StopStatistics
from stochvi.mathematics.numerics import Booleans, Vector, gauss_legendre
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
# Many laws C exp(slope x - curvature x^2 / 2) between stops at once: masses, moments, ends.
#
# They do for arrays what `TruncatedNormal` does for one law. All numbers are relative to the
# largest value of each density; panels end where it has fallen by e^-CUT. So tails and narrow gaps
# keep their digits.
# ------------------------------------------------------------------------------


class Rule(NamedTuple):
    """Gauss' rule of a panel: its nodes, and the matrix that turns densities there into moments 0
    to 2."""

    nodes: Vector
    powers: Vector

    @classmethod
    def of(cls, count: int) -> Rule:
        """The rule with this many nodes."""
        nodes, weights = gauss_legendre(count)
        return cls(nodes, weights[:, None] * nodes[:, None] ** np.arange(3))


FINE, ROUGH = Rule.of(32), Rule.of(16)
"""Rules of the two panels of each law. A normal distribution out to ten deviations keeps 1e-12 by
the fine rule, and 1e-4 by the rough one, which is enough for a scale."""


class TruncatedNormals(NamedTuple):
    """Moments of many laws, in the units of x.

    `lower` and `upper` are the densities at the stops (0 where there is none), `at_mean` that at
    the mean.
    """

    mean: Vector
    variance: Vector
    lower: Vector
    upper: Vector
    at_mean: Vector


def cut_laws(
    slope: Vector, curvature: Vector, lower: Vector, upper: Vector, rule: Rule = FINE
) -> TruncatedNormals:
    """The laws of these slopes (1/m) and curvatures (1/m^2); stops in m, infinite for none.

    A law that cannot be normalised, or whose digits do not suffice, is not a number.

    Examples
    --------
    >>> one = np.ones(1)
    >>> print(f"{cut_laws(0.0 * one, one, -one, one).variance[0]:.12f}")
    0.291125094773
    """
    with np.errstate(all="ignore"):
        peak = _peak(slope, curvature, lower, upper)
        inside = (curvature > 0.0) & (peak == slope / curvature)
        tilt = np.where(inside, 0.0, slope - curvature * peak)
        raw = np.zeros((3, len(slope)))
        for start, end in _panels(peak, slope, curvature, lower, upper):
            raw += _panel_moments(start, np.maximum(end, start), tilt, curvature, rule)
        mass = raw[0]
        first, second = raw[1:] / mass
        held = np.isfinite(mass) & (mass > 0.0) & _integrable(slope, curvature, lower, upper)
        mass = np.where(held, mass, np.nan)
        variance = second - first**2

        def density(offset: Vector) -> Vector:
            return np.asarray(np.exp(offset * (tilt - curvature * offset / 2.0)) / mass)

        return TruncatedNormals(
            mean=peak + first,
            variance=np.where(variance > 0.0, variance, np.nan),
            lower=np.where(np.isfinite(lower), density(lower - peak), 0.0),
            upper=np.where(np.isfinite(upper), density(upper - peak), 0.0),
            at_mean=density(first),
        )


def _integrable(slope: Vector, curvature: Vector, lower: Vector, upper: Vector) -> Booleans:
    falls_left = np.isfinite(lower) | (slope > 0.0)
    falls_right = np.isfinite(upper) | (slope < 0.0)
    both = np.isfinite(lower) & np.isfinite(upper)
    held: Booleans = (curvature > 0.0) | both | ((curvature == 0.0) & falls_left & falls_right)
    return held


def _peak(slope: Vector, curvature: Vector, lower: Vector, upper: Vector) -> Vector:
    """Place of the largest value of each density, m."""
    rise = (upper - lower) * (slope - curvature * (lower + upper) / 2.0)
    higher = np.where(rise > 0.0, upper, lower)
    only = np.where(np.isfinite(lower), lower, upper)
    end = np.where(np.isfinite(upper - lower), higher, only)
    return np.where(curvature > 0.0, np.clip(slope / curvature, lower, upper), end)


def _panels(
    peak: Vector, slope: Vector, curvature: Vector, lower: Vector, upper: Vector
) -> tuple[tuple[Vector, Vector], tuple[Vector, Vector]]:
    """Two intervals outside which each density is negligible, as offsets from its peak.

    On either side of an inner peak; or at either stop, where a density leans on both.
    """
    low, high = lower - peak, upper - peak
    left = np.maximum(-_reach(peak, -1.0, slope, curvature), low)
    right = np.minimum(_reach(peak, 1.0, slope, curvature), high)
    leaning = (curvature <= 0.0) & np.isfinite(high - low)
    flat = np.where(slope <= 0.0, high, low)
    valley = np.clip(slope / curvature - peak, low, high)
    turn = np.where(curvature == 0.0, flat, valley)
    from_lower = np.minimum(low + _reach(lower, 1.0, slope, curvature), turn)
    from_upper = np.maximum(high - _reach(upper, -1.0, slope, curvature), turn)
    none = np.zeros_like(peak)
    first = (np.where(low == 0.0, 0.0, left), none)
    second = (none, np.where(high == 0.0, 0.0, right))
    return (
        (np.where(leaning, low, first[0]), np.where(leaning, from_lower, first[1])),
        (np.where(leaning, from_upper, second[0]), np.where(leaning, high, second[1])),
    )


def _reach(start: Vector, direction: float, slope: Vector, curvature: Vector) -> Vector:
    """How far from `start` each density has fallen by e^-CUT; infinite if it never does."""
    fall = np.maximum(-direction * (slope - curvature * start), 0.0)
    bend = 2.0 * curvature * CUT
    concave = fall + np.hypot(fall, np.sqrt(np.maximum(bend, 0.0)))
    hollow = fall * (1.0 + np.sqrt(1.0 + bend / fall / fall))
    total = np.where(bend >= 0.0, concave, hollow)
    return np.where(total > 0.0, 2.0 * CUT / total, np.inf)


def _panel_moments(
    start: Vector, end: Vector, tilt: Vector, curvature: Vector, rule: Rule
) -> Vector:
    """Integrals of offset^k times the density relative to its peak, k = 0 to 2, as rows."""
    half, centre = (end - start) / 2.0, (end + start) / 2.0
    # log density at centre + half t: a quadratic in t
    constant = centre * (tilt - curvature * centre / 2.0)
    linear = half * (tilt - curvature * centre)
    square = -curvature * half**2 / 2.0
    log = square[:, None] * rule.nodes
    log += linear[:, None]
    log *= rule.nodes
    log += constant[:, None]
    local = half[:, None] * (np.exp(log, out=log) @ rule.powers)
    # t^k about the centre -> offset^k, by the binomial theorem
    t0, t1, t2 = (local[:, k] * half**k for k in range(3))
    return np.array([t0, t1 + centre * t0, t2 + centre * (2.0 * t1 + centre * t0)])


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

STEPS, HALVINGS = 60, 12
"""Largest numbers of Newton steps, and of halvings of one step."""

SPEED_ACCEPTED = 0.1
"""Imbalance of the power of the elastic law that is accepted: its speed only sets units and a
start."""

POLISHED = 1e-12
"""Imbalance at which Newton steps end: the last step usually reaches rounding."""

DIFFERENCE = 1e-7
"""Change of an unknown, of order 1, that gives the slope of the imbalances."""

LARGEST_STEP = 2.0
"""Largest Newton step of lambda, kappa and log s_v, which are of order 1 in the units of the
frame."""

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
    speed = _elastic_speed(oscillators)
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
    unknowns, good = newton(imbalance, start)
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


def newton(
    problem: Callable[[Vector, Any], Vector], start: Vector, enough: float = POLISHED
) -> tuple[Vector, Booleans]:
    """Roots of many problems (unknowns, problems), and which were found, by Newton's method with
    each step halved until the largest imbalance falls, until that is small `enough`.

    `problem` gives the imbalances of some problems, whose places are its second argument.
    """
    unknowns, every = start.copy(), np.arange(start.shape[1])
    values = problem(unknowns, every)
    moving = every[_size(values) > enough]
    for _ in range(STEPS):
        if not len(moving):
            break
        here, there = unknowns[:, moving], values[:, moving]
        before = _size(there)
        step = _step(problem, moving, here, there)
        left, share = np.arange(len(moving)), 1.0
        for _ in range(HALVINGS + 1):
            tried = here[:, left] + share * step[:, left]
            found = problem(tried, moving[left])
            better = _size(found) < before[left]
            places = moving[left[better]]
            unknowns[:, places], values[:, places] = tried[:, better], found[:, better]
            left, share = left[~better], share / 2.0
            if not len(left):
                break
        going = _size(values[:, moving]) > enough
        going[left] = False
        moving = moving[going]
    return unknowns, _size(values) < ACCEPTED


def _step(
    problem: Callable[[Vector, Any], Vector], some: Any, here: Vector, there: Vector
) -> Vector:
    """The Newton step of each problem, at most LARGEST_STEP; 0 where there is none."""
    ahead = DIFFERENCE * np.eye(len(here))
    slopes = [(problem(here + each[:, None], some) - there) / DIFFERENCE for each in ahead]
    jacobian = np.transpose(np.array(slopes), (2, 1, 0))
    with np.errstate(all="ignore"):
        jacobian[~(np.abs(np.linalg.det(jacobian)) > 0.0)] = np.nan
        step = -np.linalg.solve(jacobian, there.T[..., None])[..., 0].T
        step = step * np.minimum(1.0, LARGEST_STEP / np.abs(step).max(axis=0))
    return np.where(np.isfinite(step).all(axis=0), step, 0.0)


def _size(imbalance: Vector) -> Vector:
    """Largest imbalance of each oscillator; infinite where it is not a number."""
    largest = np.abs(imbalance).max(axis=0)
    return np.where(np.isnan(largest), np.inf, largest)


def _elastic_speed(oscillators: OscillatorArrays) -> Vector:
    """The speed at which the elastic law takes up the power that the noise supplies, m/s.

    b s^2 + sum 2 (1 - R_i) p_i s^3 / sqrt(2 pi) = S0 / 2, where 2 p / (1 + R) is the density at a
    stop that the balance of forces calls for; by the logarithms of both sides.
    """

    def surplus(log_speed: Unknowns, some: Any) -> Vector:
        o, speed = oscillators.take(some), np.exp(log_speed[0])
        with np.errstate(all="ignore"):
            law = cut_laws(o.load / speed**2, (o.omega / speed) ** 2, o.lower, o.upper, ROUGH)
            density = np.sum(2.0 * (1.0 - o.restitutions) * [law.lower, law.upper], axis=0)
            taken = (o.damping_rate + density * speed / ROOT_TWO_PI) * speed**2
            return np.asarray(np.log(taken / (o.intensity / 2.0)))[None]

    with np.errstate(all="ignore"):
        rough = _rough_log_speed(oscillators)
    return np.asarray(np.exp(newton(surplus, rough[None], SPEED_ACCEPTED)[0][0]))


def _rough_log_speed(o: OscillatorArrays) -> Vector:
    """Logarithm of a speed above the answer. With a damper it is the speed that the damper alone
    leaves. Without one it is the largest speed scale of springs, stops and noise."""
    gap = o.upper - o.lower
    rest = o.load / o.omega**2
    away = np.fmin(np.abs(o.upper - rest), np.abs(rest - o.lower))
    scales = np.array(
        [
            np.sqrt(o.intensity / (2.0 * o.omega)),
            np.where(np.isfinite(away), o.omega * away, 0.0),
            np.where(np.isfinite(gap), np.cbrt(gap * o.intensity), 0.0),
        ]
    )
    undamped = np.where(np.isfinite(scales), scales, 0.0).max(axis=0)
    # a load alone presses the mass on its stop, where it loses some load * s
    undamped = np.where(undamped > 0.0, undamped, o.intensity / np.abs(o.load))
    damped = np.sqrt(o.intensity / (2.0 * o.damping_rate))
    return np.asarray(np.log(np.where(o.damping_rate > 0.0, damped, undamped)))
