"""A branch of periodic regimes, followed by length of arc from one of its regimes.

A point of a branch is u = (x, WEIGHT sigma): what tells regimes at one place of the range apart
(the phases of their impacts, or a state), and the parameter. Steps go along the tangent, and
Newton's iteration takes each back to the branch. The values at which a branch is drawn change
nothing of its course: the regimes there are added between its own points.
"""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.periodic.kernels.solver import WEIGHT

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
            step = min((0.5 if careful else 1.5) * step, LONGEST_STEP)
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
