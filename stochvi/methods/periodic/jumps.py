"""Jumps of a slow sweep where the regime that it follows ends."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from stochvi.methods.periodic.branches import (
    REPEATS,
    Finder,
    Settled,
    Track,
    Vector,
)

SMALLEST = 0.02
"""Relative change of displacement or impact speed from which on a change is a jump if it does not
go back with the value. Changes of speed are relative to the speed of the vibration where that is
larger: that of a first contact grows from 0."""

ABRUPT = 0.1
"""Relative change right after the end of a branch from which on it is a jump in any case: the speed
of first contacts grows as the root of the distance from the end, and is smaller than this at the
first distance of BEYOND."""

BEYOND = (1e-5, 1e-3)
"""Distances from the end of a regime, as shares of the range, at which simulations go on from it,
one after the other: near a fold a motion takes long to leave."""

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


class Place(NamedTuple):
    """A point of a branch that a sweep follows."""

    track: Track
    number: int


class Reached(NamedTuple):
    """A motion that a sweep has reached: a state at a phase of the force, the largest displacement
    and impact speed, the number of periods after which it repeats itself (0 where it does not), and
    the simulation that found it, if there was one."""

    sigma: float
    state: Vector
    phase: float
    displacement: float
    speed: float
    periods: int
    settled: Settled | None = None


class Sweep:
    """A slow sweep over the branches that a finder has found, upwards or downwards."""

    def __init__(self, finder: Finder, *, upwards: bool) -> None:
        self.finder, self.direction = finder, 1.0 if upwards else -1.0
        self.grid = finder.grid if upwards else finder.grid[::-1]

    def steps(self) -> Iterator[Step]:
        """The jumps, in the order of the sweep.

        A regime is followed to the end of its branch, and a motion that is on no branch, as one
        that barely touches a stop, from value to value.
        """
        here = self._at(float(self.grid[0]), np.zeros(2 * self.finder.family.sizes[0]), 0.0)
        while here is not None and not self.finder.deadline.passed():
            place = self._place_of(here)
            if place is not None:
                here = self._end(place)
                if not len(self._further(here)):
                    return
                step, here = self._beyond(here)
                if step is not None:
                    yield step
            if here is None or not len(further := self._further(here)):
                return
            there = self._from(here, float(further[0]))
            if there is not None and here.periods and self._has_jumped(here, there):
                yield self._located(here, there)
            here = there

    def simulated(self) -> Iterator[tuple[float, float, float, int]]:
        """Place, largest displacement and impact speed, and number of periods after which the
        motion repeats itself (0 where it does not), at each value, each motion from the last."""
        state, phase = np.zeros(2 * self.finder.family.sizes[0]), 0.0
        for sigma in self.grid:
            here = self._at(float(sigma), state, phase, unsettled=UNSETTLED)
            if here is None or self.finder.deadline.passed():
                return
            yield here.sigma, here.displacement, here.speed, here.periods
            state = here.state

    def _at(
        self, sigma: float, state: Vector, phase: float, *, unsettled: int = 1
    ) -> Reached | None:
        """The motion that a state settles to, of which `unsettled` periods are looked at where it
        does not repeat itself; None where impacts come too fast to be followed."""
        settled = self.finder.simulate(sigma, state, phase)
        if settled is None:
            return None
        periods, last = settled.period(REPEATS), settled
        sizes = [_size(settled)]
        for _ in range((periods or unsettled) - 1):
            more = self.finder.simulate(sigma, last.state, last.phase, periods=1)
            if more is None:
                return None
            last = more
            sizes.append(_size(last))
        displacement, speed = np.max(sizes, axis=0).tolist()
        return Reached(sigma, last.state, last.phase, displacement, speed, periods, settled)

    def _from(self, here: Reached, sigma: float) -> Reached | None:
        return self._at(sigma, here.state, here.phase)

    def _further(self, here: Reached) -> Vector:
        """The values of the sweep that are still to come."""
        return self.grid[(self.grid - here.sigma) * self.direction > 1e-12]

    # Branches

    def _place_of(self, here: Reached) -> Place | None:
        """The point of a branch that a simulated motion has settled to."""
        assert here.settled is not None
        impacts = here.settled.impacts(1) if here.periods == 1 else None
        reaches = self.finder.reaches(here.settled, here.sigma)
        for track in self.finder.tracks:
            near = np.flatnonzero(np.abs(track.sigma - here.sigma) < 1e-12)
            for number in near[track.admissible[near]]:
                free = not track.stops and impacts is not None and len(impacts) == 0
                if free or (track.stops and reaches(track, int(number))):
                    return Place(track, int(number))
        return None

    def _end(self, place: Place) -> Reached:
        """The last point that can be reached from one without a jump."""
        while (following := self._neighbour(place)) is not None:
            place = following
        track, number = place
        state, phase = self.finder.end_of(track, number)
        speed = float(track.speeds[number].max(initial=0.0))
        displacement = float(track.displacement[number])
        return Reached(float(track.sigma[number]), state, phase, displacement, speed, track.periods)

    def _neighbour(self, place: Place) -> Place | None:
        """The next point in the direction of the sweep; None where the regime ends."""
        track, number = place
        for other in (number + 1, number - 1):
            if not 0 <= other < len(track.points) or not self._good(Place(track, other)):
                continue
            if (track.sigma[other] - track.sigma[number]) * self.direction > 0.0:
                return Place(track, other)
        return None

    def _good(self, place: Place) -> bool:
        track, number = place
        return bool(
            0 <= number < len(track.points)
            and track.admissible[number]
            and track.multiplier[number] < 1.0 + 1e-6
        )

    # Jumps

    def _beyond(self, end: Reached) -> tuple[Step | None, Reached | None]:
        """The jump at the end of a branch, if there is one, and the motion a little further on."""
        near, far = (end.sigma + self.direction * distance for distance in BEYOND)
        first = self._from(end, near)
        there = first and self._from(first, far)
        if first is None or there is None:
            return None, there
        jumped = self._change(end, first) > ABRUPT or self._has_jumped(end, there)
        return (_step(end.sigma, end, there) if jumped else None), there

    def _has_jumped(self, before: Reached, after: Reached) -> bool:
        """Whether a motion has changed by much, and does not go back with the value."""
        if self._change(before, after) <= SMALLEST:
            return False
        back = self._from(after, before.sigma - self.direction * BEYOND[0])
        return back is None or self._change(before, back) > SMALLEST

    def _change(self, before: Reached, after: Reached) -> float:
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

    def _located(self, before: Reached, after: Reached) -> Step:
        """The jump between two values of the sweep."""
        for _ in range(HALVINGS):
            there = self._from(before, 0.5 * (before.sigma + after.sigma))
            if there is None:
                break
            if self._has_jumped(before, there):
                after = there
            else:
                before = there
        return _step(before.sigma, before, after)


def _step(sigma: float, before: Reached, after: Reached) -> Step:
    return Step(sigma, (before.displacement, after.displacement), (before.speed, after.speed))


def _size(settled: Settled) -> tuple[float, float]:
    speeds = settled.impacts(min(4, len(settled.ends) - 1))[:, 2]
    return settled.displacement, float(speeds.max(initial=0.0))
