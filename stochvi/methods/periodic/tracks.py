"""Branches of periodic regimes, as the kernels have them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.periodic.even import TOLERANCE
from stochvi.methods.periodic.kernels import solver

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
