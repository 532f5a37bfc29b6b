"""Motions in which paths under a sine end. Chapters: attractors and their surroundings; basins of
coexisting motions; bifurcation diagrams."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, replace
from functools import cached_property
from typing import Any, Unpack

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.numerics import Matrix, Vector, Whole
from stochvi.methods.periodic.branches import Finder
from stochvi.methods.periodic.contact_branches import FOLLOWED_AT_ONCE, ContactFinder
from stochvi.methods.periodic.continuation import ROUNDING, SETTLING, Track, simulate
from stochvi.methods.periodic.family import States, unmet
from stochvi.methods.periodic.kernels import flights, solver
from stochvi.methods.periodic.sine_response import (
    MARGIN,
    SWEEPS,
    noise_left_out,
    searching,
    varied,
)
from stochvi.model.model import Model, model_of
from stochvi.results.base import DataFrame, Result, frame_by, frame_of, stacked, stated
from stochvi.results.deadline import NEVER, Deadline, graceful_interrupt
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Cost, Estimate, provenance
from stochvi.sampling.calculations import TrialSampler, WorkOptions, calculation
from stochvi.sampling.checkpoints import digest_of
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene

# ------------------------------------------------------------------------------
# The motions in which flights end: stable periodic regimes with their surroundings, and other
# motions.
# ------------------------------------------------------------------------------


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
    def _tree(self) -> scipy.spatial.cKDTree:
        return scipy.spatial.cKDTree(self.points)

    @cached_property
    def _near(self) -> float:
        """Distance up to which a state lies among the points."""
        if self.cycle:
            return 1e-3 * float(np.abs(self.points).max())
        between = scipy.spatial.cKDTree(self.points[::2]).query(self.points[1::2])[0]
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

    def flown(self, states: Matrix, periods: int, angle: float = 0.0) -> Whole:
        """Simulate states, in their place, over an angle up to the phase and some periods, or to a
        periodic motion. Returns the number of each target, or NO_ATTRACTOR or LOST."""
        found = np.empty(len(states), np.int64)
        lead = flights.course_of(self.motion, self.phase - angle, angle)
        flights.settle_flights(lead, self.course, states, periods, self.targets, found)
        return found

    def settle(self, states: Matrix, angle: float, periods: int) -> Whole:
        """As `flown`, with the number of each motion, or UNDECIDED."""
        found = self.flown(states, periods, angle)
        return np.asarray(self.owners[np.where(found == flights.LOST, flights.NO_ATTRACTOR, found)])

    def path(self, states: Matrix) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Simulate states, in their place, over the last periods: their states before each
        (number, LAST, 2 n), and which could be followed."""
        path, free = np.empty((len(states), LAST, states.shape[1])), replace(self, found=())
        known = np.ones(len(states), bool)
        for period in range(LAST):
            path[:, period] = states
            known &= free.flown(states, 1) != flights.LOST
        return path, known

    def lie_in(self, number: int, states: Matrix) -> NDArray[np.bool_]:
        """Whether flights from states come to lie among those of a motion that is not periodic."""
        path, known = self.path(states.copy())
        return np.asarray(self.found[number].holds(path) & known)

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
        self.free = KnownMotions(self.motion, self.phase, ())
        self.course = self.free.course
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
        none, angle = np.empty((len(y), 0)), (self.phase - phase) % (2.0 * math.pi)
        flights.carry(flights.course_of(self.motion, phase, angle), y, touch, none)
        points = [y.copy()]
        for _ in range(track.periods - 1):
            flights.carry(self.course, y, touch, none)
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
            flights.carry(self.course, y, touch, factors)
        share = math.sqrt(max(float(np.abs(np.linalg.eigvals(factors)).max()), 1e-6))
        form = np.asarray(scipy.linalg.solve_discrete_lyapunov(factors.T / share, eye), float)
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
        lost = self.free.flown(starts, periods) == flights.LOST
        after = np.einsum("ki,ij,kj->k", starts - point, form, starts - point)
        return not np.any(lost) and bool(np.all(after < before))

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
        before, states = self.known(), state[None].copy()
        (found,) = before.flown(states, CAPTURE_PERIODS)
        if found == flights.LOST:
            return None
        if found != flights.NO_ATTRACTOR:
            return int(before.owners[found])
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
        if np.any(self.free.flown(states, max(2 * motion.cycle, SETTLING)) == flights.LOST):
            return False
        path, known = self.free.path(states)
        return bool(np.all(motion.holds(path) & known))


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


# ------------------------------------------------------------------------------
# Basins: which of the motions that coexist under a sine a structure ends in, from many starts.
# ------------------------------------------------------------------------------


BEYOND = -2
"""Number in a map of basins of a start that lies beyond a stop."""

BLOCK = 256
"""Number of starts that are simulated together over FIRST periods, or fewer, between looks at the
clock: a tenth of a second or so. For more periods a block has fewer starts."""

ACROSS = 1.25
"""Half the width of a map that is not given, in multiples of the largest motion of a regime."""

NUMBER = 200
"""Number of values on each side of a map that is not given."""

FIRST = 50
"""Number of periods for which all starts are simulated before those that have reached no regime are
looked at."""

MOST_STARTS = 4_000_000
"""Largest number of starts of a map: 0.2 GB of states."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BasinRegime:
    """A motion in which starts end.

    Parameters
    ----------
    name
        Name made of the impacts by pair and stop, with their number where it is above 1, and of the
        periods where there are several.
    kind
        "periodic", a stable regime as of `harmonic_response`; "other regular", a motion that
        repeats itself after many impacts or with rests on a stop, or one of two frequencies;
        "chaotic".
    periods, impacts
        Number of periods after which the motion repeats itself (0: never), and of impacts in these
        periods.
    multiplier
        Largest modulus of the factors by which perturbations change over its periods; None where it
        is not known exactly.
    lyapunov
        Rate at which small perturbations grow, 1/s: exact for a periodic regime, else of one long
        motion; None where they vanish at once, by resting on a stop.
    impact_speed_max
        Largest impact speed, m/s; 0 without impacts.
    displacement, velocity
        A state of the motion (coordinates,) at the phase of the starts, m and m/s.
    share
        Share of the starts between the stops that end in this motion.

    See Also
    --------
    stochvi.methods.periodic.basins : The answer that holds it.
    """

    name: str = stated("motion", "", MISSING)
    kind: str = stated("kind", "", MISSING)
    periods: int
    impacts: int
    multiplier: float | None = stated("largest multiplier", "", MISSING)
    lyapunov: Estimate | None = stated("Lyapunov exponent", "1/s", MISSING)
    impact_speed_max: float = stated("impact speed", "m/s", MISSING)
    displacement: Vector
    velocity: Vector
    share: float = stated("share of starts", "", MISSING)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Basins(Result):
    """The ends of motions from a plane of starts.

    Parameters
    ----------
    plane
        Names of the two numbers that are varied, as "displacement.x" and "velocity.x".
    across, up
        Values of these two numbers, m or m/s.
    phase_deg
        Phase of the force at which motions start, degrees.
    frequency_hz
        Frequency of the force.
    regimes
        The motions that are reached, the most frequent first.
    ends
        Number of the regime of each start (up, across); -1 where it is undecided, -2 beyond a stop.
    periods
        Largest number of periods for which a start was simulated.
    undecided
        Share of the starts between the stops whose end was not recognised.
    assumptions
        Assumptions, a sentence each.

    See Also
    --------
    stochvi.methods.periodic.basins : The calculation.
    """

    kind = "basins"

    plane: tuple[str, str]
    across: Vector
    up: Vector
    phase_deg: float
    frequency_hz: float
    regimes: tuple[BasinRegime, ...]
    ends: Whole
    periods: int
    undecided: float
    assumptions: Sequence[str] = ()

    def at(self, across: float, up: float) -> BasinRegime | None:
        """The regime of the start that is nearest to a point of the plane; None without one."""
        column = int(np.argmin(np.abs(self.across - across)))
        row = int(np.argmin(np.abs(self.up - up)))
        number = int(self.ends[row, column])
        return None if number < 0 else self.regimes[number]

    def to_frame(self) -> DataFrame:
        """One row for each start: its two numbers, and the motion in which it ends."""
        up, across = np.meshgrid(self.up, self.across, indexing="ij")
        names = [*(regime.name for regime in self.regimes), "beyond a stop", "undecided"]
        return frame_of(
            {
                self.plane[0]: across.ravel(),
                self.plane[1]: up.ravel(),
                "regime": self.ends.ravel(),
                "name": [names[number] for number in self.ends.ravel()],
            }
        )

    def table(self) -> DataFrame:
        """One row for each regime."""
        rates = [regime.lyapunov for regime in self.regimes]
        return (
            frame_by(self.regimes, "name kind share impact_speed_max multiplier")
            .assign(
                lyapunov=[-math.inf if rate is None else rate.value for rate in rates],
                lyapunov_error=[0.0 if rate is None else rate.standard_error for rate in rates],
            )
            .rename(columns={"name": "regime"})
        )

    def _shown(self) -> DataFrame:
        return self.table()

    def summary(self) -> str:
        """The motions that coexist, and the share of the starts of each."""
        found = ", ".join(f"{100.0 * each.share:.3g} % {each.name}" for each in self.regimes)
        rest = (
            f"; {100.0 * self.undecided:.3g} % undecided after {self.periods} periods"
            if self.undecided
            else ""
        )
        number = int(np.sum(self.ends != BEYOND))
        return f"of {number} starts end in: {found or 'no motion that was recognised'}{rest}"


@calculation
@sampled
def basins(
    scene: Scene,
    plane: Mapping[str, Sequence[float]] | None = None,
    *,
    phase_deg: float = 0.0,
    periods: int = 300,
    most_impacts: int = 3,
    **options: Unpack[WorkOptions],
) -> Basins:
    """Basins of the motions that coexist under a sine, over a plane of starts.

    Every initial state is followed from impact to impact, with the exact linear motion between
    them. It is followed until it reaches the surroundings of a stable regime of
    `harmonic_response`. Starts that reach none reveal further motions: one of them is followed over
    thousands of periods, and the others are compared with it.

    Parameters
    ----------
    scene
        As for `harmonic_response`, with rigid stops, and springs and dampers that are linear.
    plane
        Two numbers of a start with their values: "displacement.NAME" (m) or "velocity.NAME" (m/s)
        of a coordinate; all others are those at rest under the constant loads. By default the
        displacement and velocity of the first coordinate.
    phase_deg
        Phase of the force at the start, degrees of the lowest common multiple of the sines.
    periods
        Number of periods for which each start is simulated.
    most_impacts
        As for `harmonic_response`.
    **options
        `WorkOptions`: executor, budget, checkpoint and others.

    Returns
    -------
    Basins
        The regime of each start.

    Raises
    ------
    NotApplicable
        If the scene is not of that kind.
    NotConverged
        If the budget ends first; the starts that were not followed are undecided.

    See Also
    --------
    stochvi.harmonic_response : The regimes, stable or not, exactly.
    bifurcation : What a slow sweep goes through.

    Examples
    --------
    A mount that may clatter or stay clear of its stops:

    >>> import stochvi
    >>> from stochvi.scenes.datasets import shipped_scene
    >>> mount = stochvi.load_scene(shipped_scene("isolator-sine"))
    >>> starts = {"displacement.x": [-0.0004, 0.0], "velocity.x": [-0.3, 0.0]}
    >>> [each.name for each in basins(mount, starts).regimes]
    ['no impacts', 'stops lower, stops upper']
    """
    if periods < 1:
        raise ValueError(f"periods must be at least 1, got {periods}")
    run = Run.of(options)
    place = Place(scene, most_impacts, run.deadline)
    place.finder.find()
    known = Attractors(place.finder, place.sigma)
    names, sides = place.plane(plane, known)
    up, across = np.meshgrid(sides[1], sides[0], indexing="ij")
    starts = place.states.starts({names[0]: across.ravel(), names[1]: up.ravel()})
    phase = math.radians(phase_deg)
    run.begin()
    ends = BasinRun(run, known, starts, phase, periods).ends()
    order, shares = _shares(ends, len(known.found))
    renumbered = np.full(len(known.found) + 2, UNDECIDED)
    renumbered[order] = np.arange(len(order))
    renumbered[BEYOND] = BEYOND
    answer = Basins(
        plane=names,
        across=sides[0],
        up=sides[1],
        phase_deg=float(phase_deg),
        frequency_hz=float(place.family.frequency_hz(place.sigma)),
        regimes=place.described(known, order, shares, phase),
        ends=renumbered[ends].reshape(len(sides[1]), len(sides[0])),
        periods=periods,
        undecided=float(np.sum(ends == UNDECIDED)) / max(int(np.sum(ends != BEYOND)), 1),
        assumptions=(*scene.assumptions(), RECOGNISED),
        warnings=noise_left_out(place.model),
        cost=run.cost(paths=int(np.sum(ends != BEYOND))),
        provenance=provenance(scene.document()),
    )
    if run.deadline.passed():
        raise run.deadline.fell_short("before all starts were simulated", "ask for fewer", answer)
    return answer


INSTEAD = "; sine finds its regimes, and bifurcation follows a motion from a start"
"""Remedy where a map of basins does not follow forces."""

RECOGNISED = (
    "a motion ends in a regime where it enters surroundings from which the regime is approached: "
    "without impacts by its energy, else as found for 256 states around the regime"
)
"""Assumption of the recognition of regimes."""


def unmet_by_flights(model: Model, *, of_any_force: bool = False) -> list[str]:
    """Sentences on what flights from many starts do not follow, with a remedy where there is one;
    `of_any_force` as for `Place`."""
    conditions = unmet(model, any_force=of_any_force)
    instead = "" if unmet(model, any_force=True) else INSTEAD
    return [each + instead for each in conditions]


class Place:
    """A scene at its own values: its regimes, and the states from which motions can start.

    `of_any_force` says that stops may be compliant, and springs and dampers functions.
    """

    def __init__(
        self, scene: Scene, most_impacts: int, deadline: Deadline, *, of_any_force: bool = False
    ) -> None:
        self.model = model_of(scene)
        if conditions := unmet_by_flights(self.model, of_any_force=of_any_force):
            raise NotApplicable("sine" if of_any_force else "basins", conditions)
        _, values, scene_at = varied(scene, None, None)
        value = float(values[0])
        ends = (1.0 - MARGIN) * value, (1.0 + MARGIN) * value
        self.finder = searching(scene_at, ends, values, None, most_impacts, deadline)
        self.family, self.sigma = self.finder.family, float(self.finder.grid[0])
        self.states = States(self.model, self.family, self.sigma)

    @property
    def period(self) -> float:
        """Period of the force, s."""
        return 1.0 / float(self.family.frequency_hz(self.sigma))

    def plane(
        self, given: Mapping[str, Sequence[float]] | None, known: Attractors
    ) -> tuple[tuple[str, str], tuple[Vector, Vector]]:
        """The two numbers that are varied, and their values."""
        names = self.states.names
        if given is None:
            first = self.model.coordinates[0]
            return (f"displacement.{first}", f"velocity.{first}"), self._sides(known)
        chosen = tuple(given)
        if len(chosen) != 2 or not set(chosen) <= set(names):
            raise ValueError(
                f"plane must be two of {', '.join(names)} with their values, got "
                f"{', '.join(map(str, chosen)) or 'none'}"
            )
        sides = tuple(np.asarray(given[name], dtype=float).ravel() for name in chosen)
        for name, side in zip(chosen, sides, strict=True):
            if not len(side) or not np.all(np.isfinite(side)):
                raise ValueError(f"{name} must have finite values, at least one, got {len(side)}")
        if len(sides[0]) * len(sides[1]) > MOST_STARTS:
            raise ValueError(
                f"plane must have at most {MOST_STARTS} starts, got "
                f"{len(sides[0]) * len(sides[1])}; ask for fewer values"
            )
        return (chosen[0], chosen[1]), (sides[0], sides[1])

    def _sides(self, known: Attractors) -> tuple[Vector, Vector]:
        """Displacements between the stops of the first coordinate, or over the motions of all
        regimes, and speeds over those of all regimes."""
        speeds, places = [0.0], [0.0]
        for each in known.found:
            states = self.states.physical(each.points)
            n = len(self.model.mass)
            places += [float(np.abs(states[:, 0]).max())]
            speeds += [float(np.abs(states[:, n]).max())]
            if each.track is not None:
                places += [float(each.track.displacement[0]) * self.family.length]
                speeds += [float(each.track.speeds.max(initial=0.0)) * self.family.speed]
        reach = ACROSS * (max(places) or self.family.length)
        low, high = -reach, reach
        unit = np.eye(len(self.model.mass))[0]
        for pair in self.model.pairs:
            if np.allclose(pair.direction, unit):
                low = max(low, pair.lower.position) if pair.lower else low
                high = min(high, pair.upper.position) if pair.upper else high
        fastest = 1.5 * ACROSS * (max(speeds) or self.family.speed)
        return np.linspace(low, high, NUMBER), np.linspace(-fastest, fastest, NUMBER)

    def described(
        self, known: Attractors, order: Sequence[int], shares: Vector, phase: float
    ) -> tuple[BasinRegime, ...]:
        """The motions described for users, in the given order."""
        found: list[BasinRegime] = []
        for number in order:
            each = known.found[number]
            name = self._name(each)
            same = sum(other.name.partition(" (")[0] == name for other in found)
            found.append(
                self._described(
                    each, known, f"{name} ({same + 1})" if same else name, shares[number], phase
                )
            )
        return tuple(found)

    def _name(self, each: Attractor) -> str:
        if each.track is None:
            if not each.cycle:
                return each.kind
            return f"repeats after {each.cycle} period{'s' if each.cycle > 1 else ''}"
        struck = Counter(self.family.stops[stop] for stop in each.track.stops)
        stops = ", ".join(
            stop if number == 1 else f"{number} times {stop}"
            for stop, number in sorted(struck.items())
        )
        if each.track.periods == 1:
            return stops or "no impacts"
        return f"{stops} in {each.track.periods} periods"

    def _described(
        self, each: Attractor, known: Attractors, name: str, share: float, phase: float
    ) -> BasinRegime:
        state = each.points[-1].copy()
        lead = flights.course_of(known.motion, known.phase, (phase - known.phase) % (2.0 * math.pi))
        flights.carry(lead, state, solver.free_touch(), np.empty((len(state), 0)))
        (there,) = self.states.physical(state[None])
        n = len(self.model.mass)
        if each.track is not None:
            multiplier = float(each.track.multiplier[0])
            periods, impacts = each.track.periods, len(each.track.stops)
            fastest = float(each.track.speeds.max(initial=0.0))
            # perturbations of a superstable regime vanish
            rate = math.log(multiplier) / periods if multiplier > 0.0 else -math.inf
            mean, error, how = rate, 0.0, "multipliers of the regime"
        else:
            assert each.growth is not None
            assert each.impacts is not None
            multiplier, periods = math.nan, each.cycle
            kept = each.impacts[:, 0] > 2.0 * math.pi * (len(each.growth) - periods) + known.phase
            impacts = int(np.sum(kept)) if periods else 0
            fastest = float(each.impacts[:, 2].max(initial=0.0))
            mean, error = exponent(each.growth, WATCHED)
            how = f"growth of a perturbation over {len(each.growth)} periods"
        return BasinRegime(
            name=name,
            kind=each.kind,
            periods=periods,
            impacts=impacts,
            multiplier=None if math.isnan(multiplier) else multiplier,
            lyapunov=rate_of(mean, error, self.period, how),
            impact_speed_max=fastest * self.family.speed,
            displacement=there[:n],
            velocity=there[n:],
            share=float(share),
        )


def rate_of(mean: float, error: float, period: float, how: str) -> Estimate | None:
    """The growth of perturbations per second from that per period; None where they vanish."""
    if not math.isfinite(mean):
        return None
    return Estimate(value=mean / period, standard_error=error / period, how=how)


@dataclass(frozen=True, eq=False)
class StartSampler(TrialSampler):
    """Blocks of starts, each of which brings its states.

    They are simulated over an angle and some periods, or to a periodic regime. With a `number` they
    are asked whether they come to lie among the states of that motion. `origin` is a digest of the
    states of all starts, and `together` the number of those that are simulated together.
    """

    known: KnownMotions
    origin: str
    together: int
    periods: int
    angle: float = 0.0
    number: int | None = None

    @property
    def block(self) -> int:
        """Number of starts in a block."""
        return self.together

    def trial(
        self, first_path: int, paths: int, deadline: Deadline, states: Matrix | None = None
    ) -> tuple[Matrix, Whole]:
        """Later states of a block, which brings its states, and numbers of motions or UNDECIDED."""
        assert states is not None
        if self.number is not None:
            held = self.known.lie_in(self.number, states)
            return states, np.where(held, self.number, UNDECIDED)
        states = states.copy()
        return states, self.known.settle(states, self.angle, self.periods)

    def paths(self, sample: list[Any]) -> int:
        """Number of starts."""
        return sum(len(ends) for _, ends in sample)


class BasinRun:
    """Starts that are simulated up to the motions in which they end."""

    def __init__(
        self, run: Run, known: Attractors, starts: Matrix, phase: float, periods: int
    ) -> None:
        self.run, self.known, self.states, self.periods = run, known, starts, periods
        self.phase = phase

    def ends(self) -> Whole:
        """Number of the motion of each start, or UNDECIDED or BEYOND."""
        self.found = np.where(self.known.possible(self.states), UNDECIDED, BEYOND)
        if not np.any(self.found == UNDECIDED):
            raise ValueError(
                "plane must hold starts between the stops, got none; all its points lie beyond a "
                "stop"
            )
        first = min(self.periods, FIRST)
        self._sample(first, (self.known.phase - self.phase) % (2.0 * math.pi))
        self._reveal(first)
        if self.periods > first:
            self._sample(self.periods - first)
            self._reveal(self.periods - first)
        return self.found

    def _reveal(self, periods: int) -> None:
        """Follow some of the undecided starts to the end, and compare the others with them."""
        known, fruitless = self.known, 0
        while fruitless < FRUITLESS and not self.run.deadline.passed():
            left = np.flatnonzero(self.found == UNDECIDED)
            if fruitless >= len(left):
                break
            before = len(known.found)
            # spread over the plane: neighbours tend to end alike
            chosen = left[(len(left) * (2 * fruitless + 1)) // (2 * FRUITLESS)]
            number = known.reveal(self.states[chosen])
            if number is not None:
                self.found[chosen] = number
            if len(known.found) == before:
                fruitless += 1
            elif known.found[-1].kind == PERIODIC:
                self._sample(periods)
            else:
                self._sample(LAST, number=len(known.found) - 1)
            self.run.tell(*self._ended(0))

    def _sample(self, periods: int, angle: float = 0.0, number: int | None = None) -> None:
        """Take states and ends of the undecided starts from a `StartSampler`."""
        left = np.flatnonzero(self.found == UNDECIDED)
        if not len(left) or self.run.deadline.passed():
            return
        states = self.states[left]

        def tell(sample: list[tuple[Matrix, Whole]]) -> tuple[float, str]:
            return self._ended(sum(int(np.sum(ends != UNDECIDED)) for _, ends in sample))

        known, origin = self.known.known(), digest_of(states)
        sampler = StartSampler(known, origin, block_of(periods), periods, angle, number)
        taken = self.run.until(
            sampler, len(left), tell=tell,
            start=lambda _, first, number: states[first : first + number],
        )  # fmt: skip
        done = left[: taken.paths]
        self.states[done] = np.concatenate([each for each, _ in taken.sample])
        self.found[done] = np.concatenate([each for _, each in taken.sample])

    def _ended(self, more: int) -> tuple[float, str]:
        """Share of the starts that have ended, with some more that are not noted yet, in words."""
        ended, number = int(np.sum(self.found != UNDECIDED)) + more, len(self.found)
        return ended / number, f"{ended} of {number} starts have ended"


def block_of(periods: int) -> int:
    """Number of starts in a block, which takes about the same time over any number of periods."""
    return max(1, BLOCK * FIRST // max(periods, FIRST))


def _shares(ends: Whole, number: int) -> tuple[list[int], Vector]:
    """Motions that are reached, the most frequent first, and the share of each."""
    counted = np.array([np.sum(ends == each) for each in range(number)], dtype=float)
    order = [int(each) for each in np.argsort(-counted, kind="stable") if counted[each] > 0.0]
    return order, counted / max(float(np.sum(ends != BEYOND)), 1.0)


# ------------------------------------------------------------------------------
# Bifurcation diagrams: impact speeds of the motions that a slow sweep goes through.
# ------------------------------------------------------------------------------


MOST_DRAWN = 8
"""Largest number of impacts that are kept for each period that is watched; if there are more, the
last ones are kept."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BifurcationSweep:
    """A slow sweep by simulation, from each value to the next.

    Parameters
    ----------
    upwards
        Whether the sweep goes up.
    value, frequency_hz
        The values of the varied number in the order of the sweep, and the frequency of the force.
    periods
        Periods of the force after which the motion repeats itself (0: it does not).
    impact_speed, stop
        Impact speeds (m/s) of the periods that were watched, and the stops, for each value.
    lyapunov, lyapunov_error
        Rate at which small perturbations grow, 1/s, with its standard error; -inf where they vanish
        by resting on a stop.

    See Also
    --------
    stochvi.methods.periodic.bifurcation : The answer that holds it.
    """

    upwards: bool
    value: Vector
    frequency_hz: Vector
    periods: NDArray[np.int64]
    impact_speed: tuple[Vector, ...]
    stop: tuple[tuple[str, ...], ...]
    lyapunov: Vector
    lyapunov_error: Vector


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Bifurcation(Result):
    """Motions that a structure between stops goes through as a number is varied slowly.

    Parameters
    ----------
    key
        The number that is varied: "frequency_hz", or a key of the scene.
    sweeps
        One sweep, or one up and one down.
    settling, watched
        Numbers of periods at each value that pass before its motion is watched, and in which it is
        watched.
    assumptions
        Assumptions, a sentence each.

    See Also
    --------
    stochvi.methods.periodic.bifurcation : The calculation.
    """

    kind = "bifurcation"

    key: str
    sweeps: tuple[BifurcationSweep, ...]
    settling: int
    watched: int
    assumptions: Sequence[str] = ()

    def to_frame(self) -> DataFrame:
        """One row for each impact that was kept, and one of speed 0 for a value without impacts."""
        return stacked(
            {
                "sweep": "up" if sweep.upwards else "down",
                "value": value,
                "frequency_hz": sweep.frequency_hz[number],
                "periods": sweep.periods[number],
                "lyapunov": sweep.lyapunov[number],
                "lyapunov_error": sweep.lyapunov_error[number],
                "stop": list(sweep.stop[number]) or [""],
                "impact_speed": speeds if len(speeds := sweep.impact_speed[number]) else [0.0],
            }
            for sweep in self.sweeps
            for number, value in enumerate(sweep.value)
        )

    def table(self) -> DataFrame:
        """One row for each value of each sweep."""
        return stacked(
            {
                "sweep": "up" if sweep.upwards else "down",
                "value": sweep.value,
                "periods": sweep.periods,
                "impacts per period": [len(each) / self.watched for each in sweep.impact_speed],
                "impact_speed_max": [each.max(initial=0.0) for each in sweep.impact_speed],
                "lyapunov": sweep.lyapunov,
                "lyapunov_error": sweep.lyapunov_error,
            }
            for sweep in self.sweeps
        )

    def _shown(self) -> DataFrame:
        return self.table()

    def summary(self) -> str:
        """How many values have motions that repeat themselves, and how many are chaotic."""
        table = self.table()
        regular = int((table["periods"] > 0).sum())
        growing = table["lyapunov"] > SIGNIFICANT * table["lyapunov_error"]
        chaotic = int((growing & (table["periods"] == 0) & (table["lyapunov"] > 0.0)).sum())
        return (
            f"of {len(table)} values of {self.key}, the motion repeats itself within "
            f"{self.watched // 2} periods at {regular}; at {chaotic} of the others small "
            "perturbations are shown to grow"
        )


@calculation
def bifurcation(
    scene: Scene,
    frequency_hz: ArrayLike | None = None,
    *,
    vary: Mapping[str, Sequence[float]] | None = None,
    sweep: str = "up",
    settling: int = 300,
    watched: int = 128,
    start: Mapping[str, float] | None = None,
    budget: float | None = None,
) -> Bifurcation:
    """Motions through which a slow sweep goes: impact speeds and Lyapunov exponent at each value.

    The motion at each value goes on from that at the last one, from impact to impact, with the
    exact linear motion between them.

    Parameters
    ----------
    scene
        As for `harmonic_response`.
    frequency_hz
        Values of the frequency of the force.
    vary
        Instead: one key of the scene with its values.
    sweep
        "up", "down" or "both".
    settling
        Periods of the force that pass at each value before its motion is watched.
    watched
        Number of periods in which the motion is watched, at least 64.
    start
        The state before the first value, as {"velocity.x": 0.2}; by default at rest.
    budget
        Seconds of wall time, without that in which kernels are compiled.

    Returns
    -------
    Bifurcation
        The sweeps.

    Raises
    ------
    NotApplicable
        If the scene is not of that kind.
    NotConverged
        If the budget ends first; the error holds the values so far.

    See Also
    --------
    stochvi.harmonic_response : The regimes, stable or not, exactly.
    basins : What coexists at one value.

    Examples
    --------
    >>> import stochvi
    >>> from stochvi.scenes.datasets import shipped_scene
    >>> mount = stochvi.load_scene(shipped_scene("isolator-sine"))
    >>> found = bifurcation(mount, [90.0, 100.0, 110.0], start={"velocity.x": 0.2})
    >>> found.table()["periods"].tolist()
    [1, 1, 1]
    """
    began = time.perf_counter()
    if sweep not in SWEEPS or not SWEEPS[sweep]:
        raise ValueError(f"sweep must be 'up', 'down' or 'both', got {sweep!r}")
    if settling < 0 or watched < 64:
        raise ValueError(
            f"settling must be at least 0 and watched at least 64, got {settling} and {watched}"
        )
    deadline = Deadline.after(budget)
    key, values, scene_at = varied(scene, frequency_hz, vary)
    low, high = float(values[0]), float(values[-1])
    if low == high:
        raise ValueError(f"{key} must have at least two values, got {low:g}")
    finder = searching(scene_at, (low, high), values, None, 1, deadline)
    states = States(model_of(scene), finder.family, 0.5)
    with graceful_interrupt():
        sweeps = tuple(
            _swept(finder, upwards, settling, watched, states, start) for upwards in SWEEPS[sweep]
        )
    answer = Bifurcation(
        key=key,
        sweeps=sweeps,
        settling=settling,
        watched=watched,
        assumptions=scene.assumptions(),
        warnings=noise_left_out(model_of(scene)),
        cost=Cost(wall_time=time.perf_counter() - began),
        provenance=provenance(scene.document()),
    )
    if deadline.passed():
        raise deadline.fell_short("before the last value", "ask for fewer", answer)
    return answer


def _swept(
    finder: Finder, upwards: bool, settling: int, watched: int, states: States,
    start: Mapping[str, float] | None,
) -> BifurcationSweep:  # fmt: skip
    """One sweep; it ends where impacts come too fast to be followed."""
    family = finder.family
    state = _start_of(finder, states, start)
    sigmas, flown = [], list[TrackedPath]()
    for sigma in finder.grid if upwards else finder.grid[::-1]:
        flight = _watched(finder, float(sigma), state, settling, watched, MOST_DRAWN * watched)
        if flight is None or finder.deadline.passed():
            break
        sigmas.append(float(sigma))
        flown.append(flight)
    frequency = family.frequency_hz(np.array(sigmas))
    rates = np.array([exponent(each.growth, settling) for each in flown]).reshape(-1, 2)
    return BifurcationSweep(
        upwards=upwards,
        value=family.value(np.array(sigmas)),
        frequency_hz=frequency,
        periods=np.array([each.cycle() for each in flown], np.int64),
        impact_speed=tuple(family.speed * each.impacts[:, 2] for each in flown),
        stop=tuple(tuple(family.stops[int(stop)] for stop in each.impacts[:, 1]) for each in flown),
        lyapunov=rates[:, 0] * frequency,
        lyapunov_error=rates[:, 1] * frequency,
    )


def _start_of(finder: Finder, states: States, start: Mapping[str, float] | None) -> Vector:
    """The state that a user gives, where no hysteresis has a memory."""
    (state,) = states.starts(start or {})
    return np.pad(state, (0, finder.size - len(state)))


def _watched(
    finder: Finder, sigma: float, state: Vector, skipped: int, periods: int, most: int
) -> TrackedPath | None:
    """Simulate on from a state, which is replaced by the last one, and watch the last periods; at
    most `most` impacts are kept. None where impacts come too fast to be followed."""
    if not isinstance(finder, ContactFinder):
        course = flights.course_of(finder.motion(sigma), 0.0, 2.0 * math.pi)
        return watch(course, state, skipped, periods, most)
    perturbation = unit_perturbation(len(state))
    ends, growth = np.empty((periods, len(state))), np.empty(periods)
    impacts, leap = [np.empty((0, 3))], FOLLOWED_AT_ONCE
    leaps = [leap] * (skipped // leap) + ([skipped % leap] if skipped % leap else [])
    for period, flown in enumerate(leaps + [1] * periods, start=-len(leaps)):
        motion = finder.perturbed(sigma, state, flown, perturbation)
        if motion is None:
            return None
        state[:] = motion.ends[-1]
        size = float(np.linalg.norm(motion.factors))
        perturbation = motion.factors / size
        if period >= 0:
            ends[period], growth[period] = state, math.log(size)
            impacts.append(motion.log[:, :3] + [2.0 * math.pi * period, 0.0, 0.0])
    return TrackedPath(ends, np.concatenate(impacts)[-most:], growth)


@calculation
def lyapunov_exponent(
    scene: Scene,
    start: Mapping[str, float] | None = None,
    *,
    settling: int = 1000,
    periods: int = 4000,
    budget: float | None = None,
) -> Estimate:
    """Rate at which a small perturbation of a motion under a sine grows, 1/s.

    Between impacts the linear motion turns the perturbation. At an impact its saltation matrix
    does, which knows that a perturbed motion is struck at another moment. The rate is above 0 where
    the motion is chaotic, and 0 where it has two frequencies. Where the motion approaches a stable
    regime, it is the logarithm of the largest multiplier per time.

    Parameters
    ----------
    scene
        As for `harmonic_response`.
    start
        The state at phase 0 of the force, as {"velocity.x": 0.2}; by default at rest.
    settling, periods
        Numbers of periods of the force that pass first, and over which the rate is then taken.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    Estimate
        The rate. Its standard error joins three parts: that of the means of 32 parts of the motion;
        the swing of the size of a perturbation that turns; and the effect of growth in proportion
        to the time. The last is ln(1 + periods / settling) over that time; no shorter motion can
        tell it from chaos.

    Raises
    ------
    NotApplicable
        If the scene is not of that kind, or its motion rests on a stop, where perturbations vanish.

    See Also
    --------
    bifurcation : The exponent over a range of values.

    Examples
    --------
    >>> import stochvi
    >>> from stochvi.scenes.datasets import shipped_scene
    >>> mount = stochvi.load_scene(shipped_scene("isolator-sine"))
    >>> round(float(lyapunov_exponent(mount)), 2)
    -6.28
    """
    if settling < 0 or periods < BATCHES:
        raise ValueError(
            f"settling must be at least 0 and periods at least {BATCHES}, got {settling} and "
            f"{periods}"
        )
    place = Place(scene, 1, NEVER, of_any_force=True)
    state = _start_of(place.finder, place.states, start)
    flight = _watched(place.finder, place.sigma, state, settling, periods, 1)
    if flight is None:
        raise NotApplicable(
            "sine",
            "start must lead to impacts that can be followed one by one, got too many in a "
            "period; give another start or a larger clearance",
        )
    how = f"growth of a perturbation over {periods} periods"
    found = rate_of(*exponent(flight.growth, settling), place.period, how)
    if found is None:
        raise NotApplicable(
            "sine",
            "start must lead to a motion without rests on a stop, got one in whose rests every "
            "perturbation ends: its exponent is minus infinity",
        )
    return found
