"""Branches of periodic regimes: found, followed, and their special points located and named."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from stochvi.methods.compile_time import leave_out_of_budgets
from stochvi.methods.periodic import continuation
from stochvi.methods.periodic.continuation import GRID, VANISHED, Continuation
from stochvi.methods.periodic.even import TOLERANCE, even_phases
from stochvi.methods.periodic.family import Family, amplitudes
from stochvi.methods.periodic.kernels import solver
from stochvi.methods.periodic.regimes import pattern_of, states_of
from stochvi.results.deadline import NEVER, Deadline

leave_out_of_budgets()

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Whole = NDArray[np.int64]

POINT, FOLD, GRAZING, DOUBLING, BREAKING, TORUS = (
    "", "fold", "grazing", "period doubling", "symmetry breaking", "torus",
)  # fmt: skip
"""Names of points of a branch: an ordinary point; where the branch turns back; where an impact
vanishes or a further one appears; where a multiplier is -1; where a multiplier is 1 and the branch
goes on; where a pair of complex multipliers has the modulus 1."""

SLOWEST = 1e-7
"""Impact speed and following flight, in the units of the kernels, up to which impacts are taken for
the end of bounces that come to rest, which no finite order of impacts describes."""

FASTEST = 1e6
"""Impact speed, in the units of the kernels, above which a solution is rounding: the phases of its
impacts leave the motion undetermined."""

FREE = 1e-10
"""Distance of a multiplier from 1 up to which a motion counts as free to move without a force:
rounding leaves some 1e-15, and the motion under a force then has a relative error of 1e-5."""

SAME = 1e-6
"""Difference of phases, rad, up to which two regimes are one."""

SEED_VALUES = 13
"""Number of values in the range at which regimes are looked for."""

MOST_WORDS = 16
"""Largest number of orders of impacts with which Newton's iteration is started; the shortest orders
come first."""

DEFAULT_IMPACTS = 3
"""Largest number of impacts in a period that is looked for unless another is given."""

STARTS = 10
"""Number of starts of Newton's iteration for each impact of an order."""

SUBHARMONICS = (1, 2, 3)
"""Numbers of periods within which a regime of one impact, or of one on each of two stops, is looked
for."""

SETTLING = 300
"""Number of periods that a simulation runs before its motion counts as settled."""

LONGEST = 8
"""Largest number of periods in which a simulated motion is looked at for repeating itself."""

REPEATS = 1e-3
"""Difference of states a period apart, relative to the motion, from which Newton's iteration
finds the regime that a simulation approaches."""

MOST_KEPT = 512
"""Number of last impacts that a simulation keeps."""

MOST_SIMULATED = 24
"""Largest number of impacts of a regime that is taken from a simulation."""


@dataclass(frozen=True, eq=False)
class Regime:
    """A periodic motion: the stops that it hits in their order (numbers), in `periods` of the
    force, at phases theta (rad); sigma is the place in the range."""

    stops: tuple[int, ...]
    periods: int
    theta: Vector
    sigma: float

    def turned(self) -> Iterator[Regime]:
        """The same regime from each of its impacts on, the first phase in [0, 2 pi)."""
        for first in range(len(self.stops)):
            stops = self.stops[first:] + self.stops[:first]
            later = self.theta[:first] + 2.0 * math.pi * self.periods
            theta = np.concatenate([self.theta[first:], later])
            theta = theta - 2.0 * math.pi * math.floor(theta[0] / (2.0 * math.pi))
            yield Regime(stops, self.periods, theta, self.sigma)

    def same(self, other: Regime) -> bool:
        """Whether two regimes at the same place are one."""
        if self.periods != other.periods or sorted(self.stops) != sorted(other.stops):
            return False
        return any(
            each.stops == other.stops and _close(each.theta, other.theta) for each in self.turned()
        )

    def shortest(self) -> Regime:
        """The regime without repetition of its own."""
        for periods in range(1, self.periods):
            count, rest = divmod(len(self.stops) * periods, self.periods)
            if self.periods % periods or rest:
                continue
            part = Regime(self.stops[:count], periods, self.theta[:count], self.sigma)
            repeated = np.concatenate(
                [
                    part.theta + 2.0 * math.pi * periods * number
                    for number in range(self.periods // periods)
                ]
            )
            again = part.stops * (self.periods // periods)
            if again == self.stops and np.all(np.abs(repeated - self.theta) < SAME):
                return part
        return self


def _close(one: Vector, other: Vector) -> bool:
    turns = np.abs(np.exp(1j * one[0]) - np.exp(1j * other[0]))
    return bool(turns < SAME and np.all(np.abs(np.diff(one) - np.diff(other)) < SAME))


@dataclass(frozen=True, eq=False)
class Track:
    """A branch in the units of the kernels.

    Parameters
    ----------
    stops, periods
        Stops that are hit, in their order, in a number of periods of the force.
    points
        Points (theta, weighted sigma) as rows (number, impacts + 1), in the order of the branch.
    names
        Name of each point, as listed above.
    margin, displacement, acceleration, speeds, factors, starts
        Results of `solver.survey` at each point.
    phases
        Phases of the impacts (points, impacts).
    """

    stops: tuple[int, ...]
    periods: int
    points: Matrix
    names: tuple[str, ...]
    margin: Vector
    displacement: Vector
    acceleration: Vector
    speeds: Matrix
    factors: NDArray[np.float64]
    starts: Matrix
    phases: Matrix

    @cached_property
    def sigma(self) -> Vector:
        """Places in the range."""
        return np.asarray(self.points[:, -1] / solver.WEIGHT)

    @cached_property
    def admissible(self) -> NDArray[np.bool_]:
        """Whether there is no further impact, and every impact comes from the free side."""
        slow = self.speeds.min(axis=1, initial=np.inf) >= -TOLERANCE
        fast = self.speeds.max(axis=1, initial=0.0) > FASTEST
        return np.asarray((self.margin >= -TOLERANCE) & slow & ~fast)

    @cached_property
    def multiplier(self) -> Vector:
        """The largest modulus of the multipliers of a period of the regime."""
        return np.asarray(np.abs(np.linalg.eigvals(self.factors)).max(axis=1))

    def regime(self, number: int) -> Regime:
        """The regime at one of the points."""
        return Regime(self.stops, self.periods, self.points[number, :-1], self.sigma[number])

    def with_points(self, places: list[int], others: Track) -> Track:
        """The branch with the points of another track inserted before some of its own."""
        names = list(self.names)
        for shift, (place, name) in enumerate(zip(places, others.names, strict=True)):
            names.insert(place + shift, name)
        mixed = {
            field: np.insert(getattr(self, field), places, getattr(others, field), axis=0)
            for field in MEASURED
        }
        return Track(stops=self.stops, periods=self.periods, names=tuple(names), **mixed)

    def part(self, chosen: slice) -> Track:
        """A part of the branch."""
        fields = {field: getattr(self, field)[chosen] for field in MEASURED}
        return Track(
            stops=self.stops, periods=self.periods, names=self.names[chosen], **fields
        )  # fmt: skip


MEASURED = (
    "points", "margin", "displacement", "acceleration", "speeds", "factors", "starts", "phases",
)  # fmt: skip
"""Fields of a track with a row for each of its points."""


class Finder:
    """Finds the branches of a family at the values of a grid of sigma (rising).

    `most_impacts` bounds the impacts of the orders that Newton's iteration is started with;
    regimes that simulations settle to are followed whatever their number.
    """

    def __init__(
        self, family: Family, grid: Vector, most_impacts: int, deadline: Deadline = NEVER
    ) -> None:
        self.family, self.grid = family, np.ascontiguousarray(grid, dtype=float)
        self.most_impacts, self.deadline = most_impacts, deadline
        self.tracks: list[Track] = []

    def find(self) -> list[Track]:
        """All branches that were found."""
        self.tracks += self._without_impacts()
        chosen = np.linspace(0, len(self.grid) - 1, min(SEED_VALUES, len(self.grid)))
        for number in np.unique(np.round(chosen).astype(int)):
            sigma = float(self.grid[number])
            for seed in itertools.chain(self._simulated(sigma), self._solved(sigma)):
                if self.deadline.passed():
                    return self.tracks
                self._add(seed)
        return self.tracks

    def _add(self, seed: Regime) -> None:
        if not any(_passes(track, seed) for track in self.tracks):
            self.tracks += self._followed(seed)

    # Seeds

    def _solved(self, sigma: float) -> Iterator[Regime]:
        """Regimes with few impacts, by Newton's iteration from many phases."""
        motion = self.motion(sigma)
        random = np.random.default_rng(0)
        for word, periods in self._words():
            count = len(word)
            gaps = random.dirichlet(np.ones(count), STARTS * count**2)
            ends = 2.0 * np.pi * periods * np.cumsum(gaps, axis=1)
            starts = 2.0 * np.pi * random.random((len(gaps), 1)) + np.roll(ends, 1, axis=1)
            starts[:, 0] -= 2.0 * np.pi * periods
            starts = np.concatenate([even_phases(motion, word, periods), starts])
            pattern = pattern_of(word, periods)
            for theta in starts:
                if _settles(motion, pattern, theta):
                    yield Regime(word, periods, theta, sigma).shortest()

    def _words(self) -> list[tuple[tuple[int, ...], int]]:
        """Orders of impacts, each once up to rotation, with their periods; the shortest first."""
        m = self.family.sizes[1]
        found: list[tuple[tuple[int, ...], int]] = [
            ((stop,), periods) for stop in range(m) for periods in SUBHARMONICS
        ]
        found += [((a, b), 3) for a, b in itertools.combinations(range(m), 2)]
        longer = (
            (word, 1)
            for count in range(2, self.most_impacts + 1)
            for word in itertools.product(range(m), repeat=count)
            if word == min(_rotations(word))
        )
        most = max(MOST_WORDS, m * len(SUBHARMONICS))
        return list(itertools.islice(itertools.chain(found, longer), most))

    @cached_property
    def tried(self) -> int:
        """Number of impacts in a period up to which Newton's iteration is started with every order
        of impacts."""
        words = {word for word, periods in self._words() if periods == 1}
        for count in range(1, self.most_impacts + 1):
            orders = itertools.product(range(self.family.sizes[1]), repeat=count)
            if not all(word in words for word in orders if word == min(_rotations(word))):
                return count - 1
        return self.most_impacts

    @property
    def looked_for(self) -> tuple[str, str]:
        """A sentence on how regimes are looked for, and a warning where few orders of impacts are
        tried."""
        most = f"{self.tried} impact{'s' if self.tried > 1 else ''}"
        how = (
            "regimes are looked for by simulations and from many phases of all orders of up to "
            f"{most} in a period; one that neither meets is not found"
        )
        if self.tried >= min(self.family.sizes[1], DEFAULT_IMPACTS):
            return how, ""
        remedy = "; raise most_impacts (--impacts)" if self.tried == self.most_impacts else ""
        return how, (
            f"regimes of more than {most} in a period are looked for by simulations, which meet no "
            f"unstable one, and in few orders{remedy}"
        )

    def _simulated(self, sigma: float) -> Iterator[Regime]:
        """Regimes that simulations settle to, from rest and from motions of some sizes."""
        motion = self.motion(sigma)
        for start in self.starts():
            if self.deadline.passed():
                return
            settled = self.simulate(sigma, start)
            if settled is not None and (found := settled.regime(motion, sigma)) is not None:
                yield found

    def simulate(
        self, sigma: float, state: Vector, phase: float = 0.0, periods: int = SETTLING
    ) -> Settled | None:
        """A motion at a place of the range, by default until it has settled; None where impacts
        come too fast to be followed."""
        return simulate(self.motion(sigma), state, periods, phase)

    def end_of(self, track: Track, number: int) -> tuple[Vector, float]:
        """A state of a regime, and the phase of the force at which it has it."""
        phase = float(track.phases[number, 0]) if track.stops else 0.0
        return track.starts[number], phase

    def reaches(self, settled: Settled, sigma: float) -> Callable[[Track, int], bool]:
        """Whether a simulated motion has settled to a point of a branch with impacts."""
        regime = settled.regime(self.motion(sigma), sigma)
        return lambda track, number: regime is not None and track.regime(number).same(regime)

    def amplitude(self, track: Track) -> Vector:
        """Amplitude of the first harmonic of the output, in units of the kernels."""
        flat = self.family.flat(track.sigma)
        return amplitudes(
            flat, self.family.sizes, track.stops, track.periods, track.phases, track.speeds
        )

    def starts(self) -> Matrix:
        """States (number, 2 n) from which simulations start: rest, and speeds of the pairs."""
        n, m, _ = self.family.sizes
        motion = self.motion(0.5)
        found = [np.zeros(2 * n)]
        for stop, speed in itertools.product(range(m), (0.3, 1.0, 3.0)):
            row = motion.rows[stop]
            state = np.zeros(2 * n)
            state[n:] = speed * motion.omega * row / (row @ row)
            found.append(state)
        return np.array(found[: 1 + 8])

    def motion(self, sigma: float) -> solver.Motion:
        """The motion at a place of the range."""
        motion: solver.Motion = solver.motion_at(self.family.expansion, sigma)
        return motion

    # Branches

    def _without_impacts(self) -> list[Track]:
        """The motion without impacts, over the grid."""
        points = solver.WEIGHT * self.grid[:, None]
        track = self.inspected((), 1, points, [POINT] * len(points))
        # a loose mass, or resonance without damping: there is no such motion, or no single one
        if not np.all(known := _determined(track)):
            if not np.any(known):
                return []
            points = points[known]
            track = self.inspected((), 1, points, [POINT] * len(points))
        return self._trimmed(self._located(track))

    def _followed(self, seed: Regime) -> list[Track]:
        pattern = pattern_of(seed.stops, seed.periods)
        branch = Continuation(self.family.expansion, pattern, self.grid)
        named = {GRID: POINT, continuation.FOLD: FOLD, VANISHED: GRAZING}
        parts: list[tuple[Matrix, list[str]]] = []
        for direction in (1.0, -1.0):
            u = np.append(seed.theta, solver.WEIGHT * seed.sigma)
            followed = branch.follow(u, direction)
            parts.append((followed.points, [named[kind] for kind in followed.kinds]))
            if followed.closed:
                break
        (points, names), *other = parts
        middle = np.append(seed.theta, solver.WEIGHT * seed.sigma)[None]
        points, names = np.concatenate([middle, points]), [POINT, *names]
        if other:
            before, before_names = other[0]
            points = np.concatenate([before[::-1], points])
            names = [*before_names[::-1], *names]
        track = self.inspected(seed.stops, seed.periods, points, names)
        return self._trimmed(self._located(track))

    def inspected(
        self, stops: tuple[int, ...], periods: int, points: Matrix, names: Sequence[str]
    ) -> Track:
        """The branch of some points, surveyed; NaN where there is no regime."""
        number, n = len(points), self.family.sizes[0]
        found, speeds = np.full((number, 3), np.nan), np.full((number, len(stops)), np.nan)
        factors, starts = np.full((number, 2 * n, 2 * n), np.nan), np.full((number, 2 * n), np.nan)
        pattern = pattern_of(stops, periods)
        for row, point in enumerate(points):
            motion = self.motion(point[-1] / solver.WEIGHT)
            theta = point[:-1] if stops else np.zeros(1)
            states = states_of(motion, pattern, theta)
            if states is None:
                continue
            starts[row] = states[0]
            speeds[row] = [
                solver.distance_of(motion, stop, state)[1]
                for stop, state in zip(stops, states, strict=False)
            ]
            *found[row], factors[row] = solver.survey(motion, pattern, theta, states)
        margin, displacement, acceleration = found.T
        return Track(
            stops, periods, points, tuple(names), margin, displacement, acceleration, speeds,
            factors, starts, points[:, :-1],
        )  # fmt: skip

    def _at(self, track: Track, share: float, number: int) -> Matrix | None:
        """The point of a branch on the plane across the chord to the next point; None without."""
        start, end = track.points[number], track.points[number + 1]
        u, normal = start + share * (end - start), end - start
        if len(track.stops):
            pattern = pattern_of(track.stops, track.periods)
            branch = Continuation(self.family.expansion, pattern, self.grid)
            place = branch.corrected(u, normal / np.linalg.norm(normal))
            if place is None:
                return None
            u = place.u
        return np.asarray(u[None])

    def _located(self, track: Track) -> Track:
        """The branch with its grazings and changes of stability among its points."""
        inserted: list[tuple[int, Matrix, str]] = []
        for name, test in TESTS.items():
            values = test(track)
            for number in np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0):
                ends = track.names[number], track.names[number + 1]
                if (name == BREAKING and FOLD in ends) or (name == GRAZING and GRAZING in ends):
                    continue
                if (point := self._root(track, int(number), test)) is not None:
                    inserted.append((int(number), point, name))
        if not inserted:
            return track
        inserted.sort(key=lambda each: each[0])
        places = [number + 1 for number, _, _ in inserted]
        points = np.concatenate([point for _, point, _ in inserted])
        names = [name for _, _, name in inserted]
        return track.with_points(places, self.inspected(track.stops, track.periods, points, names))

    def _root(self, track: Track, number: int, test: Callable[[Track], Vector]) -> Matrix | None:
        """Where a test of a branch changes its sign between two of its points."""

        def value(share: float) -> float:
            point = self._at(track, share, number)
            if point is None:
                raise ArithmeticError
            at = self.inspected(track.stops, track.periods, point, [POINT])
            return float(test(at)[0])

        try:
            share = brentq(value, 0.0, 1.0, xtol=1e-13, rtol=1e-13)
        except (ArithmeticError, ValueError):
            return None
        return self._at(track, float(share), number)

    @staticmethod
    def _trimmed(track: Track) -> list[Track]:
        """The branch from its first admissible point to its last; none where there is none."""
        good = np.flatnonzero(track.admissible)
        if not len(good):
            return []
        return [track.part(slice(max(good[0] - 1, 0), good[-1] + 2))]


def _determined(track: Track) -> NDArray[np.bool_]:
    """Whether the force determines the motion without impacts: no multiplier is 1. Without damping
    one is where the natural frequency is a multiple of that of the force; two are of a free body,
    which rounding moves apart by its square root, but not the singular values."""
    whole = np.all(np.isfinite(track.factors), axis=(1, 2))
    factors = np.where(whole[:, None, None], track.factors, 0.0)
    away = np.linalg.svd(factors - np.eye(factors.shape[1]), compute_uv=False)
    return np.asarray(whole & (away.min(axis=1) > FREE))


def _breaking(track: Track) -> Vector:
    return np.asarray(np.linalg.det(track.factors - np.eye(track.factors.shape[1])))


def _doubling(track: Track) -> Vector:
    return np.asarray(np.linalg.det(track.factors + np.eye(track.factors.shape[1])))


def _torus(track: Track) -> Vector:
    """The largest modulus of complex multipliers, less 1; 0 where it is 1 but for rounding, as
    everywhere without damping and loss."""
    values = np.linalg.eigvals(track.factors)
    complex_ = np.abs(values.imag) > 1e-9 * np.abs(values)
    beyond = np.where(complex_, np.abs(values), 0.0).max(axis=1) - 1.0
    return np.asarray(np.where(np.abs(beyond) > TOLERANCE, beyond, 0.0))


def _margin(track: Track) -> Vector:
    return np.where(np.isfinite(track.margin), track.margin, 1.0)


TESTS: dict[str, Callable[[Track], Vector]] = {
    GRAZING: _margin, DOUBLING: _doubling, BREAKING: _breaking, TORUS: _torus
}  # fmt: skip
"""A number that changes its sign along a branch at each kind of special point; folds are located
while a branch is followed."""


def _rotations(word: tuple[int, ...]) -> list[tuple[int, ...]]:
    return [word[first:] + word[:first] for first in range(len(word))]


def _settles(motion: solver.Motion, pattern: solver.Pattern, theta: Vector) -> bool:
    """Whether Newton's iteration, in the place of theta, ends at a regime that has no further
    impact, and none that is too slow or too soon followed by another."""
    states = np.empty((len(theta), 2 * motion.rows.shape[1]))
    return bool(
        solver.settle(motion, pattern, theta, states)
        and solver.slowest(motion, pattern, theta, states) > SLOWEST
        and solver.survey(motion, pattern, theta, states)[0] >= -TOLERANCE
    )


def _passes(track: Track, seed: Regime) -> bool:
    """Whether a branch goes through a regime."""
    if track.periods != seed.periods or sorted(track.stops) != sorted(seed.stops):
        return False
    here = np.flatnonzero(np.abs(track.sigma - seed.sigma) < 1e-12)
    return any(track.regime(int(number)).same(seed) for number in here)


# Simulation -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Settled:
    """The end of a simulated motion: states after its periods, the phase of the force at which it
    started, its last impacts (phase, stop, speed), and the largest displacement of the last period.
    """

    ends: Matrix
    phase: float
    log: Matrix
    displacement: float

    @property
    def state(self) -> Vector:
        """The last state."""
        return np.asarray(self.ends[-1])

    def period(self, tolerance: float) -> int:
        """Number of periods after which the motion repeats itself; 0 where it does not."""
        last = self.ends[-1]
        size = np.abs(self.ends[-LONGEST - 1 :]).max() or 1.0
        for periods in range(1, min(LONGEST, len(self.ends) - 1) + 1):
            if np.all(np.abs(self.ends[-1 - periods] - last) < tolerance * size):
                return periods
        return 0

    def impacts(self, periods: int) -> Matrix:
        """The impacts of the last periods."""
        end = self.phase + 2.0 * math.pi * (len(self.ends) - 1)
        return self.log[self.log[:, 0] > end - 2.0 * math.pi * periods]

    def regime(self, motion: solver.Motion, sigma: float) -> Regime | None:
        """The regime that the motion settles to; None without impacts, or if it does not repeat."""
        periods = self.period(REPEATS)
        impacts = self.impacts(periods) if periods else np.empty((0, 3))
        if not 0 < len(impacts) <= MOST_SIMULATED:
            return None
        turns = math.floor(impacts[0, 0] / (2.0 * math.pi))
        phases, stops = impacts[:, 0] - 2.0 * math.pi * turns, impacts[:, 1].astype(int).tolist()
        theta = phases.copy()
        settles = _settles(motion, pattern_of(stops, periods), theta)
        if not settles or np.max(np.abs(theta - phases)) > 0.2:
            return None
        return Regime(tuple(stops), periods, theta, sigma).shortest()


def simulate(
    motion: solver.Motion, start: Vector, periods: int, phase: float = 0.0
) -> Settled | None:
    """A motion from a state at a phase of the force, from impact to impact; None where impacts come
    too fast to be followed."""
    ends, log = np.empty((periods + 1, len(start))), np.zeros((MOST_KEPT, 3))
    hits, displacement = solver.march(motion, start, periods, phase, ends, log)
    if hits < 0:
        return None
    kept = log[: min(hits, MOST_KEPT)]
    return Settled(ends, phase, kept[np.argsort(kept[:, 0], kind="stable")], displacement)
