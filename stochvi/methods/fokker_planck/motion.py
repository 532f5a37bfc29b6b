"""The motion of one oscillator: its forces as functions of place and velocity, and its scales."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from stochvi.mathematics.arrays import Array
from stochvi.mathematics.quadrature import gauss_panels
from stochvi.model.model import Model, Stop
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.scenes.impact_laws import CompliantLaw

LAW_DEPTH = 18.0
"""Energy in units of s^2 at which the law exp(-energy / s^2) is cut while its scale s is searched
for: the law has fallen to 2e-8 of its peak there."""

WIDENED = 1.2
"""Speed of the weight exp(-energy / t) in units of s, sqrt(t) = WIDENED s, unless the damper alone
allows less: the density between inelastic stops has wider tails than the law of the same power."""

STRIDE = 1.3
"""Ratio of successive distances at which the potential energy is computed."""

NEAREST, FARTHEST = 1e-7, 1e12
"""The first and the last of these distances, in units of a length of the scene."""

NODES = 24
"""Number of Gauss-Legendre nodes on each panel of an integral over a law."""

PIECES = 40
"""Number of panels into which the range of a law is cut."""

SPEEDS, SPEED_WEIGHTS = (part.ravel() for part in gauss_panels(np.linspace(0.0, 8.0, 9), NODES))
"""Gauss-Legendre nodes and weights for a Gaussian distribution of unit width; 1e-14 of it lies
beyond 8."""


DEEP = 100.0
"""Energy up to which the place of lowest energy is searched for, in units of
(power length)^(2/3)."""

AT_ONCE = 16
"""Number of places at which the potential energy is computed together."""

FINE_STRIDE, FINE_AT_ONCE = 1.02, 105
"""The same two numbers for a spring that is a function, which may have further wells: the search
ends when the energy has stayed high over so many places, which is an eightfold distance."""


class _Ray:
    """The energy at places that lie further and further from a start, each computed once."""

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
        there, or up to a rigid stop."""
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
        """Compute the energy at the next places outwards."""
        motion, taken = self.motion, len(self.places) - 1
        steps = np.arange(taken, taken + self.at_once, dtype=float)
        away: Array = NEAREST * motion.length * self.stride**steps
        wall = abs(motion.wall(self.side) - self.start)
        if away[0] > FARTHEST * motion.length and wall == math.inf:
            raise NotApplicable(
                "fokker-planck",
                [
                    "the spring or a stop must hold the mass on either side, got nothing on its "
                    f"{'upper' if self.side > 0 else 'lower'} side; give a stiffness or a stop"
                ],
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
        """Power that the noise supplies per unit mass, S0 / 2, m^2/s^3."""
        return self.model.intensity / 2.0

    def wall(self, side: int) -> float:
        """Position of the rigid stop on a side, m; infinite where there is none."""
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
        """Force of spring, load and compliant stops, without damping, m/s^2."""
        x = np.asarray(x, dtype=float)
        total = self.spring(x)
        for stop in self.stops:
            if isinstance(stop.law, CompliantLaw):
                y = stop.deflection(x)
                total = total - stop.side * stop.law.force_at(y)
        return np.asarray(total, dtype=float)

    def energy(self, x: Array) -> Array:
        """Potential energy of `force`, m^2/s^2."""
        x = np.asarray(x, dtype=float)
        model = self.model
        spring = model.omega**2 * x**2 / 2.0 if model.potential is None else model.potential(x)
        total = spring - model.load * x
        for stop in self.stops:
            if isinstance(stop.law, CompliantLaw):
                total = total + stop.law.potential_at(stop.deflection(x))
        return np.asarray(total, dtype=float)

    def drag(self, v: Array) -> Array:
        """Force of the damper at velocities v, m/s^2."""
        v = np.asarray(v, dtype=float)
        drag = self.model.drag
        return self.model.damping_rate * v if drag is None else np.asarray(drag(v), dtype=float)

    @cached_property
    def length(self) -> float:
        """A length of the scene, m, with which a search begins."""
        lengths = [abs(stop.position - self._rest) for stop in self.stops]
        if len(self.stops) == 2:
            lengths.append(self.stops[1].position - self.stops[0].position)
        if self.model.omega:
            lengths.append((self.power / self.model.omega**3) ** 0.5)
        return min((length for length in lengths if length > 0.0), default=1.0)

    @property
    def _rest(self) -> float:
        """Place where a linear spring balances the load, or else 0, between the rigid stops, m."""
        rest = self.model.rest if self.model.omega else 0.0
        return min(max(rest, self.wall(-1)), self.wall(1))

    @cached_property
    def start(self) -> float:
        """Place of the lowest energy met on the way outwards from the rest position, m."""
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
        """The range of places whose energy is less than `height` (m^2/s^2) above the lowest."""
        found = [ray.up_to(height) for ray in self._rays]
        lowest = min(float(energies.min()) for _, energies in found)
        left, right = (
            self._border(places, energies, lowest + height) for places, energies in found
        )
        return left, right

    def _border(self, places: Array, energies: Array, level: float) -> float:
        """Place at which the energy crosses a level for the last time on the way outwards, m."""
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
        """Each end without a rigid stop as (side, place, n).

        n is the power with which the law exp(-energy / square) falls there, as |x - start|^-n.
        """
        return [
            (side, end, (self.start - end) * float(self.force(np.array(end))) / square)
            for side, end in ((-1, left), (1, right))
            if end != self.wall(side)
        ]

    def _nodes(self, height: float) -> tuple[Array, Array, Array]:
        """Places, weights and energies above the lowest for integrals over x."""
        left, right = self.span(height)
        edges = np.union1d(np.linspace(left, right, PIECES), self.knots(left, right))
        if len(edges) < PIECES:
            raise NotConverged(
                "fokker-planck did not converge: the motion is so small beside its distance from "
                "the unloaded spring that its places are lost in rounding; check the intensity"
            )
        x, weights = gauss_panels(edges, NODES)
        energy = self.energy(x)
        return x, weights, energy - energy.min()

    def knots(self, left: float, right: float) -> list[float]:
        """Places at which the force has a kink, m."""
        found = [float(each) for part in self.model.functions for each in part.law.knots()]
        for stop in self.stops:
            if isinstance(stop.law, CompliantLaw):
                depths = stop.law.knots()
                found += [stop.position + stop.side * float(depth) for depth in depths]
        return sorted({knot for knot in found if left < knot < right})

    def lowest(self, square: float) -> float:
        """Lowest potential energy of all places, m^2/s^2."""
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
                loss = (1.0 - stop.restitution_square_at(s * SPEEDS)) * (s * SPEEDS) ** 3 / 2.0
                stops += math.exp(-max(height, 0.0) / square) / mass * float(law @ loss)
        return damper, stops

    @cached_property
    def squares(self) -> tuple[float, float]:
        """Two squared speeds (m^2/s^2) at which a law exp(-energy / s^2) takes the noise's power.

        The first is that of damper and stops together. The second is that of the damper alone,
        above which the density is nowhere; it is infinite without a damper.
        """

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
        """Parameter t of the weight exp(-energy / t), m^2/s^2."""
        square, hottest = self.squares
        return min(hottest, WIDENED**2 * square)


MOST_STEPS = 400
"""Largest number of steps in the search for a scale, each by a factor e."""

UNBOUNDED = "damping must take up the power of the noise at some energy, got none; raise damping"
"""Condition of a stationary state, where no energy is found at which it holds."""


def _root(function: Callable[[float], float], start: float) -> float:
    """The root of a rising function, searched for in steps that double."""
    low = high = start
    step = 1.0
    for _ in range(MOST_STEPS):
        if function(low) <= 0.0:
            break
        low, high = low - step, low
    else:
        raise NotApplicable("fokker-planck", [UNBOUNDED])
    if low == start:
        for _ in range(MOST_STEPS):
            if function(high) >= 0.0:
                break
            low, high = high, high + step
        else:
            raise NotApplicable("fokker-planck", [UNBOUNDED])
    return float(brentq(function, low, high, xtol=1e-9)) if high > low else low
