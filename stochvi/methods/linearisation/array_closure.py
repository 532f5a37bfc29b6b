"""The moment closure for arrays of oscillators between rigid stops. Chapters: many densities C
exp(slope x - curvature x^2 / 2) at once; the closure."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.impact_rates import CUT
from stochvi.mathematics.numerics import Booleans, Vector, gauss_legendre
from stochvi.model.gap import OscillatorArrays
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
    to 4."""

    nodes: Vector
    powers: Vector

    @classmethod
    def of(cls, count: int) -> Rule:
        """The rule with this many nodes."""
        nodes, weights = gauss_legendre(count)
        return cls(nodes, weights[:, None] * nodes[:, None] ** np.arange(5))


FINE, ROUGH = Rule.of(32), Rule.of(16)
"""Rules of the two panels of each law. A normal distribution out to ten deviations keeps 1e-12 by
the fine rule, and 1e-4 by the rough one, which is enough for a scale."""


class TruncatedNormals(NamedTuple):
    """Moments of many laws, in the units of x; central ones from the second on.

    `lower` and `upper` are the densities at the stops (0 where there is none), `at_mean` that at
    the mean.
    """

    mean: Vector
    variance: Vector
    third: Vector
    fourth: Vector
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
        raw = np.zeros((5, len(slope)))
        for start, end in _panels(peak, slope, curvature, lower, upper):
            raw += _panel_moments(start, np.maximum(end, start), tilt, curvature, rule)
        mass = raw[0]
        first, second, third, fourth = raw[1:] / mass
        held = np.isfinite(mass) & (mass > 0.0) & _integrable(slope, curvature, lower, upper)
        mass = np.where(held, mass, np.nan)
        variance = second - first**2

        def density(offset: Vector) -> Vector:
            return np.asarray(np.exp(offset * (tilt - curvature * offset / 2.0)) / mass)

        return TruncatedNormals(
            mean=peak + first,
            variance=np.where(variance > 0.0, variance, np.nan),
            third=third - 3.0 * first * second + 2.0 * first**3,
            fourth=fourth - 4.0 * first * third + 6.0 * first**2 * second - 3.0 * first**4,
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
    """Integrals of offset^k times the density relative to its peak, k = 0 to 4, as rows."""
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
    t0, t1, t2, t3, t4 = (local[:, k] * half**k for k in range(5))
    c = centre
    return np.array(
        [
            t0,
            t1 + c * t0,
            t2 + c * (2.0 * t1 + c * t0),
            t3 + c * (3.0 * t2 + c * (3.0 * t1 + c * t0)),
            t4 + c * (4.0 * t3 + c * (6.0 * t2 + c * (4.0 * t1 + c * t0))),
        ]
    )


# ------------------------------------------------------------------------------
# The closure for arrays of oscillators between rigid stops under white noise.
#
# Per unit mass, in units in which the elastic law exp(-U / s^2) has mean 0, deviation 1 and s = 1.
# Symbols: p_i the density at stop i, A_i = (1 + R_i) / 2, g = omega^2 / E v^2 and s_v^2 = E v^2.
# The law C exp(lambda x - kappa x^2 / 2) and s_v obey the balances of force, of virial about the
# mean and of energy:
#
#     g m - load / s_v^2 + A_u p_u - A_l p_l = 0,
#     1 - g Var x - A_u p_u (upper - m) - A_l p_l (m - lower) = 0,
#     (b + sum (1 - R_i^2) p_i s_v / sqrt(2 pi)) s_v^2 = S0 / 2:
#
# three equations for lambda, kappa and log s_v, whose derivatives are moments of the same law.
# ------------------------------------------------------------------------------


ROOT_TWO_PI = math.sqrt(2.0 * math.pi)

CHUNK = 8192
"""Number of oscillators that are solved together: so many that the cost of a call does not
matter."""

SPEED_STEPS, STEPS, HALVINGS = 60, 40, 12
"""Largest numbers of Newton steps for the speed of the elastic law and for the closure, and of
halvings of one step."""

SPEED_ACCEPTED = 0.05
"""Step of the logarithm of the speed of the elastic law with which its search ends: the speed only
sets units and a start."""

ACCEPTED = 1e-10
"""Largest imbalance of a solution, relative to its terms; the bound of `linearise`."""

POLISHED, CLOSE = 1e-13, 1e-6
"""Imbalance at which Newton steps end, and imbalance from which one more step reaches rounding."""

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


class _Unit(NamedTuple):
    """Units and origin of each oscillator's frame, and the oscillators in them."""

    origin: Vector
    length: Vector
    speed: Vector
    scaled: OscillatorArrays
    least: Vector


class _State(NamedTuple):
    """lambda, kappa and log s_v as rows, the law with these parameters, and the imbalances as
    rows."""

    unknowns: Vector
    law: TruncatedNormals
    rise: Vector
    imbalance: Vector
    damping: Vector

    def take(self, places: Booleans) -> _State:
        """The states of some oscillators."""
        return _State(
            self.unknowns[:, places],
            TruncatedNormals._make(column[places] for column in self.law),
            self.rise[places],
            self.imbalance[:, places],
            self.damping[places],
        )


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
    """Newton's method from the elastic law at a speed."""
    unit = _unit_of(oscillators, speed)
    start = np.array([unit.scaled.load, unit.scaled.omega**2, np.zeros_like(speed)])
    return _in_si(oscillators, unit, _newton(unit, start))


def _take(unit: _Unit, places: Booleans) -> _Unit:
    return _Unit(
        unit.origin[places],
        unit.length[places],
        unit.speed[places],
        unit.scaled.take(places),
        unit.least[places],
    )


def _accepted(state: _State) -> Booleans:
    with np.errstate(invalid="ignore"):
        return np.asarray(_size(state.imbalance) < ACCEPTED)


def _size(imbalance: Vector) -> Vector:
    """Largest imbalance of each oscillator; infinite where it is not a number."""
    largest = np.abs(imbalance).max(axis=0)
    return np.where(np.isnan(largest), np.inf, largest)


def _unit_of(oscillators: OscillatorArrays, speed: Vector) -> _Unit:
    with np.errstate(all="ignore"):
        law = cut_laws(
            oscillators.load / speed**2,
            (oscillators.omega / speed) ** 2,
            oscillators.lower,
            oscillators.upper,
        )
        length = np.sqrt(law.variance)
        time = length / speed
        scaled = OscillatorArrays(
            omega=oscillators.omega * time,
            damping_rate=oscillators.damping_rate * time,
            intensity=oscillators.intensity * time / speed**2,
            load=(oscillators.load - oscillators.omega**2 * law.mean) * time / speed,
            positions=(oscillators.positions - law.mean) / length,
            restitutions=oscillators.restitutions,
        )
    return _Unit(law.mean, length, speed, scaled, _least_curvature(scaled))


def _elastic_speed(oscillators: OscillatorArrays) -> Vector:
    """The speed at which the elastic law takes up the power that the noise supplies, m/s.

    b s^2 + sum 2 (1 - R_i) p_i s^3 / sqrt(2 pi) = S0 / 2, where 2 p / (1 + R) is the density at a
    stop that the balance of forces calls for; Newton's method in the logarithms of both sides.
    """
    o = oscillators
    with np.errstate(all="ignore"):
        log_power = np.log(o.intensity / 2.0)
        log_speed = _rough_log_speed(o)
        moving = np.ones(len(log_speed), dtype=bool)
        for _ in range(SPEED_STEPS):
            some = o.take(moving)
            step = _speed_step(some, log_power[moving], log_speed[moving])
            step = np.clip(np.nan_to_num(step, nan=0.0), -LARGEST_STEP, LARGEST_STEP)
            log_speed[moving] += step
            moving[moving] = np.abs(step) > SPEED_ACCEPTED
            if not moving.any():
                break
    return np.exp(log_speed)


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


def _speed_step(o: OscillatorArrays, log_power: Vector, log_speed: Vector) -> Vector:
    speed = np.exp(log_speed)
    slope, curvature = o.load / speed**2, (o.omega / speed) ** 2
    law = cut_laws(slope, curvature, o.lower, o.upper, ROUGH)
    damping, growth = o.damping_rate.copy(), np.zeros_like(speed)
    for there, density, restitution, _ in _sides(o, law):
        loss = 2.0 * (1.0 - restitution) * density * speed / ROOT_TWO_PI
        # d log p / d log s, since slope and curvature go as s^-2
        rise = slope * (there - law.mean) - curvature / 2.0 * (
            there**2 - law.mean**2 - law.variance
        )
        damping += loss
        growth += loss * (1.0 - 2.0 * rise)
    surplus = log_power - np.log(damping) - 2.0 * log_speed
    return np.asarray(surplus / (2.0 + growth / damping))


def _least_curvature(o: OscillatorArrays) -> Vector:
    """The least kappa of each frame: `_floor` over the square of half a gap; 0 for one stop."""
    restitution = np.where(np.isfinite(o.positions), o.restitutions, 1.0).min(axis=0)
    half = (o.upper - o.lower) / 2.0
    return np.asarray(_floor()(restitution) / half**2)


@cache
def _floor() -> np.polynomial.Chebyshev:
    """kappa D^2 of an evenly filled, very narrow gap of half width D, by R; -2.26 at 0, 0 at 1.

    There the balance of forces asks for the density 1 / (1 + R) / D at the stops, as in `forms`;
    by Newton's method from a straight line, at enough places to interpolate to rounding.
    """

    def solved(restitution: Vector) -> Vector:
        wanted, one = 1.0 / (1.0 + restitution), np.ones_like(restitution)
        found = -2.26 * (1.0 - restitution)
        for _ in range(FLOOR_STEPS):
            law = cut_laws(0.0 * one, found, -one, one)
            found -= (law.upper - wanted) / (law.upper * (law.variance - 1.0) / 2.0)
        return found

    return np.polynomial.Chebyshev.interpolate(solved, FLOOR_DEGREE, domain=[0.0, 1.0])


FLOOR_STEPS, FLOOR_DEGREE = 6, 24
"""Number of Newton steps that reach rounding, and degree of the polynomial that interpolates to
rounding."""


def _evaluate(unit: _Unit, unknowns: Vector) -> _State:
    o, least = unit.scaled, unit.least
    slope, curvature, log_speed = unknowns
    with np.errstate(all="ignore"):
        law = cut_laws(slope, np.maximum(curvature, least), o.lower, o.upper)
        rise = 1.0 + np.maximum(least - curvature, 0.0)
        square = np.exp(2.0 * log_speed)
        force = (o.omega**2 * law.mean - o.load) / square
        virial = 1.0 - o.omega**2 * law.variance / square
        damping = o.damping_rate.copy()
        for stop, density, restitution, sign in _sides(o, law):
            push = (1.0 + restitution) / 2.0 * rise * density
            force += sign * push
            virial -= push * np.abs(stop - law.mean)
            damping += _loss(restitution, rise * density, log_speed)
        deviation = np.sqrt(law.variance)
        energy = np.log(2.0 * damping / o.intensity) + 2.0 * log_speed
        return _State(unknowns, law, rise, np.array([force * deviation, virial, energy]), damping)


def _loss(restitution: Vector, density: Vector, log_speed: Vector) -> Vector:
    """The damper that takes as much as a stop: (1 - R^2) p s_v / sqrt(2 pi)."""
    loss = (1.0 - restitution**2) * density * np.exp(log_speed) / ROOT_TWO_PI
    return np.asarray(loss)


def _sides(
    o: OscillatorArrays, law: TruncatedNormals
) -> Iterator[tuple[Vector, Vector, Vector, float]]:
    """Place (0 where there is none), density, R and outward direction of the stops."""
    places = np.where(np.isfinite(o.positions), o.positions, 0.0)
    return zip(places, (law.lower, law.upper), o.restitutions, (-1.0, 1.0), strict=True)


def _newton(unit: _Unit, start: Vector) -> _State:
    """Newton's method with the step halved until the largest imbalance falls."""
    state = _evaluate(unit, start)
    unknowns = state.unknowns.copy()
    moving = _size(state.imbalance) > POLISHED
    for _ in range(STEPS):
        if not moving.any():
            break
        some = _take(unit, moving)
        here = state.take(moving)
        found, better = _search(some, here, _step(some, here))
        unknowns[:, moving] = found.unknowns
        state = _put(state, moving, found)
        close = _size(here.imbalance) < CLOSE
        moving[moving] = better & ~close & (_size(found.imbalance) > POLISHED)
    return state


def _put(state: _State, places: Booleans, found: _State) -> _State:
    """Copy of `state` with some columns replaced."""
    for old, new in zip((*state.law, *_rows(state)), (*found.law, *_rows(found)), strict=True):
        old[..., places] = new
    return state


def _rows(state: _State) -> tuple[Vector, ...]:
    return state.unknowns, state.rise, state.imbalance, state.damping


def _step(unit: _Unit, state: _State) -> Vector:
    """The Newton step of lambda, kappa and log s_v."""
    o, law, rise = unit.scaled, state.law, state.rise
    _, curvature, log_speed = state.unknowns
    with np.errstate(all="ignore"):
        m, var = law.mean, law.variance
        square = np.exp(2.0 * log_speed)
        stiffness = o.omega**2 / square
        risen = curvature < unit.least
        # derivatives by lambda and kappa of the mean, the variance, and log p at the stops
        mean_by = (var, np.where(risen, 0.0, -law.third / 2.0 - m * var))
        spread_by = (
            law.third,
            np.where(risen, 0.0, -(law.fourth - var**2) / 2.0 - m * law.third),
        )
        zero = np.zeros_like(m)
        jacobian = np.empty((len(m), 3, 3))
        for k in (0, 1):
            force, virial, energy = stiffness * mean_by[k], -stiffness * spread_by[k], zero.copy()
            for stop, density, restitution, sign in _sides(o, law):
                log_by = (
                    stop - m,
                    np.where(risen, -1.0 / rise, -(stop**2 - m**2 - var) / 2.0),
                )[k]
                push = (1.0 + restitution) / 2.0 * rise * density
                force += sign * push * log_by
                virial -= push * (np.abs(stop - m) * log_by - sign * mean_by[k])
                energy += _loss(restitution, rise * density, log_speed) * log_by
            deviation = np.sqrt(var)
            jacobian[:, 0, k] = force * deviation + state.imbalance[0] * spread_by[k] / (2.0 * var)
            jacobian[:, 1, k] = virial
            jacobian[:, 2, k] = energy / state.damping
        losses = state.damping - o.damping_rate
        jacobian[:, 0, 2] = -2.0 * (stiffness * m - o.load / square) * np.sqrt(var)
        jacobian[:, 1, 2] = 2.0 * stiffness * var
        jacobian[:, 2, 2] = 2.0 + losses / state.damping
        return _by_cramer(jacobian, -state.imbalance.T).T


def _by_cramer(matrix: Vector, right: Vector) -> Vector:
    """Cramer's rule, three by three; not a number where there is no solution."""
    a, b, c = matrix[:, :, 0], matrix[:, :, 1], matrix[:, :, 2]
    cross = _cross(b, c)
    determinant = (a * cross).sum(axis=1)
    columns = (
        (right * cross).sum(axis=1),
        (a * _cross(right, c)).sum(axis=1),
        (a * _cross(b, right)).sum(axis=1),
    )
    return np.asarray(np.stack(columns, axis=1) / determinant[:, None])


def _cross(a: Vector, b: Vector) -> Vector:
    return np.stack(
        [
            a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1],
            a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2],
            a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0],
        ],
        axis=1,
    )


def _search(unit: _Unit, state: _State, step: Vector) -> tuple[_State, Booleans]:
    """State after the step, or after the largest part of the step that lowers the imbalance."""
    with np.errstate(all="ignore"):
        step = step * np.minimum(1.0, LARGEST_STEP / np.abs(step).max(axis=0))
    step = np.where(np.isfinite(step), step, 0.0)
    size = _size(state.imbalance)
    found = _evaluate(unit, state.unknowns + step)
    better = _size(found.imbalance) < size
    share = 1.0
    for _ in range(HALVINGS):
        if better.all():
            break
        share /= 2.0
        again = ~better
        trial = _evaluate(_take(unit, again), state.unknowns[:, again] + share * step[:, again])
        lower = _size(trial.imbalance) < size[again]
        better[again] = lower
        found = _put(found, again, trial)
    if not better.all():
        kept = state.take(~better)
        found = _put(found, ~better, kept)
    return found, better


def _in_si(oscillators: OscillatorArrays, unit: _Unit, state: _State) -> Linearised:
    """The solutions in SI units; without stops the linear law itself is the elastic one."""
    law, rise, damping = state.law, state.rise, state.damping
    good = _accepted(state)
    with np.errstate(all="ignore"):
        speed = unit.speed * np.exp(state.unknowns[2])
        frequency = speed / unit.length
        lower, upper = rise * law.lower, rise * law.upper
        variance = law.variance * unit.length**2
        columns = (
            unit.origin + unit.length * law.mean,
            variance,
            speed**2,
            law.at_mean * frequency / ROOT_TWO_PI,
            lower * frequency / ROOT_TWO_PI,
            upper * frequency / ROOT_TWO_PI,
            lower * frequency * speed / 2.0,
            upper * frequency * speed / 2.0,
            lower * frequency * speed**2 * 2.0 / ROOT_TWO_PI,
            upper * frequency * speed**2 * 2.0 / ROOT_TWO_PI,
            np.maximum(speed**2 / variance - oscillators.omega**2, 0.0),
            (damping - unit.scaled.damping_rate) * unit.speed / unit.length,
            rise,
        )
    return Linearised._make([*(np.where(good, column, np.nan) for column in columns), good])
