"""The distribution of a slowly varying energy between stops. Chapters: energy that an impact
leaves; orbits between stops, and how often each is traversed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, overload

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from stochvi.mathematics.impact_rates import NO_STOP, StopStatistics
from stochvi.mathematics.numerics import Matrix, Vector, gauss_legendre, gauss_panels
from stochvi.model.gap import Gap
from stochvi.results.errors import NotApplicable
from stochvi.scenes.impact_laws import Restitution, RigidLaw, SpeedRestitution

# ------------------------------------------------------------------------------
# Stops as an energy that varies slowly sees them: what an impact leaves of it.
#
# Per unit mass, an orbit of the energy E meets a stop with the potential energy E_i at the speed w
# = sqrt(2 (E - E_i)); the impact leaves E_i + R^2 (E - E_i).
# ------------------------------------------------------------------------------


LEAST_RESTITUTION = 1e-4
"""Smallest restitution of a stop on which the mass rests. The law converges as R falls to 0, but at
0 itself the density has no integral over small energies. From 1e-3 to this number the standard
deviations change by a relative 1e-6, the rates by 1e-3 (measured); below it the quadrature loses
digits."""

RULE = 12
"""Number of restitutions that stand for one that scatters: Gauss's rule of its distribution."""

DECADES, SPEEDS = 6.0, 1200
"""Speeds at which a restitution by speed is read: their number, and decades below the largest."""


class Returns(NamedTuple):
    """Energies beyond E_i from which impacts come to given energies.

    With each comes the change there of the probability that an impact from a higher energy ends
    below. It is minus one where, from there up, none does any more.
    """

    starts: Vector
    weights: Vector


@dataclass(frozen=True, kw_only=True)
class Barrier:
    """A stop that orbits of a higher energy than `energy` reach.

    `rebounds` are the values of R^2, each with its probability: one, or a rule for a restitution
    that scatters. `restitution` and `mean_square` are E R and E R^2.
    """

    energy: float
    restitution: float
    mean_square: float
    rebounds: tuple[tuple[float, float], ...]

    @property
    def lossless(self) -> bool:
        """Whether impacts take no energy."""
        return self.restitution == 1.0

    def kept(self, above: Vector) -> Vector:
        """E R^2 of impacts from energies beyond E_i."""
        return np.full_like(above, self.mean_square)

    def returned(self, above: Vector) -> Vector:
        """E R of impacts from energies beyond E_i."""
        return np.full_like(above, self.restitution)

    def returns(self, above: Vector) -> Iterator[Returns]:
        """Whence impacts come to energies beyond E_i."""
        for kept, probability in self.rebounds:
            if kept > 0.0:
                yield Returns(above / kept, np.full_like(above, -probability))


@dataclass(frozen=True, kw_only=True)
class SpeedBarrier:
    """A stop whose restitution depends on the speed."""

    energy: float
    law: RigidLaw

    @property
    def lossless(self) -> bool:
        """Whether impacts take no energy."""
        return self.law.conservative

    @property
    def mean_square(self) -> float:
        """R^2 at the speed that stands for all."""
        return max(self.law.restitution, self._least) ** 2

    @cached_property
    def _least(self) -> float:
        return 0.0 if self.energy else LEAST_RESTITUTION

    def kept(self, above: Vector) -> Vector:
        """R^2 of impacts from energies beyond E_i."""
        return np.asarray(self.returned(above) ** 2)

    def returned(self, above: Vector) -> Vector:
        """R of impacts from energies beyond E_i."""
        return np.maximum(self.law.restitution_at(np.sqrt(2.0 * above)), self._least)

    def returns(self, above: Vector) -> Iterator[Returns]:
        """Whence impacts come to energies beyond E_i.

        The speed R(w) w of a rebound need not rise with w. Where it falls, fast impacts come to
        rest below an energy that slower ones left above it: the speeds whose rebounds pass the one
        of that energy, upwards and downwards in turn.
        """
        own = np.sqrt(2.0 * above)
        grid = own.max(initial=0.0) * np.geomspace(10.0**-DECADES, 10.0**DECADES, 2 * SPEEDS)
        if isinstance(self.law, SpeedRestitution) and self.law.speed is not None:
            grid = np.union1d(grid, self.law.speed)
        back = grid * self.returned(0.5 * grid**2)
        slow = own * self.returned(above)
        faster, number = back > own[:, None], np.arange(len(grid))
        first = place = np.searchsorted(grid, own, side="right")
        for turn in itertools.count():
            # after an even number of passages rebounds are slower than the speed itself
            ahead = (number >= place[:, None]) & (faster if turn % 2 == 0 else ~faster)
            passed = ahead.any(axis=1)
            if not passed.any():
                return
            place = np.where(passed, ahead.argmax(axis=1), len(grid))
            at, speed = place[passed], own[passed]
            from_own = (at == first[passed]) & (turn == 0)
            low = np.where(from_own, speed, grid[at - 1])
            below = np.where(from_own, slow[passed], back[at - 1])
            rise = back[at] - below
            share = np.divide(speed - below, rise, out=np.ones_like(rise), where=rise != 0.0)
            starts = np.full_like(own, np.inf)
            starts[passed] = (low + share * (grid[at] - low)) ** 2 / 2.0
            yield Returns(starts, np.full_like(own, -1.0 if turn % 2 == 0 else 1.0))


AnyBarrier = Barrier | SpeedBarrier


def barrier_of(law: RigidLaw, energy: float) -> AnyBarrier:
    """The stop of a law at a potential energy."""
    if not isinstance(law, Restitution):
        return SpeedBarrier(energy=energy, law=law)
    least = 0.0 if energy else LEAST_RESTITUTION
    if law.scatter is None:
        r = max(law.restitution, least)
        return Barrier(energy=energy, restitution=r, mean_square=r**2, rebounds=((r**2, 1.0),))
    nodes, weights = law.scatter.rule(RULE)
    kept = np.maximum(nodes, least) ** 2
    return Barrier(
        energy=energy,
        restitution=law.restitution,
        mean_square=float(weights @ kept),
        rebounds=tuple(zip(kept.tolist(), weights.tolist(), strict=True)),
    )


# ------------------------------------------------------------------------------
# The distribution of a slowly varying energy: orbits between stops, and how often each is
# traversed.
#
# Symbols, per unit mass: E energy; U potential of spring and load; T(E) the period of the orbit of
# energy E between the stops it reaches; J(E) = closed integral of v dx (J' = T); c_i a stop, E_i =
# U(c_i), R_i its restitution; D = S0 / 2, b = c / m. A cycle gains D T by noise, loses b J by
# damping and (1 - R_i^2)(E - E_i) at each stop that it reaches. The density of the energy is p(E) =
# T G, with G the cycles per second and unit of energy. Several methods use this file; the docstring
# of `average` derives the equations.
# ------------------------------------------------------------------------------


CONTINUOUS, FINITE_JUMPS, UNFOLDED = "continuous", "finite jumps", "unfolded"
VARIANTS = (CONTINUOUS, FINITE_JUMPS, UNFOLDED)
"""Variants of averaging: how impacts change the energy."""

NODES, WEIGHTS = gauss_legendre(12)
"""Nodes and weights of the Gauss-Legendre rule of each panel of energies, and of each orbit."""

GRADED = gauss_panels([0.0, *0.5 ** np.arange(12, 0, -1), *np.linspace(0.5, 1.0, 9)[1:]], 12)
"""Nodes and weights from 0 to 1 of panels that become narrower towards 0, where a density over the
velocity has a root."""

PANELS = 14
"""Number of panels between the energies of two stops, and above the last one. With twice as many,
results change in the ninth digit only."""

LARGEST_FALL = 2.0
"""Largest fall of ln G in the first panel above a stop; a panel with a larger fall is halved. The
fall is large for a mass that is pressed hard against an inelastic stop: its energy is small for
most of the time, and its density has a long tail."""

CUT = 40.0
"""The panels end at the energy at which G has fallen to e^-CUT = 4e-18 of its value at the last
stop."""

UNREACHED = 600.0
"""Largest energy of a stop, in multiples of theta, with which the stop is kept: the density there,
e^-600 of its largest value, no longer counts in double precision."""

MOST_DOUBLINGS = 200
"""Largest number of times that the largest energy is doubled, or the first panels are halved."""


class Orbits(NamedTuple):
    """T, J, and the integrals of y dt and y^2 dt over a cycle, for orbits of given energies.

    y is x - `Well.place`. Where a mass is pressed hard against a stop, x varies very little. The
    variance would then lose all digits in a difference of squares of x itself.
    """

    period: Vector
    action: Vector
    first: Vector
    second: Vector


@dataclass(frozen=True, kw_only=True)
class Well:
    """U = omega^2 x^2 / 2 - load x between the stops, less its least value there."""

    omega: float
    load: float
    lower: float
    upper: float

    @overload
    def energy(self, x: float) -> float: ...

    @overload
    def energy(self, x: Vector) -> Vector: ...

    def energy(self, x: float | Vector) -> float | Vector:
        """Potential energy U(x), to full precision also close to the place where it is 0."""
        away = x - self.place
        return away * (0.5 * self.omega**2 * away + (self.omega**2 * self.place - self.load))

    def ends(self, energy: float) -> tuple[float, float]:
        """Ends of the orbit of an energy, m: its turning points, or stops before them."""
        if self.omega:
            rest = self.load / self.omega**2
            reach = math.sqrt(2.0 * (energy - self.energy(rest))) / self.omega
            ends = rest - reach, rest + reach
        elif self.load:
            turn = self.place - energy / self.load
            ends = (turn, math.inf) if self.load > 0.0 else (-math.inf, turn)
        else:
            ends = self.lower, self.upper
        return max(self.lower, ends[0]), min(self.upper, ends[1])

    @cached_property
    def place(self) -> float:
        """Place of the smallest potential energy between the stops, m."""
        if self.omega:
            return min(max(self.load / self.omega**2, self.lower), self.upper)
        place = self.upper if self.load > 0.0 else self.lower
        return place if math.isfinite(place) else self.upper

    def orbits(self, energy: Vector) -> Orbits:
        """Periods and the other integrals over a cycle, for which few nodes suffice."""
        return self._sprung(energy) if self.omega else self._free(energy)

    def _sprung(self, energy: Vector) -> Orbits:
        """Motion under a spring: with x = load / omega^2 + w sin a / omega and v = w cos a, dt = da
        / omega.

        Where stops cut the circle, a short arc about a turning point may remain. To keep digits
        there, angles are computed from place and speed, and differences of sines from half
        differences of angles.
        """
        rest = self.load / self.omega**2
        largest = np.sqrt(2.0 * (energy - self.energy(rest)))
        ends, speeds = [], []
        for stop in (self.lower, self.upper):
            if math.isfinite(stop):
                speeds.append(np.sqrt(np.maximum(2.0 * (energy - self.energy(stop)), 0.0)))
                ends.append(np.arctan2(self.omega * (stop - rest), speeds[-1]))
            else:
                speeds.append(np.zeros_like(energy))
                ends.append(np.full_like(energy, math.copysign(0.5 * math.pi, stop)))
        half = ((ends[1] - ends[0]) / 2.0)[:, None]
        angle = ((ends[1] + ends[0]) / 2.0)[:, None] + half * NODES
        place = np.zeros_like(energy)
        if self.place == self.upper:
            place = ends[1]
        elif self.place == self.lower:
            place = ends[0]
        middle, away = ((angle + sign * place[:, None]) / 2.0 for sign in (1.0, -1.0))
        y = 2.0 * largest[:, None] / self.omega * np.cos(middle) * np.sin(away)
        time = 2.0 * half * WEIGHTS / self.omega
        return Orbits(
            period=time.sum(axis=1),
            action=(time * (largest[:, None] * np.cos(angle)) ** 2).sum(axis=1),
            first=(time * y).sum(axis=1),
            second=(time * y**2).sum(axis=1),
        )

    def _free(self, energy: Vector) -> Orbits:
        """Without a spring v^2 / 2 = E + load y, and y is a parabola in v: few nodes are exact."""
        ends = np.array([np.full(energy.shape, stop) for stop in (self.lower, self.upper)])
        if self.load:
            turn = self.place - energy / self.load
            row = 0 if self.load > 0.0 else 1
            ends[row] = np.clip(turn, self.lower, self.upper)
        speeds = np.sqrt(np.maximum(2.0 * (energy + self.load * (ends - self.place)), 0.0))
        length = ends[1] - ends[0]
        v = (speeds[0] + speeds[1])[:, None] / 2.0 + (speeds[1] - speeds[0])[:, None] / 2.0 * NODES
        share = WEIGHTS / 2.0
        # dt = dx / v, and (v - v_0)(v + v_0) = 2 load (x - x_0) from the lowest place
        whole = (speeds[0] + speeds[1])[:, None] / 2.0
        fastest = speeds[1 if self.load > 0.0 else 0][:, None]
        y = length[:, None] * (1.0 + NODES) / 2.0
        if self.load:
            y = (v - fastest) * (v + fastest) / (2.0 * self.load)
        time = 2.0 * length[:, None] * share / whole
        return Orbits(
            period=time.sum(axis=1),
            action=(time * v**2).sum(axis=1),
            first=(time * y).sum(axis=1),
            second=(time * y**2).sum(axis=1),
        )


@dataclass(frozen=True, kw_only=True)
class EnergyLaw:
    """G at nodes in panels between the energies of the stops, with E = E_k + s^2 above each E_k.

    T and J have a square root at the energy where an orbit begins to reach a stop; as functions of
    s they are smooth there.
    """

    well: Well
    diffusion: float
    damping: float
    stops: dict[str, AnyBarrier]
    span: float
    variant: str
    halvings: tuple[int, ...]

    @cached_property
    def _edges(self) -> list[tuple[float, float, float]]:
        """Every panel as (E_k, s at its start, s at its end)."""
        starts = _starts(self.stops)
        ends = [*starts[1:], starts[-1] + self.span]
        found = []
        for start, end, halvings in zip(starts, ends, self.halvings, strict=True):
            grid = np.linspace(0.0, math.sqrt(end - start), PANELS + 1)
            halved = grid[1] * 0.5 ** np.arange(halvings, 0, -1)
            grid = np.concatenate([grid[:1], halved, grid[1:]])
            found += [(start, float(one), float(two)) for one, two in pairwise(grid)]
        return found

    @property
    def _first_panels(self) -> list[int]:
        """Number of the first panel above each E_k."""
        sizes = [PANELS + halvings for halvings in self.halvings]
        return [sum(sizes[:k]) for k in range(len(sizes))]

    @property
    def halved(self) -> tuple[int, ...]:
        """`halvings`, one more where ln G falls by more than `LARGEST_FALL` in the first panel."""
        panels = self.flux.reshape(-1, len(NODES))
        least, most = math.exp(-CUT) * panels.max(), math.exp(LARGEST_FALL)
        return tuple(
            halvings + int(panels[first, 0] > max(least, most * abs(panels[first, -1])))
            for first, halvings in zip(self._first_panels, self.halvings, strict=True)
        )

    @property
    def ends(self) -> bool:
        """Whether G is negligible at the largest energy."""
        last = self._first_panels[-1] * len(NODES)
        return bool(self.flux[-1] <= math.exp(-CUT) * self.flux[last])

    @cached_property
    def nodes(self) -> tuple[Vector, Vector]:
        """Energies at the nodes, and dE / ds there."""
        start, one, two = (np.array(column)[:, None] for column in zip(*self._edges, strict=True))
        s = (one + two) / 2.0 + (two - one) / 2.0 * NODES
        return (start + s**2).ravel(), (2.0 * s).ravel()

    @cached_property
    def weights(self) -> Vector:
        """Weights of the nodes in integrals over all energies."""
        halves = np.array([(two - one) / 2.0 for _, one, two in self._edges])
        return np.asarray((halves[:, None] * WEIGHTS).ravel() * self.nodes[1])

    def integrals_above(self, energy: Vector) -> Matrix:
        """Weights (energies, nodes): row k integrates from energy k to the largest one."""
        panel, z, half = self._in_panels(energy)
        size = len(NODES)
        rows = np.repeat(self.weights[None, :], len(energy), axis=0)
        whole = np.arange(len(self._edges))[None, :] > panel[:, None]
        rows *= np.repeat(whole, size, axis=1)
        part = _legendre_integrals(z) @ _TO_COEFFICIENTS
        places = panel[:, None] * size + np.arange(size)
        np.put_along_axis(rows, places, part * half[:, None] * self.nodes[1][places], axis=1)
        return rows

    def _in_panels(self, energy: Vector) -> tuple[NDArray[np.intp], Vector, Vector]:
        """The panel of each energy, the place in it, from -1 to 1, and half the width of it."""
        edges = np.array(self._edges)
        bounds = edges[:, 0] + edges[:, 1] ** 2
        panel = np.clip(np.searchsorted(bounds, energy, side="right") - 1, 0, len(edges) - 1)
        start, one, two = np.moveaxis(edges[panel], -1, 0)
        s, half = np.sqrt(np.maximum(energy - start, 0.0)), (two - one) / 2.0
        return panel, np.clip((s - (one + two) / 2.0) / half, -1.0, 1.0), half

    @cached_property
    def orbits(self) -> Orbits:
        """The orbits of the energies at the nodes."""
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
            unfolded = self.variant == UNFOLDED
            kept = 2.0 * stop.returned(above) - 1.0 if unfolded else stop.kept(above)
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
            if stop.lossless:
                continue
            over = energy > stop.energy
            jumps[over] += above[over]
            for starts, weights in stop.returns(energy[over] - stop.energy):
                jumps[over] += weights[:, None] * self.integrals_above(stop.energy + starts)
        falls = self.damping * np.eye(len(energy)) + jumps / self.orbits.action[:, None]
        kernel = above @ falls / self.diffusion
        return np.asarray(np.linalg.solve(np.eye(len(energy)) - kernel, np.ones(len(energy))))

    # Densities -----------------------------------------------------------------------------

    @property
    def top(self) -> float:
        """The largest energy, beyond which the density is negligible."""
        start, _, last = self._edges[-1]
        return start + last**2

    def flux_at(self, energy: Vector) -> Vector:
        """G at any energies. It is the joint density of displacement and velocity there: a cycle
        passes every place twice, once in each direction, for dx / |v|."""
        panel, z, _ = self._in_panels(energy)
        coefficients = self.flux.reshape(-1, len(NODES)) @ _TO_COEFFICIENTS.T
        found = np.sum(legvander(z, len(NODES) - 1) * coefficients[panel], axis=-1)
        return np.where(energy > self.top, 0.0, np.maximum(found, 0.0))

    def displacement_density(self, x: Vector) -> Vector:
        """Density of the displacement x (m), 1/m: the joint density over all velocities, piece by
        piece between the velocities at which an orbit begins to reach a stop."""
        potential = self.well.energy(x)
        total = np.zeros_like(potential)
        for low, high in pairwise([*_starts(self.stops), self.top]):
            first, last = (np.sqrt(2.0 * np.maximum(e - potential, 0.0)) for e in (low, high))
            nodes, weights = GRADED
            v = first[:, None] + (last - first)[:, None] * nodes
            energy = potential[:, None] + 0.5 * v**2
            total += 2.0 * (last - first) * (self.flux_at(energy) @ weights)
        return np.where((x < self.well.lower) | (x > self.well.upper), 0.0, total)

    # Moments and rates ---------------------------------------------------------------------

    def moment(self, of: Callable[[Orbits], Vector]) -> float:
        """Stationary mean of a quantity, from its integral over a cycle, which `of` returns."""
        return float(self.weights @ (self.flux * of(self.orbits)))

    @property
    def centre(self) -> float:
        """Mean displacement in a box without a spring and a load, m."""
        return (self.well.lower + self.well.upper) / 2.0

    @property
    def velocity_mean_square(self) -> float:
        """Mean square velocity, from the action: the integral of v^2 dt over a cycle."""
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
    values, degrees = legvander(z, len(NODES)), np.arange(1, len(NODES))
    # (2 n + 1) P_n is the derivative of P_(n + 1) - P_(n - 1)
    return np.column_stack([1.0 - z, (values[:, :-2] - values[:, 2:]) / (2.0 * degrees + 1.0)])


_TO_COEFFICIENTS = np.linalg.inv(legvander(NODES, len(NODES) - 1))
"""Matrix that turns values at the nodes of a panel into coefficients of Legendre polynomials."""


def energy_law(gap: Gap, variant: str = FINITE_JUMPS) -> EnergyLaw:
    """The distribution of the energy in a gap between rigid stops under white noise.

    It reaches up to an energy beyond which the density is negligible.

    Raises
    ------
    NotApplicable
        If the density is not negligible at any energy that was tried.
    """
    lower, upper = gap.ends
    well = Well(
        omega=gap.omega,
        load=gap.load,
        lower=-math.inf if lower is None else lower,
        upper=math.inf if upper is None else upper,
    )
    diffusion, damping = gap.intensity / 2.0, gap.damping_rate
    stops = {}
    for stop in gap.stops:
        energy = well.energy(stop.position)
        if isinstance(stop.law, RigidLaw) and damping * energy <= UNREACHED * diffusion:
            stops[stop.name] = barrier_of(stop.law, energy)
    span = _span(diffusion, damping, well, stops)
    halvings = (0,) * len(_starts(stops))
    for _ in range(MOST_DOUBLINGS):
        law = EnergyLaw(
            well=well, diffusion=diffusion, damping=damping, stops=stops, span=span,
            variant=variant, halvings=halvings,
        )  # fmt: skip
        if law.halved != halvings:
            halvings = law.halved
        elif law.ends:
            return law
        else:
            span *= 2.0
    raise NotApplicable(
        "average",
        "damping or stops must bound the energy of the mass, but no largest energy was found",
    )


def _starts(stops: dict[str, AnyBarrier]) -> list[float]:
    """Energies at which orbits change their form: the lowest one, and those of the stops."""
    return sorted({0.0, *(stop.energy for stop in stops.values())})


def _span(diffusion: float, damping: float, well: Well, stops: dict[str, AnyBarrier]) -> float:
    """A first guess of the energy above the last stop: where the losses of a cycle exceed CUT
    times the gain, or a hundredth of where damping alone would end it."""
    top = max([0.0, *(stop.energy for stop in stops.values())])
    span = CUT * diffusion / damping / 100.0 if damping else math.inf
    for stop in stops.values():
        lost = 1.0 - stop.mean_square
        if lost > 0.0:
            width = well.upper - well.lower
            if not math.isfinite(width):
                width = math.sqrt(2.0 * max(top, diffusion / (well.omega or 1.0))) / (
                    well.omega or 1.0
                )
            # lost E = D T, T ~ 2 width / sqrt(2 E)
            span = min(span, 4.0 * (diffusion * width / lost) ** (2.0 / 3.0))
    return span
