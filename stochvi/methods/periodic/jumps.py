"""What a slow sweep does where the regime that it follows ends."""

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
"""Relative change of displacement or impact speed from which on a change is a jump."""

BEYOND = (1e-5, 1e-3)
"""Distances from the end of a regime, in shares of the range, at which simulations go on from it,
one after the other: near a fold a motion lingers for long."""

UNSETTLED = 100
"""Number of periods over which the largest displacement of a motion is taken that does not repeat
itself."""


class Step(NamedTuple):
    """A change of regime of a sweep: where, and displacement and impact speed before and after."""

    sigma: float
    displacements: tuple[float, float]
    speeds: tuple[float, float]


class Place(NamedTuple):
    """A point of a branch that a sweep follows."""

    track: Track
    number: int


class Sweep:
    """A slow sweep over the branches that a finder has found, upwards or downwards."""

    def __init__(self, finder: Finder, *, upwards: bool) -> None:
        self.finder, self.direction = finder, 1.0 if upwards else -1.0
        self.grid = finder.grid if upwards else finder.grid[::-1]

    def steps(self) -> Iterator[Step]:
        """The changes of regime, in the order of the sweep."""
        sigma = float(self.grid[0])
        settled = self._settled(sigma, np.zeros(2 * self.finder.family.sizes[0]), 0.0)
        while settled is not None and not self.finder.deadline.passed():
            before, end = _size(settled), sigma
            state, phase = settled.state, settled.phase
            place = self._place_of(settled, sigma)
            if place is not None:
                track, number = self._last(place)
                end = float(track.sigma[number])
                state, phase = self.finder.end_of(track, number)
                before = _size_at(track, number)
            further = self.grid[(self.grid - end) * self.direction > 1e-12]
            if not len(further):
                return
            sigma = float(further[0])
            if place is not None:
                for beyond in BEYOND:
                    settled = self._settled(end + self.direction * beyond, state, phase)
                    if settled is None:
                        return
                    state, phase = settled.state, settled.phase
                after = _size(settled)
                if max(map(_change, before, after)) > SMALLEST:
                    yield Step(end, (before[0], after[0]), (before[1], after[1]))
            settled = self._settled(sigma, state, phase)

    def simulated(self) -> Iterator[tuple[float, float, float, int]]:
        """Place, largest displacement and impact speed, and number of periods after which the
        motion repeats itself (0 where it does not), at each value, each motion from the last."""
        state, phase = np.zeros(2 * self.finder.family.sizes[0]), 0.0
        for sigma in self.grid:
            settled = self._settled(float(sigma), state, phase)
            if settled is None or self.finder.deadline.passed():
                return
            periods, sizes = settled.period(REPEATS), [_size(settled)]
            for _ in range((periods or UNSETTLED) - 1):
                settled = self.finder.simulate(float(sigma), settled.state, periods=1)
                if settled is None:
                    return
                sizes.append(_size(settled))
            yield float(sigma), *np.max(sizes, axis=0).tolist(), periods
            state = settled.state

    def _settled(self, sigma: float, state: Vector, phase: float) -> Settled | None:
        return self.finder.simulate(sigma, state, phase)

    def _place_of(self, settled: Settled, sigma: float) -> Place | None:
        """The point of a branch that a simulated motion has settled to."""
        impacts = settled.impacts(1) if settled.period(REPEATS) == 1 else None
        reaches = self.finder.reaches(settled, sigma)
        for track in self.finder.tracks:
            here = np.flatnonzero(np.abs(track.sigma - sigma) < 1e-12)
            for number in here[track.admissible[here]]:
                free = not track.stops and impacts is not None and len(impacts) == 0
                if free or (track.stops and reaches(track, int(number))):
                    return Place(track, int(number))
        return None

    def _good(self, place: Place) -> bool:
        track, number = place
        return bool(
            0 <= number < len(track.points)
            and track.admissible[number]
            and track.multiplier[number] < 1.0 + 1e-6
        )

    def _neighbour(self, place: Place) -> Place | None:
        """The next point in the direction of the sweep; None where the regime ends."""
        track, number = place
        for other in (number + 1, number - 1):
            if not 0 <= other < len(track.points) or not self._good(Place(track, other)):
                continue
            if (track.sigma[other] - track.sigma[number]) * self.direction > 0.0:
                return Place(track, other)
        return None

    def _last(self, place: Place) -> Place:
        """The last point that can be reached from one without a jump."""
        while (following := self._neighbour(place)) is not None:
            place = following
        return place


def _size(settled: Settled) -> tuple[float, float]:
    speeds = settled.impacts(min(4, len(settled.ends) - 1))[:, 2]
    return settled.displacement, float(speeds.max(initial=0.0))


def _size_at(track: Track, number: int) -> tuple[float, float]:
    return float(track.displacement[number]), float(track.speeds[number].max(initial=0.0))


def _change(before: float, after: float) -> float:
    larger = max(before, after)
    return abs(after - before) / larger if larger > 0.0 else 0.0
