"""Exact stationary solutions of the Fokker-Planck equation, where a closed form exists.

Chapters: one oscillator; impact pairs that springs couple; several coordinates; `exact`; the joint
density; autocorrelations.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
from scipy.special import zeta

from stochvi.mathematics.impact_rates import CUT, ContactStatistics, StopStatistics, gaussian_stop
from stochvi.mathematics.numerics import CANCELLATION, Matrix, Vector, gauss_panels
from stochvi.mathematics.spectra import LinearMoments, response_moments
from stochvi.model.build_response import (
    StationaryMoments,
    build_response,
    linear_acceleration,
    residuals,
)
from stochvi.model.coverage import (
    beyond_one_oscillator,
    functions,
    not_gaussian,
    without_energy,
    without_noise,
)
from stochvi.model.gap import Gap, GibbsLaw, Spring
from stochvi.model.modal import absolute_accelerations, linear_law
from stochvi.model.model import LOWER, UPPER, Model, Pair, Stop, model_of
from stochvi.results.base import CoordinateResponse, PairResponse, Response
from stochvi.results.errors import MOST_NUMBERS, NoExactSolution, SceneError
from stochvi.results.estimates import Cost, Estimate
from stochvi.sampling.calculations import calculation
from stochvi.scenes.impact_laws import CompliantLaw, Law, Restitution
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import NonlinearOscillator

# ------------------------------------------------------------------------------
# One oscillator: p(x, v) = C exp(-(v^2 / 2 + U(x)) / theta), theta = S0 / 2 b (B 13.38).
#
# Without stops the response of a linear oscillator to a tabulated density is Gaussian, and its
# moments are integrals over frequency.
# ------------------------------------------------------------------------------


HEAVIEST = 3.0
"""A density that falls as |x|^-n far out has a finite variance only for n above this number."""


def response_of_one(scene: Scene, started: float) -> Response:
    """The answer for a scene without unmet conditions."""
    model = model_of(scene)
    law = displacement_law(scene)
    velocity = law.theta
    lower, upper = Gap.of(model).ends
    return StationaryMoments(
        mean=law.mean,
        variance=law.variance,
        velocity_mean_square=velocity,
        upcrossing_rate=law.density_at(law.mean) * math.sqrt(velocity / (2.0 * math.pi)),
        lower=gaussian_stop(law.density_at(lower), velocity),
        upper=gaussian_stop(law.density_at(upper), velocity),
        contact_lower=law.contact("lower"),
        contact_upper=law.contact("upper"),
        acceleration_mean_square=linear_acceleration(model),
    ).response("exact", scene, how="closed form", started=started)


def unmet_by_one(model: Model) -> list[str]:
    """The conditions of the closed form that a model of one oscillator does not meet."""
    found = [f"{loss} at the {stop.name} stop" for stop in model.stops if (loss := lossy(stop.law))]
    found += without_energy(model) if not found else []
    found += not_gaussian(model)
    if model.drag is not None:
        found.append("damping must be linear, got a function of velocity")
    if model.tables and model.stops:
        found.append(
            "excitation must be white noise where there are stops, got a tabulated density"
        )
    if model.tables and model.restoring is not None:
        found.append(
            "excitation must be white noise where the spring is a function, got a tabulated density"
        )
    if model.damping_rate == 0.0 and model.drag is None:
        found.append("damping must be positive, got 0 (there would be no stationary state)")
    found.extend(without_noise(model))
    if model.restoring is not None:
        if not found and not _held(model, _white_theta(model)):
            found.append("restoring_force must hold the mass where stops do not")
        elif not found:
            heaviest = _gibbs_law(model, _white_theta(model)).heaviest
            if heaviest <= HEAVIEST:
                found.append(
                    "restoring_force must leave a finite variance, got a density that falls as "
                    f"x^-{heaviest:.3g} far out, no faster than x^-3"
                )
    elif model.omega == 0.0 and not _held(model, theta=1.0):
        found.append("stiffness must be positive where stops do not hold the mass, got 0")
    return found


def lossy(law: Law) -> str:
    """The condition that a stop without loss meets, and what this one has; empty if it meets it."""
    if law.conservative:
        return ""
    if not law.rigid:
        return f"law must lose no energy, got {law.kind!r}"
    got = "a function of speed"
    if isinstance(law, Restitution):
        plain = isinstance(law.coefficient, int | float)
        got = f"{law.coefficient:g}" if plain else str(law.coefficient)
    return f"restitution must be 1 (an elastic stop), got {got}"


def displacement_law(scene: Scene) -> GibbsLaw:
    """Law exp(-U / theta) between the stops; under tabulated noise the Gaussian distribution.

    Raises
    ------
    SceneError
        If the potential that a spring was given is not that of its force.
    """
    model = model_of(scene)
    theta = _white_theta(model)
    if model.tables:
        tables = _table_moments(model)
        velocity, variance = theta + tables.velocity, tables.displacement
        variance += theta / model.omega**2
        omega = math.sqrt(velocity / variance)
        load = model.rest * omega**2
        return GibbsLaw(theta=velocity, omega=omega, load=load)
    law = _gibbs_law(model, theta)
    if isinstance(scene.structure, NonlinearOscillator):
        _check_potential(scene.structure, law)
    return law


def _held(model: Model, theta: float) -> bool:
    try:
        _gibbs_law(model, theta)
    except ValueError:
        return False
    return True


def _gibbs_law(model: Model, theta: float) -> GibbsLaw:
    spring = None
    if model.restoring is not None and model.potential is not None:
        spring = Spring(model.restoring, model.potential)
    return GibbsLaw.of(Gap.of(model), theta, spring)


def _white_theta(model: Model) -> float:
    """Mean square velocity theta = S0 / (2 b) under white noise, m^2/s^2."""
    return model.intensity / (2.0 * model.damping_rate)


def _table_moments(model: Model) -> LinearMoments:
    return response_moments(model.acceleration_tables, model.omega, model.damping_rate)


POTENTIAL_ERROR = 1e-6
"""Largest difference between a given potential and the integral of its force, relative to the
energies there and to theta."""


def _check_potential(structure: NonlinearOscillator, law: GibbsLaw) -> None:
    """Compare a given potential with the integral of the force, where the mass is found."""
    if structure.potential is None:
        return
    places = np.linspace(law.mean - law.deviation, law.mean + law.deviation, 5)
    bare = structure.model_copy(update={"potential": None})
    by_force, own = bare.potential_at(places), structure.potential_at(places)
    allowed = POTENTIAL_ERROR * (np.abs(by_force).max() + structure.mass * law.theta)
    wrong = np.abs(own - by_force) > allowed
    if np.any(wrong):
        raise SceneError(
            "structure",
            "needs a potential whose derivative is restoring_force, got the energy "
            f"{own[wrong][0]:g} J at {places[wrong][0]:g} m where the integral of the "
            f"force is {by_force[wrong][0]:g} J",
        )


# ------------------------------------------------------------------------------
# A few impact pairs that springs couple: their joint density by quadrature on a product of panels.
#
# p(y) ~ exp(-(y' A y / 2 - h' y + sum_j V_j(y_j)) / theta) between rigid stops.
# ------------------------------------------------------------------------------


MOST_PAIRS = 3
"""Largest number of coupled pairs that are integrated together: a fourth would cost another factor
of a hundred."""

NODES = {2: (24, 32), 3: (16, 20)}
"""Numbers of nodes in each panel of a coordinate, by the number of pairs: of the coarse rule, from
which the error is estimated, and of the fine one."""

ALLOWED = 1e-6
"""Largest relative change of a moment from the coarse to the fine rule with which the integrals
count as exact."""

MODE_ERROR = 1e-3
"""Error allowed in the place where the density is largest, in deviations of a coordinate with the
others held. A panel is four of these deviations long, so that this error does not matter."""

MOST_SWEEPS = 1000
"""Largest number of times that every coordinate is put where the energy is least."""

STEPS_INTO_A_STOP = (1.0, 3.0, 9.0)
"""Edges of panels within a compliant stop, in deflections that an impact at the rms speed
causes."""


class Intractable(Exception):
    """The integrals of a law cannot be found here; the message says why."""


@dataclass(frozen=True, kw_only=True)
class Rule:
    """A product rule: nodes of each coordinate, and the weights with the density, normalised."""

    nodes: tuple[Vector, ...]
    weights: NDArray[np.float64]
    log_mass: float


@dataclass(frozen=True, kw_only=True)
class CoupledLaw:
    """The law of pairs that depend on each other.

    Parameters
    ----------
    theta
        Energy, J.
    stiffness, load
        A (p, p), N/m, and h (p,), N.
    pairs
        The pairs, with their stops.

    Raises
    ------
    Intractable
        If nothing bounds a coordinate, or if the two rules of the quadrature differ.
    """

    theta: float
    stiffness: Matrix
    load: Vector
    pairs: tuple[Pair, ...]
    error: float = field(init=False)

    def __post_init__(self) -> None:
        self.__dict__["error"] = self._settled()

    # The energy ---------------------------------------------------------------------------

    def _soft(self, place: int) -> list[tuple[Stop, CompliantLaw]]:
        """Compliant stops of a pair, with their laws."""
        stops = self.pairs[place].stops
        return [(stop, stop.law) for stop in stops if isinstance(stop.law, CompliantLaw)]

    def _walls(self, place: int) -> tuple[float, float]:
        """Places of the rigid stops that cut the density of a coordinate; infinite for none."""
        held = {stop.side: stop.position for stop in self.pairs[place].stops if stop.rigid}
        return held.get(LOWER, -math.inf), held.get(UPPER, math.inf)

    def _stored(self, place: int, y: Vector) -> Vector:
        """Energy in the stops of a pair less that of the load, J."""
        energy = -self.load[place] * y
        for stop, law in self._soft(place):
            energy = energy + law.potential_at(stop.deflection(y))
        return np.asarray(energy)

    def _slope(self, y: Vector) -> Vector:
        """Derivatives of the energy by the coordinates, N."""
        slope = np.asarray(self.stiffness @ y - self.load)
        for place, here in enumerate(y):
            for stop, law in self._soft(place):
                slope[place] += stop.side * float(law.force_at(stop.deflection(here)))
        return slope

    @cached_property
    def _mode(self) -> Vector:
        """Place of the largest density: each coordinate in turn is put where the energy, which is
        convex, is least."""
        low, high = np.array([self._walls(place) for place in range(len(self.pairs))]).T
        unit = np.sqrt(self.theta / np.diag(self.stiffness))
        y = np.clip(np.zeros(len(unit)), low, high)
        for _ in range(MOST_SWEEPS):
            for place in range(len(y)):
                y[place] = self._lowest(place, y, low[place], high[place])
            # the energy bends at least as its springs do, so that this bounds how far y is off
            step = self._slope(y) / np.diag(self.stiffness)
            if np.all(np.abs(y - np.clip(y - step, low, high)) <= MODE_ERROR * unit):
                return y
        names = ", ".join(repr(pair.name) for pair in self.pairs)
        raise Intractable(f"no place was found where the density of the pairs {names} is largest")

    def _lowest(self, place: int, y: Vector, low: float, high: float) -> float:
        """Value of one coordinate at which the energy is least, with the others held."""

        def slope(x: float) -> float:
            moved = y.copy()
            moved[place] = x
            return float(self._slope(moved)[place])

        here, first = float(y[place]), slope(float(y[place]))
        end = min(max(here - first / float(self.stiffness[place, place]), low), high)
        last = slope(end)
        if first * last >= 0.0:
            return end if abs(last) < abs(first) else here
        return float(scipy.optimize.brentq(slope, here, end, xtol=1e-300, rtol=1e-15))

    def _ends(self, place: int) -> tuple[float, float]:
        """A range that leaves e^-CUT: the energy above its minimum is at least d' A d / 2."""
        low, high = self._walls(place)
        values, vectors = np.linalg.eigh(self.stiffness)
        reach = math.inf
        if values[0] > 1e-12 * values[-1]:
            variance = float(np.sum(vectors[place] ** 2 / values)) * self.theta
            reach = math.sqrt(2.0 * CUT * variance)
        low, high = max(low, self._mode[place] - reach), min(high, self._mode[place] + reach)
        if not math.isfinite(low) or not math.isfinite(high):
            raise Intractable(
                f"springs or two rigid stops must hold the pair {self.pairs[place].name!r}"
            )
        return low, high

    # Quadrature ---------------------------------------------------------------------------

    def _panels(self, place: int) -> list[float]:
        low, high = self._ends(place)
        edges = {low, high, float(self._mode[place])}
        speed = math.sqrt(self.theta / self.pairs[place].mass)
        for stop, law in self._soft(place):
            knots = law.knots()
            depth = law.impact(speed, self.pairs[place].mass).peak_deflection
            into = [*knots, *(step * depth for step in STEPS_INTO_A_STOP)]
            edges |= {float(stop.position + stop.side * y) for y in into}
        own = math.sqrt(self.theta / self.stiffness[place, place])
        whole = sorted(edge for edge in edges if low <= edge <= high)
        # no panel longer than a few deviations of the coordinate with the others held
        return sorted(
            {
                float(edge)
                for one, two in pairwise(whole)
                for edge in np.linspace(one, two, 1 + math.ceil((two - one) / (4.0 * own)))
            }
        )

    def _rule(self, nodes: int, fixed: tuple[int, float] | None = None) -> Rule:
        """The product rule; with `fixed` = (pair, y) on the plane where one coordinate is y."""
        places, weights = [], []
        for place in range(len(self.pairs)):
            if fixed is not None and fixed[0] == place:
                places.append(np.array([fixed[1]]))
                weights.append(np.ones(1))
                continue
            panel_nodes, panel_weights = gauss_panels(self._panels(place), nodes)
            places.append(panel_nodes)
            weights.append(panel_weights)
        if math.prod(map(len, places)) > MOST_NUMBERS:
            raise Intractable(f"the quadrature over {len(places)} coupled pairs is too large")
        grid = np.meshgrid(*places, indexing="ij", sparse=True)
        energy = sum(
            self._stored(row, y) + 0.5 * self.stiffness[row, row] * y**2
            for row, y in enumerate(grid)
        )
        for row in range(len(grid)):
            for column in range(row):
                energy = energy + self.stiffness[row, column] * grid[row] * grid[column]
        energy = np.asarray(energy)
        least = float(energy.min())
        density = np.exp(-(energy - least) / self.theta)
        for weight in np.ix_(*weights):
            density = density * weight
        mass = float(density.sum())
        return Rule(
            nodes=tuple(places),
            weights=density / mass,
            log_mass=math.log(mass) - least / self.theta,
        )

    def _settled(self) -> float:
        """The error of the fine rule; Intractable where the two rules differ."""
        coarse, fine = (self._rule(nodes) for nodes in NODES[len(self.pairs)])
        self.__dict__["_fine"] = fine
        one, two = _moments(coarse), _moments(fine)
        size = np.sqrt(np.diag(two[1]))
        error = max(
            float(np.max(np.abs(one[0] - two[0]) / size)),
            float(np.max(np.abs(one[1] - two[1]) / np.outer(size, size))),
            abs(math.expm1(coarse.log_mass - fine.log_mass)),
        )
        if not error <= ALLOWED:
            raise Intractable(
                f"the quadrature over {len(self.pairs)} coupled pairs has not settled (error "
                f"{error:.1g})"
            )
        return error

    # Moments and rates ---------------------------------------------------------------------

    @cached_property
    def mean(self) -> Vector:
        """Mean of the gaps y, m."""
        return _moments(self._fine_rule)[0]

    @cached_property
    def covariance(self) -> Matrix:
        """Covariance matrix of the gaps, m^2."""
        return _moments(self._fine_rule)[1]

    @property
    def _fine_rule(self) -> Rule:
        rule: Rule = self.__dict__["_fine"]
        return rule

    def density_at(self, place: int, y: float) -> float:
        """Marginal density of one pair's coordinate, 1/m."""
        plane = self._rule(NODES[len(self.pairs)][1], fixed=(place, y))
        return math.exp(plane.log_mass - self._fine_rule.log_mass)

    def contact(self, place: int, side: str) -> ContactStatistics | None:
        """Contact with one compliant stop, per unit of the reduced mass."""
        marginal = _marginal(self._fine_rule, place)
        for stop, law in self._soft(place):
            if stop.name == side:
                y = stop.deflection(self._fine_rule.nodes[place])
                force = float(law.force_at(y) @ marginal) / self.pairs[place].mass
                return ContactStatistics(float(marginal[y > 0.0].sum()), force, None)
        return None


def _marginal(rule: Rule, place: int) -> Vector:
    axes = tuple(axis for axis in range(rule.weights.ndim) if axis != place)
    return np.asarray(rule.weights.sum(axis=axes))


def _moments(rule: Rule) -> tuple[Vector, Matrix]:
    """Mean and covariance."""
    count = len(rule.nodes)
    mean = np.array([_marginal(rule, row) @ rule.nodes[row] for row in range(count)])
    away = [rule.nodes[row] - mean[row] for row in range(count)]
    covariance = np.zeros((count, count))
    for row in range(count):
        covariance[row, row] = _marginal(rule, row) @ away[row] ** 2
        for column in range(row):
            axes = tuple(axis for axis in range(count) if axis not in (row, column))
            joint = rule.weights.sum(axis=axes)
            covariance[row, column] = covariance[column, row] = away[column] @ joint @ away[row]
    return mean, covariance


# ------------------------------------------------------------------------------
# Several coordinates: the Gibbs distribution exp(-H / theta), and Gaussian distributions without
# stops.
#
# The stops see y = D q alone, one entry per impact pair. Given y the rest is Gaussian, so that
#
#     p(y) ~ exp(-(y' A y / 2 - h' y + sum_j V_j(y_j)) / theta),   q | y ~ N(base + G y, spread),
#
# A and h what is left of stiffness and load after the other directions have settled. Pairs that A
# does not couple are independent, each like one oscillator; coupled ones are integrated together.
# ------------------------------------------------------------------------------


MOST_NAMED = 4
"""Largest number of stops that a condition names one by one."""


class Split(NamedTuple):
    """The energy in the pairs' coordinates y, and the Gaussian distribution of q that is left given
    y.

    stiffness (p, p) and load (p,) are A and h; q | y has the mean base + gain y and the
    covariance `spread`.
    """

    stiffness: Matrix
    load: Vector
    gain: Matrix
    base: Vector
    spread: Matrix


class PairLaw(NamedTuple):
    """Impacts and contacts of one pair, per unit of its reduced mass, by the side of the stop."""

    stops: Mapping[str, StopStatistics]
    contacts: Mapping[str, ContactStatistics | None]


class Solution(NamedTuple):
    """Moments of all coordinates, and each pair; `error` is that of the quadrature, relative.

    `acceleration` holds the mean squares of the absolute accelerations of all outputs, where these
    are finite.
    """

    mean: Vector
    covariance: Matrix
    velocity: Matrix
    pairs: Sequence[PairLaw]
    error: float
    acceleration: Vector | None = None


def unmet_by_several(model: Model) -> list[str]:
    """The conditions of a closed form that a model of any structure does not meet."""
    found = functions(model, with_branches=not model.pairs) + not_gaussian(model)
    if found:
        return found
    if model.tables and model.pairs:
        found.append(
            "excitation must be white noise where there are stops, got a tabulated "
            "density; linearise and simulate take it"
        )
    if model.sines:
        found.append("excitation must be noise, got a sine")
    found.extend(without_noise(model))
    if not model.pairs:
        if not _settles(model):
            found.append(
                "stiffness and damping must hold every coordinate where there are no stops"
            )
        return found
    if any(signal.intensity for signal in model.signals):
        found.append("excitation must be white noise where there are stops, got filtered noise")
    found.extend(_losses(model))
    return found or without_energy(model) or _not_gibbs(model)


def _losses(model: Model) -> Iterator[str]:
    """Stops that lose energy, each by its name, or counted where they are many."""
    places: dict[str, list[str]] = {}
    for pair in model.pairs:
        for stop in pair.stops:
            if loss := lossy(stop.law):
                places.setdefault(loss, []).append(f"the {stop.name} stop of {pair.name}")
    for loss, at in places.items():
        if len(at) > MOST_NAMED:
            yield f"{loss} at {len(at)} stops, the first of which is {at[0]}"
        else:
            yield from (f"{loss} at {place}" for place in at)


def _not_gibbs(model: Model) -> list[str]:
    """The conditions of the Gibbs distribution that a model with elastic stops in white noise does
    not meet."""
    if model.temperature is None:
        return [
            "white noise must match damping, S = 2 theta C with one theta for all coordinates: "
            "noise of the base, or on a part of what is damped, does not; linearise and simulate "
            "take any noise"
        ]
    if not _reached(model):
        return ["damping and noise must reach every motion, directly or through springs and stops"]
    directions = np.array([pair.direction for pair in model.pairs])
    if np.linalg.matrix_rank(directions) < len(directions):
        return [
            f"impact pairs must act on independent coordinates, got {len(directions)} pairs on "
            f"{np.linalg.matrix_rank(directions)} of them"
        ]
    try:
        solve(model)
    except (Intractable, ValueError) as reason:
        return [str(reason)]
    return []


def response_of_several(scene: Scene, started: float) -> Response:
    """The answer for a scene without unmet conditions."""
    model = model_of(scene)
    found = solve(model) if model.pairs else _gaussian(model)
    free = "integral over frequency" if model.tables else "Lyapunov"
    how = "closed form" if model.pairs else f"closed form ({free})"
    return build_response(
        scene,
        "exact",
        coordinates={
            name: _coordinate(model, found, row, how) for row, name in enumerate(model.outputs)
        },
        impact_pairs={
            pair.name: PairResponse(
                **_pair(law, pair.mass, found.error, how),
                **_relative(found, pair, how),
                speed_threshold=0.0,
            )
            for pair, law in zip(model.pairs, found.pairs, strict=True)
        },
        cost=Cost(wall_time=time.perf_counter() - started),
        identities={
            name: Estimate(value=value, bias=10.0 * found.error, how=how)
            for name, value in residuals(
                model, _moments_of_several(model, found), found.mean.tolist()
            ).items()
        },
    )


def _coordinate(model: Model, found: Solution, output: int, how: str) -> CoordinateResponse:
    row = model.output_rows[output]
    mean, velocity = row @ found.mean, row @ found.velocity @ row
    deviation = np.sqrt(row @ found.covariance @ row)
    values = {
        "displacement_mean": mean,
        "displacement_std": deviation,
        "displacement_mean_square": mean**2 + deviation**2,
        "velocity_std": np.sqrt(velocity),
        "velocity_mean_square": velocity,
    }
    if not model.pairs and deviation > 0.0:
        values["upcrossing_rate"] = np.sqrt(velocity) / deviation / (2.0 * np.pi)
    if found.acceleration is not None:
        values["acceleration_std"] = np.sqrt(found.acceleration[output])
    sizes = {**values, "displacement_mean": deviation}
    return CoordinateResponse(
        **{
            name: Estimate(value=float(value), bias=found.error * float(sizes[name]), how=how)
            for name, value in values.items()
        }
    )


def _relative(found: Solution, pair: Pair, how: str) -> dict[str, Estimate]:
    """Motion of a pair of two coordinates relative to each other."""
    d = pair.direction
    if not pair.relative:
        return {}
    deviation = float(np.sqrt(d @ found.covariance @ d))
    speed = float(np.sqrt(d @ found.velocity @ d))
    values = {
        "relative_displacement_mean": (float(d @ found.mean), deviation),
        "relative_displacement_std": (deviation, deviation),
        "relative_velocity_std": (speed, speed),
    }
    return {
        name: Estimate(value=value, bias=found.error * size, how=how)
        for name, (value, size) in values.items()
    }


def _pair(law: PairLaw, mass: float, error: float, how: str) -> dict[str, Estimate | None]:
    stops = [law.stops[side] for side in law.stops]
    rate, speed, square = (sum(column) for column in zip(*stops, strict=True))
    contacts = {side: contact for side, contact in law.contacts.items() if contact is not None}
    values: dict[str, float | None] = {
        "collision_rate": rate,
        "collision_rate_lower": law.stops["lower"].rate if "lower" in law.stops else None,
        "collision_rate_upper": law.stops["upper"].rate if "upper" in law.stops else None,
        "impact_speed_mean": speed / rate if rate else None,
        "impact_speed_rate": speed,
        "impact_speed_square_rate": square,
        "contact_probability": sum(item.probability for item in contacts.values()) or None,
        "contact_force_lower": mass * contacts["lower"].force if "lower" in contacts else None,
        "contact_force_upper": mass * contacts["upper"].force if "upper" in contacts else None,
    }
    return {
        name: None if value is None else Estimate(value=value, bias=error * abs(value), how=how)
        for name, value in values.items()
    }


def _moments_of_several(model: Model, found: Solution) -> dict[tuple[str, str], float]:
    """Moments from which the balances are calculated."""
    moments: dict[tuple[str, str], float] = {}
    for row, name in enumerate(model.coordinates):
        moments[name, "x"] = float(found.mean[row])
        moments[name, "variance"] = float(found.covariance[row, row])
        moments[name, "vv"] = float(found.velocity[row, row])
    for pair, law in zip(model.pairs, found.pairs, strict=True):
        for side, hits in law.stops.items():
            held = law.contacts[side]
            moments[pair.name, f"f1_{side}"] = hits.speed_rate
            moments[pair.name, f"f2_{side}"] = hits.speed_square_rate
            moments[pair.name, f"force_{side}"] = held.force if held else 0.0
            moments[pair.name, f"loss_{side}"] = 0.0
    moments["", "kinetic"] = float(np.trace(model.mass @ found.velocity))
    moments["", "potential"] = float(np.trace(model.stiffness @ found.covariance))
    moments["", "dissipation"] = float(np.trace(model.damping @ found.velocity))
    return moments


# The Gibbs distribution -------------------------------------------------------------------


def solve(model: Model) -> Solution:
    """Moments of exp(-H / theta).

    Raises
    ------
    ValueError, Intractable
        If a coordinate is held by nothing; if too many pairs depend on each other.
    """
    theta = model.temperature
    assert theta is not None
    split = _split(model, theta)
    size = np.sqrt(np.diag(split.stiffness))
    coupled = np.abs(split.stiffness) > CANCELLATION * np.outer(size, size)
    _, labels = scipy.sparse.csgraph.connected_components(coupled, directed=False)
    count = len(model.pairs)
    mean, covariance = np.zeros(count), np.zeros((count, count))
    pairs: list[PairLaw | None] = [None] * count
    error = 0.0
    for label in np.unique(labels):
        block = np.flatnonzero(labels == label)
        part = _one_pair if len(block) == 1 else _coupled_pairs
        found = part(model, split, theta, block)
        mean[block] = found.mean
        covariance[np.ix_(block, block)] = found.covariance
        error = max(error, found.error)
        for place, pair in zip(block, found.pairs, strict=True):
            pairs[place] = pair
    return Solution(
        mean=split.base + split.gain @ mean,
        covariance=split.spread + split.gain @ covariance @ split.gain.T,
        velocity=np.asarray(theta * np.linalg.inv(model.mass), dtype=float),
        pairs=[pair for pair in pairs if pair is not None],
        error=error,
    )


def _split(model: Model, theta: float) -> Split:
    """q = along y + across z with D along = 1, D across = 0; z is Gaussian given y."""
    directions = np.array([pair.direction for pair in model.pairs])
    along, across = np.linalg.pinv(directions), scipy.linalg.null_space(directions)
    stiffness, load = model.stiffness, model.constant_force
    held = across.T @ stiffness @ across
    if held.size and not _positive(held):
        raise ValueError("stiffness must hold every coordinate that stops do not hold")
    inverse = across @ np.linalg.solve(held, across.T) if held.size else np.zeros_like(stiffness)
    gain = along - inverse @ stiffness @ along
    bare = along.T @ stiffness @ along
    left = along.T @ stiffness @ gain
    size = np.sqrt(np.diag(bare))
    left = np.where(np.abs(left) > CANCELLATION * np.outer(size, size), (left + left.T) / 2.0, 0.0)
    return Split(left, gain.T @ load, gain, inverse @ load, theta * inverse)


def _one_pair(model: Model, split: Split, theta: float, block: NDArray[np.intp]) -> Solution:
    """Law of a pair that no spring couples to others: that of an oscillator of its reduced mass."""
    row = int(block[0])
    pair = model.pairs[row]
    omega = float(np.sqrt(max(split.stiffness[row, row], 0.0) / pair.mass))
    load = float(split.load[row]) / pair.mass
    gap = Gap.of_pair(pair, omega=omega, damping_rate=0.0, load=load)
    try:
        law = GibbsLaw.of(gap, theta=theta / pair.mass)
    except ValueError:
        raise ValueError(f"springs or stops must hold the pair {pair.name!r}") from None
    found = PairLaw(
        {stop.name: gaussian_stop(law.density_at(stop.position), law.theta) for stop in gap.stops},
        {stop.name: law.contact(stop.name) for stop in gap.stops},
    )
    nothing = np.zeros((1, 1))
    return Solution(np.array([law.mean]), np.array([[law.variance]]), nothing, [found], 0.0)


def _coupled_pairs(model: Model, split: Split, theta: float, block: NDArray[np.intp]) -> Solution:
    """Laws of pairs that springs couple, by integrals over all of them."""
    pairs = tuple(model.pairs[row] for row in block)
    if len(block) > MOST_PAIRS:
        names = ", ".join(pair.name for pair in pairs)
        raise Intractable(
            f"at most {MOST_PAIRS} impact pairs may depend on each other through springs, got "
            f"{len(block)} ({names})"
        )
    law = CoupledLaw(
        theta=theta,
        stiffness=split.stiffness[np.ix_(block, block)],
        load=split.load[block],
        pairs=pairs,
    )
    found = [
        PairLaw(
            {
                stop.name: gaussian_stop(law.density_at(place, stop.position), theta / pair.mass)
                for stop in pair.stops
            },
            {stop.name: law.contact(place, stop.name) for stop in pair.stops},
        )
        for place, pair in enumerate(pairs)
    ]
    return Solution(law.mean, law.covariance, np.zeros((0, 0)), found, law.error)


# Without stops ----------------------------------------------------------------------------


def _gaussian(model: Model) -> Solution:
    """Response of a linear structure to Gaussian noise: a Gaussian distribution."""
    modes = model.modal
    law = linear_law(modes)
    assert law is not None
    n, shapes = modes.size, modes.shapes
    displacement, velocity = (
        shapes @ law.covariance[part, part] @ shapes.T for part in (slice(0, n), slice(n, 2 * n))
    )
    return Solution(
        mean=shapes @ (modes.rest + law.mean),
        covariance=displacement,
        velocity=velocity,
        pairs=[],
        error=2.0 * model.rms_bias,  # of mean squares
        acceleration=absolute_accelerations(modes, law, model.output_rows)
        if model.base_alone_moves
        else None,
    )


def _settles(model: Model) -> bool:
    """Whether a linear structure forgets how it started."""
    return linear_law(model.modal) is not None


def _positive(matrix: Matrix) -> bool:
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    if np.any(size == 0.0):
        return False
    return bool(np.linalg.eigvalsh(matrix / np.outer(size, size))[0] > CANCELLATION)


def _reached(model: Model) -> bool:
    """Whether damping acts in every mode, with a spring of some stiffness in place of each stop.

    The stiffnesses are of the structure's size and have no simple ratio. No symmetry of the springs
    can then hide a motion that impacts would reach.
    """
    stiffness = model.stiffness.copy()
    size = float(np.trace(stiffness)) or 1.0
    for number, pair in enumerate(model.pairs, start=2):
        stiffness += size * np.sqrt(number) * np.outer(pair.direction, pair.direction)
    root = np.linalg.inv(np.linalg.cholesky(model.mass))
    _, modes = np.linalg.eigh(root @ stiffness @ root.T)
    damped = np.einsum("ij,ij->j", modes, (root @ model.damping @ root.T) @ modes)
    return bool(np.all(damped > CANCELLATION * damped.max()))


# ------------------------------------------------------------------------------
# `exact`: the closed form of one oscillator, or that of several coordinates.
# ------------------------------------------------------------------------------


@calculation
def exact(
    scene: Scene,
    *,
    budget: float | None = None,
) -> Response:
    """Exact stationary response (B 13.38-13.44, for any spring, any stops and a constant load).

    White force noise of intensity S = 2 theta C, C the damping, leaves the Gibbs density

        p(q, q') = Z exp(-(q' M q' / 2 + U(q)) / theta),        (B 13.38 for one coordinate)

    with U the potential of springs, load and elastic stops, infinite beyond rigid ones; for one
    oscillator theta = S0 / 2 b per unit mass. The answer holds every moment and, by stop, the
    impact rate nu = p(stop) sqrt(E y'^2 / 2 pi), y the coordinate of the impact pair. Impact speeds
    are Rayleigh distributed, which gives F1 and F2. Compliant stops also have the share of time in
    contact and the mean force. One oscillator has the mean of the largest force of a contact as
    well; it neglects noise and damping, and `bias` bounds the error of that. Without stops the
    response of a linear structure to Gaussian noise is Gaussian: white and filtered noise through
    the Lyapunov equation, tables as integrals over frequency.

    Parameters
    ----------
    scene
        The scene.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    Response
        Moments, rates and their errors, SI units.

    Raises
    ------
    NoExactSolution
        With every condition that the scene does not meet.

    See Also
    --------
    stochvi.fokker_planck : The same from the Fokker-Planck equation.
    stochvi.simulate : The same by Monte Carlo.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> exact(scene).coordinates["x"]["displacement_std"]
    0.539560094 [closed form]
    """
    started = time.perf_counter()
    model = model_of(scene)
    conditions = unmet(model)
    if conditions:
        raise NoExactSolution(conditions)
    if one_oscillator(model):
        return response_of_one(scene, started)
    return response_of_several(scene, started)


def unmet(model: Model) -> list[str]:
    """The conditions of a closed form that a model does not meet; empty where it meets all.

    Parameters
    ----------
    model
        The model of a scene.

    Returns
    -------
    list[str]
        Sentences, empty where everything is met.

    See Also
    --------
    stochvi.exact : The method.
    stochvi.explain : What all methods say of a scene.

    Examples
    --------
    >>> from stochvi.model.model import model_of
    >>> from stochvi.scenes import shipped_scene
    >>> from stochvi.scenes.scene import load_scene
    >>> model = model_of(load_scene(shipped_scene("oscillator-lossy")))
    >>> len(unmet(model))  # both stops take energy
    2
    """
    return unmet_by_one(model) if one_oscillator(model) else unmet_by_several(model)


def one_oscillator(model: Model) -> bool:
    """Whether the law of one oscillator, which takes functions, is the one to use."""
    return not beyond_one_oscillator(model, with_functions=True)


# ------------------------------------------------------------------------------
# The exact joint density of one oscillator, as functions of place and speed.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, repr=False)
class ExactDensity:
    """p(x, v) = p(x) exp(-v^2 / 2 theta) / sqrt(2 pi theta), with what follows from it (B 13.38).

    Everything is computed in logarithms, so that tails far out keep their digits; densities of
    no more than 1e-308 are 0, their logarithms are not. Made by `exact_density`.

    See Also
    --------
    stochvi.methods.closed_form.exact_density : The calculation.
    """

    response: Response
    law: GibbsLaw
    mass: float

    def __repr__(self) -> str:
        return f"<exact density, E v^2 = {self.law.theta:g} m^2/s^2>"

    def density(self, x: ArrayLike, v: ArrayLike) -> Vector:
        """Joint density at displacements x (m) and velocities v (m/s), s/m^2."""
        return _exp(self.log_density(x, v))

    def log_density(self, x: ArrayLike, v: ArrayLike) -> Vector:
        """Logarithm of the joint density; minus infinity beyond rigid stops."""
        return np.asarray(self.law.log_density(x) + _log_normal(v, self.law.theta))

    def displacement_density(self, x: ArrayLike) -> Vector:
        """Density of the displacement, 1/m; 0 beyond rigid stops."""
        return self.law.density(x)

    def velocity_density(self, v: ArrayLike) -> Vector:
        """Density of the velocity, s/m: normal with the variance theta."""
        return _exp(_log_normal(v, self.law.theta))

    def tail(self, x: ArrayLike) -> Vector:
        """Probability of a displacement above x (m), P(X > x)."""
        return _exp(self.log_tail(x))

    def log_tail(self, x: ArrayLike) -> Vector:
        """log P(X > x), also where that is too small for a number."""
        return self.law.log_tail(x)

    def impact_speed_density(self, side: str, w: ArrayLike) -> Vector:
        """Density of the speeds (m/s) of impacts on the "lower" or "upper" stop, s/m.

        Rayleigh's, (w / theta) exp(-w^2 / 2 theta): that of the flux v p(stop, v) (B 13.44).
        """
        self._position(side)
        speed = np.maximum(np.asarray(w, dtype=float), 0.0)
        theta = self.law.theta
        return np.asarray(speed / theta * _exp(-(speed**2) / (2.0 * theta)))

    def impact_flux(self, side: str, w: ArrayLike) -> Vector:
        """Impacts on one stop per second and per unit of incident speed, w p(stop, w), 1/m."""
        rate = self.rate_above(side, 0.0)
        return np.asarray(rate * self.impact_speed_density(side, w))

    def rate_above(self, side: str, speed: ArrayLike) -> Vector:
        """Impacts per second on one stop that are faster than `speed` (m/s), 1/s."""
        return _exp(self.log_rate_above(side, speed))

    def log_rate_above(self, side: str, speed: ArrayLike) -> Vector:
        """Logarithm of p(stop) sqrt(theta / 2 pi) exp(-speed^2 / 2 theta)."""
        theta = self.law.theta
        rate = self.law.log_density(self._position(side)) + 0.5 * math.log(theta / (2.0 * math.pi))
        above = np.maximum(np.asarray(speed, dtype=float), 0.0)
        return np.asarray(rate - above**2 / (2.0 * theta))

    @property
    def contact_probability(self) -> float | None:
        """Share of time in contact with compliant stops; None where none does."""
        for pair in self.response.impact_pairs.values():
            share = pair["contact_probability"]
            return share.value if isinstance(share, Estimate) else None
        return None

    def peak_force_exceedance(self, side: str, force: ArrayLike) -> Vector:
        """P(largest force of a contact > force), N, with one compliant stop.

        The mass turns where U has risen by w^2 / 2, w the Rayleigh speed of the contact's onset:
        P = exp(-(U(y) - U(0)) / theta), y the deflection of that force. Noise and damping during
        the contact are neglected.
        """
        self._position(side)
        return self.law.peak_force_exceedance(side, np.asarray(force, dtype=float) / self.mass)

    def peak_force_density(self, side: str, force: ArrayLike) -> Vector:
        """Density of the largest force of a contact, 1/N; a force at which the stop yields has
        a probability of its own, which the density leaves out."""
        self._position(side)
        per_unit_mass = np.asarray(force, dtype=float) / self.mass
        return np.asarray(self.law.peak_force_density(side, per_unit_mass) / self.mass)

    def _position(self, side: str) -> float:
        stops = {stop.name: stop for stop in (self.law.lower, self.law.upper) if stop is not None}
        if side not in stops:
            raise ValueError(f"side must be one with a stop ({', '.join(stops)}), got {side!r}")
        return stops[side].position


@calculation
def exact_density(
    scene: Scene,
    *,
    budget: float | None = None,
) -> ExactDensity:
    """The exact law of one oscillator; conditions as for `exact`.

    Parameters
    ----------
    scene
        The scene.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    ExactDensity
        The joint density, its tails and that of impact speeds.

    See Also
    --------
    stochvi.exact : The averages.
    stochvi.methods.fokker_planck.fokker_planck_density : Where stops take energy.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, law=Restitution(coefficient=1.0))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> law = exact_density(scene)
    >>> law.log_tail([1.0, 40.0]).round(6).tolist()
    [-1.668268, -804.435688]
    """
    model = model_of(scene)
    conditions = unmet(model)
    if not conditions and len(model.coordinates) > 1:
        conditions = ["the scene must have one coordinate for a joint density"]
    if conditions:
        raise NoExactSolution(conditions)
    response = exact(scene)
    return ExactDensity(response=response, law=_law(scene, response), mass=model.unit_mass)


@calculation
def displacement_density(scene: Scene, x: ArrayLike) -> Vector:
    """Exact probability density of the displacement, 1/m; conditions as for `exact`.

    Parameters
    ----------
    scene
        The scene.
    x
        Displacements, m.

    Returns
    -------
    Vector
        One value for each displacement, 1/m.

    See Also
    --------
    stochvi.methods.closed_form.exact_density : Displacement and velocity together.

    Examples
    --------
    >>> from stochvi import Oscillator, Scene, WhiteNoise
    >>> free = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> displacement_density(free, [0.0]).round(6).tolist()
    [0.398942]
    """
    return exact_density(scene).displacement_density(x)


def _law(scene: Scene, response: Response) -> GibbsLaw:
    """Law of the displacement; for filtered noise the Gaussian distribution with its moments."""
    if one_oscillator(model_of(scene)):
        return displacement_law(scene)
    (found,) = response.coordinates.values()
    values = {name: item.value for name, item in found.items() if item is not None}
    omega = values["velocity_std"] / values["displacement_std"]
    return GibbsLaw(
        theta=values["velocity_mean_square"],
        omega=omega,
        load=values["displacement_mean"] * omega**2,
    )


def _log_normal(v: ArrayLike, theta: float) -> Vector:
    velocity = np.asarray(v, dtype=float)
    return -(velocity**2) / (2.0 * theta) - 0.5 * math.log(2.0 * math.pi * theta)


def _exp(logarithm: ArrayLike) -> Vector:
    with np.errstate(under="ignore"):
        return np.asarray(np.exp(logarithm))


# ------------------------------------------------------------------------------
# Exact autocorrelations of the displacement: the two that are known.
# ------------------------------------------------------------------------------


MOST_TERMS = 2000
"""Number of terms of the series for a box. The rest is bounded, and at most 1e-11 of the
variance."""


@calculation
def autocorrelation(scene: Scene, lag: ArrayLike) -> Vector:
    """Stationary autocovariance of the displacement, E (x(t) - m)(x(t + lag) - m), m^2.

    Without stops, under white noise, with w^2 = omega^2 - b^2 / 4,

        R = (theta / omega^2) e^(-b t / 2) (cos w t + (b / 2 w) sin w t),  t = |lag|,

    hyperbolic functions where damping is above critical. A mass without a spring between two
    elastic rigid stops, a distance 2 D apart, is the mirror image of a free one. The displacement
    of the free mass over a time t has the variance s2 = 2 (theta / b^2)(b t - 1 + e^(-b t)). The
    Fourier series of the mirror gives

        R = (32 D^2 / pi^4) sum over odd k of k^-4 exp(-(k pi / 2 D)^2 s2 / 2).

    Parameters
    ----------
    scene
        The scene.
    lag
        Times, s, of either sign.

    Returns
    -------
    Vector
        One value for each place or time, SI units.

    Raises
    ------
    NoExactSolution
        For any other scene, with what is unmet.

    See Also
    --------
    stochvi.exact : The averages of the same scene.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> box = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=0.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> autocorrelation(box, [0.0, 1.0]).round(9).tolist()
    [0.333333333, 0.099582601]
    """
    model = model_of(scene)
    conditions = unmet(model) or beyond_one_oscillator(model) or _neither(model)
    if conditions:
        raise NoExactSolution(conditions)
    time = np.abs(np.asarray(lag, dtype=float))
    theta = model.intensity / (2.0 * model.damping_rate)
    if model.lower is None or model.upper is None:
        return _linear(model, theta, time)
    width = model.upper.position - model.lower.position
    return _box(width / 2.0, theta, model.damping_rate, time)


def _neither(model: Model) -> list[str]:
    """Why the scene is neither a linear oscillator nor a box; empty if it is one."""
    if model.tables:
        return ["excitation must be white noise for an autocorrelation, got a tabulated density"]
    if not model.stops:
        return []
    box = len(model.stops) == 2 and model.rigid
    if model.omega == 0.0 and model.load == 0.0 and box:
        return []
    return [
        "an autocorrelation is known without stops, or between two rigid stops without a spring "
        "and a load"
    ]


def _linear(model: Model, theta: float, time: Vector) -> Vector:
    omega, half = model.omega, model.damping_rate / 2.0
    # complex where damping is above critical; the limit sin(w t) / w = t where it is critical
    own = np.emath.sqrt(omega**2 - half**2)
    if np.iscomplexobj(own):
        rate = float(own.imag)
        # both exponentials decay: written so that neither overflows
        slow, fast = np.exp((rate - half) * time), np.exp(-(rate + half) * time)
        shape = (slow + fast) / 2.0 + half / rate * (slow - fast) / 2.0
    else:
        swing = half * time * np.sinc(own * time / math.pi)
        shape = np.exp(-half * time) * (np.cos(own * time) + swing)
    return np.asarray(theta / omega**2 * shape)


def _box(half_width: float, theta: float, b: float, time: Vector) -> Vector:
    spread = 2.0 * theta / b**2 * (b * time + np.expm1(-b * time))
    k = 2.0 * np.arange(MOST_TERMS) + 1.0
    decay = (math.pi / (2.0 * half_width)) ** 2 * spread / 2.0
    with np.errstate(under="ignore"):
        terms = np.exp(-(k**2) * decay[..., None]) @ k**-4
        # the terms left out lie between 0 and this; their middle has half the error
        rest = zeta(4.0, MOST_TERMS + 0.5) / 16.0 * np.exp(-((k[-1] + 2.0) ** 2) * decay)
    return np.asarray(32.0 * half_width**2 / math.pi**4 * (terms + rest / 2.0))


__all__ = [
    "ExactDensity",
    "autocorrelation",
    "displacement_density",
    "exact",
    "exact_density",
    "unmet",
]
