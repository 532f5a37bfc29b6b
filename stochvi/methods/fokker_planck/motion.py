"""A scene as forces that are functions, and the box of unit speed that it is solved in."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from stochvi.mathematics.quadrature import gauss_panels
from stochvi.methods.fokker_planck.basis import Array
from stochvi.model.model import Model, Stop
from stochvi.results.errors import NotApplicable
from stochvi.scenes.impact_laws import CompliantLaw, ForceTable, Viscoelastic

LAW_DEPTH = 18.0
"""Energy in units of s^2 at which the law exp(-energy / s^2) is cut where a scale is sought: there
it is 2e-8 of its peak."""

WIDENED = 1.2
"""Speed of the weight exp(-energy / t) in units of s, sqrt(t) = WIDENED s, unless damping alone
says less: what stops leave of the law is wider than the law that takes up the same power."""

STRIDE = 1.3
"""Ratio of the distances at which the potential is looked at for where it rises."""

NEAREST, FARTHEST = 1e-7, 1e12
"""First and last of these distances, in units of a length of the scene."""

NODES = 24
"""Of Gauss's rule on each of the pieces of a law."""

PIECES = 40
"""Into which the range of a law is cut, also for a look at its lowest energy."""

SPEEDS, SPEED_WEIGHTS = (
    part.ravel() for part in gauss_panels(np.linspace(0.0, 8.0, 9), NODES)
)  # speeds of a law of unit width, of which 1e-14 lies beyond 8


DEEP = 100.0
"""Energy up to which a place of low energy is sought, in units of (power length)^(2/3)."""

AT_ONCE = 16
"""Places at which the potential is looked at together."""

FINE_STRIDE, FINE_AT_ONCE = 1.02, 105
"""Of a spring that is a function, which may have further wells: the energy must stay high for as
many places, an eightfold distance, for none to be expected."""


class _Ray:
    """The energy at places further and further out from a start; looked at once each."""

    def __init__(self, motion: Motion, start: float, side: int) -> None:
        self.motion, self.start, self.side = motion, start, side
        self.places = np.array([start])
        self.energies = motion.energy(self.places)
        self.ended = False
        function = motion.model.restoring is not None
        self.stride, self.at_once = (FINE_STRIDE, FINE_AT_ONCE) if function else (STRIDE, AT_ONCE)
        self.quiet = FINE_AT_ONCE if function else 1

    def up_to(self, height: float) -> tuple[Array, Array]:
        """Places and energies until the energy is `height` above the lowest on the way and stays
        there, or up to a wall."""
        while True:
            lowest = np.minimum.accumulate(self.energies)
            low = np.flatnonzero(self.energies - lowest < height)
            last = int(low[-1]) + 1 if len(low) else 0
            if len(self.places) - last >= self.quiet:
                return self.places[: last + 1], self.energies[: last + 1]
            if self.ended:
                return self.places, self.energies
            self._on()

    def _on(self) -> None:
        """Look further out."""
        motion, taken = self.motion, len(self.places) - 1
        steps = np.arange(taken, taken + self.at_once, dtype=float)
        away: Array = NEAREST * motion.length * self.stride**steps
        wall = abs(motion.wall(self.side) - self.start)
        if away[0] > FARTHEST * motion.length and wall == math.inf:
            raise NotApplicable(
                "fokker-planck", ["spring and stops must hold the mass on both sides"]
            )
        places = self.start + self.side * away[away < wall]
        if len(places) < self.at_once:
            self.ended = True
            places = np.append(places, motion.wall(self.side))
        with np.errstate(over="ignore", invalid="ignore"):
            energies = motion.energy(places)
        energies = np.where(np.isnan(energies), math.inf, energies)
        self.places = np.append(self.places, places)
        self.energies = np.append(self.energies, energies)


@dataclass(frozen=True, kw_only=True)
class Motion:
    """x'' = force(x) - drag(x') + white noise of intensity S0, between stops; per unit mass, SI."""

    model: Model

    @property
    def stops(self) -> tuple[Stop, ...]:
        """The stops, the lower one first, with their laws per unit mass."""
        return self.model.stops_per_unit_mass

    @property
    def power(self) -> float:
        """That the noise supplies, S0 / 2."""
        return self.model.intensity / 2.0

    def wall(self, side: int) -> float:
        """Where a rigid stop ends the space; infinite where none does."""
        for stop in self.stops:
            if stop.side == side and stop.rigid:
                return stop.position
        return math.inf * side

    def spring(self, x: Array) -> Array:
        """Force of spring and load, m/s^2."""
        x = np.asarray(x, dtype=float)
        model = self.model
        pull = model.omega**2 * x if model.restoring is None else model.restoring(x)
        return np.asarray(model.load - pull, dtype=float)

    def force(self, x: Array) -> Array:
        """Of spring, load and stops that give way, without damping, m/s^2."""
        x = np.asarray(x, dtype=float)
        total = self.spring(x)
        for stop in self.stops:
            if isinstance(stop.law, CompliantLaw):
                y = stop.deflection(x)
                total = total - stop.side * _elastic(stop.law).force_at(y)
        return np.asarray(total, dtype=float)

    def energy(self, x: Array) -> Array:
        """Potential energy of that force, m^2/s^2."""
        x = np.asarray(x, dtype=float)
        model = self.model
        spring = model.omega**2 * x**2 / 2.0 if model.potential is None else model.potential(x)
        total = spring - model.load * x
        for stop in self.stops:
            if isinstance(stop.law, CompliantLaw):
                total = total + stop.law.potential_at(stop.deflection(x))
        return np.asarray(total, dtype=float)

    def drag(self, v: Array) -> Array:
        """Of the damper, m/s^2."""
        v = np.asarray(v, dtype=float)
        drag = self.model.drag
        return self.model.damping_rate * v if drag is None else np.asarray(drag(v), dtype=float)

    @cached_property
    def length(self) -> float:
        """Some length of the scene, to begin a search with."""
        lengths = [abs(stop.position - self._rest) for stop in self.stops]
        if len(self.stops) == 2:
            lengths.append(self.stops[1].position - self.stops[0].position)
        if self.model.omega:
            lengths.append((self.power / self.model.omega**3) ** 0.5)
        return min((length for length in lengths if length > 0.0), default=1.0)

    @property
    def _rest(self) -> float:
        """Where spring and load alone balance, if that can be told, within the walls."""
        rest = self.model.rest if self.model.omega else 0.0
        return min(max(rest, self.wall(-1)), self.wall(1))

    @cached_property
    def start(self) -> float:
        """A place of low energy: the lowest that is met on the way out from the rest position."""
        height = DEEP * (self.power * self.length) ** (2.0 / 3.0)
        rays = [_Ray(self, self._rest, side) for side in (-1, 1)]
        places, energies = (
            np.concatenate(part) for part in zip(*(ray.up_to(height) for ray in rays), strict=True)
        )
        order = np.argsort(places)
        lowest = int(np.argmin(energies[order]))
        around = places[order][max(lowest - 1, 0) : lowest + 2]
        found = minimize_scalar(
            lambda x: float(self.energy(np.array(x))),
            bounds=(around[0], around[-1]),
            method="bounded",
            options={"xatol": 1e-6 * (around[-1] - around[0])},
        )
        best = float(places[order][lowest])
        return float(found.x) if found.fun < energies[order][lowest] else best

    @cached_property
    def _rays(self) -> tuple[_Ray, _Ray]:
        return _Ray(self, self.start, -1), _Ray(self, self.start, 1)

    def span(self, height: float) -> tuple[float, float]:
        """Around all places whose energy is less than `height` above the lowest; within walls."""
        found = [ray.up_to(height) for ray in self._rays]
        lowest = min(float(energies.min()) for _, energies in found)
        left, right = (
            self._border(places, energies, lowest + height) for places, energies in found
        )
        return left, right

    def _border(self, places: Array, energies: Array, level: float) -> float:
        """Beyond the last of places that go outwards at which the energy is below a level."""
        last = int(np.flatnonzero(energies < level)[-1]) if (energies < level).any() else 0
        if last + 1 == len(places):
            return float(places[last])

        def above(x: float) -> float:
            energy = float(self.energy(np.array(x)))
            return min(energy, level + 1.0) - level if not math.isnan(energy) else 1.0

        near, far = float(places[last]), float(places[last + 1])
        if above(near) >= 0.0:
            return far
        return float(brentq(above, near, far, xtol=1e-9 * abs(far - near)))

    def open_ends(self, left: float, right: float, square: float) -> list[tuple[int, float, float]]:
        """Side of each end without a wall, its place, and n of a law exp(-energy / square) that
        falls as |x - start|^-n there."""
        return [
            (side, end, (self.start - end) * float(self.force(np.array(end))) / square)
            for side, end in ((-1, left), (1, right))
            if end != self.wall(side)
        ]

    def _nodes(self, height: float) -> tuple[Array, Array, Array]:
        """Places, weights and energies above the lowest for integrals over x."""
        left, right = self.span(height)
        edges = np.union1d(np.linspace(left, right, PIECES), self.knots(left, right))
        x, weights = gauss_panels(edges, NODES)
        energy = self.energy(x)
        return x, weights, energy - energy.min()

    def knots(self, left: float, right: float) -> list[float]:
        """Places where the force has a kink."""
        found = []
        for stop in self.stops:
            if isinstance(stop.law, CompliantLaw):
                table = isinstance(stop.law, ForceTable)
                depths = stop.law.pieces[0] if isinstance(stop.law, ForceTable) else [0.0]
                found += [stop.position + stop.side * float(depth) for depth in depths]
                found += [stop.position] if table else []
        return sorted({knot for knot in found if left < knot < right})

    def lowest(self, square: float) -> float:
        """Lowest energy of all places."""
        x, _, energy = self._nodes(LAW_DEPTH * square)
        return float(self.energy(x[[int(np.argmin(energy))]])[0])

    def taken(self, square: float) -> tuple[float, float]:
        """Power that damper and stops take under the law exp(-energy / square)."""
        s = math.sqrt(square)
        law = SPEED_WEIGHTS * np.exp(-(SPEEDS**2) / 2.0) / math.sqrt(2.0 * math.pi)
        drag = (self.drag(s * SPEEDS) - self.drag(-s * SPEEDS)) * s * SPEEDS
        damper = float(law @ drag)
        stops = 0.0
        if any(not stop.law.conservative for stop in self.stops):
            _, weights, energy = self._nodes(LAW_DEPTH * square)
            mass = float(weights @ np.exp(-energy / square))
            lowest = self.lowest(square)
            for stop in self.stops:
                height = float(self.energy(np.array(stop.position))) - lowest
                loss = (1.0 - stop.restitution_at(s * SPEEDS) ** 2) * (s * SPEEDS) ** 3 / 2.0
                stops += math.exp(-max(height, 0.0) / square) / mass * float(law @ loss)
        return damper, stops

    @cached_property
    def squares(self) -> tuple[float, float]:
        """s^2 at which the law exp(-energy / s^2) takes up the power of the noise, and at which it
        would if the damper were alone: nowhere is the density hotter; infinite without damper."""

        def excess(log_square: float, *, stops: bool) -> float:
            damper, taken = self.taken(math.exp(log_square))
            total = damper + (taken if stops else 0.0)
            return min(max(total / self.power, -1e3), 1e3) - 1.0

        guess = math.log((self.power * self.length) ** (2.0 / 3.0))
        square = math.exp(_root(lambda e: excess(e, stops=True), guess))
        most = math.inf
        if self.taken(square)[0] > 1e-12 * self.power:
            # by the damper alone, which may be too little to be found
            most = math.exp(_root(lambda e: excess(e, stops=False), math.log(square)))
        return square, most

    @property
    def weight(self) -> float:
        """t of the weight exp(-energy / t)."""
        square, hottest = self.squares
        return min(hottest, WIDENED**2 * square)


MOST_STEPS = 400
"""Of a search for a scale, each by a factor e."""


def _root(function: Callable[[float], float], start: float) -> float:
    """Where a rising function is 0."""
    low = high = start
    step = 1.0
    for _ in range(MOST_STEPS):
        if function(low) <= 0.0:
            break
        low, high = low - step, low
    else:
        raise NotApplicable("fokker-planck", ["damping must take up the power of the noise"])
    if low == start:
        for _ in range(MOST_STEPS):
            if function(high) >= 0.0:
                break
            low, high = high, high + step
        else:
            raise NotApplicable("fokker-planck", ["damping must take up the power of the noise"])
    return float(brentq(function, low, high, xtol=1e-9)) if high > low else low


def _elastic(law: CompliantLaw) -> CompliantLaw:
    """The part of a law that has a potential."""
    return law.model_copy(update={"damping_ratio": 0.0}) if isinstance(law, Viscoelastic) else law
