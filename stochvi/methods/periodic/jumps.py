"""Slow sweeps: along the branches that they reach, from one to the next by flights, and from value
to value over motions that do not repeat themselves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.methods.periodic.branches import LOOKS, MOST_PATIENCE, Finder
from stochvi.methods.periodic.continuation import FOLD
from stochvi.methods.periodic.simulations import REPEATS, SETTLING, FinalMotion
from stochvi.methods.periodic.tracks import OnBranch, Track

SMALLEST = 0.02
"""Relative change of displacement or impact speed from which on a change is a jump if it does not
go back with the value. Changes of speed are relative to the speed of the vibration where that is
larger: that of a first contact grows from 0."""

ABRUPT = 0.1
"""Relative change right after the end of a branch from which on it is a jump in any case. The speed
of first contacts grows as the root of the distance from the end. At the first distance of BEYOND it
is still smaller than this."""

LEAP = 0.2
"""Relative change from which on a motion on no branch has jumped: where it does not repeat itself
its largest values are those of a finite time, and differ by more than ABRUPT now and then."""

BEYOND = (1e-6, 1e-4)
"""Relative distances of the varied number from the end of a regime at which flights go on from it,
one after the other: near a fold a motion takes long to leave."""

PUSH, PUSHED = 1e-3, 6
"""A motion that stays at a regime which no longer attracts it is pushed: it loses this share of its
velocity, and is then followed for so many flights. Nothing else would perturb it, and just beyond a
change of stability perturbations grow by some 0.1 % in a period."""

MEMORIES = 10
"""Time after which the motion at a value of a simulated sweep is read. Its unit is the time in
which free motion decays by a factor e."""

STRIDE = 4e-3
"""Relative distance of the varied number between two flights where a motion is on no branch."""

WANDERING = 4
"""Number of looks at a flight that goes on from a motion on no branch."""

HALVINGS = 8
"""Number of halvings by which a jump is located where the motion before it is on no branch."""

UNSETTLED = 100
"""Number of periods over which the largest displacement of a motion is taken that does not repeat
itself."""


class Step(NamedTuple):
    """A jump of a sweep: its place, and displacement and impact speed before and after it."""

    sigma: float
    displacements: tuple[float, float]
    speeds: tuple[float, float]


class SweepState(NamedTuple):
    """A motion that a sweep has reached: a state at a phase of the force, the largest displacement
    and impact speed, and its place on a branch, if it is on one."""

    sigma: float
    state: Vector
    phase: float
    displacement: float
    speed: float
    place: OnBranch | None


class Sweep:
    """A slow sweep over the range of a finder, upwards or downwards.

    Branches that the finder does not have yet are added to it. `elsewhere` takes the places at
    which the sweep was on no branch.
    """

    def __init__(self, finder: Finder, *, upwards: bool) -> None:
        self.finder, self.direction = finder, 1.0 if upwards else -1.0
        self.upwards, self.elsewhere = upwards, list[float]()

    def steps(self) -> Iterator[Step]:
        """The jumps, in the order of the sweep."""
        start = 0.0 if self.upwards else 1.0
        here = self._reached(start, self.finder.at_rest(start), 0.0)
        while here is not None and not self.finder.deadline.passed():
            if here.place is not None:
                here = self._end(here, here.place)
                if self._left(here) < 1e-9:
                    return
                step, here = self._beyond(here)
                if step is not None:
                    yield step
                continue
            self.elsewhere.append(here.sigma)
            if self._left(here) < 1e-9:
                return
            there = self._from(here, min(STRIDE / self.finder.family.span, self._left(here)))
            if there is not None and self._change(here, there) > LEAP:
                yield from self._located(here, there)
            here = there

    def simulated(self) -> Iterator[tuple[float, float, float, int]]:
        """For each value, its place, largest displacement and impact speed, and the number of
        periods after which the motion repeats itself, or 0. Each motion starts from the last."""
        grid = self.finder.grid if self.upwards else self.finder.grid[::-1]
        state = self.finder.at_rest(float(grid[0]))
        for sigma in grid.tolist():
            settling = min(MEMORIES * self.finder.memory(sigma), MOST_PATIENCE)
            settled = self.finder.simulate(sigma, state, periods=max(SETTLING, int(settling)))
            sized = None if settled is None else self._sized(sigma, settled, 0)
            if settled is None or sized is None or self.finder.deadline.passed():
                return
            displacement, speed, state = sized
            yield sigma, displacement, speed, settled.period(REPEATS)

    def _left(self, here: SweepState) -> float:
        """How far the end of the range is away."""
        return 1.0 - here.sigma if self.upwards else here.sigma

    def _reached(
        self, sigma: float, state: Vector, phase: float, looks: int = LOOKS
    ) -> SweepState | None:
        """The motion that a state leads to; None where impacts come too fast to be followed."""
        ended = self.finder.ended(sigma, state, phase, looks, patient=looks == LOOKS)
        if ended is None:
            return None
        place = ended.place
        # where damping is light the motion is still on its way to the regime
        if place is not None and (regime := self.finder.regime_at(place, sigma)) is not None:
            return self._on(regime, 0, place)
        periods = 0 if place is None else place.track.periods
        sized = self._sized(sigma, ended.settled, periods)
        if sized is None:
            return None
        displacement, speed, state = sized
        return SweepState(sigma, state, phase, displacement, speed, place)

    def _on(self, track: Track, number: int, place: OnBranch) -> SweepState:
        """The regime at one of the points of a branch."""
        state, phase = track.state(number)
        speed = float(track.speeds[number].max(initial=0.0))
        displacement = float(track.displacement[number])
        return SweepState(float(track.sigma[number]), state, phase, displacement, speed, place)

    def _sized(
        self, sigma: float, settled: FinalMotion, periods: int
    ) -> tuple[float, float, Vector] | None:
        """Largest displacement and impact speed of a motion, over its periods or, where they are 0
        and it does not repeat itself, over many; and its last state."""
        periods = periods or settled.period(REPEATS) or UNSETTLED
        state, sizes = settled.state, list[tuple[float, float]]()
        # an impact that comes now before, now after the phase at which periods end is in one of two
        for _ in range(periods + 1):
            more = self.finder.simulate(sigma, state, settled.phase, periods=1)
            if more is None:
                return None
            speeds = more.impacts(1)[:, 2]
            sizes.append((more.displacement, float(speeds.max(initial=0.0))))
            state = more.state
        displacement, speed = np.max(sizes, axis=0).tolist()
        return displacement, speed, state

    def _from(self, here: SweepState, distance: float) -> SweepState | None:
        """The motion at a distance further on; behind, where it is below 0."""
        sigma = here.sigma + self.direction * distance
        looks = LOOKS if here.place is not None else WANDERING
        return self._reached(min(max(sigma, 0.0), 1.0), here.state, here.phase, looks)

    # Branches

    def _end(self, here: SweepState, place: OnBranch) -> SweepState:
        """The last regime of a branch that can be reached from one without a jump."""
        track = place.track
        first = self._ahead(track, here.sigma, (place.number, place.number + 1))
        if first is None:
            return here
        while first is not None:
            number = first
            first = self._ahead(track, track.sigma[number], (number - 1, number + 1))
        return self._on(track, number, place)

    def _ahead(self, track: Track, sigma: float, numbers: tuple[int, int]) -> int | None:
        """Which of two points is a lasting regime further on in the sweep; None where neither."""
        for number in numbers:
            inside = 0 <= number < len(track.points) and track.lasting[number]
            if inside and (track.sigma[number] - sigma) * self.direction > 0.0:
                return number
        return None

    # Jumps

    def _beyond(self, end: SweepState) -> tuple[Step | None, SweepState | None]:
        """The jump at the end of a branch, if there is one, and the motion a little further on."""
        near, far = (distance / self.finder.family.span for distance in BEYOND)
        first = self._from(end, near)
        there = first and self._from(first, far)
        if first is None or there is None:
            return None, there
        if there.place is None and self._change(end, there) <= SMALLEST:
            # it may grow gradually, too, and go back too slowly to be seen
            there = self._pushed(end, there)
            return (
                _step(end.sigma, end, there) if self._change(end, there) > LEAP else None
            ), there
        jumped = (
            self._change(end, first) > ABRUPT
            or (self._turns(end) and self._change(end, there) > SMALLEST)
            or self._has_jumped(end, there)
        )
        return (_step(end.sigma, end, there) if jumped else None), there

    def _turns(self, end: SweepState) -> bool:
        """Whether a branch turns back at its end: chaos beyond it may leave no second motion."""
        if end.place is None:
            return False
        track, near = end.place.track, BEYOND[1] / self.finder.family.span
        folds = track.sigma[[name == FOLD for name in track.names]]
        return bool(np.any(np.abs(folds - end.sigma) < near))

    def _pushed(self, end: SweepState, there: SweepState) -> SweepState:
        """The motion to which a perturbation leads from the end of a branch."""
        state = there.state.copy()
        state[len(state) // 2 :] *= 1.0 - PUSH
        for _ in range(PUSHED):
            further = self._reached(there.sigma, state, there.phase)
            if further is None:
                break
            there, state = further, further.state
            if there.place is not None or self._change(end, there) > LEAP:
                break
        return there

    def _has_jumped(self, before: SweepState, after: SweepState) -> bool:
        """Whether a motion has changed by much, and does not go back with the value."""
        if self._change(before, after) <= SMALLEST:
            return False
        behind = BEYOND[0] / self.finder.family.span + abs(after.sigma - before.sigma)
        back = self._from(after, -behind)
        return back is None or self._change(before, back) > SMALLEST

    def _change(self, before: SweepState, after: SweepState) -> float:
        """The larger one of the relative changes of displacement and speed."""
        omega = self.finder.motion(before.sigma).omega
        displacement = max(before.displacement, after.displacement)
        speed = max(before.speed, after.speed, omega * displacement)
        if displacement == 0.0:
            return 0.0
        return max(
            abs(after.displacement - before.displacement) / displacement,
            abs(after.speed - before.speed) / speed,
        )

    def _located(self, before: SweepState, after: SweepState) -> Iterator[Step]:
        """The jump between two values of the sweep, if it still is one at its place."""
        for _ in range(HALVINGS):
            there = self._from(before, 0.5 * abs(after.sigma - before.sigma))
            if there is None:
                break
            if self._change(before, there) > LEAP:
                after = there
            else:
                before = there
        if self._change(before, after) > LEAP:
            yield _step(before.sigma, before, after)


def _step(sigma: float, before: SweepState, after: SweepState) -> Step:
    return Step(sigma, (before.displacement, after.displacement), (before.speed, after.speed))
