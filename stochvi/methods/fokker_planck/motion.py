"""The oscillator whose Fokker-Planck equation is solved. Chapters: restitutions that scatter;
forces and scales of the motion; conditions of the method; the motion in the units of a box."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import scipy

from stochvi.mathematics.impact_rates import (
    BetaDistribution,
    corner_exponent,
    equivalent_restitution,
)
from stochvi.mathematics.numerics import Array, Vector, gauss_panels
from stochvi.methods.fokker_planck.basis import FARTHEST_STOP
from stochvi.model.coverage import (
    beyond_one_oscillator,
    compliant,
    nonlinear,
    not_white,
    speed_functions,
    without_dissipation,
    without_energy,
)
from stochvi.model.model import UPPER, Model, Stop
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.scenes.impact_laws import CompliantLaw, Restitution

# ------------------------------------------------------------------------------
# A few restitutions with probabilities, which stand for one that scatters.
# ------------------------------------------------------------------------------


COUNTS = (6, 12, 24, 48)
"""Numbers of restitutions that are tried; each takes the time of one matrix."""

CORNER_ERROR = 1e-7
"""Relative error of E R^(beta - 2) from which a rule is fine enough: beta is the exponent of the
density at the stop, to which slow impacts are most sensitive."""


def restitution_rule(law: BetaDistribution) -> tuple[Vector, Vector]:
    """Restitutions and their probabilities: the first of Gauss's rules that is fine enough, or the
    finest one. E R and E R^2 are exact in all."""
    power = corner_exponent(equivalent_restitution(law)) - 2.0
    wanted = law.moment(power)
    for count in COUNTS:
        nodes, weights = law.rule(count)
        if abs(weights @ nodes**power - wanted) <= CORNER_ERROR * wanted:
            break
    return nodes, weights


# ------------------------------------------------------------------------------
# The motion of one oscillator: its forces as functions of place and velocity, and its scales.
# ------------------------------------------------------------------------------


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
                "the spring or a stop must hold the mass on either side, got nothing on its "
                f"{'upper' if self.side > 0 else 'lower'} side; give a stiffness or a stop",
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
        found = scipy.optimize.minimize_scalar(
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
        return float(scipy.optimize.brentq(above, near, far, xtol=1e-9 * abs(far - near)))

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
        raise NotApplicable("fokker-planck", UNBOUNDED)
    if low == start:
        for _ in range(MOST_STEPS):
            if function(high) >= 0.0:
                break
            low, high = high, high + step
        else:
            raise NotApplicable("fokker-planck", UNBOUNDED)
    return float(scipy.optimize.brentq(function, low, high, xtol=1e-9)) if high > low else low


# ------------------------------------------------------------------------------
# Conditions that a model must meet for the Fokker-Planck equation to be solved.
# ------------------------------------------------------------------------------


def unmet(model: Model) -> list[str]:
    """The conditions of `fokker_planck` that a model does not meet; empty where it meets all.

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
    stochvi.fokker_planck : The method.
    stochvi.explain : What all methods say of a scene.

    Examples
    --------
    >>> from stochvi.model.model import model_of
    >>> from stochvi.scenes import shipped_scene
    >>> from stochvi.scenes.scene import load_scene
    >>> model = model_of(load_scene(shipped_scene("isolator-truck")))
    >>> unmet(model)
    ['excitation must be white noise, got a tabulated density']
    """
    found = beyond_one_oscillator(model, with_functions=True, white_only=True)
    if found:
        return found
    found = [*not_white(model), *without_dissipation(model)]
    found += speed_functions(model) or without_energy(model)
    if not _held(model):
        found.append(
            "stiffness must be positive where stops do not hold the mass, got 0"
            if model.restoring is None
            else "restoring_force must hold the mass where stops do not"
        )
    return found


def unmet_by_transient(model: Model) -> list[str]:
    """The conditions of `transient` that a model does not meet; empty where it meets all.

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
    stochvi.transient : The method.

    Examples
    --------
    >>> from stochvi.model.model import model_of
    >>> from stochvi.scenes import shipped_scene
    >>> from stochvi.scenes.scene import load_scene
    >>> model = model_of(load_scene(shipped_scene("oscillator-lossy")))
    >>> unmet_by_transient(model)
    []
    """
    return beyond_one_oscillator(model, white_only=True) or [*unmet(model), *compliant(model)]


def unmet_by_first_passage(model: Model, lower: float | None, upper: float | None) -> list[str]:
    """The conditions of `first_passage` that a model and two barriers (m) do not meet.

    A barrier that is None is left out, and a stop there turns paths back; where both are, the stops
    of the model are the barriers.

    Parameters
    ----------
    model
        The model of a scene.
    lower
        Lower barrier, m; None for none.
    upper
        Upper barrier, m; None for none.

    Returns
    -------
    list[str]
        Sentences, empty where everything is met.

    See Also
    --------
    stochvi.first_passage : The method.

    Examples
    --------
    >>> from stochvi.model.model import model_of
    >>> from stochvi.scenes import shipped_scene
    >>> from stochvi.scenes.scene import load_scene
    >>> model = model_of(load_scene(shipped_scene("oscillator-lossy")))
    >>> unmet_by_first_passage(model, None, None)
    []
    """
    # a stop that is a barrier ends the path: its law, also a function, does not matter
    found = nonlinear(model) or beyond_one_oscillator(model, with_functions=True, white_only=True)
    if found:
        return found
    found = not_white(model)
    low, high = barriers(model, lower, upper)
    if math.isinf(low) and math.isinf(high):
        found.append("there must be a lower or an upper barrier, or a stop, got none")
    elif not low < high:
        found.append(f"barriers must have lower < upper, got {low:g} and {high:g}")
    if model.omega == 0.0 and any(math.isinf(end) for end in box_ends(model, low, high)):
        found.append("stiffness must be positive where only one barrier is, got 0")
    found += [
        f"law of the {stop.name} stop must be a restitution, as no barrier is before it, got "
        f"{stop.law.kind!r}"
        for stop in turning_stops(model, low, high)
        if not isinstance(stop.law, Restitution)
    ]
    for stop in model.stops:
        barrier = high if stop.side > 0 else low
        if math.isfinite(barrier) and stop.deflection(barrier) > 0.0:
            found.append(
                f"barriers must not lie beyond a stop, got {stop.name} at {barrier:g} m and a stop "
                f"at {stop.position:g} m"
            )
    return found


def box_ends(model: Model, lower: float, upper: float) -> tuple[float, float]:
    """The barriers, m, or the stops on sides without a barrier; infinite without either."""
    return (
        model.lower_position if math.isinf(lower) else lower,
        model.upper_position if math.isinf(upper) else upper,
    )


def barriers(
    model: Model, lower: float | None = None, upper: float | None = None
) -> tuple[float, float]:
    """The barriers that are given, or the stops of a model where none is; infinite for none, m."""
    if lower is None and upper is None:
        return model.lower_position, model.upper_position
    return -math.inf if lower is None else lower, math.inf if upper is None else upper


def turning_stops(model: Model, lower: float, upper: float) -> list[Stop]:
    """The stops on sides without a barrier, m, which turn paths back."""
    return [stop for stop in model.stops if math.isinf(upper if stop.side > 0 else lower)]


def _held(model: Model) -> bool:
    """Whether spring, load and stops keep the mass from leaving on either side."""
    if model.omega > 0.0:
        return True
    try:
        Motion(model=model).span(model.intensity or 1.0)
    except NotApplicable:
        return False
    return True


LEAST_RTOL = 1e-12
"""Smallest relative error that may be asked for: rounding leaves no smaller one."""


def check_rtol(rtol: float) -> None:
    """Raise ValueError if a relative error is out of range."""
    if not LEAST_RTOL <= rtol < math.inf:
        raise ValueError(f"rtol must be at least {LEAST_RTOL:g}, got {rtol:g}")
    if rtol >= 1.0:
        raise ValueError(f"rtol must be below 1, got {rtol:g}")


# ------------------------------------------------------------------------------
# The motion of a scene in the units of a box: lengths, speeds and energies of the order of one.
#
# The density is sought as p(xi, u) = M q with the weight M = exp(-u^2 / 2 - energy(xi)), where
#
#     0 = -u dp/dxi - d/du [(force(xi) + grip(xi, u) - damping(u)) p] + diffusion d2p/du2
#
# and a mass that arrives at a rigid stop with the speed w leaves it with R(w) w. Where R scatters,
# the density of leaving speeds is the mean over R.
# ------------------------------------------------------------------------------


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
                "restoring_force must leave a finite variance, got a density that falls as "
                f"x^-{falls:.3g} far out, no faster than x^-3",
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
