"""Life times in noise: how long each regime that coexists under a sine lasts, and what follows.

A path starts in a regime and is simulated with the noise of the scene. Every few periods its state
is followed on without noise, to the regime in whose basin it lies. A path has left its regime once
it lies outside of that basin for long enough to forget how it got there.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Matrix, Whole
from stochvi.methods.monte_carlo.kernels.random_numbers import seed_streams
from stochvi.methods.monte_carlo.modal import ModalPlan, plan_modal
from stochvi.methods.monte_carlo.modal_tables import plan_modal_tables
from stochvi.methods.periodic.attractors import PERIODIC, Attractors
from stochvi.methods.periodic.basins import BasinRun, Place
from stochvi.methods.periodic.family import unmet
from stochvi.model.calculations import calculation
from stochvi.model.model import model_of
from stochvi.results.base import Result
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Cost, provenance
from stochvi.results.intervals import binomial_interval, poisson_interval
from stochvi.results.progress import Progress
from stochvi.sampling.workers import pool_of
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd


BETWEEN_LOOKS = 5
"""Number of periods of the force between two looks at the state of a path."""

LOOKS = 8
"""Number of looks between two looks at the clock."""

DECAY_FACTOR = 10.0
"""Factor by which a small disturbance has decayed, in the slowest of the regimes, in the time for
which a path must stay outside a basin to have left it."""

DECIDED = 200
"""Number of periods for which a state is followed on without noise to the regime of its basin."""

MIXED = 0.1
"""Share of the looks at which paths lie outside a basin to which they come back, from which on a
warning is given."""

GROUP = 64
"""Number of paths that are simulated together."""

FIRST_GROUPS = 64
"""Number of groups of each regime that are started at first. After each round there are twice as
many, so that a small budget is not spent on their starts."""

MORE_PATHS = 2.56
"""Number of paths that are simulated for each one that must leave: with more paths, enough of them
leave earlier."""

SEARCHED = 24
"""Number of values on each side of the plane of starts from which coexisting motions are looked
for."""


@dataclass(frozen=True, kw_only=True)
class Destination:
    """Where paths go that leave a regime.

    Parameters
    ----------
    regime
        Name of the regime, or "undecided".
    paths
        Number of paths.
    share, share_low, share_high
        Share of these paths among all that left, with its exact 95 % interval.

    See Also
    --------
    stochvi.statistics.lifetimes : The answer that holds it.
    """

    regime: str
    paths: int
    share: float
    share_low: float
    share_high: float


@dataclass(frozen=True, kw_only=True)
class LifeTime:
    """How long a regime lasts in noise.

    Parameters
    ----------
    regime, kind
        Name and kind of the regime, as in `BasinRegime`.
    impact_speed_max
        Largest impact speed without noise, m/s.
    life_time, life_time_low, life_time_high
        Mean time until a path leaves, s, with its 95 % interval; None where no path left, and where
        there is no upper limit.
    left, paths
        Paths that left, of those that were simulated.
    watched
        Seconds that paths spent in the regime, all together, as far as a departure in them would
        have been noted: without the last `LifeTimes.outside` seconds of those that stayed.
    destinations
        The regimes to which these paths went, the most frequent first.

    See Also
    --------
    stochvi.statistics.lifetimes : The answer that holds it.
    """

    regime: str
    kind: str
    impact_speed_max: float
    life_time: float | None
    life_time_low: float
    life_time_high: float | None
    left: int
    paths: int
    watched: float
    destinations: tuple[Destination, ...]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LifeTimes(Result):
    """How long the regimes that coexist under a sine last in noise, and where paths go.

    Parameters
    ----------
    regimes
        The life time of each motion that was found.
    frequency_hz
        Frequency of the force.
    outside
        Seconds that a path stays outside the basin of its regime before it counts as having left.
    assumptions
        What was taken for granted, a sentence each.

    See Also
    --------
    stochvi.statistics.lifetimes : What makes it.
    """

    regimes: tuple[LifeTime, ...]
    frequency_hz: float
    outside: float
    assumptions: Sequence[str] = ()

    def to_frame(self) -> pd.DataFrame:
        """One row for each regime and each destination; one for a regime that no path left."""
        import pandas as pd

        rows = []
        for each in self.regimes:
            row = {
                "regime": each.regime,
                "life_time": _or_nan(each.life_time),
                "life_time_low": each.life_time_low,
                "life_time_high": math.inf if each.left == 0 else each.life_time_high,
                "left": each.left,
                "paths": each.paths,
            }
            for there in each.destinations:
                rows.append(
                    row
                    | {
                        "to": there.regime,
                        "share": there.share,
                        "share_low": there.share_low,
                        "share_high": there.share_high,
                    }
                )
            if not each.destinations:
                rows.append(row | {"to": "", "share": math.nan})
        return pd.DataFrame(rows)

    def _document(self) -> dict[str, Any]:
        return {"method": "lifetimes", **super()._document()}

    def summary(self) -> str:
        """How long each regime lasts, in a sentence."""
        return "; ".join(map(_sentence, self.regimes))


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _sentence(each: LifeTime) -> str:
    if each.life_time is None:
        return f"{each.regime}: longer than {each.life_time_low:.3g} s (95 %), no path left it"
    most = max(each.destinations, key=lambda there: there.paths)
    high = math.inf if each.life_time_high is None else each.life_time_high
    return (
        f"{each.regime}: {each.life_time:.3g} s ({each.life_time_low:.3g} to {high:.3g} s), "
        f"{100.0 * most.share:.3g} % to {most.regime}"
    )


@calculation
def lifetimes(
    scene: Scene,
    regimes: Sequence[str] | None = None,
    *,
    rel_error: float = 0.1,
    seed: int = 0,
    threads: int | None = None,
    budget: float = 60.0,
    progress: Progress | None = None,
) -> LifeTimes:
    """How long each regime under a sine lasts in the noise of the scene, and where paths then go.

    Paths start in each of the motions that coexist without noise, and are simulated with it until
    enough of them have left the basin of their regime.

    Parameters
    ----------
    scene
        A linear structure with rigid stops, sines whose frequencies are multiples of one, and
        white, filtered or tabulated noise.
    regimes
        Names of the regimes whose life times are wanted, as "no impacts"; by default all.
    rel_error
        Relative standard error of the mean life times to reach; life times are taken for
        exponential.
    seed
        Seed of the random numbers: the same seed gives the same digits.
    threads
        Number of threads, by default that of the cores.
    budget
        Seconds of wall time, without that in which kernels are compiled.
    progress
        Called now and then with the fraction done and a sentence.

    Returns
    -------
    LifeTimes
        The life times and destinations of each motion.

    Raises
    ------
    NotApplicable
        If the scene is not of that kind, or has one motion alone.
    NotConverged
        If too few paths left by the end of the budget; the error holds what is known, a lower limit
        of a life time at least.

    See Also
    --------
    stochvi.methods.periodic.basins : What a start ends in without noise.
    stochvi.isolators.jolts : What a jolt does.

    Examples
    --------
    >>> import stochvi
    >>> from stochvi.scenes.datasets import shipped_scene
    >>> quiet = stochvi.load_scene(shipped_scene("isolator-sine"))
    >>> noise = stochvi.WhiteNoise(intensity=0.01)
    >>> noisy = quiet.replace(excitations=(*quiet.excitations, noise))
    >>> found = lifetimes(noisy, ["no impacts"], rel_error=0.5)
    >>> [each.regime for each in found.regimes]
    ['no impacts']
    """
    began, deadline = time.perf_counter(), Deadline.after(budget)
    if not 0.0 < rel_error <= 1.0:
        raise ValueError(f"rel_error must be above 0 and at most 1, got {rel_error}")
    model = model_of(scene)
    conditions = unmet(model)
    if not model.noisy:
        conditions.append("excitation must contain noise besides the sine, got none")
    if conditions:
        raise NotApplicable("lifetimes", conditions)
    plan = plan_modal_tables(model, 0.0, None) if model.tables else plan_modal(model, 0.0, None)
    with pool_of(None, threads) as crew:
        place = Place(scene, 3, deadline)
        known = _coexisting(place, crew.workers, deadline)
        wanted = math.ceil(1.0 / rel_error**2)
        watch = Watch(place, known, plan)
        most = math.ceil(MORE_PATHS * wanted / GROUP)
        groups = watch.groups(regimes, most, seed)
        while not deadline.passed():
            behind = [of for of in groups if _left(of) < wanted]
            if progress and behind:
                least = min(map(_left, behind))
                progress(least / wanted, f"{least} of {wanted} paths have left each regime")
            waiting = [group for of in behind for group in of if not np.all(group.left)]
            if not waiting:
                break
            list(crew.executor.map(Group.advance, waiting))
            for of in behind:
                of += watch.more(of, most)
    answer = LifeTimes(
        regimes=watch.answers(groups),
        frequency_hz=1.0 / place.period,
        outside=watch.outside * BETWEEN_LOOKS * place.period,
        assumptions=(*scene.assumptions(), LEAVING),
        cost=Cost(
            wall_time=time.perf_counter() - began,
            paths=sum(len(group.left) for of in groups for group in of),
            steps=sum(group.steps for of in groups for group in of),
            threads=crew.workers,
        ),
        warnings=watch.warnings(groups),
        provenance=provenance(scene.document(), seed),
    )
    if deadline.passed():
        raise deadline.fell_short(
            "before enough paths had left their regimes", "raise it, or rel_error", answer
        )
    return answer


LEAVING = (
    "a path has left a regime where it stays outside its basin, as without noise, for the time in "
    "which disturbances decay to a tenth; regimes are left at constant rates"
)
"""What life times take for granted."""


def _coexisting(place: Place, threads: int, deadline: Deadline) -> Attractors:
    """The motions that coexist without noise: stable regimes, and others that starts reveal."""
    place.finder.find()
    known = Attractors(place.finder, place.sigma)
    names, sides = place.plane(None, known)
    chosen = [side[np.linspace(0, len(side) - 1, SEARCHED).astype(int)] for side in sides]
    across, up = np.meshgrid(*chosen)
    starts = place.states.starts({names[0]: across.ravel(), names[1]: up.ravel()})
    BasinRun(known, starts, known.phase, DECIDED, threads, deadline).ends()
    if len(known.found) < 2 and not deadline.passed():
        raise NotApplicable(
            "lifetimes", ["several motions must coexist without noise, got one alone"]
        )
    return known


class Watch:
    """What all groups of paths have in common: the plan, the regimes, and the phase of the
    sines."""

    def __init__(self, place: Place, known: Attractors, plan: ModalPlan) -> None:
        self.place, self.known = place, known
        period = place.period
        self.plan = plan.at_whole_periods(period)
        self.steps = round(BETWEEN_LOOKS * period / self.plan.step)
        slowest = max(
            (
                math.log(DECAY_FACTOR) / -math.log(max(rate, 1e-12))
                for each in known.found
                if each.track is not None
                for rate in [float(each.track.multiplier[0]) ** (1.0 / each.track.periods)]
            ),
            default=float(BETWEEN_LOOKS),
        )
        self.outside = max(2, math.ceil(slowest / BETWEEN_LOOKS))
        order = range(len(known.found))
        self.described = place.described(known, order, np.zeros(len(order)), 0.0)

    def groups(self, names: Sequence[str] | None, most: int, seed: int) -> list[list[Group]]:
        """The first of at most so many groups of paths that start in each motion, or in those of
        some names."""
        known = [each.name for each in self.described]
        if unknown := set(names or ()) - set(known):
            raise ValueError(
                f"regimes must be some of {', '.join(map(repr, known))}, got "
                f"{', '.join(map(repr, sorted(unknown)))}"
            )
        return [
            [Group(self, regime, most * regime + k, seed) for k in range(min(most, FIRST_GROUPS))]
            for regime, name in enumerate(known)
            if names is None or name in names
        ]

    def more(self, of: Sequence[Group], most: int) -> list[Group]:
        """As many further groups that start in the same motion; `most` at most together with
        these."""
        first = of[0]
        return [
            Group(self, first.regime, first.number + k, first.seed)
            for k in range(len(of), min(2 * len(of), most))
        ]

    def start(self, regime: int, streams: NDArray[np.uint64]) -> Matrix:
        """States (2 modes, paths) of the modes in a motion, at the phase of its points."""
        points = self.known.found[regime].points
        chosen = points[np.linspace(0, len(points), streams.shape[1], endpoint=False).astype(int)]
        if self.known.found[regime].kind == PERIODIC:
            chosen = points[np.arange(streams.shape[1]) % len(points)]
        physical = self.place.states.physical(chosen).T
        modes = self.plan.modes
        back = np.linalg.inv(modes.shapes)
        n = modes.size
        return np.vstack([back @ physical[:n] - modes.rest[:, None], back @ physical[n:]])

    def set_sines(self, state: Matrix) -> None:
        """Give the sines of states of the plan the phase of the points of the regimes."""
        modes, model = self.plan.modes, self.plan.model
        base = 2.0 * math.pi / self.place.period
        for first, omega, amplitude in modes.sines:
            turn = round(omega / base) * self.known.phase + model.signals[first // 2].phase
            row = 2 * modes.size + first
            state[row], state[row + 1] = amplitude * math.cos(turn), -amplitude * math.sin(turn)

    def regimes(self, motion: Matrix) -> Whole:
        """The regimes in whose basins states (2 modes, paths) of the modes lie."""
        modes, n = self.plan.modes, self.plan.modes.size
        moved = modes.shapes @ (motion[:n] + modes.rest[:, None])
        states = self.place.states.scaled(np.vstack([moved, modes.shapes @ motion[n:]]).T)
        deadline = self.place.finder.deadline
        return BasinRun(
            self.known, np.ascontiguousarray(states), self.known.phase, DECIDED, 1, deadline
        ).known_ends()

    def answers(self, groups: list[list[Group]]) -> tuple[LifeTime, ...]:
        """The life times of all motions."""
        names = [each.name for each in self.described]
        found = []
        for of in groups:
            regime = self.described[of[0].regime]
            left = _left(of)
            watched = float(sum(group.watched() for group in of))
            low, high = poisson_interval(left, watched) if watched else (0.0, math.inf)
            ends = np.concatenate([group.ends[group.left] for group in of])
            found.append(
                LifeTime(
                    regime=regime.name,
                    kind=regime.kind,
                    impact_speed_max=regime.impact_speed_max,
                    life_time=watched / left if left else None,
                    life_time_low=1.0 / high,
                    life_time_high=1.0 / low if low > 0.0 else None,
                    left=left,
                    paths=sum(len(group.left) for group in of),
                    watched=watched,
                    destinations=_destinations(ends, names),
                )
            )
        return tuple(found)

    def warnings(self, groups: list[list[Group]]) -> tuple[str, ...]:
        """Which regimes the noise mixes with others."""
        shares = [(self.described[of[0].regime].name, _share_outside(of)) for of in groups]
        return tuple(
            f"the noise mixes the regime '{name}' with others: before paths leave it, they lie "
            f"{100.0 * share:.0f} % of the time outside its basin and come back, so that its life "
            "time hangs on how long they must stay outside"
            for name, share in shares
            if share > MIXED
        )


def _share_outside(groups: Sequence[Group]) -> float:
    """Share of the looks at which paths lay outside a basin to which they later came back."""
    looks = sum(group.seen for group in groups)
    return sum(group.returned for group in groups) / looks if looks else 0.0


def _left(groups: Sequence[Group]) -> int:
    return int(sum(np.sum(group.left) for group in groups))


def _destinations(ends: Whole, names: Sequence[str]) -> tuple[Destination, ...]:
    counted = sorted(
        ((int(np.sum(ends == number)), int(number)) for number in np.unique(ends)), reverse=True
    )
    found = []
    for paths, number in counted:
        low, high = binomial_interval(paths, len(ends))
        found.append(
            Destination(
                regime=names[number] if number >= 0 else "undecided",
                paths=paths,
                share=paths / len(ends),
                share_low=low,
                share_high=high,
            )
        )
    return tuple(found)


class Group:
    """Paths that start in one regime and are simulated together."""

    def __init__(self, watch: Watch, regime: int, number: int, seed: int) -> None:
        self.watch, self.regime = watch, regime
        self.number, self.seed = number, seed
        streams = np.empty((2, GROUP), np.uint64)
        seed_streams(np.uint64(seed), number * GROUP, streams)
        state = watch.plan.start(streams)
        watch.set_sines(state)
        motion = watch.start(regime, streams)
        self.flight = watch.plan.flight(state, streams, motion, seed, number * GROUP)
        self.looks, self.steps = 0, 0
        self.since = np.zeros(GROUP, np.int64)
        self.ends = np.full(GROUP, regime)
        self.left = np.zeros(GROUP, bool)
        self.left_at = np.zeros(GROUP, np.int64)
        self.seen, self.returned = 0, 0

    def advance(self) -> None:
        """Simulate the paths on, and look at them now and then."""
        for _ in range(LOOKS):
            if np.all(self.left) or self.watch.place.finder.deadline.passed():
                return
            motion = self.flight.on(self.watch.steps)
            self.steps += self.watch.steps * GROUP
            self.looks += 1
            here = np.flatnonzero(~self.left)
            ends = self.watch.regimes(motion[:, here])
            if self.watch.place.finder.deadline.passed():
                # the last states may not have been followed to a regime
                self.looks -= 1
                return
            self._note(here, ends)

    def _note(self, here: Whole, ends: Whole) -> None:
        """Note the basins in which the paths lie that have not left."""
        outside = ends != self.regime
        started = outside & (self.since[here] == 0)
        self.since[here[started]] = self.looks
        back = ~outside & (self.since[here] > 0)
        self.returned += int(np.sum(self.looks - self.since[here[back]]))
        self.seen += int(np.sum(~outside)) + int(np.sum(self.looks - self.since[here[back]]))
        self.since[here[~outside]] = 0
        gone = outside & (self.looks - self.since[here] >= self.watch.outside)
        self.left[here[gone]] = True
        self.left_at[here[gone]] = self.since[here[gone]]
        self.ends[here[gone]] = ends[gone]

    def watched(self) -> float:
        """Seconds in the regime in which a departure would have been noted, all paths together.

        A departure is dated back to the start of the stay outside, so that one in the last
        `Watch.outside` looks cannot have been noted yet: these looks are not counted.
        """
        noted = max(self.looks - self.watch.outside, 0)
        looks = np.where(self.left, self.left_at - 0.5, noted)
        return float(looks.sum()) * BETWEEN_LOOKS * self.watch.place.period
