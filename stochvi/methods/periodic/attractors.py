"""The motions in which flights end: stable periodic regimes with their surroundings, and other
motions."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov
from scipy.spatial import cKDTree

from stochvi.mathematics.arrays import Matrix, Vector, Whole
from stochvi.methods.periodic.branches import Finder
from stochvi.methods.periodic.kernels import flights, solver
from stochvi.methods.periodic.simulations import SETTLING, simulate
from stochvi.methods.periodic.tracks import ROUNDING, Track

PERIODIC, REGULAR, CHAOTIC = "periodic", "other regular", "chaotic"
"""Kinds of motion: a stable regime of the exact solver; another motion whose perturbations do not
grow, as one that rests on a stop for a while, has many impacts, or has two frequencies; and a
motion whose perturbations grow."""

UNDECIDED = -1
"""Number of no motion, for a flight whose end has not been recognised."""

ATTRACTING = 1.0 - 1e-7
"""Largest multiplier of a regime in which motions end: without damping and loss it is 1, but for
rounding and the steps of Newton's iteration."""

SAMPLES = 256
"""Number of states by which a neighbourhood of a regime is tried: half of them on its edge."""

LARGEST, HALVINGS = 16.0, 60
"""Limit of the first neighbourhood that is tried, in multiples of the largest eigenvalue of its
form; states are of order 1. The limit is halved at most so often, until motions from the
neighbourhood approach the regime."""

CAPTURE_PERIODS = 4096
"""Number of periods in which a flight may reach a known regime before its own motion is
classified."""

WATCHED = 4096
"""Number of periods over which the motion of a flight is looked at."""

BATCHES = 32
"""Number of parts of a flight whose means give the standard error of an exponent."""

SIGNIFICANT = 4.0
"""Number of standard errors above 0 from which on an exponent means chaos; scatter alone gives this
with a probability of 3e-5."""

REPEATED = 1e-6
"""Difference of states, relative to the largest, at which a motion repeats itself."""

BESIDE, DISTURBED = 16, 1e-6
"""Number of flights that start beside a motion that repeats itself, and their distance from it
relative to its size: they show whether it attracts."""

NEAR = 3.0
"""A state lies among those of a long flight up to this distance from them. The unit is the largest
distance from a state of one half of the flight to the other half."""

LAST = 8
"""Number of last periods in which a flight must lie among the states of another one to have ended
in the same motion."""

FRUITLESS = 8
"""Number of successive flights without a new motion after which no more are tried."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Attractor:
    """A motion in which flights end, in the units of the kernels.

    Parameters
    ----------
    kind
        "periodic", "other regular" or "chaotic".
    track
        The regime of a periodic motion, a branch of one point; None for others.
    points
        States of the motion (number, 2 n) at the phase at which flights are looked at: one for each
        of its periods, or those of a long flight.
    forms, limits
        For a periodic motion, quadratic forms around the points, and their values up to which
        flights end in it.
    growth
        Logarithm by which small perturbations grow in each period of a long flight.
    impacts
        Phases, stops and speeds of the impacts of a long flight.
    """

    kind: str
    points: Matrix
    track: Track | None = None
    forms: Matrix | None = None
    limits: Vector | None = None
    growth: Vector | None = None
    impacts: Matrix | None = None
    cycle: int = 0

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)

    @cached_property
    def _near(self) -> float:
        """Distance up to which a state lies among the points."""
        if self.cycle:
            return 1e-3 * float(np.abs(self.points).max())
        between = cKDTree(self.points[::2]).query(self.points[1::2])[0]
        return NEAR * float(np.max(between))

    def holds(self, states: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether flights (number, periods, 2 n) lie among the points all the time."""
        number, periods, size = states.shape
        apart = np.asarray(self._tree.query(states.reshape(-1, size))[0])
        return np.asarray(np.all(apart.reshape(number, periods) < self._near, axis=1))


def exponent(growth: Vector, before: int) -> tuple[float, float]:
    """Mean growth per period of a perturbation that has been turned for some periods `before`, and
    its standard error; -inf where perturbations vanish.

    The error joins three parts: that of the means of parts; the swing of the size of a perturbation
    that turns; and the effect of growth in proportion to the time. The last is the logarithm of the
    share by which the time has grown; it belongs to a motion of two frequencies, whose exponent is
    0.
    """
    if not np.all(np.isfinite(growth)):
        return -math.inf, 0.0
    periods, mean = len(growth), float(growth.mean())
    means = np.array([part.mean() for part in np.array_split(growth, BATCHES)])
    swing = math.sqrt(2.0) * np.cumsum(growth - mean).std() / periods
    drift = math.log1p(periods / max(before, 1)) / periods
    return mean, math.hypot(means.std(ddof=1) / math.sqrt(BATCHES), swing, drift)


def unit_perturbation(size: int) -> Matrix:
    """A small change of a state in no direction of its own."""
    random = np.random.default_rng(1).normal(size=(size, 1))
    return np.asarray(random / np.linalg.norm(random))


@dataclass(frozen=True, eq=False)
class TrackedPath:
    """A flight that was watched: states after each period, impacts and growth of perturbations."""

    ends: Matrix
    impacts: Matrix
    growth: Vector

    def cycle(self) -> int:
        """Number of periods after which it repeats itself, at most half of those that were
        watched; 0 where it does not."""
        size = float(np.abs(self.ends).max()) or 1.0
        last = self.ends[-1]
        for periods in range(1, len(self.ends) // 2 + 1):
            if np.all(np.abs(self.ends[-1 - periods] - last) < REPEATED * size):
                return periods
        return 0


def watch(
    course: flights.Course, state: Vector, skipped: int, periods: int, most: int
) -> TrackedPath | None:
    """Simulate on from a state, which is replaced by the last one, and watch the last periods; at
    most so many impacts are kept. None where impacts come too fast to be followed."""
    log, ends = np.zeros((most, 3)), np.empty((periods, len(state)))
    growth = np.empty(periods)
    hits = flights.watch_flight(
        course, state, skipped, flights.Watched(log, ends, growth), unit_perturbation(len(state))
    )
    if hits < 0:
        return None
    kept = log[: min(hits, most)]
    return TrackedPath(ends, kept[np.argsort(kept[:, 0], kind="stable")], growth)


@dataclass(frozen=True, eq=False)
class KnownMotions:
    """The motions in which flights at one place of a family end, as far as they are known: what
    workers need to recognise the ends of flights.

    Flights are looked at once a period, at a `phase` of the force.
    """

    motion: solver.Motion
    phase: float
    found: tuple[Attractor, ...]

    @cached_property
    def course(self) -> flights.Course:
        """The course of one period."""
        course: flights.Course = flights.course_of(self.motion, self.phase, 2.0 * math.pi)
        return course

    @cached_property
    def targets(self) -> flights.Targets:
        """The points of the periodic motions in turn."""
        size = 2 * self.motion.rows.shape[1]
        known = [each for each in self.found if each.kind == PERIODIC]
        return flights.Targets(
            np.concatenate([np.empty((0, size)), *(each.points for each in known)]),
            np.concatenate([np.empty((0, size, size)), *(each.forms for each in known)]),
            np.concatenate([np.empty(0), *(each.limits for each in known)]),
        )

    @cached_property
    def owners(self) -> Whole:
        """The number of the motion to which each target belongs, and last UNDECIDED, of
        NO_ATTRACTOR."""
        known = [number for number, each in enumerate(self.found) if each.kind == PERIODIC
                 for _ in each.points]  # fmt: skip
        return np.array([*known, UNDECIDED], np.int64)

    def settle(self, states: Matrix, angle: float, periods: int) -> Whole:
        """Simulate states, in their place, over an angle up to the phase and some periods, or to a
        periodic motion. Returns the number of each motion, or UNDECIDED."""
        found = np.empty(len(states), np.int64)
        lead = flights.course_of(self.motion, self.phase - angle, angle)
        flights.settle_flights(lead, self.course, states, periods, self.targets, found)
        return np.asarray(self.owners[np.where(found == flights.LOST, flights.NO_ATTRACTOR, found)])

    def lie_in(self, number: int, states: Matrix) -> NDArray[np.bool_]:
        """Whether flights from states come to lie among those of a motion that is not periodic."""
        states, path = states.copy(), np.empty((len(states), LAST, states.shape[1]))
        none = flights.Targets(*(each[:0] for each in self.targets))
        lead = flights.course_of(self.motion, self.phase, 0.0)
        lost = np.empty(len(states), np.int64)
        for period in range(LAST):
            path[:, period] = states
            flights.settle_flights(lead, self.course, states, 1, none, lost)
        return np.asarray(self.found[number].holds(path) & (lost != flights.LOST))

    def ends_of(self, states: Matrix, periods: int) -> Whole:
        """Number of the motion in which each of some states ends, or UNDECIDED; the states are
        replaced by later ones."""
        ends = self.settle(states, 0.0, periods)
        for number, each in enumerate(self.found):
            left = np.flatnonzero(ends == UNDECIDED)
            if each.kind != PERIODIC and len(left):
                ends[left[self.lie_in(number, states[left])]] = number
        return ends


class Attractors:
    """The motions in which flights at one place of a family end, as they become known.

    Flights are looked at once a period, at a phase of the force that lies far from the impacts of
    all regimes.
    """

    def __init__(self, finder: Finder, sigma: float) -> None:
        self.finder, self.sigma = finder, sigma
        self.motion = finder.motion(sigma)
        chosen = [
            (track, int(number))
            for track in finder.tracks
            for number in np.flatnonzero(np.abs(track.sigma - sigma) < ROUNDING)
            if track.admissible[number] and not track.names[number]
        ]
        struck = [track.points[number, :-1] for track, number in chosen if track.stops]
        self.phase = _farthest(np.concatenate(struck) if struck else np.zeros(1))
        self.course = flights.course_of(self.motion, self.phase, 2.0 * math.pi)
        self.found: list[Attractor] = []
        for track, number in chosen:
            self._add(track.part(slice(number, number + 1)))

    def _add(self, track: Track) -> None:
        """Add a regime to the known motions, if it attracts."""
        if not track.multiplier[0] < ATTRACTING:
            return
        points = self._points(track)
        if any(_same(points, known.points) for known in self.found if known.kind == PERIODIC):
            return
        forms, limits = [], []
        for point in points:
            form, limit = self._surroundings(track, point)
            forms.append(form)
            limits.append(limit)
        self.found.append(
            Attractor(
                kind=PERIODIC, track=track, points=points, forms=np.array(forms),
                limits=np.array(limits),
            )
        )  # fmt: skip

    def _points(self, track: Track) -> Matrix:
        """The states of a regime at the phase at which flights are looked at."""
        y, touch = track.starts[0].copy(), solver.free_touch()
        phase = 0.0
        if track.stops:
            phase = float(track.points[0, 0])
            touch.fastest[0] = solver.strike(self.motion, track.stops[0], y)
            touch.on[1] = track.stops[0]
        none, log = np.empty((len(y), 0)), np.empty((0, 3))
        angle = (self.phase - phase) % (2.0 * math.pi)
        if angle > 0.0:
            flights.fly(flights.course_of(self.motion, phase, angle), y, touch, none, log, 0)
        points = [y.copy()]
        for _ in range(track.periods - 1):
            flights.fly(self.course, y, touch, none, log, 0)
            points.append(y.copy())
        return np.array(points)

    def _surroundings(self, track: Track, point: Vector) -> tuple[Matrix, float]:
        """A quadratic form around a state of a regime, and its value up to which flights approach.

        Without impacts the energy of the difference falls as long as no stop is met: it cannot be
        met where it is too small. Elsewhere the form falls over the periods of the regime for small
        differences. The limit is lowered until it falls for many states within it.
        """
        if not track.stops and (known := self._by_energy(float(track.margin[0]))) is not None:
            return known
        eye = np.eye(len(point))
        factors, y = eye.copy(), point.copy()
        touch = solver.free_touch()
        for _ in range(track.periods):
            flights.fly(self.course, y, touch, factors, np.empty((0, 3)), 0)
        share = math.sqrt(max(float(np.abs(np.linalg.eigvals(factors)).max()), 1e-6))
        form = np.asarray(solve_discrete_lyapunov(factors.T / share, eye), float)
        form = np.asarray(0.5 * (form + form.T), float)
        root = np.linalg.inv(np.linalg.cholesky(form)).T
        random = np.random.default_rng(2)
        ways = random.normal(size=(SAMPLES, len(point)))
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        ways[::2] *= random.random((SAMPLES // 2, 1))
        ways = ways @ root.T
        limit = LARGEST * float(np.linalg.eigvalsh(form)[-1])
        for _ in range(HALVINGS):
            starts = np.asarray(point + math.sqrt(limit) * ways, float)
            starts = starts[self.possible(starts)]
            if len(starts) and self._approach(starts, point, form, track.periods):
                return form, limit
            limit *= 0.5
        return form, 0.0

    def _approach(self, starts: Matrix, point: Vector, form: Matrix, periods: int) -> bool:
        before = np.einsum("ki,ij,kj->k", starts - point, form, starts - point)
        lost = self._flown(starts, periods)
        after = np.einsum("ki,ij,kj->k", starts - point, form, starts - point)
        return not lost and bool(np.all(after < before))

    def _flown(self, states: Matrix, periods: int) -> bool:
        """Simulate states over some periods, which replaces them; return whether one could not be
        followed."""
        n = states.shape[1]
        none = flights.Targets(np.empty((0, n)), np.empty((0, n, n)), np.empty(0))
        found = np.empty(len(states), np.int64)
        lead = flights.course_of(self.motion, self.phase, 0.0)
        flights.settle_flights(lead, self.course, states, periods, none, found)
        return bool(np.any(found == flights.LOST))

    def _by_energy(self, margin: float) -> tuple[Matrix, float] | None:
        """The energy of a difference and its value below which no stop within a margin is met; None
        where damping may add energy, or a mass is free."""
        generator, rows = self.motion.generator, self.motion.rows
        n = rows.shape[1]
        stiffness, damping = -generator[n : 2 * n, :n], -generator[n : 2 * n, n : 2 * n]
        even = np.allclose(stiffness, stiffness.T, rtol=0.0, atol=1e-12 * np.abs(stiffness).max())
        if not even or np.linalg.eigvalsh(damping + damping.T)[0] < 0.0:
            return None
        if np.linalg.eigvalsh(stiffness)[0] <= 1e-9:
            return None
        form = np.zeros((2 * n, 2 * n))
        form[:n, :n], form[n:, n:] = stiffness, np.eye(n)
        reach = np.einsum("si,ij,sj->s", rows, np.linalg.inv(stiffness), rows)
        if not len(rows):
            return form, math.inf
        return form, max(margin, 0.0) ** 2 / float(reach.max())

    def possible(self, states: Matrix) -> NDArray[np.bool_]:
        """Whether states lie beyond no stop."""
        n = self.motion.rows.shape[1]
        distances = states[:, :n] @ self.motion.rows.T - self.motion.positions
        return np.asarray(np.all(distances <= 1e-12, axis=1))

    def known(self) -> KnownMotions:
        """The motions that are known now, without what only describes them."""
        found = (replace(each, track=None, growth=None, impacts=None) for each in self.found)
        return KnownMotions(self.motion, self.phase, tuple(found))

    def reveal(self, state: Vector) -> int | None:
        """The number of the motion in which a flight from a state ends, which is added if it is
        new; None where that is not clear."""
        before, states, found = self.known(), state[None].copy(), np.empty(1, np.int64)
        lead = flights.course_of(self.motion, self.phase, 0.0)
        flights.settle_flights(lead, self.course, states, CAPTURE_PERIODS, before.targets, found)
        if found[0] == flights.LOST:
            return None
        if found[0] != flights.NO_ATTRACTOR:
            return int(before.owners[found[0]])
        settled = simulate(self.motion, states[0], SETTLING, self.phase)
        regime = None if settled is None else self.finder.regime_of(settled, self.sigma)
        if regime is not None:
            points_ = np.append(regime.theta, solver.WEIGHT * regime.sigma)[None]
            track = self.finder.inspected(regime.stops, regime.periods, points_, [""])
            known = len(self.found)
            self._add(track)
            if len(self.found) > known:
                return known
        return self._watched(states[0])

    def _watched(self, state: Vector) -> int | None:
        flight = watch(self.course, state, WATCHED, WATCHED, 16 * WATCHED)
        if flight is None:
            return None
        cycle = flight.cycle()
        last = flight.ends[-LAST:][None]
        for number, each in enumerate(self.found):
            if each.kind != PERIODIC and each.holds(last)[0]:
                return number
        mean, error = exponent(flight.growth, WATCHED)
        if mean > SIGNIFICANT * error:
            kind = CHAOTIC
        elif cycle or abs(mean) <= SIGNIFICANT * error:
            kind = REGULAR
        else:
            return None
        motion = Attractor(
            kind=kind, points=flight.ends[-cycle:] if cycle else flight.ends,
            growth=flight.growth, impacts=flight.impacts, cycle=cycle,
        )  # fmt: skip
        if cycle and not self._attracts(motion):
            return None
        self.found.append(motion)
        return len(self.found) - 1

    def _attracts(self, motion: Attractor) -> bool:
        """Whether flights that start close to a motion that repeats itself come back to it.

        A motion that rests on a stop forgets every perturbation, and repeats itself digit by digit.
        It does so even where, between two rests, perturbations grow so much that its digits are
        rounding.
        """
        points = motion.points
        chosen = points[np.linspace(0, len(points) - 1, min(len(points), BESIDE)).astype(int)]
        ways = np.random.default_rng(3).normal(size=chosen.shape)
        moved = DISTURBED * float(np.abs(points).max()) * ways
        states = np.where(self.possible(chosen + moved)[:, None], chosen + moved, chosen - moved)
        states = np.ascontiguousarray(states[self.possible(states)])
        if self._flown(states, max(2 * motion.cycle, SETTLING)):
            return False
        path = np.empty((len(states), LAST, states.shape[1]))
        for period in range(LAST):
            path[:, period] = states
            if self._flown(states, 1):
                return False
        return bool(np.all(motion.holds(path)))


def _farthest(phases: Vector) -> float:
    """The phase, in [0, 2 pi), that lies farthest from some phases."""
    known = np.sort(np.mod(phases, 2.0 * math.pi))
    gaps = np.diff(np.append(known, known[0] + 2.0 * math.pi))
    widest = int(np.argmax(gaps))
    return float((known[widest] + 0.5 * gaps[widest]) % (2.0 * math.pi))


def _same(one: Matrix, other: Matrix) -> bool:
    """Whether two regimes pass through the same states."""
    if len(one) != len(other):
        return False
    size = float(np.abs(one).max()) or 1.0
    return any(np.all(np.abs(each - one[0]) < 1e-6 * size) for each in other)
