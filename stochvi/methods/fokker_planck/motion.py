"""A scene as forces that are functions, and the box of unit speed that it is solved in."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from stochvi.mathematics.quadrature import gauss_panels
from stochvi.methods.fokker_planck.boxes import FARTHEST_STOP
from stochvi.methods.fokker_planck.mesh import Array
from stochvi.methods.fokker_planck.strips import Box, Grip
from stochvi.model.model import Model, Stop
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.scenes.impact_laws import CompliantLaw, ForceTable, Hertz, Viscoelastic

LAW_DEPTH = 18.0
"""Energy in units of s^2 at which the law exp(-energy / s^2) is cut where a scale is sought: there
it is 2e-8 of its peak."""

REACH = 7.2
"""A box ends at the energy t REACH^2 / 2 above what its farthest stop calls for, and so do its
velocities: the part of F2 beyond is 2e-10."""

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

SYMMETRIC = 1e-10
"""Part of the largest force by which those on both sides may differ in a symmetric scene."""

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

METASTABLE = 30.0
"""Barrier between wells in units of the weight's energy from which on the rounding of numbers
decides how often each of them is visited: 1e-16 exp(30) is a thousandth."""

BARRIER_PLACES = 2048
"""At which the energy is looked at for a barrier."""


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


class Corner(NamedTuple):
    """Where, at u = 0, a stop begins to take energy, and the speed up to which noise hides that."""

    place: float
    slowest: float


HIDDEN = 0.1
"""Speed in units of (diffusion / damping of a stop)^(1/2) up to which the density is smooth."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """x = centre + length xi, v = speed u, and the box between xi = -1 and 1.

    A `halved` frame holds the upper half of a symmetric scene; `reach` is the largest u. `knots`
    are places where the force has a kink, `roots` those (and sides) from which on it goes as a
    broken power. `rare_energy` is what must be resolved however rare it is, in units of t above
    the lowest: that of the nearest stop, or of a barrier between wells if that is higher;
    `barrier` is the height of that above the shallower well. `reached` are the stops that are not
    out of reach.
    """

    motion: Motion
    box: Box
    left: float
    right: float
    length: float
    speed: float
    reach: float
    halved: bool
    corners: tuple[Corner, ...]
    knots: tuple[float, ...]
    roots: tuple[tuple[float, int], ...]
    rare_energy: float
    reached: tuple[Stop, ...]
    barrier: float

    @property
    def centre(self) -> float:
        """Of the box, m."""
        return (self.left + self.right) / 2.0


def make_frame(motion: Motion, stretch: float = 1.0, hit: Collection[Stop] = ()) -> Frame:
    """The box of a scene, its weight `stretch` times as wide in velocity as expected.

    Stops that are known to be `hit` are within reach, whatever the law exp(-energy / s^2) says.
    """
    square, weight = motion.squares[0], motion.weight * stretch**2
    lowest = motion.lowest(square)
    heights = {
        stop: max(float(motion.energy(np.array(stop.position))) - lowest, 0.0)
        for stop in motion.stops
    }
    within = square * FARTHEST_STOP**2 / 2.0
    reached = tuple(stop for stop in motion.stops if heights[stop] <= within or stop in hit)
    energies = [heights[stop] / weight for stop in reached] or [0.0]
    reach = math.sqrt(REACH**2 + 2.0 * max(energies))
    left, right = motion.span(weight * reach**2 / 2.0)
    if motion.model.restoring is not None:
        _check_tails(motion, left, right, weight)
    barrier, top = _barrier(motion, left, right, weight)
    if top > max(energies):
        reach = math.sqrt(REACH**2 + 2.0 * top)
        left, right = motion.span(weight * reach**2 / 2.0)
    walls = {stop.side for stop in reached if stop.rigid}
    halved = len(walls) != 1 and _is_symmetric(motion, left, right)
    if halved:
        left = (left + right) / 2.0
        barrier, top = _barrier(motion, left, right, weight)
    if barrier > METASTABLE:
        raise NotConverged(APART.format(barrier=barrier))
    units = _Units((left + right) / 2.0, (right - left) / 2.0, math.sqrt(weight))
    solved = tuple(stop for stop in reached if not halved or stop.side > 0)
    touched = [stop for stop in solved if not stop.rigid]
    return Frame(
        motion=motion,
        box=_box(motion, solved, units, lowest),
        left=left,
        right=right,
        length=units.length,
        speed=units.speed,
        reach=reach,
        halved=halved,
        corners=tuple(
            Corner(units.place(stop), _hidden(motion, stop, units))
            for stop in solved
            if not stop.law.conservative
        ),
        knots=tuple((knot - units.centre) / units.length for knot in motion.knots(left, right)),
        roots=tuple((units.place(s), s.side) for s in touched if isinstance(s.law, Hertz)),
        rare_energy=max(min(energies), top),
        reached=reached,
        barrier=barrier,
    )


HEAVIEST = 3.0
"""Power with which a density must fall, and faster, for its variance to be finite."""


def _check_tails(motion: Motion, left: float, right: float, weight: float) -> None:
    for _, _, falls in motion.open_ends(left, right, weight):
        if falls <= HEAVIEST:
            raise NotApplicable(
                "fokker-planck",
                [
                    "restoring_force must leave a finite variance, got a density that falls as "
                    f"x^-{falls:.3g} far out, no faster than x^-3"
                ],
            )


APART = (
    "fokker-planck cannot tell how often each well is visited: wells are metastable, {barrier:.0f} "
    "times the mean energy in velocity below the barrier between them, and numbers of 16 digits "
    "end at 30; exact may have the answer, or solve each well on its own"
)


def _barrier(motion: Motion, left: float, right: float, weight: float) -> tuple[float, float]:
    """Of the highest barrier between wells of a spring that is a function: how high it is above
    the shallower well and above all places, in units of the weight's energy; 0 if there is none."""
    if motion.model.restoring is None:
        return 0.0, 0.0
    energy = motion.energy(np.linspace(left, right, BARRIER_PLACES)) / weight
    before = np.minimum.accumulate(energy)
    after = np.minimum.accumulate(energy[::-1])[::-1]
    height = energy - np.maximum(before, after)
    if height.max() <= 0.0:
        return 0.0, 0.0
    return float(height.max()), float(energy[height > 0.0].max() - energy.min())


class _Units(NamedTuple):
    """Of a box: its centre, m, half its length, m, and the speed of the weight, m/s."""

    centre: float
    length: float
    speed: float

    def place(self, stop: Stop) -> float:
        """Of a stop; a rigid one ends the box."""
        if stop.rigid:
            return float(stop.side)
        return (stop.position - self.centre) / self.length


def _box(motion: Motion, stops: tuple[Stop, ...], units: _Units, lowest: float) -> Box:
    centre, length, speed = units
    leaving = {stop.side: _leaving(stop, speed) for stop in stops if stop.rigid}
    scale = length / speed**2
    return Box(
        force=lambda xi: motion.force(centre + length * xi) * scale,
        energy=lambda xi: (motion.energy(centre + length * xi) - lowest) / speed**2,
        damping=lambda u: motion.drag(speed * u) * scale,
        diffusion=motion.power * length / speed**3,
        leaving_left=leaving.get(-1, _all),
        leaving_right=leaving.get(1, _all),
        grips=tuple(_grip(s, units) for s in stops if isinstance(s.law, Viscoelastic)),
    )


def _hidden(motion: Motion, stop: Stop, units: _Units) -> float:
    """Speed below which noise hides that a stop takes energy; 0 for a rigid one."""
    if not isinstance(stop.law, Viscoelastic):
        return 0.0
    return HIDDEN * math.sqrt(motion.power / stop.law.damping(1.0)) / units.speed


def _all(w: Array) -> Array:
    """An elastic wall."""
    return w


def _leaving(stop: Stop, speed: float) -> Callable[[Array], Array]:
    return lambda w: stop.restitution_at(speed * w) * w


def _grip(stop: Stop, units: _Units) -> Grip:
    """What the damper of a viscoelastic stop adds to the force of its spring."""
    law, (_, length, speed) = stop.law, units
    assert isinstance(law, Viscoelastic)
    stiffness, damping, side = law.stiffness, law.damping(1.0), stop.side
    place = units.place(stop)
    scale = length / speed**2

    def spring(xi: Array) -> Array:
        return np.asarray(stiffness * side * length * (xi - place), dtype=float)

    def force(xi: Array, u: Array) -> Array:
        # towards the mass: max(K y + c y', 0) less K y
        push = np.maximum(damping * side * speed * u, -spring(xi))
        return np.asarray(-side * scale * push, dtype=float)

    def kink(xi: Array) -> Array:
        if damping == 0.0:
            return np.full_like(xi, math.inf)
        return np.asarray(-side * spring(xi) / (damping * speed), dtype=float)

    left, right = (place, math.inf) if side > 0 else (-math.inf, place)
    return Grip(left, right, force, kink)


def _is_symmetric(motion: Motion, left: float, right: float) -> bool:
    middle = (left + right) / 2.0
    if len(motion.stops) == 1:
        return False
    if motion.stops:
        lower, upper = motion.stops
        if lower.law != upper.law or abs(lower.position + upper.position - 2.0 * middle) > (
            SYMMETRIC * (right - left)
        ):
            return False
    y = np.linspace(0.0, (right - left) / 2.0, PIECES)
    up, down = motion.force(middle + y), motion.force(middle - y)
    v = math.sqrt(motion.weight) * SPEEDS
    forward, backward = motion.drag(v), motion.drag(-v)
    largest = float(np.max(np.abs(up)) + np.max(np.abs(forward)))
    uneven = max(float(np.max(np.abs(up + down))), float(np.max(np.abs(forward + backward))))
    return uneven <= SYMMETRIC * largest
