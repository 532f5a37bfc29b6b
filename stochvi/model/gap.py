"""One gap on its own: a unit mass between at most two stops. Chapters: the gap, in SI or scaled
units; the density of a mass on a spring between compliant stops; arrays of oscillators between
rigid stops."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.impact_rates import CUT, NODES, WEIGHTS, ContactStatistics, cut_laws
from stochvi.mathematics.numerics import Booleans, Vector, newton
from stochvi.mathematics.spectra import Filter, Table
from stochvi.model.model import LOWER, UPPER, Model, Pair, Stop
from stochvi.scenes.impact_laws import CompliantLaw


@dataclass(frozen=True, kw_only=True)
class Gap:
    """x'' + damping_rate x' + omega^2 x = noise + load between the stops, per unit mass.

    Methods for a single gap compute with it. `Gap.of` makes it from the model of one oscillator.
    `Gap.of_pair` makes it from one impact pair of a structure, with a spring that stands for the
    rest of the structure.

    Parameters
    ----------
    omega, damping_rate
        Natural frequency, rad/s, and b, 1/s.
    load
        Constant load, m/s^2.
    lower, upper
        The stops, with laws for forces per unit mass; None for none.
    intensity
        Intensity S0 of the white noise, m^2/s^3.
    tables, filters
        The coloured noise: one-sided densities, (m/s^2)^2/Hz, and filtered noise.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> gap = Gap(
    ...     omega=2.0, damping_rate=0.1, load=1.0,
    ...     upper=Stop(UPPER, 3.0, Restitution(coefficient=0.8)),
    ... )
    >>> gap.scaled(origin=1.0, length=2.0, speed=4.0).upper.position
    1.0
    """

    omega: float
    damping_rate: float
    load: float
    lower: Stop | None = None
    upper: Stop | None = None
    intensity: float = 0.0
    tables: tuple[Table, ...] = ()
    filters: tuple[Filter, ...] = ()

    @classmethod
    def of(cls, model: Model) -> Self:
        """The gap of a model of one oscillator."""
        return cls(
            omega=model.omega,
            damping_rate=model.damping_rate,
            load=model.load,
            lower=model.lower,
            upper=model.upper,
            intensity=model.intensity,
            tables=model.acceleration_tables,
            filters=model.filters,
        )

    @classmethod
    def of_pair(cls, pair: Pair, *, omega: float, damping_rate: float, load: float) -> Self:
        """The gap of an impact pair, held as by one spring of the natural frequency `omega`."""
        stops = {stop.side: stop.per_unit_mass(pair.mass) for stop in pair.stops}
        return cls(
            omega=omega,
            damping_rate=damping_rate,
            load=load,
            lower=stops.get(LOWER),
            upper=stops.get(UPPER),
        )

    @property
    def stops(self) -> tuple[Stop, ...]:
        """The stops that there are, the lower one first."""
        return tuple(stop for stop in (self.lower, self.upper) if stop is not None)

    @property
    def soft(self) -> bool:
        """Whether any stop is compliant."""
        return not all(stop.rigid for stop in self.stops)

    @property
    def elastic(self) -> bool:
        """Whether no stop loses energy."""
        return all(stop.law.conservative for stop in self.stops)

    @property
    def coloured(self) -> bool:
        """Whether any noise is not white."""
        return bool(self.tables or self.filters)

    @property
    def ends(self) -> tuple[float | None, float | None]:
        """Positions of the two stops, m; None where there is no stop."""
        return (
            None if self.lower is None else self.lower.position,
            None if self.upper is None else self.upper.position,
        )

    @property
    def walls(self) -> tuple[float | None, float | None]:
        """Positions of the rigid stops, m; None on a side whose stop is compliant or missing."""
        lower, upper = self.lower, self.upper
        return (
            lower.position if lower is not None and lower.rigid else None,
            upper.position if upper is not None and upper.rigid else None,
        )

    @property
    def width(self) -> float:
        """Distance between the stops, m; infinite unless there are two."""
        if self.lower is None or self.upper is None:
            return math.inf
        return self.upper.position - self.lower.position

    def from_rest(self, rest: float) -> Self:
        """The same gap with x measured from the rest position, m, which takes the load."""
        return replace(
            self,
            load=0.0,
            lower=self.lower and _moved(self.lower, rest),
            upper=self.upper and _moved(self.upper, rest),
        )

    def scaled(self, *, origin: float, length: float, speed: float) -> Self:
        """The same gap with x measured from `origin`, in units of length (m) and speed (m/s)."""
        time = length / speed
        return replace(
            self,
            omega=self.omega * time,
            damping_rate=self.damping_rate * time,
            intensity=self.intensity * time / speed**2,
            tables=tuple(
                Table(
                    frequency_hz=table.frequency_hz * time, density=table.density * time / speed**2
                )
                for table in self.tables
            ),
            filters=tuple(
                Filter(
                    noise.omega * time, noise.damping_rate * time, noise.intensity * time / speed**2
                )
                for noise in self.filters
            ),
            load=(self.load - self.omega**2 * origin) * time / speed,
            lower=self.lower and _scaled(self.lower, origin, length, time),
            upper=self.upper and _scaled(self.upper, origin, length, time),
        )


def _moved(stop: Stop, origin: float) -> Stop:
    return replace(stop, position=stop.position - origin)


def _scaled(stop: Stop, origin: float, length: float, time: float) -> Stop:
    return Stop(stop.side, (stop.position - origin) / length, stop.law.scaled(length, time))


# ------------------------------------------------------------------------------
# The density C exp(-U(x) / theta) of a mass on a spring between compliant stops.
#
# U(x) = omega^2 x^2 / 2 - load x + V_u(x - upper) + V_l(lower - x), all per unit mass; a rigid stop
# cuts the density instead. U is convex, so the density has one peak, and everything is computed
# relative to it. A spring given as a function takes the place of omega^2 x^2 / 2: its U may have
# several wells, which are searched for, and its integrals are refined until they no longer change.
# ------------------------------------------------------------------------------


MOST_DOUBLINGS = 2000
"""Largest number of doublings of a bracket: enough to reach any length in double precision from any
other."""


MOST_HALVINGS = 30
"""Largest number of times that a panel about a kink of a function is halved: a panel of 2^-30 of
the first length contributes nothing that counts."""

SETTLED = 1e-13
"""A panel is fine enough if halving it changes the integral by no more than this share of its whole
value."""


@dataclass(frozen=True, kw_only=True)
class WellSearch:
    """Settings of the search for the wells of a spring given as a function, outwards from a place.

    Parameters
    ----------
    shortest, longest
        Lengths, m. Over the shortest one no energy changes; an energy that has not changed over
        the longest one is taken to be constant. The search grows from one to the other by factors
        of `stride`.
    stride
        Factor from one length to the next while the energy hardly changes.
    share_of_gap, share_of_theta
        The search begins at the first length that is large enough: this share of the distance to a
        rigid stop, or an energy change by this share of theta.
    places
        Number of places between a distance and its double at which the energy is evaluated.
    doublings
        Number of doublings of the distance over which the energy must stay high until no further
        well is expected.
    """

    shortest: float = 1e-40
    longest: float = 1e40
    stride: float = 16.0
    share_of_gap: float = 1e-6
    share_of_theta: float = 0.01
    places: int = 512
    doublings: int = 3


SEARCH = WellSearch()
"""Settings of the search for wells that all laws use."""


class Spring(NamedTuple):
    """Force (m/s^2) and energy (m^2/s^2) per unit mass of a spring, as functions of x (m)."""

    force: Callable[[ArrayLike], Vector]
    energy: Callable[[ArrayLike], Vector]


@dataclass(frozen=True, kw_only=True)
class GibbsLaw:
    """Density of x where v is N(0, theta) and independent of it (B 13.38).

    Parameters
    ----------
    theta
        E v^2, m^2/s^2.
    omega, load
        Natural frequency, rad/s, and constant load per unit mass, m/s^2.
    lower, upper
        The stops, with laws for forces per unit mass; None for no stop. A viscoelastic stop enters
        with its spring alone.
    spring
        A function in place of omega^2 x; omega is then 0. Its wells are searched for outwards
        from 0 until the energy has stayed 50 theta above the deepest well while the distance grew
        eightfold.

    Raises
    ------
    ValueError
        Where nothing holds the mass on one side.

    Examples
    --------
    >>> from stochvi.model.model import UPPER
    >>> from stochvi.scenes.impact_laws import Elastic
    >>> stop = Stop(UPPER, 1.0, Elastic(stiffness=100.0))
    >>> law = GibbsLaw(theta=1.0, omega=1.0, upper=stop)
    >>> round(law.mean, 12), round(law.contact("upper").probability, 12)
    (-0.243802368138, 0.032121450803)
    """

    theta: float
    omega: float
    load: float = 0.0
    lower: Stop | None = None
    upper: Stop | None = None
    spring: Spring | None = None

    def __post_init__(self) -> None:
        if not self.holds("lower") or not self.holds("upper"):
            raise ValueError("neither spring nor stops hold the mass")

    @classmethod
    def of(cls, gap: Gap, theta: float, spring: Spring | None = None) -> Self:
        """The law of a gap at theta."""
        return cls(
            theta=theta,
            omega=gap.omega,
            load=gap.load,
            lower=gap.lower,
            upper=gap.upper,
            spring=spring,
        )

    @cached_property
    def _stops(self) -> dict[str, Stop]:
        """The stops that there are, by "lower" and "upper"."""
        return {stop.name: stop for stop in (self.lower, self.upper) if stop is not None}

    @cached_property
    def _soft(self) -> tuple[tuple[Stop, CompliantLaw], ...]:
        """The compliant stops, with their laws."""
        stops = self._stops.values()
        return tuple((stop, stop.law) for stop in stops if isinstance(stop.law, CompliantLaw))

    @cached_property
    def walls(self) -> tuple[float, float]:
        """Places at which rigid stops cut the density below and above; infinite where none does."""
        walls = {name: stop.position for name, stop in self._stops.items() if stop.rigid}
        return walls.get("lower", -math.inf), walls.get("upper", math.inf)

    def holds(self, side: str) -> bool:
        """Whether the mass cannot be lost on the "lower" or "upper" side."""
        if self.spring is not None:
            return math.isfinite(self._ends[0 if side == "lower" else 1])
        if self.omega > 0.0:
            return True
        outward = self.load if side == "upper" else -self.load
        if side not in self._stops:
            return outward < 0.0
        law = self._stops[side].law
        return not isinstance(law, CompliantLaw) or law.largest_force > outward

    # The potential ------------------------------------------------------------------------

    def _pull(self, x: ArrayLike) -> Vector:
        """Slope U'(x) of the potential energy per unit mass, m/s^2."""
        x = np.asarray(x, dtype=float)
        spring = (self.spring.force(x) if self.spring else self.omega**2 * x) - self.load
        stops = [stop.side * law.force_at(stop.deflection(x)) for stop, law in self._soft]
        return np.asarray(sum(stops, spring))

    def _rise(self, offset: ArrayLike, origin: float) -> Vector:
        """Rise of the potential energy, U(origin + offset) - U(origin), m^2/s^2."""
        offset = np.asarray(offset, dtype=float)
        spring = offset * (self.omega**2 * (origin + offset / 2.0) - self.load)
        if self.spring is not None:
            spring = spring + self.spring.energy(origin + offset) - self.spring.energy(origin)
        stops = [
            law.potential_at(stop.deflection(origin + offset))
            - law.potential_at(stop.deflection(origin))
            for stop, law in self._soft
        ]
        return np.asarray(sum(stops, spring))

    @cached_property
    def _scale(self) -> float:
        """Length at which a search starts: at most the shortest on which the density changes, m."""
        speed = math.sqrt(self.theta)
        lengths = [law.impact(speed, 1.0).peak_deflection for _, law in self._soft]
        if self.omega > 0.0:
            lengths.append(speed / self.omega)
        if self.load:
            lengths.append(self.theta / abs(self.load))
        if self.lower is not None and self.upper is not None:
            lengths.append(self.upper.position - self.lower.position)
        return min(length for length in lengths if length > 0.0)

    @cached_property
    def peak(self) -> float:
        """Place of the largest density, m: where U' = 0, or a rigid stop."""
        if self.spring is not None:
            return self._deepest_well()
        start = self.load / self.omega**2 if self.omega else 0.0
        stops = [stop.position for stop in self._stops.values()]
        if self.omega == 0.0 or any(float(self._pull(stop)) == 0.0 for stop in stops):
            start = stops[0]
        low, high = self.walls
        start = min(max(start, low), high)
        slope = float(self._pull(start))
        if slope == 0.0:
            return start
        away = -math.copysign(1.0, slope)
        end = high if away > 0.0 else low
        distance = self._first(lambda d: away * float(self._pull(start + away * d)), start, away)
        if distance >= abs(end - start):
            return end
        return start + away * distance

    def _wall(self, away: float) -> float:
        """The rigid stop on one side, -1 or 1; infinite where there is none."""
        return self.walls[1] if away > 0.0 else self.walls[0]

    def _within(self, x: ArrayLike) -> Vector:
        """Place x moved to the near side of rigid stops, m."""
        return np.asarray(np.clip(np.asarray(x, dtype=float), *self.walls))

    def _outer(self, origin: float, away: float) -> float:
        """Place, in the direction `away` from `origin`, beyond which the density is negligible.

        For a spring given as a function. A rigid stop ends the search; infinity where nothing holds
        the mass.
        """
        end = self._wall(away)
        most = (end - origin) * away
        distance, lowest, high = self._near(origin, away, most), 0.0, 0
        for _ in range(MOST_DOUBLINGS):
            if distance >= most:
                return end
            ring = origin + away * distance * np.linspace(1.0, 2.0, SEARCH.places)
            with np.errstate(over="ignore", invalid="ignore"):
                rise = self._rise(ring - origin, origin) / self.theta
            if not np.any(rise < math.inf):
                return float(ring[0])
            lowest = min(lowest, float(np.nanmin(rise)))
            high = high + 1 if np.all(rise > lowest + CUT) else 0
            if high == SEARCH.doublings:
                return float(origin + away * distance)
            distance *= 2.0
            if distance > SEARCH.longest:
                break
        return math.inf

    @cached_property
    def _ends(self) -> tuple[float, float]:
        """Places (m) outside which the density is negligible, for a spring given as a function."""
        start = float(self._within(0.0))
        return self._outer(start, -1.0), self._outer(start, 1.0)

    def _near(self, origin: float, away: float, most: float) -> float:
        """A distance over which the energy hardly changes."""
        distance = SEARCH.shortest
        while distance < min(most * SEARCH.share_of_gap, SEARCH.longest):
            if (
                abs(float(self._rise(SEARCH.stride * away * distance, origin)))
                > SEARCH.share_of_theta * self.theta
            ):
                break
            distance *= SEARCH.stride
        return distance

    def _deepest_well(self) -> float:
        """Place of the lowest energy of a spring given as a function, between `_ends`, m."""
        start, ends = float(self._within(0.0)), self._ends
        # on a logarithmic grid about the start and on an even one: a well may be narrow
        steps = [
            np.geomspace(SEARCH.shortest, 1.0, 8 * SEARCH.places) * (end - start) for end in ends
        ]
        places = np.sort(np.concatenate([[start], start + steps[0], start + steps[1]]))
        near = np.linspace(ends[0], ends[1], 8 * SEARCH.places)
        places = np.unique(np.concatenate([places, near]))
        rise = self._rise(places - start, start)
        best = int(np.argmin(rise))
        around = float(places[max(best - 1, 0)]), float(places[min(best + 1, len(places) - 1)])
        found = scipy.optimize.minimize_scalar(
            lambda x: float(self._rise(x - start, start)), bounds=around, method="bounded",
            options={"xatol": 1e-10 * (around[1] - around[0])},
        )  # fmt: skip
        return float(found.x if found.fun < rise[best] else places[best])

    def _first(self, function: Callable[[float], float], origin: float, away: float) -> float:
        """Distance at which a function that starts below 0 reaches 0, up to a rigid stop, m."""
        most = abs(self._wall(away) - origin)
        near, far = 0.0, self._scale
        for _ in range(MOST_DOUBLINGS):
            if far >= most:
                far = most
                if most == 0.0 or function(far) < 0.0:
                    return most
                break
            if function(far) >= 0.0:
                break
            near, far = far, 2.0 * far
        return float(scipy.optimize.brentq(function, near, far, xtol=1e-14 * far, rtol=1e-14))

    # Quadrature ---------------------------------------------------------------------------

    def _edges(self, start: float, end: float) -> list[float]:
        """Places from `start` to `end` between which the potential is smooth."""
        places = {start, end}
        for stop, law in self._soft:
            places |= {float(stop.position + stop.side * knot) for knot in law.knots()}
        return sorted(place for place in places if start <= place <= end)

    def _nodes(self, edges: list[float]) -> tuple[Vector, Vector]:
        """Places and weights of quadrature panel by panel.

        Within a stop the deflection is the square of the variable, in which a Hertz force is a
        polynomial.
        """
        places, weights = [np.zeros(0)], [np.zeros(0)]
        for start, end in pairwise(edges):
            origin, sign = self._origin(start, end)
            if origin is None:
                half = (end - start) / 2.0
                places.append((start + end) / 2.0 + half * NODES)
                weights.append(half * WEIGHTS)
                continue
            a, b = (math.sqrt(abs(edge - origin)) for edge in (start, end))
            s, half = (a + b) / 2.0 + (b - a) / 2.0 * NODES, abs(b - a) / 2.0
            places.append(origin + sign * s**2)
            weights.append(2.0 * s * half * WEIGHTS)
        return np.concatenate(places), np.concatenate(weights)

    def _origin(self, start: float, end: float) -> tuple[float | None, float]:
        """Position of the stop within which a panel lies, None for no stop, and the side of it."""
        for stop, _ in reversed(self._soft):
            if stop.deflection(start) >= 0.0 and stop.deflection(end) >= 0.0:
                return stop.position, float(stop.side)
        return None, 1.0

    def _reach(self, origin: float, away: float) -> float:
        """How far from `origin`, where the potential rises, the density has fallen by e^-CUT."""
        if self.spring is not None:
            return abs(self._outer(origin, away) - origin)
        return self._first(
            lambda d: float(self._rise(away * d, origin)) - CUT * self.theta, origin, away
        )

    def _weighed(self, start: float, end: float, origin: float) -> tuple[Vector, Vector]:
        """Offsets from `origin` of nodes from `start` to `end`, and weights that hold the density
        in units of that at `origin`."""
        edges = sorted({*self._edges(start, end), min(max(origin, start), end)})
        if self.spring is None:
            return self._weights(edges, origin)
        for _ in range(MOST_HALVINGS):
            halved = sorted({*edges, *((one + two) / 2.0 for one, two in pairwise(edges))})
            whole = self._panels(edges, origin)
            parts = self._panels(halved, origin)
            moved = np.abs(parts[0::2] + parts[1::2] - whole) > SETTLED * float(parts.sum())
            if not np.any(moved):
                break
            middles = [(one + two) / 2.0 for one, two in pairwise(edges)]
            edges = sorted({*edges, *np.array(middles)[moved].tolist()})
        return self._weights(halved, origin)

    def _panels(self, edges: list[float], origin: float) -> Vector:
        """Integral of the density over each panel."""
        return np.asarray(self._weights(edges, origin)[1].reshape(-1, len(NODES)).sum(axis=1))

    def _weights(self, edges: list[float], origin: float) -> tuple[Vector, Vector]:
        places, weights = self._nodes(edges)
        offset = places - origin
        with np.errstate(under="ignore", over="ignore"):
            return offset, weights * np.exp(-self._rise(offset, origin) / self.theta)

    @cached_property
    def _quadrature(self) -> tuple[Vector, Vector]:
        """Offsets of the nodes from the peak, and weights that include the density."""
        left = self.peak - self._reach(self.peak, -1.0)
        right = self.peak + self._reach(self.peak, 1.0)
        return self._weighed(left, right, self.peak)

    @cached_property
    def _mass(self) -> float:
        return float(self._quadrature[1].sum())

    def expect(self, values: Vector) -> float:
        """Mean of `values`, given at the nodes."""
        return float(values @ self._quadrature[1]) / self._mass

    # Moments and densities -----------------------------------------------------------------

    @cached_property
    def mean(self) -> float:
        """Mean of x, m."""
        return self.peak + self.expect(self._quadrature[0]) + self._beyond(1)

    @cached_property
    def variance(self) -> float:
        """Variance of x, m^2."""
        offset = self._quadrature[0]
        return self.expect((offset - self.expect(offset)) ** 2) + self._beyond(2)

    def _beyond(self, power: int) -> float:
        """Part of E (x - peak)^power that lies beyond the ends of the quadrature. For a density p
        that falls as |x - peak|^-n there it is |x - peak|^(power + 1) p / (n - power - 1)."""
        found = 0.0
        for away, end, falls in self._open_ends() if self.spring else []:
            x = abs(end - self.peak)
            found += away**power * x ** (power + 1) * self.density_at(end) / (falls - power - 1.0)
        return found

    def _open_ends(self) -> list[tuple[float, float, float]]:
        """For each end without a rigid stop: its side, its place, and n of p ~ |x - peak|^-n."""
        return [
            (away, end, (end - self.peak) * float(self._pull(end)) / self.theta)
            for away in (-1.0, 1.0)
            if (end := self._outer(self.peak, away)) != self._wall(away)
        ]

    @property
    def heaviest(self) -> float:
        """Smallest n of the powers |x|^-n with which the density falls far out, for a spring given
        as a function; the variance is finite for n > 3."""
        return min((n for _, _, n in self._open_ends()), default=math.inf)

    @property
    def deviation(self) -> float:
        """Standard deviation of x, m."""
        return math.sqrt(self.variance)

    def log_density(self, x: ArrayLike) -> Vector:
        """Logarithm of the density at x (1/m); minus infinity beyond rigid stops."""
        x = np.asarray(x, dtype=float)
        inside = self._within(x)
        relative = -self._rise(inside - self.peak, self.peak) / self.theta
        return np.where(inside == x, relative - math.log(self._mass), -math.inf)

    def density(self, x: ArrayLike) -> Vector:
        """Probability density at x, 1/m; zero beyond rigid stops."""
        with np.errstate(under="ignore"):
            return np.asarray(np.exp(self.log_density(x)))

    def log_tail(self, x: ArrayLike) -> Vector:
        """log P(X > x), computed from the smaller of the two parts that x divides."""
        return np.asarray(np.vectorize(self._log_tail, otypes=[float])(x))

    def _log_tail(self, x: float) -> float:
        if x >= self.peak:
            return self._log_beyond(x, 1.0)
        below = self._log_beyond(x, -1.0)
        return math.log(-math.expm1(below)) if below < 0.0 else -math.inf

    def _log_beyond(self, x: float, away: float) -> float:
        """Logarithm of the probability of the part beyond x, on the side away from the peak."""
        if float(self._within(x)) != x:
            return -math.inf
        end = x + away * self._reach(x, away)
        share = float(self._weighed(min(x, end), max(x, end), x)[1].sum()) / self._mass
        if share == 0.0:
            return -math.inf
        # rounding must not make the whole more than 1
        return min(math.log(share) - float(self._rise(x - self.peak, self.peak)) / self.theta, 0.0)

    def density_at(self, x: float | None) -> float:
        """Density at one place; 0 for the place of a stop that does not exist."""
        return 0.0 if x is None else float(self.density(x))

    def contact(self, side: str) -> ContactStatistics | None:
        """Contact with the compliant stop on a side; None if that stop is rigid or missing."""
        stop = self._stops.get(side)
        if stop is None or not isinstance(stop.law, CompliantLaw):
            return None
        y = stop.deflection(self.peak + self._quadrature[0])
        return ContactStatistics(
            probability=self.expect(np.where(y > 0.0, 1.0, 0.0)),
            force=self.expect(stop.law.force_at(y)),
            peak_force=self._peak_force(stop, stop.law),
        )

    def _soft_stop(self, side: str) -> tuple[Stop, CompliantLaw]:
        for stop, law in self._soft:
            if stop.name == side:
                return stop, law
        raise ValueError(
            f"the {side} stop must be compliant, got a rigid one: its force has no law"
        )

    def peak_force_exceedance(self, side: str, force: ArrayLike) -> Vector:
        """P(largest force of a contact > force), force per unit mass, noise and damping neglected.

        The mass turns where U = U(stop) + w^2 / 2, with w its impact speed, which is Rayleigh
        distributed. So P = exp(-(U(y_f) - U(stop)) / theta), with y_f the deflection at that force.
        P = 1 for a force that the mass reaches even at zero impact speed.
        """
        stop, law = self._soft_stop(side)
        y = law.deflection_at(force)
        reached = np.isfinite(y)
        rise = self._rise(stop.side * np.where(reached, y, 0.0), stop.position) / self.theta
        with np.errstate(under="ignore"):
            return np.where(reached, np.exp(-np.maximum(rise, 0.0)), 0.0)

    def peak_force_density(self, side: str, force: ArrayLike) -> Vector:
        """Minus the derivative of `peak_force_exceedance`, U'(y) P / (theta dF/dy)."""
        stop, law = self._soft_stop(side)
        exceedance = self.peak_force_exceedance(side, force)
        y = law.deflection_at(force)
        y = np.where(exceedance > 0.0, y, 0.0)
        slope = np.where(y > 0.0, law.slope_at(y), math.inf)
        pull = stop.side * self._pull(stop.position + stop.side * y)
        density = pull * exceedance / slope / self.theta
        return np.where(exceedance < 1.0, density, 0.0)

    def _peak_force(self, bumper: Stop, law: CompliantLaw) -> float | None:
        """Mean of the largest force of a contact without noise and damping while it lasts.

        A mass that arrives at the speed w turns where U = U(stop) + w^2 / 2. With w Rayleigh
        distributed, the mean of F there is F(y_0) + int F'(y) exp(-(U - U(stop)) / theta) dy from
        y_0 on. y_0 is the deflection at which a mass with w = 0 turns: 0, unless the mass is
        pressed into the stop. None where a spring given as a function makes U fall again further
        in, so that a faster mass may turn elsewhere.
        """
        sign, stop = float(bumper.side), bumper.position
        start = stop
        if sign * float(self._pull(stop)) < 0.0:
            if sign * (self.peak - stop) < 0.0:
                return None
            bottom = sign * (self.peak - stop)
            start = stop + sign * (bottom + self._first(
                lambda d: float(self._rise(sign * (bottom + d), stop)), self.peak, sign
            ))  # fmt: skip
        end = start + sign * self._first(
            lambda d: float(self._rise(start + sign * d - stop, stop)) - CUT * self.theta,
            start,
            sign,
        )
        edges = self._edges(min(start, end), max(start, end))
        places, weights = self._nodes(edges)
        if np.any(sign * self._pull(places) < 0.0):
            return None
        shape = np.exp(-self._rise(places - stop, stop) / self.theta)
        y = sign * (places - stop)
        first = float(law.force_at(sign * (start - stop)))
        return first + float((law.slope_at(y) * shape) @ weights)


# ------------------------------------------------------------------------------
# Arrays of oscillators between rigid stops under white noise, for methods that solve many at once.
#
# Every oscillator obeys, per unit mass,
#
#     x'' + damping_rate x' + omega^2 x = white noise of the intensity S0 + load,
#
# and leaves a stop that it meets at the speed w with the speed R w.
# ------------------------------------------------------------------------------


class OscillatorArrays(NamedTuple):
    """Oscillators per unit mass as arrays of one length, SI units.

    Parameters
    ----------
    omega, damping_rate, intensity, load
        Natural frequency (rad/s), b (1/s), S0 (m^2/s^3) and constant load (m/s^2).
    positions
        Positions of the lower and the upper stops (2, oscillators), m from the unloaded spring;
        infinite for no stop.
    restitutions
        R of the lower and the upper stops (2, oscillators); it has no meaning where there is no
        stop.

    Examples
    --------
    >>> found = OscillatorArrays.broadcast(omega=[1.0, 2.0], damping_rate=0.1, intensity=0.2)
    >>> found.omega, found.upper
    (array([1., 2.]), array([inf, inf]))
    """

    omega: Vector
    damping_rate: Vector
    intensity: Vector
    load: Vector
    positions: Vector
    restitutions: Vector

    @property
    def lower(self) -> Vector:
        """Positions of the lower stops, m; -inf for no stop."""
        return np.asarray(self.positions[0])

    @property
    def upper(self) -> Vector:
        """Positions of the upper stops, m; inf for no stop."""
        return np.asarray(self.positions[1])

    @classmethod
    def broadcast(
        cls,
        *,
        omega: ArrayLike,
        damping_rate: ArrayLike,
        intensity: ArrayLike,
        load: ArrayLike = 0.0,
        lower: ArrayLike = -math.inf,
        upper: ArrayLike = math.inf,
        restitution_lower: ArrayLike = 1.0,
        restitution_upper: ArrayLike = 1.0,
    ) -> Self:
        """Columns of one shape from numbers and arrays that are broadcast against each other."""
        stops = (lower, upper, restitution_lower, restitution_upper)
        columns = (omega, damping_rate, intensity, load, *stops)
        full = np.broadcast_arrays(*(np.asarray(column, dtype=float) for column in columns))
        positions, restitutions = np.stack(full[4:6]), np.stack(full[6:])
        return cls._make([*full[:4], positions, restitutions])

    @classmethod
    def of(cls, model: Model) -> Self:
        """The one oscillator of a model with rigid stops, as arrays of the length 1."""
        positions, restitutions = np.array([[-math.inf], [math.inf]]), np.ones((2, 1))
        for stop in model.stops_per_unit_mass:
            row = int(stop.side == UPPER)
            positions[row] = stop.position
            if stop.coefficient is not None:
                restitutions[row] = stop.coefficient
            elif stop.scattered:  # the one that takes the same energy
                restitutions[row] = math.sqrt(stop.law.restitution_mean_square)
        return cls(
            omega=np.array([model.omega]),
            damping_rate=np.array([model.damping_rate]),
            intensity=np.array([model.intensity]),
            load=np.array([model.load]),
            positions=positions,
            restitutions=restitutions,
        )

    def flat(self) -> OscillatorArrays:
        """The same oscillators as arrays of one dimension."""
        axes = self.omega.ndim
        return OscillatorArrays._make(
            column.reshape(*column.shape[: column.ndim - axes], -1) for column in self
        )

    def take(self, places: Booleans | NDArray[np.intp] | slice) -> OscillatorArrays:
        """Some of the oscillators, by index, by mask or by slice."""
        return OscillatorArrays._make(column[..., places] for column in self)

    def scaled(self, origin: Vector, length: Vector, speed: Vector) -> OscillatorArrays:
        """The same oscillators, each with x measured from its origin, in units of its length (m)
        and speed (m/s)."""
        time = length / speed
        return OscillatorArrays(
            omega=self.omega * time,
            damping_rate=self.damping_rate * time,
            intensity=self.intensity * time / speed**2,
            load=(self.load - self.omega**2 * origin) * time / speed,
            positions=(self.positions - origin) / length,
            restitutions=self.restitutions,
        )

    @property
    def elastic(self) -> Booleans:
        """Whether no stop loses energy."""
        lossless = (self.restitutions == 1.0) | np.isinf(self.positions)
        return np.asarray(lossless.all(axis=0), dtype=np.bool_)

    @property
    def held(self) -> Booleans:
        """Whether spring, or stops and load, keep the oscillator from being lost on either side."""
        kept = np.isfinite(self.positions) | np.stack([self.load > 0.0, self.load < 0.0])
        return np.asarray((self.omega > 0.0) | kept.all(axis=0), dtype=np.bool_)

    def force(self, x: Vector) -> Vector:
        """Force of spring and load per unit mass at the displacements x, m/s^2."""
        return np.asarray(self.load - self.omega**2 * x)

    def lowest(self) -> Vector:
        """Displacement between the stops at which the potential energy is lowest, m.

        Without spring and load, where all places are alike, it is the one nearest to 0.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            rest = self.load / self.omega**2
        rest = np.where(np.isnan(rest), 0.0, rest)
        return np.asarray(np.clip(rest, *self.positions))

    def climb(self, energy: Vector) -> Vector:
        """Distance from the lowest place over which the potential energy rises by `energy`, m.

        Parameters
        ----------
        energy
            Energy per unit mass, m^2/s^2. The distance is infinite where no spring and no load
            raises the potential.
        """
        slope = np.abs(self.force(self.lowest()))
        with np.errstate(divide="ignore", invalid="ignore"):
            # at a position of rest between the stops the slope is 0, but for rounding
            inside = self.load / self.omega**2 == self.lowest()
            slope = np.where(inside, 0.0, slope)
            distance = 2.0 * energy / (slope + np.sqrt(slope**2 + 2.0 * self.omega**2 * energy))
        return np.asarray(distance)

    def speed_scale(self, enough: float = 1e-10) -> Vector:
        """The speed s at which the law exp(-energy / s^2) takes up the power of the noise, m/s.

        b s^2 + sum over stops of (1 - R^2) p s^3 / sqrt(2 pi) = S0 / 2, with p the density at the
        stop: the balance of energy, with F2 of Rayleigh's distribution. Exact between elastic
        stops. The logarithm of the power is balanced up to `enough`.
        """

        def surplus(log_speed: Vector, some: Any) -> Vector:
            o, speed = self.take(some), np.exp(log_speed[0])
            with np.errstate(all="ignore"):
                law = cut_laws(o.load / speed**2, (o.omega / speed) ** 2, o.lower, o.upper)
                density = np.sum((1.0 - o.restitutions**2) * [law.lower, law.upper], axis=0)
                taken = (o.damping_rate + density * speed / math.sqrt(2.0 * math.pi)) * speed**2
                return np.asarray(np.log(taken / (o.intensity / 2.0)))[None]

        with np.errstate(all="ignore"):
            rough = self._rough_log_speed()
        return np.asarray(np.exp(newton(surplus, rough[None], enough)[0][0]))

    def _rough_log_speed(self) -> Vector:
        """Logarithm of a speed above that scale: what the damper alone leaves, or without one the
        largest speed scale of springs, stops and noise."""
        gap = self.upper - self.lower
        rest = self.load / self.omega**2
        away = np.fmin(np.abs(self.upper - rest), np.abs(rest - self.lower))
        scales = np.array(
            [
                np.sqrt(self.intensity / (2.0 * self.omega)),
                np.where(np.isfinite(away), self.omega * away, 0.0),
                np.where(np.isfinite(gap), np.cbrt(gap * self.intensity), 0.0),
            ]
        )
        undamped = np.where(np.isfinite(scales), scales, 0.0).max(axis=0)
        # a load alone presses the mass on its stop, where it loses some load * s
        undamped = np.where(undamped > 0.0, undamped, self.intensity / np.abs(self.load))
        damped = np.sqrt(self.intensity / (2.0 * self.damping_rate))
        return np.asarray(np.log(np.where(self.damping_rate > 0.0, damped, undamped)))

    def check(self) -> None:
        """Refuse numbers that are out of range.

        Raises
        ------
        ValueError
            The message names the first column that holds such a number.
        """
        (lower, upper), (r_lower, r_upper) = self.positions, self.restitutions
        columns = {
            "omega": self.omega, "damping_rate": self.damping_rate, "intensity": self.intensity,
            "load": self.load, "lower": lower, "upper": upper,
            "restitution_lower": r_lower, "restitution_upper": r_upper,
        }  # fmt: skip
        for name, column in columns.items():
            if np.isnan(column).any():
                raise ValueError(f"{name} must be numbers, got nan")
            if name not in ("lower", "upper") and np.isinf(column).any():
                raise ValueError(f"{name} must be finite, got inf")
            if name in ("omega", "damping_rate", "intensity") and (column < 0.0).any():
                raise ValueError(f"{name} must be at least 0, got {column.min():g}")
            outside = (column < 0.0) | (column > 1.0)
            if name.startswith("restitution") and outside.any():
                raise ValueError(f"{name} must be in [0, 1], got {column[outside][0]:g}")
        crossed = np.flatnonzero(~(lower < upper))
        if crossed.size:
            index = crossed[0]
            raise ValueError(
                f"lower must be below upper, got {lower.flat[index]:g} and {upper.flat[index]:g} "
                f"at index {index}"
            )

    def unmet(self) -> list[str]:
        """The conditions of a stationary state that not all of the oscillators meet."""
        unmet = []
        if (self.intensity == 0.0).any():
            unmet.append("intensity must be positive in every scene, got 0")
        if (self.elastic & (self.damping_rate == 0.0)).any():
            unmet.append("damping_rate must be positive where no stop takes energy, got 0")
        if not self.held.all():
            unmet.append("omega must be positive where stops do not hold the mass, got 0")
        return unmet
