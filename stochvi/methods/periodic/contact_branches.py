"""Branches of periodic regimes where stops give way: by shooting from the phase 0 of the force.

A regime is a state z that the flow F over its periods takes back to itself, F(z, sigma) = z. Its
Jacobian, which the flow gives exactly, holds the factors of small disturbances; branches are
followed by length of arc in (z, sigma). Where a contact appears or vanishes the motion does not
change at once: a branch is cut there into branches of one order of contacts each.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from stochvi.methods.periodic.branches import (
    FOLD,
    GRAZING,
    MOST_KEPT,
    POINT,
    REPEATS,
    SAME,
    SEED_VALUES,
    SETTLING,
    SUBHARMONICS,
    Finder,
    Matrix,
    Settled,
    Track,
    Vector,
)
from stochvi.methods.periodic.family import Family
from stochvi.methods.periodic.kernels import contact_flow, solver
from stochvi.methods.periodic.regimes import unstruck
from stochvi.results.deadline import NEVER, Deadline

CHANGE = 1e-6
"""Step of sigma over which the flow is differenced."""

CONVERGED = 1e-11
"""Change of a state, in the units of the kernels, at which Newton's iteration has converged."""

MOST_ITERATIONS = 12
"""Largest number of Newton steps."""

RANDOM_STARTS = 12
"""Number of states, for each number of periods, from which Newton's iteration is started at a
value; they are normal, of the size of the motions that simulations settle to."""

REACH = 10.0
"""Size of a state, in multiples of the largest one to which simulations settle, at which a Newton
iteration from a random start is given up: it would lead to no regime, and take long."""

MOST_EDGES = 3
"""Largest number of pairs of stable regimes at a value between which an unstable one is looked for,
and largest number of values at which that is done."""

EDGE_HALVINGS, EDGE_PERIODS = 30, 40
"""Number of times that the line between two stable regimes is halved, and number of periods after
which a start counts as leading to the nearer of the two."""

LINGERING = 8
"""Number of periods in which a motion that starts on the edge between two regimes comes close to
the unstable regime on it."""

STEPS = (1e-6, 0.02, 0.3)
"""Smallest, first and largest step of arc, in units of the kernels and of `solver.WEIGHT`."""

BEYOND = 0.2
"""Share of the range by which Newton's iteration may leave it. Far outside, the series of the
numbers of a scene means nothing, and a force may become so slow that its period is never
simulated."""

TURN = 0.95
"""Smallest cosine of the angle between tangents at two successive points."""

BESIDE = 0.25
"""Largest distance of a regime from the chord between two points of its branch, in lengths of the
chord: one that is farther away belongs to another branch."""

HALVINGS = 40
"""Number of times that the step to a fold or to a grazing is halved."""


class Orbit(NamedTuple):
    """A regime: its state at the phase 0, the state after each of its periods, and its place."""

    state: Vector
    ends: Matrix
    sigma: float

    @property
    def periods(self) -> int:
        """Number of periods after which it repeats itself."""
        return len(self.ends)


class Motion(NamedTuple):
    """The result of the flow over some periods."""

    ends: Matrix
    factors: Matrix
    log: Matrix
    displacement: float
    acceleration: float
    amplitude: float


class ContactFinder(Finder):
    """Finds the branches of a family with stops that give way."""

    def find(self) -> list[Track]:
        """All branches that were found."""
        chosen = np.linspace(0, len(self.grid) - 1, min(SEED_VALUES, len(self.grid)))
        numbers = np.unique(np.round(chosen).astype(int))
        edges = numbers[:: max(1, (len(numbers) - 1) // (MOST_EDGES - 1))]
        for number in numbers:
            for orbit in self._orbits(float(self.grid[number]), edges=number in edges):
                if self.deadline.passed():
                    return self.tracks
                if not any(self._holds(track, orbit) for track in self.tracks):
                    self.tracks += self._traced(orbit)
        return self.tracks

    @property
    def looked_for(self) -> tuple[str, str]:
        return (
            "regimes are looked for by simulations and from random states; one that neither meets "
            "is not found"
        ), ""

    # One motion

    def flown(
        self, sigma: float, state: Vector, periods: int, phase: float = 0.0, *, factors: bool = True
    ) -> Motion | None:
        """A motion over some periods; None where contacts come too fast to be followed."""
        n = self.family.sizes[0]
        ends, log = np.empty((periods + 1, 2 * n)), np.zeros((MOST_KEPT, 3 + 2 * n))
        grown = np.empty((2 * n, 2 * n) if factors else (0, 0))
        hits, *sizes = contact_flow.flow(
            self.motion(sigma), self.family.laws_at(sigma), np.ascontiguousarray(state), phase,
            contact_flow.Record(ends, log, grown),
        )  # fmt: skip
        if hits < 0 or not np.all(np.isfinite(ends)):
            return None
        kept = log[: min(hits, MOST_KEPT)]
        kept = kept[np.argsort(kept[:, 0], kind="stable")]
        return Motion(ends, grown, kept, *sizes)

    def simulate(
        self, sigma: float, state: Vector, phase: float = 0.0, periods: int = SETTLING
    ) -> Settled | None:
        # all motions start at the phase 0, where regimes are known
        settling = self.flown(sigma, state, periods, factors=False)
        if settling is None:
            return None
        last = self.flown(sigma, settling.ends[-1], 1, factors=False)
        if last is None:
            return None
        return Settled(settling.ends, 0.0, settling.log[:, :3], last.displacement)

    def end_of(self, track: Track, number: int) -> tuple[Vector, float]:
        return track.points[number, :-1], 0.0

    def reaches(self, settled: Settled, sigma: float) -> Callable[[Track, int], bool]:
        orbit = self._settled_orbit(settled, sigma)
        return lambda track, number: orbit is not None and self._at_point(track, number, orbit)

    def amplitude(self, track: Track) -> Vector:
        found = (self._flown(point, track.periods, factors=False) for point in track.points)
        return np.array([np.nan if each is None else each.amplitude for each in found])

    def _flown(self, u: Vector, periods: int, *, factors: bool = True) -> Motion | None:
        return self.flown(u[-1] / solver.WEIGHT, u[:-1], periods, factors=factors)

    # Regimes at one place

    def _orbits(self, sigma: float, *, edges: bool) -> Iterator[Orbit]:
        """Regimes from simulations, on the `edges` between those, and by Newton's iteration from
        states of their size."""
        size, known = 1e-3, list[Orbit]()
        still = self._still(sigma)
        for start in (*self.starts(), *([] if still is None else [still])):
            settled = self.simulate(sigma, start)
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
        random = np.random.default_rng(0)
        for periods in SUBHARMONICS:
            for start in size * random.normal(size=(RANDOM_STARTS, 2 * self.family.sizes[0])):
                if self.deadline.passed():
                    return
                if (orbit := self._orbit(start, periods, sigma, reach=REACH * size)) is not None:
                    yield orbit

    def _on_edge(self, one: Orbit, other: Orbit) -> Orbit | None:
        """The unstable regime that parts the starts of two stable ones: a start between them that
        leads to neither for long comes close to it."""
        way, low, high = other.state - one.state, 0.0, 1.0
        for _ in range(EDGE_HALVINGS):
            middle = 0.5 * (low + high)
            motion = self.flown(one.sigma, one.state + middle * way, EDGE_PERIODS, factors=False)
            if motion is None:
                return None
            away = [np.abs(each.ends - motion.ends[-1]).max(axis=1).min() for each in (one, other)]
            low, high = (middle, high) if away[0] < away[1] else (low, middle)
        motion = self.flown(one.sigma, one.state + low * way, LINGERING, factors=False)
        if motion is None:
            return None
        slowest = int(np.argmin(np.abs(np.diff(motion.ends, axis=0)).max(axis=1)))
        return self._orbit(motion.ends[slowest], 1, one.sigma)

    def _still(self, sigma: float) -> Vector | None:
        """The motion without contacts at the phase 0; None where there is none."""
        state = unstruck(self.motion(sigma))
        return state if state is not None and np.all(np.abs(state) < 1e6) else None

    def _settled_orbit(self, settled: Settled, sigma: float) -> Orbit | None:
        periods = settled.period(REPEATS)
        return self._orbit(settled.state, periods, sigma) if periods else None

    def _orbit(self, start: Vector, periods: int, sigma: float, reach: float = 1e3) -> Orbit | None:
        """The regime that Newton's iteration ends at; None where it fails, or leaves the states
        within a reach."""
        state = start.copy()
        for _ in range(MOST_ITERATIONS):
            motion = self.flown(sigma, state, periods)
            if motion is None:
                return None
            change = _solved(motion.factors - np.eye(len(state)), state - motion.ends[-1])
            if change is None or not np.abs(state + change).max() < reach:
                return None
            state = state + change
            if np.abs(change).max() < CONVERGED * (1.0 + np.abs(state).max()):
                ends = np.concatenate([state[None], motion.ends[1:-1]])
                for shorter in range(1, periods):
                    if periods % shorter == 0 and np.abs(ends[shorter] - state).max() < SAME:
                        return Orbit(state, ends[:shorter], sigma)
                return Orbit(state, ends, sigma)
        return None

    def _holds(self, track: Track, orbit: Orbit) -> bool:
        if track.periods != orbit.periods:
            return False
        here = np.flatnonzero(np.abs(track.sigma - orbit.sigma) < 1e-12)
        return any(self._at_point(track, int(number), orbit) for number in here)

    @staticmethod
    def _at_point(track: Track, number: int, orbit: Orbit) -> bool:
        away = np.abs(orbit.ends - track.points[number, :-1]).max(axis=1)
        return track.periods == orbit.periods and bool(away.min() < SAME)

    # Branches

    def _corrected(self, u: Vector, normal: Vector, periods: int) -> tuple[Vector, Vector] | None:
        """The regime on the plane through u with a normal, and the tangent of the branch there."""
        at = u.copy()
        for _ in range(MOST_ITERATIONS):
            motion = self._flown(at, periods)
            sides = [
                self._flown(_moved(at, side * CHANGE), periods, factors=False) for side in (-1, 1)
            ]
            if motion is None or sides[0] is None or sides[1] is None:
                return None
            slope = (sides[1].ends[-1] - sides[0].ends[-1]) / (2.0 * CHANGE * solver.WEIGHT)
            matrix = np.vstack(
                [np.column_stack([motion.factors - np.eye(len(slope)), slope]), normal]
            )
            right = np.append(at[:-1] - motion.ends[-1], -normal @ (at - u))
            change = _solved(matrix, right)
            if change is None or not np.abs(change).max() < 1e3:
                return None
            at = at + change
            if not -BEYOND < at[-1] / solver.WEIGHT < 1.0 + BEYOND:
                return None
            if np.abs(change).max() < CONVERGED * (1.0 + np.abs(at).max()):
                tangent = _solved(matrix, np.append(np.zeros(len(slope)), 1.0))
                return None if tangent is None else (at, tangent / np.linalg.norm(tangent))
        return None

    def _at(self, track: Track, share: float, number: int) -> Matrix | None:
        start, end = track.points[number], track.points[number + 1]
        normal = (end - start) / np.linalg.norm(end - start)
        found = self._corrected(start + share * (end - start), normal, track.periods)
        return None if found is None else found[0][None]

    def _followed_from(
        self, orbit: Orbit, direction: float
    ) -> tuple[list[Vector], list[str], bool]:
        """Points of a branch in one direction of sigma, with their names, and whether it closed."""
        first = np.append(orbit.state, solver.WEIGHT * orbit.sigma)
        found = self._corrected(first, np.eye(len(first))[-1], orbit.periods)
        if found is None:
            return [], [], False
        u, tangent = found[0], found[1] * np.sign(found[1][-1] or 1.0) * direction
        points, names = list[Vector](), list[str]()
        length, step = 0.0, STEPS[1]
        while len(points) < 8 * len(self.grid) + 200 and not self.deadline.passed():
            found = self._corrected(u + step * tangent, tangent, orbit.periods)
            good = found is not None and abs(found[1] @ tangent) > TURN
            if not good or found is None:
                step *= 0.5
                if step < STEPS[0]:
                    break
                continue
            fresh, way = found[0], found[1] * np.sign(found[1] @ tangent)
            if (
                way[-1] * tangent[-1] < 0.0
                and (turn := self._turn(u, tangent, step, orbit)) is not None
            ):
                self._fill(points, names, u, turn, orbit.periods)
                points.append(turn)
                names.append(FOLD)
                self._fill(points, names, turn, fresh, orbit.periods)
            else:
                self._fill(points, names, u, fresh, orbit.periods)
            length += step
            u, tangent = fresh, way
            if not 0.0 <= u[-1] <= solver.WEIGHT:
                break
            if length > 4.0 * step + 0.5 and np.linalg.norm(u - first) < step:
                return points, names, True
            step = min(1.5 * step, STEPS[2])
        return points, names, False

    def _turn(self, u: Vector, tangent: Vector, step: float, orbit: Orbit) -> Vector | None:
        """Where a branch turns back within a step, by bisection."""
        low, high, turn = 0.0, step, None
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            found = self._corrected(u + middle * tangent, tangent, orbit.periods)
            if found is None:
                return turn
            turn, way = found
            if way[-1] * np.sign(way @ tangent) * tangent[-1] > 0.0:
                low = middle
            else:
                high = middle
        return turn

    def _fill(
        self, points: list[Vector], names: list[str], start: Vector, end: Vector, periods: int,
        parts: int = 2**6,
    ) -> None:  # fmt: skip
        """Add the regimes at the values of the grid between two points of a branch, if Newton's
        iteration ends close to the chord between them at each value; else do the same for the two
        halves of the chord, down to so many parts of it."""
        values, way = solver.WEIGHT * self.grid, end - start
        ahead = np.sign(way[-1])
        inside = values[(ahead * (values - start[-1]) > 0.0) & (ahead * (values - end[-1]) <= 0.0)]
        found = list[Vector]()
        for value in inside if ahead > 0.0 else inside[::-1]:
            guess = start + (value - start[-1]) / way[-1] * way
            orbit = self._orbit(guess[:-1], periods, value / solver.WEIGHT)
            if orbit is not None and orbit.periods == periods:
                away = np.linalg.norm(orbit.state - guess[:-1])
                if away < BESIDE * np.linalg.norm(way):
                    found.append(np.append(orbit.state, value))
        if len(found) < len(inside) and parts > 1:
            middle = self._corrected(start + 0.5 * way, way / np.linalg.norm(way), periods)
            if middle is not None:
                self._fill(points, names, start, middle[0], periods, parts // 2)
                self._fill(points, names, middle[0], end, periods, parts // 2)
                return
        points += found
        names += [POINT] * len(found)

    def _traced(self, orbit: Orbit) -> list[Track]:
        """The branch through a regime, as branches of one order of contacts each."""
        middle = np.append(orbit.state, solver.WEIGHT * orbit.sigma)
        points, names, closed = self._followed_from(orbit, 1.0)
        before, before_names, _ = ([], [], True) if closed else self._followed_from(orbit, -1.0)
        points = [*before[::-1], middle, *points]
        names = [*before_names[::-1], POINT, *names]
        words = [self._word(u, orbit.periods) for u in points]
        found, first = list[Track](), 0
        edge: list[Vector] = []
        for number in range(1, len(points) + 1):
            if number < len(points) and words[number] == words[first]:
                continue
            last = []
            if number < len(points):
                place = self._changed(points[number - 1], points[number], words[first], orbit)
                last = [] if place is None else [place]
            part = [*edge, *points[first:number], *last]
            labels = [GRAZING] * len(edge) + names[first:number] + [GRAZING] * len(last)
            track = self.inspected(words[first], orbit.periods, np.array(part), labels)
            found.append(self._located(track))
            first, edge = number, last
        return found

    def _word(self, u: Vector, periods: int) -> tuple[int, ...]:
        motion = self._flown(u, periods, factors=False)
        return () if motion is None else _word_of(motion.log)

    def _changed(
        self, start: Vector, end: Vector, word: tuple[int, ...], orbit: Orbit
    ) -> Vector | None:
        """Where the order of contacts changes between two points of a branch, by bisection."""
        normal = (end - start) / np.linalg.norm(end - start)
        low, high, place = 0.0, 1.0, None
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            found = self._corrected(start + middle * (end - start), normal, orbit.periods)
            if found is None:
                return place
            place = found[0]
            if self._word(place, orbit.periods) == word:
                low = middle
            else:
                high = middle
        return place

    def inspected(
        self, stops: tuple[int, ...], periods: int, points: Matrix, names: Sequence[str]
    ) -> Track:
        number, count, two = len(points), len(stops), 2 * self.family.sizes[0]
        sizes, factors = np.zeros((number, 2)), np.zeros((number, two, two))
        speeds, phases = np.zeros((number, count)), np.zeros((number, count))
        starts = np.array(points[:, :-1])
        for place, u in enumerate(points):
            motion = self._flown(u, periods)
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
        return Track(
            stops, periods, points, tuple(names), np.ones(number), displacement, acceleration,
            speeds, factors, starts, phases,
        )  # fmt: skip


def _different(orbits: Sequence[Orbit]) -> list[Orbit]:
    """The regimes among some, each once."""
    found = list[Orbit]()
    for orbit in orbits:
        if all(np.abs(each.ends - orbit.state).max(axis=1).min() > SAME for each in found):
            found.append(orbit)
    return found


def _word_of(log: Matrix) -> tuple[int, ...]:
    """The order of contacts, rotated to the form that comes first in the alphabet: it does not
    matter which contact follows the phase 0."""
    word = tuple(log[:, 1].astype(int).tolist())
    return min((word[first:] + word[:first] for first in range(len(word))), default=())


def _turned(log: Matrix, periods: int) -> Matrix:
    """The contacts of a regime in the order of `_word_of`, phases rising."""
    word, wanted = tuple(log[:, 1].astype(int).tolist()), _word_of(log)
    first = next((k for k in range(len(word)) if word[k:] + word[:k] == wanted), 0)
    later = log[:first].copy()
    later[:, 0] += 2.0 * math.pi * periods
    return np.concatenate([log[first:], later])


def _moved(u: Vector, change: float) -> Vector:
    """The same state at another place of the range."""
    moved = u.copy()
    moved[-1] += change * solver.WEIGHT
    return moved


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
    """The finder of a family: of rigid stops, or of some that give way."""
    kind = ContactFinder if any(family.pieces) else Finder
    return kind(family, grid, most_impacts, deadline)
