"""Continuation of a branch. Chapters: states of a periodic motion from the phases of its impacts;
impacts even in time; branches as kernels have them; simulation from impact to impact; steps by
length of arc."""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.methods.periodic.family import Numbers, amplitudes
from stochvi.methods.periodic.kernels import solver
from stochvi.methods.periodic.kernels.solver import WEIGHT

# ------------------------------------------------------------------------------
# The states of one periodic regime, from the phases of its impacts.
# ------------------------------------------------------------------------------


def pattern_of(stops: Sequence[int], periods: int) -> solver.Pattern:
    """Impacts on the stops of these numbers, in this order, in periods of the force."""
    return solver.Pattern(np.array(stops, np.int64), periods)


def states_of(motion: solver.Motion, pattern: solver.Pattern, theta: Vector) -> Matrix | None:
    """The states (impacts, 2 n) before impacts at the phases theta, or without impacts the one
    (1, 2 n) at the phase 0; None where there is no such motion, or no single one."""
    count = len(pattern.stops)
    if not count:
        state = unstruck(motion)
        return None if state is None else state[None]
    states, left = np.empty((count, 2 * motion.rows.shape[1])), np.empty(count)
    found = solver.residual(motion, pattern, theta, states, left, np.empty((0, 0)))
    return states if found else None


def unstruck(motion: solver.Motion, phase: float = 0.0) -> Vector | None:
    """The state (2 n,) at a phase of the force of the motion without impacts; None where there is
    none, or no single one."""
    two = 2 * motion.rows.shape[1]
    whole = solver.transition(motion.generator, 2.0 * math.pi / motion.omega)
    w, driven = np.empty(len(whole) - two), np.empty(two)
    solver.force_state(motion, phase, w)
    solver.apply(np.ascontiguousarray(whole[:two, two:]), w, driven)
    state = driven[:, None].copy()
    return state[:, 0] if solver.solve(np.eye(two) - whole[:two, :two], state) else None


# ------------------------------------------------------------------------------
# Regimes whose impacts are even in time: all of them, from the roots of a polynomial.
# ------------------------------------------------------------------------------


NEAR_CIRCLE = 1e-3
"""Distance from the unit circle up to which a root counts as a phase; at a grazing two roots meet
on it."""

TOLERANCE = 1e-9
"""Depth to which a regime may pass a stop, relative to the unit of length; rounding error stays
below it."""

NOTHING = 1e-13
"""Distance at the first impact, relative to the gap, up to which it counts as zero; rounding error
stays below it."""


ROOT_STEPS = 20_000
"""Largest number of steps of a period, so that a regime takes fractions of a second."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EvenRegime:
    """A periodic motion whose impacts are even in time (SI units).

    Parameters
    ----------
    phase
        Phases of the force at the impacts, rad.
    displacement, velocity
        The coordinates just before the first impact.
    impact_speed
        Incident speeds.
    amplitude
        Amplitude of the first harmonic of the output, m.
    multiplier
        Largest modulus of the factors of small perturbations over the period of the regime.
    admissible
        Whether it meets no stop besides these impacts.
    """

    phase: Vector
    displacement: Vector
    velocity: Vector
    impact_speed: Vector
    amplitude: float
    multiplier: float
    admissible: bool


def even_phases(motion: solver.Motion, stops: Sequence[int], periods: int) -> Matrix:
    """Phases (number, impacts) at which impacts evenly in time meet the first stop.

    The distance at the first impact is a sum of harmonics of its phase, so that all its roots are
    known: all regimes of one impact, and the symmetric ones of two between equal stops.
    """
    waves = _waves(motion, stops, periods)
    if not np.all(np.isfinite(waves)) or not np.any(waves[:-1]):
        return np.empty((0, len(stops)))
    roots = np.roots(waves)
    first = np.angle(roots[np.abs(np.abs(roots) - 1.0) < NEAR_CIRCLE])
    return np.asarray(first[:, None] + _apart(stops, periods))


def even_regimes(numbers: Numbers, stops: Sequence[int], periods: int = 1) -> list[EvenRegime]:
    """The regimes with impacts on the given stops, in this order and even in time, the fastest
    first. Those of several impacts are symmetric between equal stops."""
    units, length, duration = numbers.units()
    motion, shapes = numbers.motion(units), numbers.shapes / units.shapes
    steps = 2.0 * math.pi * periods / motion.omega / solver.step_of(motion)
    if not 0.0 < steps <= ROOT_STEPS:
        raise ValueError(
            f"a period of omega must take at most {ROOT_STEPS} steps, got {steps:.3g}; ask for a "
            "higher frequency"
        )
    pattern, speed, n = pattern_of(stops, periods), length / duration, len(shapes)
    states = np.empty((len(stops), 2 * n))
    found = []
    for theta in even_phases(motion, stops, periods):
        if not solver.settle(motion, pattern, theta, states):
            continue
        rows = motion.rows[pattern.stops]
        speeds = speed * np.einsum("ki,ki->k", rows, states[:, n:])
        if not speeds.min() > 0.0:
            continue
        margin, _, _, factors = solver.survey(motion, pattern, theta, states)
        (amplitude,) = amplitudes(
            numbers.flat[None], numbers.sizes, stops, periods, theta[None], speeds[None]
        )
        found.append(
            EvenRegime(
                phase=theta,
                displacement=length * shapes @ states[0, :n],
                velocity=speed * shapes @ states[0, n:],
                impact_speed=speeds,
                amplitude=float(amplitude),
                multiplier=float(np.abs(np.linalg.eigvals(factors)).max()),
                admissible=bool(margin >= -TOLERANCE),
            )
        )
    return sorted(found, key=lambda each: -float(each.impact_speed[0]))


def widest(numbers: Numbers, stops: Sequence[int], periods: int = 1) -> float:
    """Factor by which all gaps may grow until no phase of one sine is left for such impacts, where
    no constant force acts; infinite where nothing is lost."""
    units, length, _ = numbers.units()
    motion = numbers.motion(units)
    first, mean, _ = np.abs(_waves(motion, stops, periods))
    reach = float(np.max(np.abs(numbers.distances))) / length
    return float(2.0 * first / mean) if mean > NOTHING * reach else math.inf


def _apart(stops: Sequence[int], periods: int) -> Vector:
    """Phases between the first impact and each other one."""
    return np.asarray(2.0 * np.pi * periods / len(stops) * np.arange(len(stops)))


def _waves(motion: solver.Motion, stops: Sequence[int], periods: int) -> NDArray[np.complex128]:
    """Coefficients of e^(i k phase) of the distance at the first impact, from the highest k to the
    lowest; NaN where phases leave the motion undetermined."""
    count, n = len(stops), motion.rows.shape[1]
    samples = len(motion.generator) - 2 * n
    pattern, apart = pattern_of(stops, periods), _apart(stops, periods)
    states, left, none = np.empty((count, 2 * n)), np.empty(count), np.empty((0, 0))
    distances = np.full(samples, np.nan)
    for number in range(samples):
        theta = 2.0 * np.pi * number / samples + apart
        if not solver.residual(motion, pattern, theta, states, left, none):
            break
        distances[number] = left[0]
    return np.asarray(np.fft.fftshift(np.fft.fft(distances))[::-1] / samples)


# ------------------------------------------------------------------------------
# Branches of periodic regimes, as the kernels have them.
# ------------------------------------------------------------------------------


SAME = 1e-6
"""Difference of phases, rad, or of states up to which two regimes are one."""

ROUNDING = 1e-12
"""Difference of places up to which they are one."""

FASTEST = 1e6
"""Impact speed, in the units of the kernels, above which a solution is rounding: the phases of its
impacts leave the motion undetermined."""

STAYS = 1.0 + 1e-6
"""Largest multiplier of a motion in which a flight can end."""


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
        Points u of a branch as rows, in its order: phases of the impacts, or the state at the phase
        0, and the weighted sigma.
    names
        Name of each point, as of `continuation`.
    margin, displacement, acceleration, speeds, factors, starts
        Results of `solver.survey` at each point.
    phases
        Phases of the impacts (points, impacts).
    by_state
        Whether points hold states.
    rests
        Stops that are rested on for a part of the period.
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
    by_state: bool = False
    rests: tuple[int, ...] = ()

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
        """The largest modulus of the multipliers of a period of the regime; infinite where an
        impact of speed 0 leaves no derivative, as at the end of a branch that grazes."""
        whole = np.asarray(np.isfinite(self.factors).all(axis=(1, 2)))
        found = np.full(len(whole), np.inf)
        found[whole] = np.abs(np.linalg.eigvals(self.factors[whole])).max(axis=1)
        if self.rests:
            # rounding decides on which side of the end the factors were taken
            found[[name == GRAZING for name in self.names]] = np.inf
        return found

    @cached_property
    def lasting(self) -> NDArray[np.bool_]:
        """Whether a flight can end there."""
        return np.asarray(self.admissible & (self.multiplier < STAYS))

    def state(self, number: int) -> tuple[Vector, float]:
        """A state of the motion at one of the points, and the phase of the force at which it has
        it."""
        if self.by_state:
            return self.points[number, :-1], 0.0
        return self.starts[number], float(self.phases[number, 0]) if self.stops else 0.0

    def around(self, sigma: float) -> Iterator[tuple[int, Vector]]:
        """Each place where the branch passes a value: the number of the point before it, and the
        point of the chord to the next."""
        away = self.sigma - sigma
        # a regime from which the branch was followed is one of its points but for rounding
        away[np.abs(away) < ROUNDING] = 0.0
        for number in np.flatnonzero((away[:-1] * away[1:] <= 0.0) & (away[:-1] != away[1:])):
            share = away[number] / (away[number] - away[number + 1])
            start, end = self.points[number], self.points[number + 1]
            u = start + share * (end - start)
            u[-1] = solver.WEIGHT * sigma
            yield int(number), u
        if len(away) == 1 and away[0] == 0.0:
            yield 0, self.points[0].copy()

    def with_points(self, places: list[int], others: Track) -> Track:
        """The branch with the points of another track inserted before some of its own."""
        names = list(self.names)
        for shift, (place, name) in enumerate(zip(places, others.names, strict=True)):
            names.insert(place + shift, name)
        mixed = {
            field: np.insert(getattr(self, field), places, getattr(others, field), axis=0)
            for field in MEASURED
        }
        return replace(self, names=tuple(names), **mixed)

    def part(self, chosen: slice | NDArray[np.bool_]) -> Track:
        """A part of the branch."""
        fields = {field: getattr(self, field)[chosen] for field in MEASURED}
        names = tuple(np.array(self.names, dtype=object)[chosen])
        return replace(self, names=names, **fields)


MEASURED = (
    "points", "margin", "displacement", "acceleration", "speeds", "factors", "starts", "phases",
)  # fmt: skip
"""Fields of a track with a row for each of its points."""


class OnBranch(NamedTuple):
    """A regime of a branch, between one of its points and the next."""

    track: Track
    number: int


# ------------------------------------------------------------------------------
# Motions by simulation from impact to impact, and the regimes that they settle to.
# ------------------------------------------------------------------------------


SETTLING = 300
"""Number of periods that a simulation runs before its motion counts as settled."""

LONGEST = 8
"""Largest number of periods in which a simulated motion is looked at for repeating itself."""

REPEATS = 1e-3
"""Difference of states a period apart, relative to the motion, from which Newton's iteration
finds the regime that a simulation approaches."""

MOST_KEPT = 4096
"""Number of last impacts that a simulation keeps: more than it follows in a period."""

MOST_SIMULATED = 24
"""Largest number of impacts of a regime that Newton's iteration takes from a simulation."""


class FinalMotion(NamedTuple):
    """A simulated motion: `ends`, the states after its periods, and the phase of the force at which
    it started. `log` holds its last impacts and releases: phase, stop or -1 less the stop, speed,
    and the state where the flow gives it. Then come the largest displacement and acceleration of
    the last period, and the stop that is rested on, or FREE. The flow also gives the amplitude of
    the first harmonic, and the factors of small perturbations.
    """

    ends: Matrix
    phase: float
    log: Matrix
    displacement: float
    acceleration: float = 0.0
    resting: int = solver.FREE
    amplitude: float = math.nan
    factors: Matrix = np.empty((0, 0))

    @property
    def state(self) -> Vector:
        """The last state."""
        return np.asarray(self.ends[-1])

    def period(self, tolerance: float) -> int:
        """Number of periods after which the motion repeats itself; 0 where it does not."""
        last = self.ends[-1]
        # all states of a motion that rests on a stop at this phase may be 0
        size = max(np.abs(self.ends[-LONGEST - 1 :]).max(), self.displacement) or 1.0
        for periods in range(1, min(LONGEST, len(self.ends) - 1) + 1):
            if np.all(np.abs(self.ends[-1 - periods] - last) < tolerance * size):
                return periods
        return 0

    def _last(self, periods: int) -> Matrix:
        end = self.phase + 2.0 * math.pi * (len(self.ends) - 1)
        return self.log[self.log[:, 0] > end - 2.0 * math.pi * periods]

    def impacts(self, periods: int) -> Matrix:
        """The impacts of the last periods."""
        last = self._last(periods)
        return last[last[:, 1] >= 0.0]

    def rests(self, periods: int) -> tuple[int, ...]:
        """The stops that are rested on in the last periods."""
        last = self._last(periods)[:, 1]
        found = {int(-1 - stop) for stop in last[last < 0.0]}
        return tuple(sorted(found | ({self.resting} - {solver.FREE})))


def simulate(
    motion: solver.Motion, start: Vector, periods: int, phase: float = 0.0
) -> FinalMotion | None:
    """A motion from a state at a phase of the force, from impact to impact; None where impacts come
    too fast to be followed."""
    ends, log = np.empty((periods + 1, len(start))), np.zeros((MOST_KEPT, 3))
    hits, displacement, acceleration, resting = solver.march(
        motion, start, periods, phase, ends, log
    )
    if hits < 0:
        return None
    kept = log[: min(hits, MOST_KEPT)]
    kept = kept[np.argsort(kept[:, 0], kind="stable")]
    return FinalMotion(ends, phase, kept, displacement, acceleration, resting)


# ------------------------------------------------------------------------------
# A branch of periodic regimes, followed by length of arc from one of its regimes.
#
# A point of a branch is u = (x, WEIGHT sigma): what tells regimes at one place of the range apart
# (the phases of their impacts, or a state), and the parameter. Steps go along the tangent, and
# Newton's iteration takes each back to the branch. The values at which a branch is drawn change
# nothing of its course: the regimes there are added between its own points.
# ------------------------------------------------------------------------------


POINT, NODE, FOLD, GRAZING, DOUBLING, PITCHFORK, NEIMARK_SACKER, STICKING = (
    "", "node", "fold", "grazing", "period doubling", "symmetry breaking", "torus", "sticking",
)  # fmt: skip
"""Names of points of a branch: at a value that was asked for; between those; where the branch turns
back; where an impact vanishes or a further one appears; where a multiplier is -1; where a
multiplier is 1 and the branch goes on; where a pair of complex multipliers has the modulus 1;
where rests on a stop begin or end."""

MOST_STEPS = 5_000
"""Largest number of steps along a branch, good or not."""

FIRST_STEP, SHORTEST_STEP, LONGEST_STEP = 0.02, 1e-7, 0.4
"""First, smallest and largest length of arc of a step."""

LONGEST_SHARE = 0.01
"""Largest length of arc of a step as a share of the largest number of a state, where that is more:
near a lightly damped resonance states are thousands of units, and a branch turns with their
phase."""

CORNER = (1e-5, 1e-4, 1e-3)
"""Lengths of steps by which a branch is continued where it has a corner."""

TURN = 0.97
"""Smallest cosine of the angle between the tangents at two successive points of a branch."""

HALVINGS = 50
"""Number of halvings of a step in which a special point is located: rounding is reached."""

BESIDE = 0.25
"""Largest distance of a regime from the chord between two points of its branch, in lengths of the
chord: one that is farther away belongs to another branch."""

CALM = 2
"""Number of short steps after one that has failed whose length is halved, too: a corner of a branch
is come to by bisection."""

APART = 0.5
"""A branch comes back to a regime at least such a length of arc after it has passed it."""

MET = 1e-7
"""Largest difference of points that are one regime."""

MOST_GROWTH = 1e4
"""A branch is followed as long as small perturbations of its regimes grow by no more than this. No
motion stays near such a regime, and it takes ever smaller steps to find the next one."""

PARTS = 64
"""Largest number of parts of a chord into which it is divided until regimes lie beside it."""


class BranchPlace(NamedTuple):
    """A regime of a branch: its point u and the tangent there, and its smallest impact speed, or
    its shortest flight if that is less. Small perturbations grow by `growth` in its periods."""

    u: Vector
    tangent: Vector
    slowest: float
    growth: float = 0.0


class Problem(Protocol):
    """The equations of a branch."""

    def corrected(self, u: Vector, normal: Vector) -> BranchPlace | None:
        """The regime on the plane through u with a normal; None where Newton's iteration fails."""

    def settled(self, u: Vector) -> Vector | None:
        """The regime near u at its own place of the range; None where there is none."""

    def difference(self, points: Matrix, u: Vector) -> Matrix:
        """How far each of some points lies from u."""

    def images(self, u: Vector) -> Matrix:
        """All points of the regime at u, this one first: a regime starts at each of its periods."""


class BranchPoints(NamedTuple):
    """Points (number, size of u) of a branch in its order, and their names."""

    points: Matrix
    names: list[str]


class Continuation:
    """A branch from one of its regimes on.

    Parameters
    ----------
    problem
        The equations of the branch.
    drawn
        Rising values of WEIGHT sigma at which regimes are asked for.
    reach
        Largest change of WEIGHT sigma in a step.
    given_up
        Asked after each step: whether to end there.
    """

    def __init__(
        self, problem: Problem, drawn: Vector, reach: float, given_up: Callable[[], bool]
    ) -> None:
        self.problem, self.drawn, self.reach, self.given_up = problem, drawn, reach, given_up

    def through(self, u: Vector, name: str, known: Matrix) -> BranchPoints:
        """The branch through a regime, in both directions, until it leaves the range or an impact
        vanishes. It also ends at a regime that is `known`, or that it has passed."""
        points, names, closed = self._from(u, 1.0, known)
        passed = [known, *(self.problem.images(each) for each in points)]
        before, names_before, _ = (
            ([], [], True) if closed else self._from(u, -1.0, np.concatenate(passed))
        )
        return BranchPoints(
            np.array([*before[::-1], u, *points]), [*names_before[::-1], name, *names]
        )  # fmt: skip

    def _from(
        self, u: Vector, direction: float, known: Matrix
    ) -> tuple[list[Vector], list[str], bool]:
        """Points of a branch, the parameter first in a direction, with their names, and whether it
        has closed."""
        points, names = list[Vector](), list[str]()
        images = self.problem.images(u)
        # the regimes that were passed, the length of arc at each, and their other images
        passed, lengths, others = images[:1], [0.0], np.concatenate([known, images[1:]])

        def add(name: str, *found: Vector) -> None:
            points.extend(found)
            names.extend([name] * len(found))

        last = self.problem.corrected(u, np.append(np.zeros(len(u) - 1), 1.0))
        if last is None:
            return points, names, False
        if last.tangent[-1] * direction < 0.0:
            last = last._replace(tangent=-last.tangent)
        step, length, calm = FIRST_STEP, 0.0, CALM
        for _ in range(MOST_STEPS):
            if self.given_up():
                break
            step = min(step, self.reach / max(abs(last.tangent[-1]), 1e-12))
            place = self._ahead(last, step)
            if place is None or place.tangent @ last.tangent < TURN:
                step, calm = 0.5 * step, 0
                if step < SHORTEST_STEP:
                    corner = self._round(last)
                    if corner is None:
                        break
                    add(NODE, corner.u)
                    last, step, calm = corner, FIRST_STEP, CALM
                continue
            length += step
            if not place.slowest > 0.0:
                end = self._bisected(last, step, lambda each: each.slowest > 0.0)[0]
                add(POINT, *self.between(last.u, end))
                add(GRAZING, end)
                break
            back = passed[: bisect.bisect_left(lengths, length - APART)]
            met = self._met(last.u, place.u, np.concatenate([back, others]))
            place = met or place
            images = self.problem.images(place.u)
            passed, others = np.vstack([passed, images[:1]]), np.vstack([others, images[1:]])
            lengths.append(length)
            begin = last.u
            if place.tangent[-1] * last.tangent[-1] < 0.0:
                turn = self._bisected(last, step, _rising(last.tangent[-1]))[1]
                # where a branch doubles its period the equations are singular, and may lead astray
                if _from_chord(place.u - last.u, (turn - last.u)[None])[1] < BESIDE:
                    begin = turn
                    add(POINT, *self.between(last.u, begin))
                    add(FOLD, begin)
            add(POINT, *self.between(begin, place.u))
            if not 0.0 <= place.u[-1] <= WEIGHT:
                break
            add(NODE, place.u)
            if place.growth > MOST_GROWTH:
                break
            if met is not None:
                away = self.problem.difference(u[None], met.u)
                return points, names, bool(np.abs(away).max() < MET)
            last = place
            calm += 1
            careful = calm <= CALM and step < CORNER[-1]
            longest = max(LONGEST_STEP, LONGEST_SHARE * float(np.abs(place.u).max()))
            step = min((0.5 if careful else 1.5) * step, longest)
        return points, names, False

    def _met(self, start: Vector, end: Vector, earlier: Matrix) -> BranchPlace | None:
        """The first of some regimes through which a step of the branch leads; None if none.

        Without it a loop would be followed again and again. Beyond a period doubling the branch
        has the regimes that it had before, a period later.
        """
        way = end - start
        along, beside = _from_chord(way, self.problem.difference(earlier, start))
        close = np.flatnonzero((along > 0.0) & (along <= 1.0) & (beside < BESIDE))
        for number in close[np.argsort(along[close])]:
            normal = way / np.linalg.norm(way)
            place = self.problem.corrected(start + along[number] * way, normal)
            if place is None:
                continue
            if np.abs(self.problem.difference(earlier[number][None], place.u)).max() < MET:
                return place
        return None

    def _ahead(self, last: BranchPlace, step: float) -> BranchPlace | None:
        """The regime a step ahead, its tangent in the same sense."""
        place = self.problem.corrected(last.u + step * last.tangent, last.tangent)
        if place is None or place.tangent @ last.tangent >= 0.0:
            return place
        return place._replace(tangent=-place.tangent)

    def _round(self, last: BranchPlace) -> BranchPlace | None:
        """The regime beyond a corner of a branch, as where a contact begins: there it goes on in
        another direction, or turns back."""
        back = last.tangent * np.append(np.ones(len(last.u) - 1), -1.0)
        for step, way in itertools.product(CORNER, (last.tangent, back)):
            place = self.problem.corrected(last.u + step * way, way)
            if place is None or not place.slowest > 0.0:
                continue
            gone = place.u - last.u
            if np.linalg.norm(gone) > 2.0 * step or not 0.0 <= place.u[-1] <= WEIGHT:
                continue
            ahead = place.tangent if place.tangent @ gone > 0.0 else -place.tangent
            # the branch that it came by would be found, too
            if way is last.tangent or ahead @ last.tangent > -TURN:
                return place._replace(tangent=ahead)
        return None

    def _bisected(
        self, last: BranchPlace, step: float, before: Callable[[BranchPlace], bool]
    ) -> tuple[Vector, Vector]:
        """The last point of a step before a condition changes, and the last one that was tried."""
        low, high, end, tried = 0.0, 1.0, last.u, last.u
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            place = self._ahead(last, middle * step)
            if place is not None:
                tried = place.u
            if place is not None and before(place):
                low, end = middle, place.u
            else:
                high = middle
        return end, tried

    def between(self, start: Vector, end: Vector, parts: int = PARTS) -> list[Vector]:
        """The regimes at the values that are drawn between two points of a branch, if they lie
        close to the chord; else those of the two halves of the chord."""
        way, values = end - start, self.drawn
        if way[-1] >= 0.0:
            inside = values[np.searchsorted(values, start[-1], "right") :]
            inside = inside[: np.searchsorted(inside, end[-1], "right")]
        else:
            inside = values[np.searchsorted(values, end[-1], "left") :]
            inside = inside[: np.searchsorted(inside, start[-1], "left")][::-1]
        found, limit = list[Vector](), BESIDE * float(np.linalg.norm(way)) + 1e-9
        for value in inside:
            guess = start + (value - start[-1]) / way[-1] * way
            guess[-1] = value
            place = self.problem.settled(guess)
            if place is not None and np.linalg.norm(place - guess) < limit:
                found.append(place)
        if len(found) < len(inside) and parts > 1:
            middle = self.problem.corrected(start + 0.5 * way, way / np.linalg.norm(way))
            if middle is not None:
                halves = (start, middle.u), (middle.u, end)
                return [each for a, b in halves for each in self.between(a, b, parts // 2)]
        return found


def _from_chord(chord: Vector, gone: Matrix) -> tuple[Vector, Vector]:
    """How far points lie along a chord from its start, and how far beside it, in its lengths."""
    along = gone @ chord / (chord @ chord)
    return along, np.linalg.norm(gone - along[:, None] * chord, axis=1) / np.linalg.norm(chord)


def _rising(way: float) -> Callable[[BranchPlace], bool]:
    """Whether the parameter goes the same way at a regime."""
    return lambda place: bool(place.tangent[-1] * way > 0.0)


def root(
    problem: Problem, start: Vector, end: Vector, test: Callable[[Vector], float],
    values: tuple[float, float],
) -> Vector:  # fmt: skip
    """The point between two points of a branch at which a test, of which the values there are
    known, changes its sign.

    The chord shrinks to the root, so that the iteration starts ever closer to the branch: where a
    second branch crosses, its equations are singular at the very point that is looked for.
    """
    low, high, below, above = start, end, *values
    for turn in range(HALVINGS):
        way = high - low
        length = float(np.linalg.norm(way))
        if length < 1e-13:
            break
        # false position, and each third time the middle, so that both ends move
        share = 0.5 if turn % 3 == 2 or below == above else below / (below - above)
        share = min(max(share, 1e-3), 1.0 - 1e-3)
        place = problem.corrected(low + share * way, way / length)
        if place is None or np.linalg.norm(place.u - low - share * way) > BESIDE * length + 1e-12:
            break
        value = test(place.u)
        if value == 0.0:
            return place.u
        if (value < 0.0) == (below < 0.0):
            low, below = place.u, value
        else:
            high, above = place.u, value
    return low + below / (below - above) * (high - low)
