"""A branch of periodic regimes of one order of impacts, followed from one of its regimes.

A point of a branch is u = (theta, WEIGHT sigma): the phases of the impacts, and the parameter.
Steps go along the tangent; Newton's iteration of `kernels/solver.py` takes each back to the branch.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.methods.periodic.kernels import solver

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

GRID, FOLD, VANISHED = range(3)
"""Kinds of points of a branch: at a value that was asked for; where the branch turns back; where
the speed of an impact vanishes, or two impacts merge."""

MOST_STEPS = 20_000
"""Largest number of steps along a branch, good or not."""

MOST_VISITS = 8
"""Number of points on each value that was asked for at which a branch is given up."""

MOST_SPECIAL = 200
"""Number of further points at which a branch is given up."""

FIRST_STEP, SHORTEST_STEP, LONGEST_STEP = 0.02, 1e-7, 0.5
"""First, smallest and largest length of arc of a step, rad."""

TURN = 0.98
"""Smallest cosine of the angle between the tangents at two successive points of a branch."""

HALVINGS = 50
"""Number of halvings of a step in which a special point is located: rounding is reached."""

NEAR = 0.5
"""Largest distance, rad, of the phases of a regime from the chord of the step that passes it."""


class Place(NamedTuple):
    """A regime of a branch: its point u and the tangent there (K + 1,), and its smallest impact
    speed, or its shortest flight if that is less."""

    u: Vector
    tangent: Vector
    slowest: float


class Followed(NamedTuple):
    """Points (number, K + 1) of a branch in its order, their kinds, and whether it has closed."""

    points: Matrix
    kinds: list[int]
    closed: bool


class Continuation:
    """The branches of regimes with impacts in one order.

    Parameters
    ----------
    expansion
        The numbers of the scene over the range.
    pattern
        The impacts and the periods of the regimes.
    grid
        Rising values of sigma at which regimes are asked for.
    """

    def __init__(self, expansion: solver.Expansion, pattern: solver.Pattern, grid: Vector) -> None:
        self.expansion, self.pattern, self.grid = expansion, pattern, grid.tolist()
        self.most = MOST_VISITS * len(grid) + MOST_SPECIAL

    def corrected(self, u: Vector, normal: Vector) -> Place | None:
        """The regime on the plane through u with a normal; None where Newton's iteration fails."""
        u, tangent = u.copy(), normal.copy()
        slowest = solver.correct(self.expansion, self.pattern, u, tangent)
        return None if math.isnan(slowest) else Place(u, tangent, slowest)

    def follow(self, u: Vector, direction: float) -> Followed:
        """Follow a branch from the regime u, the parameter first in a direction, until it leaves
        the range, closes, or an impact vanishes."""
        points: list[Vector] = []
        kinds: list[int] = []
        closed = self._follow(u, direction, points, kinds)
        return Followed(np.reshape(points, (len(points), len(u))), kinds, closed)

    def _follow(self, u: Vector, direction: float, points: list[Vector], kinds: list[int]) -> bool:
        """Add the points of a branch and their kinds; whether the branch has closed."""

        def add(kind: int, *found: Vector) -> None:
            points.extend(found)
            kinds.extend([kind] * len(found))

        last = self.corrected(u, np.append(np.zeros(len(u) - 1), 1.0))
        if last is None:
            return False
        if last.tangent[-1] * direction < 0.0:
            last = last._replace(tangent=-last.tangent)
        step, length = FIRST_STEP, 0.0
        for _ in range(MOST_STEPS):
            if len(points) >= self.most:
                return False
            place = self.corrected(last.u + step * last.tangent, last.tangent)
            if (
                place is None
                or place.tangent @ last.tangent < TURN
                or (place.u - last.u) @ last.tangent > 1.1 * step
            ):
                step *= 0.5
                if step < SHORTEST_STEP:
                    return False
                continue
            length += step
            if not place.slowest > 0.0:
                end = self._end(last, step)
                add(GRID, *self._between(last.u, end))
                add(VANISHED, end)
                return False
            begin = last.u
            if place.tangent[-1] * last.tangent[-1] < 0.0:
                begin = self._fold(last, step)
                add(GRID, *self._between(last.u, begin))
                add(FOLD, begin)
            add(GRID, *self._between(begin, place.u))
            last = place
            if not 0.0 <= last.u[-1] <= solver.WEIGHT:
                return False
            if length > 4.0 * step + 0.5 and _apart(last.u, u) < step:
                return True
            step = min(1.5 * step, LONGEST_STEP)
        return False

    def _end(self, last: Place, step: float) -> Vector:
        """The last point of a step before an impact vanishes, by bisection."""
        low, high, end = 0.0, 1.0, last.u
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            place = self.corrected(last.u + middle * step * last.tangent, last.tangent)
            if place is not None and place.slowest > 0.0:
                low, end = middle, place.u
            else:
                high = middle
        return end

    def _fold(self, last: Place, step: float) -> Vector:
        """The point of a step at which the branch turns back, by bisection."""
        low, high, fold = 0.0, 1.0, last.u
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            place = self.corrected(last.u + middle * step * last.tangent, last.tangent)
            if place is None:
                break
            fold = place.u
            if place.tangent[-1] * last.tangent[-1] > 0.0:
                low = middle
            else:
                high = middle
        return fold

    def _between(self, start: Vector, end: Vector) -> list[Vector]:
        """The regimes at the values of the grid between two points of a branch."""
        low, high = float(start[-1] / solver.WEIGHT), float(end[-1] / solver.WEIGHT)
        if high >= low:
            inside = self.grid[bisect_right(self.grid, low) : bisect_right(self.grid, high)]
        else:
            inside = self.grid[bisect_left(self.grid, high) : bisect_left(self.grid, low)][::-1]
        if not inside:
            return []
        states, found = np.empty((len(start) - 1, 2 * self.expansion.n)), []
        for sigma in inside:
            share = (sigma - low) / (high - low)
            u = start + share * (end - start)
            u[-1] = sigma * solver.WEIGHT
            motion = solver.motion_at(self.expansion, sigma)
            if not solver.settle(motion, self.pattern, u[:-1], states):
                continue
            away = np.abs(u - start - share * (end - start))[:-1]
            if np.max(away) < NEAR:
                found.append(u)
        return found


def _apart(one: Vector, other: Vector) -> float:
    """The largest difference of two points of a branch, phases but for whole turns."""
    turns = (one[:-1] - other[:-1]) / (2.0 * math.pi)
    phases = 2.0 * math.pi * np.abs(turns - np.floor(turns + 0.5))
    return float(max(abs(one[-1] - other[-1]), np.max(phases)))
