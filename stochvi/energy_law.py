"""The law of a slowly varying energy: orbits between stops, and how often each is run through.

Symbols, per unit mass: E energy, U potential of spring and load, T(E) the period of the orbit of
energy E between the stops it reaches, J(E) = closed integral of v dx (J' = T), c_i a stop, E_i =
U(c_i), R_i its restitution, D = S0 / 2, b = c / m. A cycle gains D T by noise, loses b J by
damping and (1 - R_i^2)(E - E_i) at each stop that it reaches, and p(E) = T G. Up to floor 3 this is
mathematics that methods share; `average` says where it comes from.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.collisions import NO_STOP, StopStatistics
from stochvi.errors import NotApplicable
from stochvi.scenes import System

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

CONTINUOUS, FINITE_JUMPS, UNFOLDED = "continuous", "finite jumps", "unfolded"
VARIANTS = (CONTINUOUS, FINITE_JUMPS, UNFOLDED)

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
INTEGRATED = np.polynomial.legendre.Legendre.basis
"""Of a Legendre polynomial, by its degree."""

PANELS = 14
"""Between two stops' energies, and above the last; twice as many change the ninth digit."""

CUT = 40.0
"""The energy ends where G has fallen by e^-CUT, some 4e-18, from what it is at the last stop."""

UNREACHED = 600.0
"""Energy of a stop, in theta, from which on it is never reached in numbers of this size."""

MOST_DOUBLINGS = 200
"""Of the largest energy."""


class Orbits(NamedTuple):
    """Of orbits of given energies: T, J, and the integrals of x dt and x^2 dt over a cycle."""

    period: Vector
    action: Vector
    first: Vector
    second: Vector


@dataclass(frozen=True, kw_only=True)
class Well:
    """U = omega^2 x^2 / 2 - load x between the stops, less its value at rest where that exists."""

    omega: float
    load: float
    lower: float
    upper: float

    def energy(self, x: float) -> float:
        """U(x)."""
        if self.omega:
            return 0.5 * (self.omega * x - self.load / self.omega) ** 2
        return -self.load * x

    @cached_property
    def bottom(self) -> float:
        """The least energy there is between the stops."""
        if self.omega:
            rest = min(max(self.load / self.omega**2, self.lower), self.upper)
        else:
            rest = self.upper if self.load > 0.0 else self.lower
        if not math.isfinite(rest):
            rest = self.upper
        return self.energy(rest)

    def orbits(self, energy: Vector) -> Orbits:
        """Periods and what else a cycle holds, in closed form."""
        return self._sprung(energy) if self.omega else self._free(energy)

    def _sprung(self, energy: Vector) -> Orbits:
        """With y = x - load / omega^2 and sin a = omega y / sqrt(2 E): dt = da / omega."""
        rest = self.load / self.omega**2
        reach = np.sqrt(2.0 * energy) / self.omega
        ends = [np.clip((stop - rest) / reach, -1.0, 1.0) for stop in (self.lower, self.upper)]
        angle = np.arcsin(ends[1]) - np.arcsin(ends[0])
        cosines = [np.sqrt((1.0 - end) * (1.0 + end)) for end in ends]
        swing = ends[1] * cosines[1] - ends[0] * cosines[0]
        period = 2.0 * angle / self.omega
        first = 2.0 * reach / self.omega * (cosines[0] - cosines[1])
        second = reach**2 / self.omega * (angle - swing)
        return Orbits(
            period=period,
            action=2.0 * energy / self.omega * (angle + swing),
            first=first + rest * period,
            second=second + 2.0 * rest * first + rest**2 * period,
        )

    def _free(self, energy: Vector) -> Orbits:
        """Without a spring v^2 = 2 (E + load x), and x a parabola in v: few nodes are exact."""
        ends = np.array([np.full(energy.shape, stop) for stop in (self.lower, self.upper)])
        if self.load:
            turn = -energy / self.load
            row = 0 if self.load > 0.0 else 1
            ends[row] = np.clip(turn, self.lower, self.upper)
        speeds = np.sqrt(np.maximum(2.0 * (energy + self.load * ends), 0.0))
        length = ends[1] - ends[0]
        v = (speeds[0] + speeds[1])[:, None] / 2.0 + (speeds[1] - speeds[0])[:, None] / 2.0 * NODES
        share = WEIGHTS / 2.0
        # dt = dx / v, x from the end where v is known: (v - v_0)(v + v_0) = 2 load (x - x_0)
        whole = (speeds[0] + speeds[1])[:, None] / 2.0
        along = (v - speeds[0][:, None]) * (v + speeds[0][:, None])
        x = ends[0][:, None] + (along / (2.0 * self.load) if self.load else
                                length[:, None] * (1.0 + NODES) / 2.0)  # fmt: skip
        time = 2.0 * length[:, None] * share / whole
        return Orbits(
            period=time.sum(axis=1),
            action=(time * v**2).sum(axis=1),
            first=(time * x).sum(axis=1),
            second=(time * x**2).sum(axis=1),
        )


class Stop(NamedTuple):
    """E_i and R_i of a stop."""

    energy: float
    restitution: float


@dataclass(frozen=True, kw_only=True)
class EnergyLaw:
    """G on nodes: panels between the energies of the stops, E = E_k + s^2 above each of them.

    The square takes the root out of T and J where an orbit begins to reach a stop.
    """

    well: Well
    diffusion: float
    damping: float
    stops: dict[str, Stop]
    span: float
    variant: str

    @cached_property
    def _edges(self) -> list[tuple[float, float, float]]:
        """(E_k, s from, s to) of every panel."""
        starts = sorted({self.well.bottom, *(stop.energy for stop in self.stops.values())})
        ends = [*starts[1:], starts[-1] + self.span]
        found = []
        for start, end in zip(starts, ends, strict=True):
            grid = np.linspace(0.0, math.sqrt(end - start), PANELS + 1)
            found += [(start, float(one), float(two)) for one, two in pairwise(grid)]
        return found

    @cached_property
    def nodes(self) -> tuple[Vector, Vector]:
        """Energies, and dE / ds there."""
        start, one, two = (np.array(column)[:, None] for column in zip(*self._edges, strict=True))
        s = (one + two) / 2.0 + (two - one) / 2.0 * NODES
        return (start + s**2).ravel(), (2.0 * s).ravel()

    @cached_property
    def weights(self) -> Vector:
        """Of integrals over all energies."""
        halves = np.array([(two - one) / 2.0 for _, one, two in self._edges])
        return np.asarray((halves[:, None] * WEIGHTS).ravel() * self.nodes[1])

    def integrals_above(self, energy: Vector) -> Matrix:
        """Row by row, the weights of the nodes in an integral from each energy on."""
        edges = np.array(self._edges)
        bounds = edges[:, 0] + edges[:, 1] ** 2
        panel = np.clip(np.searchsorted(bounds, energy, side="right") - 1, 0, len(edges) - 1)
        size = len(NODES)
        rows = np.repeat(self.weights[None, :], len(energy), axis=0)
        whole = np.arange(len(edges))[None, :] > panel[:, None]
        rows *= np.repeat(whole, size, axis=1)
        start, one, two = edges[panel].T
        s = np.sqrt(np.maximum(energy - start, 0.0))
        z = np.clip((s - (one + two) / 2.0) / ((two - one) / 2.0), -1.0, 1.0)
        part = _legendre_integrals(z) @ _TO_COEFFICIENTS
        places = panel[:, None] * size + np.arange(size)
        np.put_along_axis(
            rows, places, part * ((two - one) / 2.0)[:, None] * self.nodes[1][places], axis=1
        )
        return rows

    @cached_property
    def orbits(self) -> Orbits:
        """At the nodes."""
        return self.well.orbits(self.nodes[0])

    @cached_property
    def flux(self) -> Vector:
        """G at the nodes: cycles per second and unit of energy."""
        shape = self._with_jumps() if self.variant == FINITE_JUMPS else self._continuous()
        return shape / float(self.weights @ (shape * self.orbits.period))

    def _continuous(self) -> Vector:
        energy = self.nodes[0]
        loss = np.zeros_like(energy)
        for stop in self.stops.values():
            above = np.maximum(energy - stop.energy, 0.0)
            kept = 2.0 * stop.restitution - 1.0 if self.variant == UNFOLDED else stop.restitution**2
            loss += (1.0 - kept) * above
        rate = (self.damping + loss / self.orbits.action) / self.diffusion
        below = self.integrals_above(energy) @ rate
        return np.asarray(np.exp(below - below.max()))

    def _with_jumps(self) -> Vector:
        """Integral form of the balance, from the largest energy down: every term is positive."""
        energy = self.nodes[0]
        above = self.integrals_above(energy)
        jumps = np.zeros_like(above)
        for stop in self.stops.values():
            if stop.restitution == 1.0:
                continue
            over = energy > stop.energy
            jumps[over] += above[over]
            if stop.restitution > 0.0:
                start = stop.energy + (energy[over] - stop.energy) / stop.restitution**2
                jumps[over] -= self.integrals_above(start)
        falls = self.damping * np.eye(len(energy)) + jumps / self.orbits.action[:, None]
        kernel = above @ falls / self.diffusion
        return np.asarray(np.linalg.solve(np.eye(len(energy)) - kernel, np.ones(len(energy))))

    # What is asked of it ------------------------------------------------------------------

    def moment(self, of: Callable[[Orbits], Vector]) -> float:
        """Mean of what `of` integrates over a cycle."""
        return float(self.weights @ (self.flux * of(self.orbits)))

    @property
    def centre(self) -> float:
        """E x of a box without a spring and a load."""
        return (self.well.lower + self.well.upper) / 2.0

    @property
    def velocity_mean_square(self) -> float:
        """E v^2: the action is the integral of v^2 dt over a cycle."""
        return self.moment(lambda orbits: orbits.action)

    def rate_of_cycles_above(self, energy: float) -> float:
        """Cycles per second of orbits above an energy."""
        return float((self.integrals_above(np.array([energy])) @ self.flux)[0])

    def stop(self, side: str) -> StopStatistics:
        """Rate, F1 and F2: each cycle that reaches a stop hits it once, at sqrt(2 (E - E_i))."""
        if side not in self.stops:
            return NO_STOP
        over = np.maximum(self.nodes[0] - self.stops[side].energy, 0.0)
        hits = self.weights * self.flux * (over > 0.0)
        speed = np.sqrt(2.0 * over)
        return StopStatistics(float(hits.sum()), float(hits @ speed), float(hits @ speed**2))


def _legendre_integrals(z: Vector) -> Matrix:
    """Integrals of the Legendre polynomials from each z to 1."""
    columns = []
    for degree in range(len(NODES)):
        whole = INTEGRATED(degree).integ()
        columns.append(whole(1.0) - whole(z))
    return np.stack(columns, axis=1)


_TO_COEFFICIENTS = np.linalg.inv(np.polynomial.legendre.legvander(NODES, len(NODES) - 1))
"""From values at the nodes to coefficients of Legendre polynomials."""


def energy_law(system: System, variant: str = FINITE_JUMPS) -> EnergyLaw:
    """The law, up to an energy beyond which nothing is left."""
    well = Well(
        omega=system.omega,
        load=system.load,
        lower=-math.inf if system.lower is None else system.lower,
        upper=math.inf if system.upper is None else system.upper,
    )
    sides = (
        ("lower", system.lower, system.restitution_lower),
        ("upper", system.upper, system.restitution_upper),
    )
    diffusion, damping = system.intensity / 2.0, system.damping_rate
    stops = {
        side: Stop(well.energy(place), restitution)
        for side, place, restitution in sides
        if place is not None
        and restitution is not None
        and damping * (well.energy(place) - well.bottom) <= UNREACHED * diffusion
    }
    span = _span(diffusion, damping, well, stops)
    for _ in range(MOST_DOUBLINGS):
        law = EnergyLaw(
            well=well, diffusion=diffusion, damping=damping, stops=stops, span=span, variant=variant
        )
        if law.flux[-1] <= math.exp(-CUT) * law.flux[-PANELS * len(NODES)]:
            return law
        span *= 2.0
    raise NotApplicable("average", ["no energy was found that the mass does not exceed"])


def _span(diffusion: float, damping: float, well: Well, stops: dict[str, Stop]) -> float:
    """A first guess of the energy above the last stop: where the losses of a cycle exceed CUT
    times the gain, or a hundredth of where damping alone would end it."""
    top = max([well.bottom, *(stop.energy for stop in stops.values())])
    span = CUT * diffusion / damping / 100.0 if damping else math.inf
    for stop in stops.values():
        lost = 1.0 - stop.restitution**2
        if lost > 0.0:
            width = well.upper - well.lower
            if not math.isfinite(width):
                width = math.sqrt(2.0 * max(top, diffusion / (well.omega or 1.0))) / (
                    well.omega or 1.0
                )
            # lost E = D T, T ~ 2 width / sqrt(2 E)
            span = min(span, 4.0 * (diffusion * width / lost) ** (2.0 / 3.0))
    return span
