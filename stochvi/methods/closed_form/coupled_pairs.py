"""A few impact pairs that springs couple: their joint density by quadrature on a product of panels.

p(y) ~ exp(-(y' A y / 2 - h' y + sum_j V_j(y_j)) / theta) between rigid stops.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.impact_rates import ContactStatistics
from stochvi.mathematics.quadrature import gauss_panels
from stochvi.mathematics.truncated_normal import CUT
from stochvi.model.model import LOWER, UPPER, Pair, Stop
from stochvi.results.sizes import MOST_NUMBERS
from stochvi.scenes.impact_laws import CompliantLaw

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
        return float(brentq(slope, here, end, xtol=1e-300, rtol=1e-15))

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
