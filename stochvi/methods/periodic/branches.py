"""Branches of periodic motions between rigid stops. Chapters: motions that rest on a stop, followed
by simulation; branches by Newton's iteration, with their special points."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.methods.periodic import continuation
from stochvi.methods.periodic.continuation import (
    DOUBLING,
    FOLD,
    GRAZING,
    MOST_SIMULATED,
    NEIMARK_SACKER,
    NODE,
    PITCHFORK,
    POINT,
    REPEATS,
    ROUNDING,
    STICKING,
    TOLERANCE,
    Continuation,
    FinalMotion,
    OnBranch,
    Problem,
    Regime,
    Track,
    even_phases,
    pattern_of,
    simulate,
    states_of,
)
from stochvi.methods.periodic.family import Family, amplitudes
from stochvi.methods.periodic.kernels import flights, solver
from stochvi.results.deadline import NEVER, Deadline
from stochvi.sampling.workers import leave_out_of_budgets

# ------------------------------------------------------------------------------
# Regimes in which a mass rests on a stop for a part of the period: followed by flights.
#
# Chatter that ends at rest has no finite order of impacts. While a mass rests it forgets where it
# came from, so a flight settles within a few periods. The flight at each place of the range starts
# from the motion at the last. Successive impacts on one stop count as one, of the speed of the
# fastest.
# ------------------------------------------------------------------------------


EXACT, COARSE = 1e-7, 1e-4
"""Difference of states a period apart, relative to the motion. Up to the first it repeats itself:
chatter ends where impacts have 1e-9 of the fastest speed. Above the second it does not repeat
itself after fewer periods."""

RESTS_LOOKED_AT, RESTS_LOOKS = 16, 12
"""Smallest number of periods of a flight between two values, and how often it goes on until it
repeats itself."""

STEP = 0.01
"""Largest relative change of the varied number between two flights."""

NEAR = 0.3
"""Largest change of a state between two flights, relative to the motion, on one branch."""

SAME = 1e-4
"""Difference of states, relative to the motion, up to which two motions are one."""

SHORT = 0.02
"""Duration of a rest, rad, up to which a branch ends because the rest does."""

SHORTEST, MOST_IN_VAIN = 1e-4, 6
"""Smallest relative change of the varied number over a branch, and number of shorter ones after
which no more are followed: where nothing is damped a motion repeats itself by chance."""

HALVINGS = 16
"""Number of halvings by which the end of a branch is located."""

STILL = 1e-7
"""Impact speed, in the units of the kernels, up to which an impact is a rest that goes on."""


class RestRun(NamedTuple):
    """A motion that repeats itself.

    Parameters
    ----------
    ends
        The states at the phase 0, after each of its periods.
    rests, rest
        The stops that are rested on, and the shortest rest, rad.
    stops, phases, speeds
        Runs of impacts on one stop each: the stop, and phase and speed of the fastest.
    displacement, acceleration
        Largest ones of the output.
    """

    ends: Matrix
    rests: tuple[int, ...]
    rest: float
    stops: tuple[int, ...]
    phases: Vector
    speeds: Vector
    displacement: float
    acceleration: float

    @property
    def size(self) -> float:
        """The size of the motion; all its states at the phase 0 may be 0."""
        return max(float(np.abs(self.ends).max()), self.displacement) or 1.0

    @property
    def kind(self) -> tuple[object, ...]:
        """Numbers that stay the same along a branch."""
        return len(self.ends), self.rests, sorted(self.stops)


class Rests:
    """The branches of regimes with rests, as they become known.

    Parameters
    ----------
    motion_at
        The motion at a place of the range.
    drawn
        Rising places at which regimes are asked for.
    span
        Relative change of the varied number over the range.
    deadline
        Moment at which branches end.
    """

    def __init__(
        self, motion_at: Callable[[float], solver.Motion], drawn: Vector, span: float,
        deadline: Deadline,
    ) -> None:  # fmt: skip
        self.motion_at, self.drawn, self.deadline = motion_at, drawn, deadline
        self.flown = np.union1d(drawn, np.linspace(0.0, 1.0, 2 + math.ceil(span / STEP)))
        self.shortest = min(SHORTEST / span, 0.5 * float(np.min(np.diff(self.flown))))
        self.tracks: list[Track] = []
        self._in_vain = 0

    def place_of(self, settled: FinalMotion, sigma: float) -> OnBranch | None:
        """The place of the regime to which a simulation has settled, on a branch that is followed
        from it if there is none yet; None where it does not repeat itself."""
        if self._in_vain == MOST_IN_VAIN and not self.tracks:
            return None
        state = at_phase_0(self.motion_at(sigma), settled.state, settled.phase)
        size = max(float(np.abs(settled.ends[-1]).max()), settled.displacement) or 1.0
        for track in self.tracks:
            for number, u in track.around(sigma):
                if np.abs(state - u[:-1]).max() < COARSE * size:
                    return OnBranch(track, number)
        found = self._repeated(sigma, state, 1, RESTS_LOOKS // 3)
        if found is None or not found.rests:
            return None
        if (place := self._known(found, sigma)) is not None or self._in_vain == MOST_IN_VAIN:
            return place
        track = self._followed(found, sigma)
        if np.ptp(track.sigma) < self.shortest:
            self._in_vain += 1
            return None
        self.tracks.append(track)
        return self._known(found, sigma)

    def _known(self, found: RestRun, sigma: float) -> OnBranch | None:
        for track in self.tracks:
            if track.periods != len(found.ends) or track.rests != found.rests:
                continue
            for number, u in track.around(sigma):
                known = self._repeated(sigma, u[:-1], track.periods)
                if known is None:
                    continue
                apart = np.abs(found.ends - known.ends[-1]).max(axis=1)
                if apart.min() < SAME * found.size:
                    return OnBranch(track, number)
        return None

    def _repeated(
        self, sigma: float, state: Vector, periods: int, looks: int = RESTS_LOOKS
    ) -> RestRun | None:
        """The motion that repeats itself to which a state leads; None where there is none."""
        motion, many = self.motion_at(sigma), periods * math.ceil(RESTS_LOOKED_AT / periods)
        for _ in range(looks):
            settled = simulate(motion, state, many)
            if settled is None or self.deadline.passed():
                return None
            state = settled.state
            # a slow approach comes closest to itself after several periods
            if (found := settled.period(EXACT)) and found == settled.period(COARSE):
                return _measured(motion, settled, found)
        return None

    def _followed(self, first: RestRun, sigma: float) -> Track:
        ahead = list(self._from(first, sigma, self.flown[self.flown > sigma + 1e-12]))
        behind = list(self._from(first, sigma, self.flown[self.flown < sigma - 1e-12][::-1]))
        rows = [*behind[::-1], (sigma, self._name(sigma), first), *ahead]
        places, names, found = zip(*rows, strict=True)
        states = np.array([each.ends[-1] for each in found])
        factors = [
            _factors(self.motion_at(place), each.ends[-1], len(each.ends))
            for place, each in zip(places, found, strict=True)
        ]
        return Track(
            stops=first.stops,
            periods=len(first.ends),
            points=np.column_stack([states, solver.WEIGHT * np.array(places)]),
            names=names,
            margin=np.ones(len(rows)),
            displacement=np.array([each.displacement for each in found]),
            acceleration=np.array([each.acceleration for each in found]),
            speeds=np.array([each.speeds for each in found]),
            factors=np.array(factors),
            starts=states,
            phases=np.array([each.phases for each in found]),
            by_state=True,
            rests=first.rests,
        )

    def _name(self, sigma: float) -> str:
        return POINT if np.min(np.abs(self.drawn - sigma)) < ROUNDING else NODE

    def _from(
        self, here: RestRun, sigma: float, places: Vector
    ) -> Iterator[tuple[float, str, RestRun]]:
        """The branch over places that follow each other, to where it ends."""
        for place in places.tolist():
            if self.deadline.passed():
                return
            there = self._repeated(place, here.ends[-1], len(here.ends))
            if there is None or there.kind != here.kind or _far(here, there):
                yield self._end(here, sigma, place)
                return
            yield place, self._name(place), there
            here, sigma = there, place

    def _end(self, here: RestRun, low: float, high: float) -> tuple[float, str, RestRun]:
        """Where a branch ends between two places, by bisection."""
        beyond: RestRun | None = None
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            there = self._repeated(middle, here.ends[-1], len(here.ends), RESTS_LOOKS // 3)
            if there is None or there.kind != here.kind or _far(here, there):
                high, beyond = middle, there
            else:
                low, here = middle, there
        ends = here.rest < SHORT or (beyond is not None and beyond.rests != here.rests)
        return low, STICKING if ends else GRAZING, here


def _far(here: RestRun, there: RestRun) -> bool:
    return bool(np.abs(there.ends[-1] - here.ends[-1]).max() > NEAR * here.size)


def _measured(motion: solver.Motion, settled: FinalMotion, periods: int) -> RestRun | None:
    """The motion over its periods, from the end of a flight; None where impacts come too fast to be
    followed once more."""
    parts, state = list[FinalMotion](), settled.state
    for _ in range(periods):
        part = simulate(motion, state, 1)
        if part is None:
            return None
        parts.append(part)
        state = part.state
    turns = [np.array([2.0 * math.pi * number, 0.0, 0.0]) for number in range(periods)]
    log = np.concatenate([part.log + turn for part, turn in zip(parts, turns, strict=True)])
    struck = log[(log[:, 1] >= 0.0) & (log[:, 2] > STILL)]
    runs = _runs(struck, periods)
    fastest = np.array([run[np.argmax(run[:, 2])] for run in runs]).reshape(-1, 3)
    releases = log[log[:, 1] < 0.0]
    return RestRun(
        ends=np.array([part.state for part in parts]),
        rests=settled.rests(periods),
        rest=min((_rest_before(each, struck, periods) for each in releases), default=math.inf),
        stops=tuple(fastest[:, 1].astype(int).tolist()),
        phases=fastest[:, 0],
        speeds=fastest[:, 2],
        displacement=max(part.displacement for part in parts),
        acceleration=max(part.acceleration for part in parts),
    )


def _runs(struck: Matrix, periods: int) -> list[Matrix]:
    """Impacts over a period of the motion, by runs on one stop; a run may go over its end."""
    changes = np.flatnonzero(struck[:, 1] != np.roll(struck[:, 1], 1))
    if len(changes):
        first = int(changes[0])
        later = struck[:first] + np.array([2.0 * math.pi * periods, 0.0, 0.0])
        struck = np.concatenate([struck[first:], later])
    numbers = range(len(struck))
    return [
        struck[list(run)] for _, run in itertools.groupby(numbers, lambda number: struck[number, 1])
    ]


def _rest_before(release: Vector, struck: Matrix, periods: int) -> float:
    """The duration of the rest that a release ends, rad: since the last impact on the stop."""
    own = struck[struck[:, 1] == -1.0 - release[1], 0]
    return float(np.min((release[0] - own) % (2.0 * math.pi * periods), initial=math.inf))


def _factors(motion: solver.Motion, state: Vector, periods: int) -> Matrix:
    """The factors by which small perturbations change over a number of periods."""
    course = flights.course_of(motion, 0.0, 2.0 * math.pi)
    y, touch = state.copy(), solver.free_touch()
    # a state on a stop is known to rest there after a period
    for _ in range(periods):
        flights.carry(course, y, touch, np.empty((len(y), 0)))
    factors = np.eye(len(y))
    if touch.on[0] != solver.FREE:
        for column in range(len(y)):
            flights.settle_on(motion, touch.on[0], factors[:, column])
    for _ in range(periods):
        flights.carry(course, y, touch, factors)
    return factors


def at_phase_0(motion: solver.Motion, state: Vector, phase: float) -> Vector:
    """A state at the next phase 0 of the force, from one at another phase."""
    y, course = state.copy(), flights.course_of(motion, phase, -phase % (2.0 * math.pi))
    flights.carry(course, y, solver.free_touch(), np.empty((len(y), 0)))
    return y


# ------------------------------------------------------------------------------
# Branches of periodic regimes: found by flights and by Newton's iteration, followed, and their
# special points located and named.
# ------------------------------------------------------------------------------


leave_out_of_budgets()


SLOWEST = 1e-7
"""Impact speed and following flight, in the units of the kernels, up to which impacts count as the
end of chatter. No finite order of impacts describes chatter."""

FREE = 1e-10
"""Distance of a multiplier from 1 up to which a motion counts as free to move without a force:
rounding leaves some 1e-15, and the motion under a force then has a relative error of 1e-5."""

UNHELD = 1e-12
"""Stiffness, relative to the largest, below which a direction counts as not held by any spring."""

SEED_VALUES = 13
"""Number of values in the range at which regimes are looked for, besides those beside grazings."""

BESIDE_GRAZING = 2e-3
"""Relative distance from a grazing of the motion without impacts at which regimes are looked
for."""

APART = 0.01
"""Largest relative change of the varied number between points of the motion without impacts."""

CHANGED, REFINEMENTS = 0.1, 10
"""Relative change of its displacement from which on points are added between two, and how often."""

FARTHEST = 0.04
"""Largest relative change of the varied number in a step along a branch."""

ONE_POINT = 1e-6
"""A change of stability so close to a fold or a grazing of the branch belongs to it; difference of
points of the branch."""

MOST_WORDS = 16
"""Largest number of orders of impacts with which Newton's iteration is started; the shortest orders
come first."""

DEFAULT_IMPACTS = 3
"""Largest number of impacts in a period that is looked for unless another is given."""

STARTS = 10
"""Number of starts of Newton's iteration for each impact of an order."""

SUBHARMONICS = (1, 2, 3)
"""Numbers of periods within which regimes of one impact are looked for; with two stops, also those
of one impact on each."""

LOOKED_AT, LOOKS = 50, 12
"""Number of periods after which a flight is looked at for having ended in a regime, and how often
that is done."""

MOST_PATIENCE = 5_000
"""Largest number of periods after which a flight with light damping is looked at."""

AT_FOLD = 1e-3
"""Distance from a fold, as a difference of points of the branch. Within it rounding may move the
change of sign of a multiplier less 1 that belongs to the fold."""

MOST_BRANCHES = 128
"""Number of branches from which on no more are followed from flights: in a range of chaos there is
no end of windows."""

RANDOM_STARTS, MOST_LOOKS = 192, 800
"""Number of random starts, over all values at which regimes are looked for, and of looks at their
flights after which no more are started: where flights do not settle fewer suffice to say so."""

MOST_MOVED = 0.2
"""Largest change of a phase, rad, from the end of a simulation to the regime that it approaches."""


class Ended(NamedTuple):
    """The end of a flight: the last motion, and the regime, if it has settled to one."""

    settled: FinalMotion
    place: OnBranch | None


class Scattered(NamedTuple):
    """Places of the range where random flights started, and whether each ended in a regime."""

    sigma: Vector
    listed: NDArray[np.bool_]


class Phases:
    """The equations of regimes whose impacts have one order: u holds their phases."""

    def __init__(self, expansion: solver.Expansion, pattern: solver.Pattern) -> None:
        self.expansion, self.pattern = expansion, pattern

    def corrected(self, u: Vector, normal: Vector) -> continuation.BranchPlace | None:
        """The regime on the plane through u with a normal; None where Newton's iteration fails."""
        u, tangent = u.copy(), normal.copy()
        slowest = solver.correct(self.expansion, self.pattern, u, tangent)
        return None if math.isnan(slowest) else continuation.BranchPlace(u, tangent, slowest)

    def settled(self, u: Vector) -> Vector | None:
        """The regime near u at its place of the range; None where Newton's iteration fails."""
        u, states = u.copy(), np.empty((len(u) - 1, 2 * self.expansion.n))
        motion = solver.motion_at(self.expansion, u[-1] / solver.WEIGHT)
        return u if solver.settle(motion, self.pattern, u[:-1], states) else None

    def difference(self, points: Matrix, u: Vector) -> Matrix:
        """How far each of some points lies from u, but for whole periods of the force."""
        away = np.asarray(points - u)
        away[:, :-1] -= 2.0 * math.pi * np.round(away[:, :1] / (2.0 * math.pi))
        return away

    def images(self, u: Vector) -> Matrix:
        """The regime from each impact on from which the order of impacts is the same."""
        return turned(u[None], self.pattern, tuple(self.pattern.stops.tolist()))


class Unstruck:
    """The motion without impacts: there is one at each place."""

    def corrected(self, u: Vector, normal: Vector) -> continuation.BranchPlace:
        """The motion at u."""
        return continuation.BranchPlace(u, normal, math.inf)

    def settled(self, u: Vector) -> Vector:
        """The motion at u."""
        return u

    def difference(self, points: Matrix, u: Vector) -> Matrix:
        """How far each of some places lies from u."""
        return points - u

    def images(self, u: Vector) -> Matrix:
        """The motion at u."""
        return u[None]


def ordinary(track: Track) -> Matrix:
    """Points of a branch at which no other branch crosses it."""
    return track.points[[name in (POINT, NODE) for name in track.names]]


def turned(points: Matrix, pattern: solver.Pattern, stops: tuple[int, ...]) -> Matrix:
    """Points of a branch from each impact on from which the stops are hit in a wanted order; their
    phases are those of a pattern."""
    own, count = tuple(pattern.stops.tolist()), len(stops)
    later = points[:, :-1] + 2.0 * math.pi * pattern.periods
    parts = [
        np.column_stack([points[:, first:-1], later[:, :first], points[:, -1]])
        for first in range(count)
        if own[first:] + own[:first] == stops
    ]
    return np.concatenate([*parts, np.empty((0, count + 1))])


class Finder:
    """Finds the branches of a family; `grid` (rising) holds the values of sigma at which they are
    drawn, and changes nothing of where they are looked for.

    `most_impacts` bounds the impacts of the orders that Newton's iteration is started with;
    regimes that simulations settle to are followed whatever their number.
    """

    def __init__(
        self, family: Family, grid: Vector, most_impacts: int, deadline: Deadline = NEVER
    ) -> None:
        self.family, self.grid = family, np.ascontiguousarray(grid, dtype=float)
        self.most_impacts, self.deadline = most_impacts, deadline
        self.tracks: list[Track] = []
        self.looks = 0
        self._in_vain: list[Regime] = []
        self.rests = Rests(self.motion, self.grid, family.span, deadline)

    @property
    def size(self) -> int:
        """Numbers of a state."""
        return 2 * self.family.sizes[0]

    stable = 1.0 + 1e-9
    """Largest multiplier of a stable regime; without damping and loss it is 1 but for rounding."""

    def find(self) -> list[Track]:
        """All branches that were found."""
        self.tracks += self.without_impacts()
        for sigma in self.seeds:
            for start in self.starts():
                if self.deadline.passed():
                    return self.tracks
                self.ended(sigma, start)
            self._solve(sigma)
        return self.tracks

    @cached_property
    def seeds(self) -> list[float]:
        """The places of the range at which regimes are looked for."""
        if len(self.grid) == 1:
            return [float(self.grid[0])]
        beside = BESIDE_GRAZING / self.family.span
        grazings = [
            sigma + side * beside
            for track in self.tracks
            for sigma in track.sigma[np.array(track.names) == GRAZING]
            for side in (-1.0, 1.0)
        ]
        return [*np.linspace(0.0, 1.0, SEED_VALUES), *(s for s in grazings if 0.0 < s < 1.0)]

    def scattered(self) -> Scattered:
        """Flights from random starts, and whether they end in the regimes of branches."""
        random, listed, places = np.random.default_rng(0), list[bool](), list[float]()
        rounds, before = math.ceil(self.random_starts / len(self.seeds)), self.looks
        for sigma in self.seeds * rounds:
            if self.deadline.passed() or self.looks - before > MOST_LOOKS:
                break
            ended = self.ended(sigma, self._random_start(sigma, random), patient=True)
            places.append(sigma)
            listed.append(ended is not None and ended.place is not None)
        return Scattered(np.array(places), np.array(listed, bool))

    random_starts = RANDOM_STARTS

    # Flights

    def ended(
        self, sigma: float, state: Vector, phase: float = 0.0, looks: int = LOOKS,
        *, patient: bool = False,
    ) -> Ended | None:  # fmt: skip
        """Where a flight from a state ends; a regime that is on no branch yet is followed first.
        A `patient` look waits until light damping shows. None where impacts come too fast to be
        followed."""
        periods = self.patience(sigma) if patient else LOOKED_AT
        ended: Ended | None = None
        for _ in range(looks):
            self.looks += math.ceil(periods / LOOKED_AT)
            settled = self.simulate(sigma, state, phase, periods)
            if settled is None:
                return None
            state, ended = settled.state, Ended(settled, self._place_of(settled, sigma))
            if ended.place is not None or self.deadline.passed():
                break
        return ended

    def memory(self, sigma: float) -> float:
        """Number of periods of the force in which the slowest free motion decays by a factor e; 0
        where one does not decay."""
        motion, n = self.motion(sigma), self.family.sizes[0]
        slowest = -float(np.linalg.eigvals(motion.generator[: 2 * n, : 2 * n]).real.max())
        # what rounding leaves of no damping is no damping
        if slowest <= UNHELD * motion.omega:
            return 0.0
        return motion.omega / (2.0 * math.pi * slowest)

    def patience(self, sigma: float) -> int:
        """Number of periods of a look that waits until free motion decays by a factor e."""
        return min(max(LOOKED_AT, math.ceil(self.memory(sigma))), MOST_PATIENCE)

    def simulate(
        self, sigma: float, state: Vector, phase: float = 0.0, periods: int = LOOKED_AT
    ) -> FinalMotion | None:
        """A motion at a place of the range; None where impacts come too fast to be followed."""
        return simulate(self.motion(sigma), state, periods, phase)

    def _place_of(self, settled: FinalMotion, sigma: float) -> OnBranch | None:
        """The lasting regime to which a simulation has settled; None where it has not."""
        if not (periods := settled.period(REPEATS)):
            return self._free_soon(settled, sigma)
        if settled.rests(periods):
            return self.rests.place_of(settled, sigma)
        if not len(settled.impacts(periods)):
            return self._free_at(sigma) if periods == 1 else None
        regime = self.regime_of(settled, sigma)
        return None if regime is None else self.added(regime)

    def _free_soon(self, settled: FinalMotion, sigma: float) -> OnBranch | None:
        """The motion without impacts where what is left of free motion decays to it: all its modes
        together reach no stop."""
        place = self._free_at(sigma)
        regime = None if place is None else self.regime_at(place, sigma)
        if regime is None or len(settled.impacts(1)) or settled.rests(1):
            return None
        motion, n = self.motion(sigma), self.family.sizes[0]
        growth, ways = np.linalg.eig(motion.generator[: 2 * n, : 2 * n])
        if not growth.real.max() < 0.0:
            return None
        change = settled.ends[-1] - settled.ends[-2]
        left = np.linalg.solve(regime.factors[0] - np.eye(2 * n), change)
        swing = np.abs(motion.rows @ ways[:n]) @ np.abs(np.linalg.solve(ways, left))
        return place if bool(np.all(swing < regime.margin[0])) else None

    def _free_at(self, sigma: float) -> OnBranch | None:
        for track in self.tracks:
            for number, _ in () if track.stops else track.around(sigma):
                if track.admissible[number : number + 2].any():
                    return OnBranch(track, number)
        return None

    def regime_of(self, settled: FinalMotion, sigma: float) -> Regime | None:
        """The regime that a simulation settles to; None without impacts, or if it does not
        repeat."""
        periods = settled.period(REPEATS)
        impacts = settled.impacts(periods) if periods else np.empty((0, 3))
        if not 0 < len(impacts) <= MOST_SIMULATED:
            return None
        turns = math.floor(impacts[0, 0] / (2.0 * math.pi))
        phases, stops = impacts[:, 0] - 2.0 * math.pi * turns, impacts[:, 1].astype(int).tolist()
        theta = phases.copy()
        settles = _settles(self.motion(sigma), pattern_of(stops, periods), theta)
        if not settles or np.max(np.abs(theta - phases)) > MOST_MOVED:
            return None
        return Regime(tuple(stops), periods, theta, sigma).shortest()

    def added(self, regime: Regime) -> OnBranch | None:
        """The place of a regime, on a branch that is followed from it if there is none yet; None
        where the regime does not last."""
        u = np.append(regime.theta, solver.WEIGHT * regime.sigma)[None]
        if not self.inspected(regime.stops, regime.periods, u, [POINT]).lasting[0]:
            return None
        if (place := self._known(regime)) is not None:
            return place
        if len(self.tracks) >= MOST_BRANCHES or any(
            each.sigma == regime.sigma and each.same(regime) for each in self._in_vain
        ):
            return None
        self.tracks += self._followed(regime)
        if (place := self._known(regime)) is None:
            self._in_vain.append(regime)
        return place

    def _known(self, regime: Regime) -> OnBranch | None:
        for track in self._alike(regime):
            for number, u in self._passing(track, regime.sigma):
                if Regime(track.stops, track.periods, u[:-1], regime.sigma).same(regime):
                    return OnBranch(track, number)
        return None

    def _alike(self, regime: Regime) -> Iterator[Track]:
        """The branches on which a regime may lie."""
        for track in self.tracks:
            if track.by_state or track.periods != regime.periods or not track.stops:
                continue
            if sorted(track.stops) == sorted(regime.stops):
                yield track

    def _passing(
        self, track: Track, sigma: float, near: Callable[[Vector], bool] = lambda _: True
    ) -> Iterator[tuple[int, Vector]]:
        """The regimes of a branch at a place, if the chord there is near enough, each with the
        number of the point before it."""
        place = np.array([solver.WEIGHT * sigma])
        here = self._continuation(self.problem_of(track), place)
        for number, u in track.around(sigma):
            if not near(u):
                continue
            # close to a period doubling the chord alone would lead to the shorter regime
            around = track.points[number : number + 2]
            for each in (*around, *here.between(around[0], around[-1])):
                if abs(each[-1] - place[0]) <= solver.WEIGHT * ROUNDING:
                    yield number, each

    def regime_at(self, place: OnBranch, sigma: float) -> Track | None:
        """The regime of a branch at a place of the range, as a branch of one point; None where
        there is none, or where it is known by flights alone."""
        track = place.track
        if track.rests:
            return None
        found = min(
            self._passing(track, sigma), key=lambda each: abs(each[0] - place.number), default=None
        )
        if found is None:
            return None
        regime = self.inspected(track.stops, track.periods, found[1][None], [POINT])
        return regime if regime.lasting[0] else None

    def starts(self) -> Matrix:
        """States (number, 2 n) from which simulations start: rest, and speeds of the pairs."""
        n, m, _ = self.family.sizes
        motion = self.motion(0.5)
        found = [self.at_rest(0.5)]
        for stop, speed in itertools.product(range(m), (0.3, 1.0, 3.0)):
            row = motion.rows[stop]
            state = np.zeros(self.size)
            state[n : 2 * n] = speed * motion.omega * row / (row @ row)
            found.append(state)
        return np.array(found[: 1 + 8])

    def _random_start(self, sigma: float, random: np.random.Generator) -> Vector:
        """A state between the stops, of a random size."""
        motion, n = self.motion(sigma), self.family.sizes[0]
        state = random.normal(size=2 * n)
        state[n:] *= 10.0 ** random.uniform(-1.0, 0.5)
        move_inside(motion, state, lambda: 1.0 + 0.5 * random.random())
        return np.asarray(state)

    def at_rest(self, sigma: float) -> Vector:
        """The state at rest under the constant loads: at a stop where it would lie beyond it."""
        motion, n = self.motion(sigma), self.family.sizes[0]
        stiffness, load = -motion.generator[n : 2 * n, :n], motion.generator[n : 2 * n, -1]
        state = np.zeros(2 * n)
        # a free mass stays where it is
        state[:n] = np.linalg.lstsq(stiffness, load, rcond=UNHELD)[0]
        move_inside(motion, state, lambda: 1.0)
        return state

    def motion(self, sigma: float) -> solver.Motion:
        """The motion at a place of the range."""
        motion: solver.Motion = solver.motion_at(self.family.expansion, sigma)
        return motion

    # Newton's iteration

    def _solve(self, sigma: float) -> None:
        """Add regimes with few impacts, by Newton's iteration from many phases."""
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
                if self.deadline.passed():
                    return
                if _settles(motion, pattern, theta):
                    regime = Regime(word, periods, theta, sigma).shortest()
                    if self._known(regime) is None:
                        self.tracks += self._followed(regime)

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

    # Branches

    def amplitude(self, track: Track) -> Vector:
        """Amplitude of the first harmonic of the output, in units of the kernels; NaN where the
        motion rests on a stop."""
        if track.by_state:
            return np.full(len(track.points), np.nan)
        flat = self.family.flat(track.sigma)
        return amplitudes(
            flat, self.family.sizes, track.stops, track.periods, track.phases, track.speeds
        )

    def problem_of(self, track: Track) -> Problem:
        """The equations of a branch."""
        if not track.stops:
            return Unstruck()
        return Phases(self.family.expansion, pattern_of(track.stops, track.periods))

    def _continuation(self, problem: Problem, drawn: Vector | None = None) -> Continuation:
        reach = solver.WEIGHT * min(0.1, FARTHEST / self.family.span)
        drawn = solver.WEIGHT * self.grid if drawn is None else drawn
        return Continuation(problem, drawn, reach, self.deadline.passed)

    def _name(self, sigma: float) -> str:
        """Name of an ordinary point at a place."""
        return POINT if np.min(np.abs(self.grid - sigma)) < ROUNDING else NODE

    def without_impacts(self) -> list[Track]:
        """The motion without impacts."""
        nodes = np.linspace(0.0, 1.0, max(2, math.ceil(self.family.span / APART)))
        if len(self.grid) == 1:
            nodes = self.grid
        track = self._unstruck(np.union1d(self.grid, nodes))
        for _ in range(REFINEMENTS):
            sizes = track.displacement
            steep = np.abs(np.diff(sizes)) > CHANGED * np.maximum(sizes[1:], sizes[:-1])
            if not np.any(steep):
                break
            steep[1:] |= steep[:-1].copy()
            steep[:-1] |= steep[1:].copy()
            middles = 0.5 * (track.sigma[1:] + track.sigma[:-1])[steep]
            more = self._unstruck(middles)
            track = track.with_points((np.flatnonzero(steep) + 1).tolist(), more)
        # a loose mass, or resonance without damping: there is no such motion, or no single one
        track = track.part(_determined(track))
        return self._trimmed(self._located(track)) if len(track.points) else []

    def _unstruck(self, places: Vector) -> Track:
        names = [self._name(sigma) for sigma in places]
        return self.inspected((), 1, solver.WEIGHT * places[:, None], names)

    def _followed(self, seed: Regime) -> list[Track]:
        problem = Phases(self.family.expansion, pattern_of(seed.stops, seed.periods))
        u = np.append(seed.theta, solver.WEIGHT * seed.sigma)
        known = [
            turned(ordinary(each), pattern_of(each.stops, each.periods), seed.stops)
            for each in self._alike(seed)
        ]
        found = self._continuation(problem).through(
            u, self._name(seed.sigma), np.concatenate([np.empty((0, len(u))), *known])
        )
        track = self.inspected(seed.stops, seed.periods, found.points, found.names)
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

    def _located(self, track: Track) -> Track:
        """The branch with its grazings and changes of stability among its points."""
        inserted: list[tuple[int, Matrix, str]] = []
        problem = self.problem_of(track)
        for name, test in TESTS.items():
            own = values = test(track)
            if name == PITCHFORK:
                values = _without_folds(track, own)
            for number in np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0):
                if self.deadline.passed():
                    break

                # beyond a fold the branch is seen from the other side
                side = float(np.sign(own[number] * values[number]))

                def value(
                    u: Vector, test: Callable[[Track], Vector] = test, side: float = side
                ) -> float:
                    here = self.inspected(track.stops, track.periods, u[None], [""])
                    return side * float(test(here)[0])

                start, end = track.points[number], track.points[number + 1]
                around = float(values[number]), float(values[number + 1])
                point = continuation.root(problem, start, end, value, around)
                if any(
                    track.names[beside] in (FOLD, GRAZING)
                    and np.abs(point - track.points[beside]).max() < ONE_POINT
                    for beside in (number, number + 1)
                ):
                    continue
                inserted.append((int(number), point[None], name))
        if not inserted:
            return track
        inserted.sort(key=lambda each: each[0])
        places = [number + 1 for number, _, _ in inserted]
        points = np.concatenate([point for _, point, _ in inserted])
        names = [name for _, _, name in inserted]
        return track.with_points(places, self.inspected(track.stops, track.periods, points, names))

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


def _without_folds(track: Track, values: Vector) -> Vector:
    """Values of `_breaking` along a branch without the changes of sign that belong to its folds,
    where a multiplier passes 1 as well."""
    values = values.copy()
    for fold in [number for number, name in enumerate(track.names) if name == FOLD]:
        far = np.abs(track.points - track.points[fold]).max(axis=1) > AT_FOLD
        before, after = np.flatnonzero(far[:fold]), fold + np.flatnonzero(far[fold:])
        if not len(before) or not len(after):
            continue
        near = slice(before[-1] + 1, after[0])
        folds = track.names[near].count(FOLD)
        if values[before[-1]] * values[after[0]] * (-1.0) ** folds > 0.0:
            # the branch is seen from the other side from here on
            values[near] = values[after[0]]
            values[: near.start] *= (-1.0) ** folds
    return values


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
    GRAZING: _margin, DOUBLING: _doubling, PITCHFORK: _breaking, NEIMARK_SACKER: _torus
}  # fmt: skip
"""A number that changes its sign along a branch at each kind of special point; folds are located
while a branch is followed."""


def move_inside(motion: solver.Motion, state: Vector, share: Callable[[], float]) -> None:
    """Move a state, in its place, off the stops beyond which it lies, each time by a `share` of how
    far it lies beyond."""
    n = motion.rows.shape[1]
    for _ in range(n + 1):
        for row, position in zip(motion.rows, motion.positions, strict=True):
            if (depth := row @ state[:n] - position) > 0.0:
                state[:n] -= share() * depth / (row @ row) * row


def _rotations(word: tuple[int, ...]) -> list[tuple[int, ...]]:
    return [word[first:] + word[:first] for first in range(len(word))]


def _settles(motion: solver.Motion, pattern: solver.Pattern, theta: Vector) -> bool:
    """Whether Newton's iteration, in place of theta, ends at a regime without a further impact.
    No impact may be too slow, or too soon followed by another."""
    states = np.empty((len(theta), 2 * motion.rows.shape[1]))
    return bool(
        solver.settle(motion, pattern, theta, states)
        and solver.slowest(motion, pattern, theta, states) > SLOWEST
        and solver.survey(motion, pattern, theta, states)[0] >= -TOLERANCE
    )
