"""The motion of a scene in the units of a box: lengths, speeds and energies of the order of one.

The density is sought as p(xi, u) = M q with the weight M = exp(-u^2 / 2 - energy(xi)), where

    0 = -u dp/dxi - d/du [(force(xi) + grip(xi, u) - damping(u)) p] + diffusion d2p/du2

and a mass that arrives at a rigid stop with the speed w leaves it with R(w) w. Where R scatters,
the density of leaving speeds is the mean over R.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Array
from stochvi.methods.fokker_planck.linear_boxes import FARTHEST_STOP
from stochvi.methods.fokker_planck.motion import PIECES, SPEEDS, Motion
from stochvi.methods.fokker_planck.restitution_rule import restitution_rule
from stochvi.model.model import UPPER, Stop
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.scenes.impact_laws import CompliantLaw, Restitution

Law = Callable[[Array], Array]

REACH = 7.2
"""A box ends at the energy t REACH^2 / 2 above the energy of its farthest stop, and so do its
velocities. t is that of the weight exp(-energy / t); the part of F2 beyond is 2e-10."""

FASTEST = 30.0
"""Largest energy of impacts that a box is made for, in units of t: their rate is then as small a
part of the whole as the rounding of a number."""

SYMMETRIC = 1e-10
"""Share of the largest force by which the forces on both sides may differ in a symmetric scene,
because of rounding."""

METASTABLE = 30.0
"""Highest barrier between wells that is solved for, in units of the weight's energy: from there on
rounding decides how often each well is visited, as 1e-16 exp(30) is a thousandth."""

SMALLEST_BOX = 1e-12
"""Shortest box, in units of the distance of its ends from the unloaded spring: it has 4 digits."""

BARRIER_PLACES = 2048
"""Number of places at which the energy is compared to find a barrier."""

HIDDEN = 0.1
"""Speed in units of (diffusion / damping of a stop)^(1/2) up to which the density is smooth."""


class StopForce(NamedTuple):
    """A force that depends on place and velocity, between two places of the box.

    `force(xi, u)` takes arrays that are broadcast; `kink(xi)` is the velocity at which the slope of
    the force jumps.
    """

    left: float
    right: float
    force: Callable[[Array, Array], Array]
    kink: Law


class StopSingularity(NamedTuple):
    """Place where a stop begins to take energy, and speed below which noise smooths the density."""

    place: float
    slowest: float


@dataclass(frozen=True, kw_only=True)
class ScaledMotion:
    """A motion with x = centre + length xi and v = speed u, in the box between xi = -1 and 1.

    Parameters
    ----------
    motion
        The motion in SI units.
    left, right
        The ends of the box, m.
    speed
        The unit of velocity, sqrt(t) of the weight exp(-energy / t), m/s.
    lowest_energy
        The lowest potential energy of all places, m^2/s^2, from which `energy` counts.
    reach
        The largest velocity u.
    halved
        Whether the box holds the upper half of a symmetric scene only.
    reached
        The stops within reach.
    rare_energy
        The energy in units of t of what must be resolved however rare it is: that of the slowest
        impact to count on the nearest stop, or of a barrier between wells if that is higher.
    barrier
        Height of the barrier above the shallower well in units of t; 0 without a barrier.
    """

    motion: Motion
    left: float
    right: float
    speed: float
    lowest_energy: float
    reach: float
    halved: bool
    reached: tuple[Stop, ...]
    rare_energy: float
    barrier: float

    @property
    def centre(self) -> float:
        """Middle of the box, m."""
        return (self.left + self.right) / 2.0

    @property
    def length(self) -> float:
        """Half the length of the box, m: the unit of displacement."""
        return (self.right - self.left) / 2.0

    @property
    def stops(self) -> tuple[Stop, ...]:
        """The stops in the box; a halved box has the upper stop only."""
        return tuple(stop for stop in self.reached if not self.halved or stop.side == UPPER)

    def place(self, stop: Stop) -> float:
        """Place xi of a stop; a rigid one ends the box."""
        if stop.rigid:
            return float(stop.side)
        return (stop.position - self.centre) / self.length

    # The equation of motion ---------------------------------------------------------------------

    @property
    def _acceleration(self) -> float:
        """Factor that turns an acceleration into the units of the box, s^2/m."""
        return self.length / self.speed**2

    @property
    def diffusion(self) -> float:
        """Half the intensity of the noise."""
        return self.motion.power * self.length / self.speed**3

    def force(self, xi: Array) -> Array:
        """Force of spring, load and the springs of stops."""
        return self.motion.force(self.centre + self.length * xi) * self._acceleration

    def energy(self, xi: Array) -> Array:
        """Potential energy of that force, 0 at its lowest."""
        energy = self.motion.energy(self.centre + self.length * xi)
        return np.asarray((energy - self.lowest_energy) / self.speed**2)

    def damping(self, u: Array) -> Array:
        """Force of the damper, against the velocity u."""
        return self.motion.drag(self.speed * u) * self._acceleration

    def leaving(self, side: int) -> list[tuple[float, Law]]:
        """Speeds with which a mass that arrives with the speed w leaves an end of the box, each
        with its probability."""
        stop = next((stop for stop in self.stops if stop.rigid and stop.side == side), None)
        if stop is None:
            return [(1.0, lambda w: w)]
        if isinstance(stop.law, Restitution) and stop.law.scatter is not None:
            nodes, weights = restitution_rule(stop.law.scatter)
            return [
                (float(p), partial(np.multiply, r)) for p, r in zip(weights, nodes, strict=True)
            ]
        return [(1.0, lambda w: stop.restitution_at(self.speed * w) * w)]

    @property
    def grips(self) -> tuple[StopForce, ...]:
        """Forces that the dampers of stops add to those of their springs."""
        return tuple(
            self._grip(stop, stop.law)
            for stop in self.stops
            if isinstance(stop.law, CompliantLaw) and not stop.law.conservative
        )

    def _grip(self, stop: Stop, law: CompliantLaw) -> StopForce:
        damping, place = law.damping(1.0), self.place(stop)

        def spring(xi: Array) -> Array:
            return law.force_at(stop.side * self.length * (xi - place))

        def force(xi: Array, u: Array) -> Array:
            # towards the mass: max(spring(y) + c y', 0) less spring(y)
            push = np.maximum(damping * stop.side * self.speed * u, -spring(xi))
            return np.asarray(-stop.side * self._acceleration * push, dtype=float)

        def kink(xi: Array) -> Array:
            return np.asarray(-stop.side * spring(xi) / (damping * self.speed), dtype=float)

        left, right = (place, math.inf) if stop.side == UPPER else (-math.inf, place)
        return StopForce(left, right, force, kink)

    # Where the density is not smooth ------------------------------------------------------------

    @property
    def corners(self) -> tuple[StopSingularity, ...]:
        """The corners at the stops that take energy."""
        return tuple(
            StopSingularity(self.place(stop), self._hidden(stop))
            for stop in self.stops
            if not stop.law.conservative
        )

    def _hidden(self, stop: Stop) -> float:
        """Speed below which noise hides that a stop takes energy; 0 for a rigid one."""
        if not isinstance(stop.law, CompliantLaw):
            return 0.0
        return HIDDEN * math.sqrt(self.motion.power / stop.law.damping(1.0)) / self.speed

    @property
    def knots(self) -> tuple[float, ...]:
        """Places where the force has a kink."""
        knots = self.motion.knots(self.left, self.right)
        return tuple((knot - self.centre) / self.length for knot in knots)

    @property
    def roots(self) -> tuple[tuple[float, int], ...]:
        """Places, and sides, from which on the force of a stop goes as y^(3/2)."""
        return tuple(
            (self.place(stop), stop.side)
            for stop in self.stops
            if isinstance(stop.law, CompliantLaw) and stop.law.starts_as_root
        )


def scaled_motion(
    motion: Motion, stretch: float = 1.0, hit: Collection[Stop] = (), threshold: float = 0.0
) -> ScaledMotion:
    """The box of a motion, its weight `stretch` times as wide in velocity as expected.

    Stops that are known to be `hit` are within reach, whatever the law exp(-energy / s^2) says.
    The box reaches beyond impacts of the speed `threshold`, m/s, and these must be resolved.

    Raises
    ------
    NotApplicable
        If the density falls too slowly far out to have a variance.
    NotConverged
        If the barrier between two wells is too high for the digits of floating-point numbers.
    """
    square, weight = motion.squares[0], motion.weight * stretch**2
    lowest = motion.lowest(square)
    heights = {
        stop: max(float(motion.energy(np.array(stop.position))) - lowest, 0.0)
        for stop in motion.stops
    }
    within = square * FARTHEST_STOP**2 / 2.0
    reached = tuple(stop for stop in motion.stops if heights[stop] <= within or stop in hit)
    fast = min(max(threshold**2 / weight - 1.0, 0.0) / 2.0, FASTEST)
    energies = [heights[stop] / weight + fast for stop in reached] or [0.0]
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
    if not right - left > SMALLEST_BOX * max(abs(left), abs(right)):
        raise NotConverged(
            f"fokker-planck cannot resolve the motion within {right - left:.1g} m at {right:.3g} m "
            "from the unloaded spring: double precision ends at 1e-16 of that; simulate this scene"
        )
    if barrier > METASTABLE:
        raise NotConverged(BARRIER_TOO_HIGH.format(barrier=barrier))
    return ScaledMotion(
        motion=motion,
        left=left,
        right=right,
        speed=math.sqrt(weight),
        lowest_energy=lowest,
        reach=reach,
        halved=halved,
        reached=reached,
        rare_energy=max(min(energies), top),
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


BARRIER_TOO_HIGH = (
    "fokker-planck cannot tell how often each well is visited: the barrier between the wells is "
    "{barrier:.0f} times the mean energy in velocity, and double precision ends at 30; exact may "
    "have the answer, or solve each well on its own"
)


def _barrier(motion: Motion, left: float, right: float, weight: float) -> tuple[float, float]:
    """Height of the highest barrier between the wells of a spring that is a function, in units of
    the weight's energy. It is given above the shallower well and above the lowest place; 0 without
    a barrier."""
    if motion.model.restoring is None:
        return 0.0, 0.0
    energy = motion.energy(np.linspace(left, right, BARRIER_PLACES)) / weight
    before = np.minimum.accumulate(energy)
    after = np.minimum.accumulate(energy[::-1])[::-1]
    height = energy - np.maximum(before, after)
    if height.max() <= 0.0:
        return 0.0, 0.0
    return float(height.max()), float(energy[height > 0.0].max() - energy.min())


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
