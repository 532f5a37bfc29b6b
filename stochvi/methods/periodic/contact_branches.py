"""Branches of periodic motions by shooting, where stops are compliant, or springs and dampers are
functions."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.methods.periodic import continuation
from stochvi.methods.periodic.branches import LOOKED_AT, SUBHARMONICS, Finder, ordinary
from stochvi.methods.periodic.continuation import (
    GRAZING,
    LONGEST,
    MOST_KEPT,
    REPEATS,
    SAME,
    SETTLING,
    FinalMotion,
    OnBranch,
    Problem,
    Track,
    unstruck,
)
from stochvi.methods.periodic.family import Family
from stochvi.methods.periodic.kernels import flow, solver
from stochvi.results.deadline import NEVER, Deadline

# ------------------------------------------------------------------------------
# Branches of periodic regimes by shooting from the phase 0 of the force.
#
# A regime is a state z that the flow F over its periods takes back to itself, F(z, sigma) = z. Its
# Jacobian, which the flow gives, holds the factors of small perturbations; branches are followed by
# length of arc in (z, sigma). Where a contact appears or vanishes the motion does not change at
# once: a branch is cut there into branches of one order of contacts each. A state holds the
# memories of hysteresis after displacements and velocities.
# ------------------------------------------------------------------------------

MOST_ITERATIONS = 12
"""Largest number of Newton steps."""

RANDOM_STARTS, FEW_STARTS = 12, 4
"""Number of states, for each number of periods, from which Newton's iteration is started at a
value; they are normal, of the size of the motions that simulations settle to. With functions
fewer are started at each of many places: altogether they are more, and all differ."""

SPEEDS = 1.0, 3.0, 10.0
"""Speeds from which simulations start: lengths of the kernels times the frequency of the force."""

FOLLOWED_AT_ONCE = 64
"""Largest number of periods over which a perturbation is followed at once: it grows by less than
the range of floating-point numbers."""

REACH = 10.0
"""Size of a state at which a Newton iteration from a random start is given up. Its unit is the
largest state to which simulations settle. It would lead to no regime, and take long."""

MOST_EDGES = 3
"""An unstable regime is looked for between pairs of stable ones: largest number of pairs at a
value, and largest number of such values."""

EDGE_HALVINGS, EDGE_PERIODS = 30, 40
"""Number of times that the line between two stable regimes is halved. After so many periods a start
counts as leading to the nearer of the two."""

LINEAR, MOST_CONDITION = 0.1, 1e8
"""A motion approaches a stable regime slowly where a period changes its distance as that of small
perturbations, up to such a share of it. Directions in which perturbations decay must differ."""

CAPTURE_PERIODS = 8
"""Number of periods in which a motion that starts on the edge between two regimes comes close to
the unstable regime on it."""

FARTHEST = 1e3
"""Distance from its start at which Newton's iteration along a branch is given up."""

BEYOND = 0.2
"""Share of the range by which Newton's iteration may leave it. Far outside, the series of the
numbers of a scene means nothing, and a force may become so slow that its period is never
simulated."""

HALVINGS = 40
"""Number of times that the step to a grazing is halved."""

FAR = 1e3
"""Size of a state up to which Newton's iteration goes on from any start."""

NEAR = 0.3
"""Newton's iteration shows whether a regime belongs to a branch. It is started up to this distance
of a state from the branch, relative to the size of the regime."""


class Orbit(NamedTuple):
    """A regime: its state at the phase 0, the state after each of its periods, and its place."""

    state: Vector
    ends: Matrix
    sigma: float

    @property
    def periods(self) -> int:
        """Number of periods after which it repeats itself."""
        return len(self.ends)

    @property
    def u(self) -> Vector:
        """Its point of a branch."""
        return np.append(self.state, solver.WEIGHT * self.sigma)

    def away(self, state: Vector) -> float:
        """The distance of a state from the nearest of its own."""
        return float(np.abs(self.ends - state).max(axis=1).min())


class Precision(NamedTuple):
    """Numbers that depend on how exact the flow is, and on its price.

    Parameters
    ----------
    starts
        Number of random starts of simulations.
    converged
        Change of a state, in the units of the kernels, at which Newton's iteration has converged.
    change
        Change of the place of the range, in units of the range, over which the flow is differenced.
        In chaos its slopes may change by a hundredth of themselves within 1e-6.
    stable
        As of `Finder`.
    """

    starts: int
    converged: float
    change: float
    stable: float


SERIES = Precision(starts=96, converged=1e-11, change=1e-8, stable=1.0 + 1e-9)
"""Without functions."""

EXTRAPOLATED = Precision(starts=32, converged=1e-9, change=1e-6, stable=1.0 + 1e-6)
"""Where springs and dampers are functions."""


class ContactFinder(Finder):
    """Finds the branches of a family with compliant stops, springs and dampers that are
    functions."""

    def __init__(
        self, family: Family, grid: Vector, most_impacts: int, deadline: Deadline = NEVER
    ) -> None:
        super().__init__(family, grid, most_impacts, deadline)
        self.precision = EXTRAPOLATED if family.functions.parts else SERIES
        self.random_starts, self.stable = self.precision.starts, self.precision.stable
        self._system: tuple[float, flow.System] | None = None

    @property
    def size(self) -> int:
        return super().size + self.family.functions.remembering

    @cached_property
    def _known_images(self) -> dict[Track, Matrix]:
        """What `_images` has found."""
        return {}

    def find(self) -> list[Track]:
        """All branches that were found."""
        chosen = self.seeds = self.places()
        edges = chosen[:: max(1, (len(chosen) - 1) // (MOST_EDGES - 1))]
        for sigma in chosen:
            for orbit in self._orbits(sigma, edges=sigma in edges):
                if self.deadline.passed():
                    return self.tracks
                self._added(orbit)
        return self.tracks

    def places(self) -> list[float]:
        """The places of the range at which regimes are looked for."""
        if self.family.functions.parts:
            return self.seeds
        free = Finder(self.family, self.grid, 1, self.deadline)
        free.tracks = free.without_impacts()
        return free.seeds

    @property
    def looked_for(self) -> tuple[str, str]:
        return (
            "regimes are looked for by simulations and from random states; one that neither meets "
            "is not found"
        ), ""

    # One motion

    def system(self, sigma: float) -> flow.System:
        """The scene at a place of the range."""
        if self._system is None or self._system[0] != sigma:
            family = self.family
            found = flow.System(
                self.motion(sigma), family.laws_at(sigma), family.functions.at(sigma)
            )
            self._system = sigma, found
        return self._system[1]

    def flown(
        self, sigma: float, state: Vector, periods: int, phase: float = 0.0, *, factors: bool = True
    ) -> FinalMotion | None:
        """A motion over some periods; None where contacts come too fast to be followed."""
        return self.perturbed(
            sigma, state, periods, np.eye(self.size, self.size if factors else 0), phase
        )

    def perturbed(
        self, sigma: float, state: Vector, periods: int, perturbations: Matrix, phase: float = 0.0
    ) -> FinalMotion | None:
        """As `flown`; the factors are what becomes of small perturbations (size, number) of its
        start, over at most FOLLOWED_AT_ONCE periods."""
        ends, log = np.empty((periods + 1, self.size)), np.zeros((MOST_KEPT, 3 + self.size))
        grown = perturbations.copy()
        hits, displacement, acceleration, amplitude = flow.flow(
            self.system(sigma), np.ascontiguousarray(state), phase, flow.Record(ends, log, grown)
        )
        if hits < 0 or not np.all(np.isfinite(ends)):
            return None
        kept = log[: min(hits, MOST_KEPT)]
        kept = kept[np.argsort(kept[:, 0], kind="stable")]
        return FinalMotion(
            ends, phase, kept, displacement, acceleration, amplitude=amplitude, factors=grown
        )

    def simulate(
        self, sigma: float, state: Vector, phase: float = 0.0, periods: int = LOOKED_AT
    ) -> FinalMotion | None:
        # all motions start at the phase 0, where regimes are known
        return self.flown(sigma, state, periods, factors=False)

    def _place_of(self, settled: FinalMotion, sigma: float) -> OnBranch | None:
        orbit = self._settled_orbit(settled, sigma)
        return None if orbit is None else self._added(orbit)

    def _added(self, orbit: Orbit) -> OnBranch | None:
        """The place of a regime, on a branch that is followed from it if there is none yet."""
        if (place := self._known_orbit(orbit)) is None:
            self.tracks += self._traced(orbit)
            place = self._known_orbit(orbit)
        return place

    def _known_orbit(self, orbit: Orbit) -> OnBranch | None:
        size = float(np.abs(orbit.ends).max()) or 1.0
        for track in self.tracks:
            if track.periods != orbit.periods:
                continue
            beside = self._passing(track, orbit.sigma, lambda u: orbit.away(u[:-1]) < NEAR * size)
            for number, u in beside:
                if orbit.away(u[:-1]) < SAME:
                    return OnBranch(track, number)
        return None

    def amplitude(self, track: Track) -> Vector:
        found = (self.at_point(point, track.periods, factors=False) for point in track.points)
        return np.array([np.nan if each is None else each.amplitude for each in found])

    def at_point(self, u: Vector, periods: int, *, factors: bool = True) -> FinalMotion | None:
        """The motion from a point of a branch on; None where it cannot be followed."""
        return self.flown(u[-1] / solver.WEIGHT, u[:-1], periods, factors=factors)

    # Regimes at one place

    def _orbits(self, sigma: float, *, edges: bool) -> Iterator[Orbit]:
        """Regimes from simulations, on the `edges` between those, and by Newton's iteration from
        states of their size."""
        size, known = 1e-3, list[Orbit]()
        still = self._still(sigma)
        for start in (*self.starts(), *([] if still is None else [still])):
            settled = self.simulate(sigma, start, periods=SETTLING)
            if self.deadline.passed():
                return
            if settled is None:
                continue
            size = max(size, float(np.abs(settled.ends).max()))
            if (orbit := self._settled_orbit(settled, sigma)) is not None:
                known.append(orbit)
                yield orbit
        pairs = itertools.combinations(_different(known), 2)
        for one, other in itertools.islice(pairs, MOST_EDGES if edges else 0):
            if self.deadline.passed():
                return
            if (orbit := self._on_edge(one, other)) is not None:
                yield orbit
        for periods, starts in zip(SUBHARMONICS, self.newton_starts(sigma), strict=True):
            for start in size * starts:
                if self.deadline.passed():
                    return
                if (orbit := self.orbit(start, periods, sigma, reach=REACH * size)) is not None:
                    yield orbit

    def newton_starts(self, sigma: float) -> Matrix:
        """States from which Newton's iteration is started at a place, for each number of periods,
        in units of the motions there: (numbers of periods, states, size)."""
        seed, count = 0, RANDOM_STARTS
        if self.family.functions.parts:
            # a start costs more than with linear springs
            seed = self.seeds.index(sigma)
            count = max(FEW_STARTS, RANDOM_STARTS // len(self.seeds))
        return np.random.default_rng(seed).normal(size=(len(SUBHARMONICS), count, self.size))

    def starts(self) -> Matrix:
        """As for rigid stops, and speeds of the first function: without stops, too, there are large
        motions beside small ones."""
        found, n = list(super().starts()), self.family.sizes[0]
        omega, functions = self.motion(0.5).omega, self.system(0.5).functions
        for speed in SPEEDS if self.family.functions.parts else ():
            state = np.zeros(self.size)
            row = functions.calls.rows[0] / functions.widths[0]
            state[n : 2 * n] = speed * omega * row
            found.append(state)
        return np.array(found)

    def at_rest(self, sigma: float) -> Vector:
        return np.append(super().at_rest(sigma), self._unloaded)

    def _random_start(self, sigma: float, random: np.random.Generator) -> Vector:
        start = super()._random_start(sigma, random)
        return np.append(start, random.uniform(-1.0, 1.0, len(self._unloaded)))

    @property
    def _unloaded(self) -> Vector:
        """The memories of hysteresis before any motion."""
        return np.zeros(self.family.functions.remembering)

    def _on_edge(self, one: Orbit, other: Orbit) -> Orbit | None:
        """The unstable regime that parts the starts of two stable ones: a start between them that
        leads to neither for long comes close to it."""
        way, low, high = other.state - one.state, 0.0, 1.0
        for _ in range(EDGE_HALVINGS):
            middle = 0.5 * (low + high)
            motion = self.flown(one.sigma, one.state + middle * way, EDGE_PERIODS, factors=False)
            if motion is None:
                return None
            nearer = one.away(motion.ends[-1]) < other.away(motion.ends[-1])
            low, high = (middle, high) if nearer else (low, middle)
        motion = self.flown(one.sigma, one.state + low * way, CAPTURE_PERIODS, factors=False)
        if motion is None:
            return None
        slowest = int(np.argmin(np.abs(np.diff(motion.ends, axis=0)).max(axis=1)))
        return self.orbit(motion.ends[slowest], 1, one.sigma)

    def _still(self, sigma: float) -> Vector | None:
        """The motion without contacts at the phase 0; None where there is none."""
        state = unstruck(self.motion(sigma))
        if state is None or not np.all(np.abs(state) < 1e6):
            return None
        return np.append(state, self._unloaded)

    def _settled_orbit(self, settled: FinalMotion, sigma: float) -> Orbit | None:
        """The lasting regime to which a simulation has settled; None where it has not. In chaos
        motions come close to unstable regimes by chance, of which there is no end."""
        periods = settled.period(REPEATS)
        orbit = self.orbit(settled.state, periods or 1, sigma)
        if orbit is None:
            return None
        here = self.inspected((), orbit.periods, orbit.u[None], [""])
        if not here.lasting[0] or not (periods or _approaches(settled.ends, orbit, here)):
            return None
        return orbit

    def orbit(
        self, start: Vector, periods: int, sigma: float, reach: float | None = None
    ) -> Orbit | None:
        """The regime that Newton's iteration ends at; None where it fails, or leaves the states
        within a reach, which by default grows with the start: in resonance with light damping
        motions have a thousand times the size of others."""
        most = max(FAR, REACH * float(np.abs(start).max())) if reach is None else reach
        ends = np.empty((0, len(start)))

        def equations(state: Vector) -> Linearised | None:
            nonlocal ends
            motion = self.flown(sigma, state, periods)
            if motion is None:
                return None
            ends = motion.ends
            return Linearised(ends[-1] - state, motion.factors - np.eye(len(state)))

        found = _root(
            equations, start, self.precision.converged,
            lambda state: bool(np.abs(state).max() < most),
        )  # fmt: skip
        if found is None:
            return None
        state = found.place
        ends = np.concatenate([state[None], ends[1:-1]])
        for shorter in range(1, periods):
            if periods % shorter == 0 and np.abs(ends[shorter] - state).max() < SAME:
                return Orbit(state, ends[:shorter], sigma)
        return Orbit(state, ends, sigma)

    # Branches

    def problem_of(self, track: Track) -> Problem:
        return Shooting(self, track.periods)

    def _traced(self, orbit: Orbit) -> list[Track]:
        """The branch through a regime, as branches of one order of contacts each; what was looked
        at before the deadline."""
        problem = Shooting(self, orbit.periods)
        known = [self._images(each) for each in self.tracks if each.periods == orbit.periods]
        points, names = self._continuation(problem).through(
            orbit.u, self._name(orbit.sigma), np.concatenate([np.empty((0, self.size + 1)), *known])
        )
        words = [
            self._word(u, orbit.periods)
            for u in itertools.takewhile(lambda _: not self.deadline.passed(), points)
        ] or [self._word(points[0], orbit.periods)]
        points = points[: len(words)]
        found, first = list[Track](), 0
        edge: list[Vector] = []
        for number in range(1, len(points) + 1):
            if number < len(points) and words[number] == words[first]:
                continue
            last, ahead = list[Vector](), list[Vector]()
            if number < len(points):
                around = points[number - 1], points[number]
                last, ahead = self._changed(*around, (words[first], words[number]), problem)
            part = [*edge, *points[first:number], *last]
            labels = [GRAZING] * len(edge) + names[first:number] + [GRAZING] * len(last)
            track = self.inspected(words[first], orbit.periods, np.array(part), labels, whole=False)
            found.append(self._located(track))
            first, edge = number, ahead
            if self.deadline.passed():
                break
        return found

    def _images(self, track: Track) -> Matrix:
        """All points of the regimes of a branch, which are found once."""
        if track not in self._known_images:
            problem = self.problem_of(track)
            self._known_images[track] = np.concatenate(
                [np.empty((0, self.size + 1)), *(problem.images(u) for u in ordinary(track))]
            )
        return self._known_images[track]

    def _word(self, u: Vector, periods: int) -> tuple[int, ...]:
        motion = self.at_point(u, periods, factors=False)
        return () if motion is None else contact_sequence(motion.log)

    def _changed(
        self, start: Vector, end: Vector, words: tuple[tuple[int, ...], ...], problem: Shooting
    ) -> list[list[Vector]]:
        """The last regime with the first order of contacts and the first one with the second order
        between two points of a branch, by bisection; none where none was found.

        Multipliers leap at a grazing: the end of each branch is a regime of its own side.
        """
        last, first = self._bisected(start, end, words[0], problem)
        if first is not None and self._word(first, problem.periods) != words[1]:
            first, _ = self._bisected(end, first, words[1], problem)
        return [[] if each is None else [each] for each in (last, first)]

    def _bisected(
        self, start: Vector, end: Vector, word: tuple[int, ...], problem: Shooting
    ) -> tuple[Vector | None, Vector | None]:
        """The last regime with the order of contacts of the first of two points of a branch, and
        the first regime beyond it."""
        normal = (end - start) / np.linalg.norm(end - start)
        low, high, last, beyond = 0.0, 1.0, None, None
        for _ in range(HALVINGS):
            if self.deadline.passed():
                break
            middle = 0.5 * (low + high)
            found = problem.corrected(start + middle * (end - start), normal)
            if found is None:
                break
            if self._word(found.u, problem.periods) == word:
                low, last = middle, found.u
            else:
                high, beyond = middle, found.u
        return last, beyond

    def inspected(
        self, stops: tuple[int, ...], periods: int, points: Matrix, names: Sequence[str],
        *, whole: bool = True,
    ) -> Track:  # fmt: skip
        """The branch, up to the deadline where it need not be `whole`."""
        number, count, two = len(points), len(stops), self.size
        sizes, factors = np.zeros((number, 2)), np.zeros((number, two, two))
        speeds, phases = np.zeros((number, count)), np.zeros((number, count))
        starts = np.array(points[:, :-1])
        for place, u in enumerate(points):
            if place and not whole and self.deadline.passed():
                number = place
                break
            motion = self.at_point(u, periods)
            assert motion is not None, "a regime is followed once more"
            sizes[place] = motion.displacement, motion.acceleration
            factors[place] = motion.factors
            log = _turned(motion.log, periods)
            if count and len(log):
                # at a grazing one contact more or fewer is seen: it has no speed there
                own = min(count, len(log))
                phases[place, :own], speeds[place, :own] = log[:own, 0], log[:own, 2]
                starts[place] = log[0, 3:]
        displacement, acceleration = sizes.T
        track = Track(
            stops, periods, points, tuple(names), np.ones(len(points)), displacement, acceleration,
            speeds, factors, starts, phases, by_state=True,
        )  # fmt: skip
        return track.part(slice(number))


class Shooting:
    """The equations of regimes of some periods: u holds their state at the phase 0."""

    def __init__(self, finder: ContactFinder, periods: int) -> None:
        self.finder, self.periods = finder, periods

    def corrected(self, u: Vector, normal: Vector) -> continuation.BranchPlace | None:
        """The regime on the plane through u with a normal; None where Newton's iteration fails."""
        finder, change = self.finder, self.finder.precision.change

        def equations(at: Vector) -> Linearised | None:
            motion = finder.at_point(at, self.periods)
            if motion is None:
                return None
            left = np.append(motion.ends[-1] - at[:-1], normal @ (at - u))
            sides = [
                finder.at_point(_moved(at, side * change), self.periods, factors=False)
                for side in (-1, 1)
            ]
            if sides[0] is None or sides[1] is None:
                return None
            slope = (sides[1].ends[-1] - sides[0].ends[-1]) / (2.0 * change * solver.WEIGHT)
            matrix = [np.column_stack([motion.factors - np.eye(len(slope)), slope]), normal]
            return Linearised(left, np.vstack(matrix))

        def possible(at: Vector) -> bool:
            inside = -BEYOND < at[-1] / solver.WEIGHT < 1.0 + BEYOND
            return inside and bool(np.abs(at - u).max() < FARTHEST)

        found = _root(equations, u, finder.precision.converged, possible)
        if found is None:
            return None
        tangent = _solved(found.slopes, np.append(np.zeros(len(u) - 1), 1.0))
        if tangent is None:
            return None
        factors = found.slopes[:-1, :-1] + np.eye(len(u) - 1)
        growth = float(np.abs(np.linalg.eigvals(factors)).max())
        return continuation.BranchPlace(
            found.place, tangent / np.linalg.norm(tangent), math.inf, growth
        )

    def settled(self, u: Vector) -> Vector | None:
        """The regime near u at its place of the range; None where Newton's iteration fails."""
        orbit = self.finder.orbit(u[:-1], self.periods, u[-1] / solver.WEIGHT)
        return None if orbit is None or orbit.periods != self.periods else orbit.u

    def difference(self, points: Matrix, u: Vector) -> Matrix:
        """How far each of some points lies from u."""
        return points - u

    def images(self, u: Vector) -> Matrix:
        """The state after each period; that at u alone where the motion cannot be followed."""
        motion = self.finder.at_point(u, self.periods, factors=False)
        states = u[None, :-1] if motion is None else motion.ends[:-1]
        return np.column_stack([states, np.full(len(states), u[-1])])


def _approaches(ends: Matrix, orbit: Orbit, here: Track) -> bool:
    """Whether a motion, by its states after each period, goes to a regime of one period: its last
    perturbations turn and decay as those that are small do."""
    if orbit.periods > 1:
        return False
    values, ways = np.linalg.eig(here.factors[0])
    if not np.abs(values).max() < 1.0 or np.linalg.cond(ways) > MOST_CONDITION:
        return False
    away = np.linalg.solve(ways, (ends - orbit.state).T)
    size = np.linalg.norm(away, axis=0)
    left = np.linalg.norm(away[:, 1:] - values[:, None] * away[:, :-1], axis=0)
    decay = float(np.abs(values).max()) ** (len(ends) - 1)
    linear = np.all(left[-LONGEST:] <= LINEAR * size[-1 - LONGEST : -1])
    return bool(linear and size[-1] <= 0.5 * (1.0 + decay) * size[0])


def _different(orbits: Sequence[Orbit]) -> list[Orbit]:
    """The regimes among some, each once."""
    found = list[Orbit]()
    for orbit in orbits:
        if all(each.away(orbit.state) > SAME for each in found):
            found.append(orbit)
    return found


def contact_sequence(log: Matrix) -> tuple[int, ...]:
    """The order of contacts, rotated to the form that comes first in the alphabet: it does not
    matter which contact follows the phase 0."""
    word = tuple(log[:, 1].astype(int).tolist())
    return min((word[first:] + word[:first] for first in range(len(word))), default=())


def _turned(log: Matrix, periods: int) -> Matrix:
    """The contacts of a regime in the order of `contact_sequence`, phases rising."""
    word, wanted = tuple(log[:, 1].astype(int).tolist()), contact_sequence(log)
    first = next((k for k in range(len(word)) if word[k:] + word[:k] == wanted), 0)
    later = log[:first].copy()
    later[:, 0] += 2.0 * math.pi * periods
    return np.concatenate([log[first:], later])


def _moved(u: Vector, change: float) -> Vector:
    """The same state at another place of the range."""
    moved = u.copy()
    moved[-1] += change * solver.WEIGHT
    return moved


class Linearised(NamedTuple):
    """What is left of equations at a place, and its slopes."""

    left: Vector
    slopes: Matrix


class Root(NamedTuple):
    """A solution of equations, and their slopes close to it."""

    place: Vector
    slopes: Matrix


def _root(
    equations: Callable[[Vector], Linearised | None], start: Vector, converged: float,
    possible: Callable[[Vector], bool],
) -> Root | None:  # fmt: skip
    """The place that Newton's iteration ends at; None where it fails, or leaves the possible
    ones."""
    at = start
    for _ in range(MOST_ITERATIONS):
        found = equations(at)
        change = None if found is None else _solved(found.slopes, -found.left)
        if found is None or change is None or not possible(at + change):
            return None
        at = at + change
        if np.abs(change).max() < converged * (1.0 + np.abs(at).max()):
            return Root(at, found.slopes)
    return None


def _solved(matrix: Matrix, right: Vector) -> Vector | None:
    """The solution of linear equations; None where there is none."""
    try:
        found = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return None
    return np.asarray(found) if np.all(np.isfinite(found)) else None


def finder_of(
    family: Family, grid: Vector, most_impacts: int, deadline: Deadline = NEVER
) -> Finder:
    """The finder of a family: of rigid stops alone, or of any forces."""
    kind = ContactFinder if any(family.pieces) or family.functions.parts else Finder
    return kind(family, grid, most_impacts, deadline)
