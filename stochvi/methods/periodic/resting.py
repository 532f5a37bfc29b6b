"""Regimes in which a mass rests on a stop for a part of the period: followed by flights.

Chatter that ends at rest has no finite order of impacts. While a mass rests it forgets where it
came from, so a flight settles within a few periods. The flight at each place of the range starts
from the motion at the last. Successive impacts on one stop count as one, of the speed of the
fastest.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.periodic.continuation import GRAZING, NODE, POINT, STICKING
from stochvi.methods.periodic.kernels import flights, solver
from stochvi.methods.periodic.simulations import FinalMotion, simulate
from stochvi.methods.periodic.tracks import ROUNDING, OnBranch, Track
from stochvi.results.deadline import Deadline

EXACT, COARSE = 1e-7, 1e-4
"""Difference of states a period apart, relative to the motion. Up to the first it repeats itself:
chatter ends where impacts have 1e-9 of the fastest speed. Above the second it does not repeat
itself after fewer periods."""

LOOKED_AT, LOOKS = 16, 12
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
        found = self._repeated(sigma, state, 1, LOOKS // 3)
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
        self, sigma: float, state: Vector, periods: int, looks: int = LOOKS
    ) -> RestRun | None:
        """The motion that repeats itself to which a state leads; None where there is none."""
        motion, many = self.motion_at(sigma), periods * math.ceil(LOOKED_AT / periods)
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
            there = self._repeated(middle, here.ends[-1], len(here.ends), LOOKS // 3)
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
    y, touch, none = state.copy(), solver.free_touch(), np.empty((0, 3))
    # a state on a stop is known to rest there after a period
    for _ in range(periods):
        flights.fly(course, y, touch, np.empty((len(y), 0)), none, 0)
    factors = np.eye(len(y))
    if touch.on[0] != solver.FREE:
        for column in range(len(y)):
            flights.settle_on(motion, touch.on[0], factors[:, column])
    for _ in range(periods):
        flights.fly(course, y, touch, factors, none, 0)
    return factors


def at_phase_0(motion: solver.Motion, state: Vector, phase: float) -> Vector:
    """A state at the next phase 0 of the force, from one at another phase."""
    y, angle = state.copy(), -phase % (2.0 * math.pi)
    if angle > 0.0:
        course = flights.course_of(motion, phase, angle)
        flights.fly(course, y, solver.free_touch(), np.empty((len(y), 0)), np.empty((0, 3)), 0)
    return y
