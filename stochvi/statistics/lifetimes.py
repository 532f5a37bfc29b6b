"""Life times in noise of motions that coexist under a sine.

Chapters: mean life from paths that are looked at now and then; the calculation.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, dataclass, replace
from typing import Any, NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Booleans, Matrix, Vector, Whole
from stochvi.mathematics.units import TIME
from stochvi.methods.periodic.attracted import (
    PERIODIC,
    Attractors,
    BasinRegime,
    BasinRun,
    KnownMotions,
    Place,
    unmet_by_flights,
)
from stochvi.methods.periodic.family import States
from stochvi.model.coverage import not_gaussian
from stochvi.model.model import model_of
from stochvi.motion.kernels.random_numbers import seed_streams
from stochvi.motion.modal import Aloft, Flight, ModalPlan, plan_modal
from stochvi.motion.modal_tables import plan_modal_tables
from stochvi.results.base import DataFrame, Result, frame_of, stated
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import GAUSSIAN_95, binomial_interval, poisson_interval, provenance
from stochvi.sampling.calculations import AccuracyOptions, Sampler, calculation
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene

# ------------------------------------------------------------------------------
# Mean life of paths that are looked at now and then, of which some outlive the last look.
#
# Paths that start in one motion leave it rarely at first, as noise has not spread them yet. Once
# they have forgotten their start they leave at a constant rate. Seconds per departure are wrong
# where paths are watched for a part of their lives: too many of these seconds are early ones. So
# the share of paths that are still there is counted up to the look at which the start is forgotten
# (E. Kaplan and P. Meier 1958), and falls exponentially only beyond it.
# ------------------------------------------------------------------------------


class MeanLife(NamedTuple):
    """A mean life with its 95 % interval and standard error, all in looks.

    Where no path left at the constant rate, the value is NaN, and `upper` and `error` are infinite.
    """

    value: float
    lower: float
    upper: float
    error: float


class Beginning(NamedTuple):
    """The looks before the start is forgotten: after each look the share of paths still there, and
    the squared relative error that the look adds to the shares of all later looks."""

    alive: Vector
    squared_error: Vector

    def mean_life(self, beyond: float) -> tuple[float, float]:
        """The mean life, and its standard error (M. Greenwood 1926), where the paths still there at
        the end live on for so many looks."""
        before = np.concatenate([[1.0], self.alive])
        # departures are noted half an interval late
        spent = np.append(0.5 * (before[1:] + before[:-1]), before[-1] * beyond)
        rest = spent[::-1].cumsum()[::-1]
        later = rest[1:] + 0.5 * self.alive
        return float(rest[0]), math.sqrt(float(self.squared_error @ later**2))


class Survival(NamedTuple):
    """Numbers of paths by look: how many might have left at it, and how many did."""

    at_risk: Whole
    departures: Whole

    @classmethod
    def of(cls, ends: Whole, left: Booleans) -> Survival:
        """The numbers of paths that were watched up to the looks `ends`, at which some `left`."""
        looks = int(ends.max(initial=0))
        ended, gone = (np.bincount(each, minlength=looks + 1) for each in (ends, ends[left]))
        return cls(ended[::-1].cumsum()[::-1][1:], gone[1:])

    @property
    def watched(self) -> float:
        """Number of looks that paths lived through, all together."""
        return float(self.at_risk.sum() - 0.5 * self.departures.sum())

    def mean_life(self, forgotten: int) -> MeanLife:
        """The mean life of paths that leave at a constant rate after the look `forgotten`.

        The interval joins the errors of the looks before it with the exact interval of the rate.
        """
        beginning = self._beginning(forgotten)
        last = float(beginning.alive[-1]) if len(beginning.alive) else 1.0
        later = Survival(self.at_risk[forgotten:], self.departures[forgotten:])
        left, watched = int(later.departures.sum()), later.watched
        slow, fast = poisson_interval(left, watched) if watched else (0.0, math.inf)
        if last > 0.0 and left == 0:
            value, error = beginning.mean_life(1.0 / fast)
            return MeanLife(math.nan, max(value - GAUSSIAN_95 * error, 0.0), math.inf, math.inf)
        short, beyond, long = (1.0 / fast, watched / left, 1.0 / slow) if left else (0.0, 0.0, 0.0)
        value, error = beginning.mean_life(beyond)
        lower = value - math.hypot(GAUSSIAN_95 * error, last * (beyond - short))
        upper = value + math.hypot(GAUSSIAN_95 * error, last * (long - beyond))
        error = math.hypot(error, last * beyond / math.sqrt(max(left, 1)))
        return MeanLife(value, max(lower, 0.0), upper, error)

    def _beginning(self, forgotten: int) -> Beginning:
        at_risk, departures = (each[:forgotten].astype(float) for each in self)
        stayed = at_risk - departures
        # none is left to count where all have gone
        squared = departures / (at_risk * np.maximum(stayed, 1.0))
        return Beginning(np.cumprod(stayed / at_risk), np.where(stayed > 0.0, squared, 0.0))


# ------------------------------------------------------------------------------
# Life times in noise: how long each regime that coexists under a sine lasts, and what follows.
#
# A path starts in a regime and is simulated with the noise of the scene. Every few periods its
# state is followed on without noise, to the regime in whose basin it lies. A path has left its
# regime once it lies outside of that basin for long enough to forget how it got there.
# ------------------------------------------------------------------------------


BETWEEN_LOOKS = 5
"""Number of periods of the force between two looks at the state of a path."""

LOOKS = 8
"""Number of looks at a group of paths in a round, besides those before which a departure at the
constant rate is noted: a small budget is not spent on beginnings alone."""

DECAY_FACTOR = 10.0
"""A path has left a basin once it stays outside for some time. In this time a small perturbation
decays by this factor, in the slowest of the regimes."""

FORGOTTEN = 2
"""Multiple of that time after which paths leave at a constant rate: their variance has come within
DECAY_FACTOR to the power of -4 of that of paths without a start."""

DECIDED = 200
"""Number of periods for which a state is followed on without noise to the regime of its basin."""

MIXED = 0.1
"""A warning is given from this share of the looks on at which paths lie outside a basin to which
they come back."""

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
    """Destination of the paths that leave a regime.

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

    regime: str = stated("they go to", "", MISSING)
    paths: int
    share: float = stated("share", "", MISSING)
    share_low: float = stated("share from", "", MISSING)
    share_high: float = stated("share to", "", MISSING)


NOWHERE = Destination(regime="", paths=0, share=math.nan, share_low=math.nan, share_high=math.nan)
"""Destination of a regime that no path left."""


@dataclass(frozen=True, kw_only=True)
class LifeTime:
    """Life time of a regime in noise.

    Parameters
    ----------
    regime, kind
        Name and kind of the regime, as in `BasinRegime`.
    impact_speed_max
        Largest impact speed without noise, m/s.
    life_time, life_time_low, life_time_high
        Mean time until a path that starts in the motion without noise leaves, s, with its 95 %
        interval; None where too few paths left, and where there is no upper limit.
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

    regime: str = stated("regime", "", MISSING)
    kind: str
    impact_speed_max: float
    life_time: float | None = stated("life time", "s", MISSING)
    life_time_low: float = stated("95 % from", "s", MISSING)
    life_time_high: float | None = stated("to", "s", MISSING)
    left: int = stated("paths left", "", MISSING)
    paths: int = stated("of", "", MISSING)
    watched: float
    destinations: tuple[Destination, ...]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LifeTimes(Result):
    """Life times in noise of the regimes that coexist under a sine, and destinations of the paths.

    Parameters
    ----------
    regimes
        The life time of each motion that was found.
    frequency_hz
        Frequency of the force.
    outside
        Seconds that a path stays outside the basin of its regime before it counts as having left.
    assumptions
        Assumptions, a sentence each.

    See Also
    --------
    stochvi.statistics.lifetimes : The calculation.
    """

    kind = "lifetimes"

    regimes: tuple[LifeTime, ...]
    frequency_hz: float
    outside: float
    assumptions: Sequence[str] = ()

    @property
    def departures(self) -> list[tuple[LifeTime, Destination]]:
        """Each regime with each destination, or with none."""
        return [(each, to) for each in self.regimes for to in each.destinations or (NOWHERE,)]

    def to_frame(self) -> DataFrame:
        """One row for each regime and each destination; one for a regime that no path left."""
        rows = [
            {name: getattr(each, name) for name in OF_A_REGIME}
            | {"to": to.regime}
            | {name: getattr(to, name) for name in ("share", "share_low", "share_high")}
            for each, to in self.departures
        ]
        found = frame_of(rows).astype({"life_time": float})
        endless = found["life_time"].isna()
        return found.assign(life_time_high=found["life_time_high"].mask(endless, math.inf))

    def summary(self) -> str:
        """How long each regime lasts, in a sentence."""
        return "; ".join(map(_sentence, self.regimes))


OF_A_REGIME = ("regime", "life_time", "life_time_low", "life_time_high", "left", "paths")
"""Columns of a regime."""


def _sentence(each: LifeTime) -> str:
    if each.life_time is None:
        left = "no path" if each.left == 0 else f"{each.left} of {each.paths} paths"
        least = TIME.text(each.life_time_low, ".3g")
        return f"{each.regime}: longer than {least} (95 %), {left} left it"
    most = max(each.destinations, key=lambda there: there.paths)
    high = math.inf if each.life_time_high is None else each.life_time_high
    return (
        f"{each.regime}: {TIME.text(each.life_time, '.3g')} "
        f"({TIME.span(each.life_time_low, high, '.3g')}), "
        f"{100.0 * most.share:.3g} % to {most.regime}"
    )


@calculation
@sampled(rel_error=0.1)
def lifetimes(
    scene: Scene,
    regimes: Sequence[str] | None = None,
    **options: Unpack[AccuracyOptions],
) -> LifeTimes:
    """Life time of each regime under a sine in the noise of the scene, and where paths then go.

    Paths start in each of the motions that coexist without noise. They are simulated with noise
    until enough of them have left the basin of their regime.

    Parameters
    ----------
    scene
        A linear structure with rigid stops, sines whose frequencies are multiples of one, and
        white, filtered or tabulated noise.
    regimes
        Names of the regimes whose life times are wanted, as "no impacts"; by default all.
    **options
        `AccuracyOptions`: rel_error, seed, budget and others. The relative error is that of the
        mean life times; 0.1 if left out.

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
    stochvi.isolators.perturbations : What a perturbation does.

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
    run = Run.of(options)
    model = model_of(scene)
    conditions = unmet_by_flights(model) + not_gaussian(model)
    if not model.noisy:
        conditions.append("excitation must contain noise besides the sine, got none")
    if conditions:
        raise NotApplicable("lifetimes", conditions)
    plan = plan_modal_tables(model, 0.0, None) if model.tables else plan_modal(model, 0.0, None)
    run.begin()
    place = Place(scene, 3, run.deadline)
    known = _coexisting(place, run)
    described = place.described(known, range(len(known.found)), np.zeros(len(known.found)), 0.0)
    wanted = math.ceil(1.0 / run.accuracy**2)
    sampler = DepartureSampler(
        plan.at_whole_periods(place.period), known.known(), place.states, place.period,
        _looks_outside(known), _numbers(regimes, [each.name for each in described]), wanted,
        run.seed,
    )  # fmt: skip

    def more(sample: Departures) -> int:
        return GROUP * len(sample.round)

    def tell(sample: Departures) -> tuple[float, str]:
        least = min(sampler.departures(sample, regime) for regime in sampler.regimes)
        return least / wanted, f"{least:.0f} of {wanted} departures from each regime"

    first = GROUP * len(sampler.first_round)
    taken = run.until(sampler, first, more, start=sampler.group_of, tell=tell)
    answer = LifeTimes(
        regimes=tuple(sampler.life_time(taken.sample, described, each) for each in sampler.regimes),
        frequency_hz=1.0 / place.period,
        outside=sampler.outside * BETWEEN_LOOKS * place.period,
        assumptions=(*scene.assumptions(), LEAVING),
        cost=run.cost(
            paths=GROUP * len(taken.sample.groups),
            steps=GROUP * sampler.steps * sum(g.looks for g in taken.sample.groups.values()),
        ),
        warnings=tuple(_mixed(taken.sample, described, sampler.regimes)),
        provenance=provenance(scene.document(), run.seed),
    )
    if not taken.enough:
        raise run.deadline.fell_short(
            "before enough paths had left their regimes", "raise it, or rel_error", answer
        )
    return answer


LEAVING = (
    "a path has left a regime once it stays outside its basin, as without noise, for the time in "
    "which perturbations decay to a tenth; after twice that time regimes are left at constant rates"
)
"""Assumption of life times."""


def _coexisting(place: Place, run: Run) -> Attractors:
    """The motions that coexist without noise: stable regimes, and others that starts reveal."""
    place.finder.find()
    known = Attractors(place.finder, place.sigma)
    names, sides = place.plane(None, known)
    chosen = [side[np.linspace(0, len(side) - 1, SEARCHED).astype(int)] for side in sides]
    across, up = np.meshgrid(*chosen)
    starts = place.states.starts({names[0]: across.ravel(), names[1]: up.ravel()})
    silent = replace(run, progress=None)
    BasinRun(silent, known, starts, known.phase, DECIDED).ends()
    if len(known.found) < 2 and not run.deadline.passed():
        raise NotApplicable(
            "lifetimes",
            "several motions must coexist without noise, got one alone; change the sine or the "
            "clearance (sine shows where several do)",
        )
    return known


def _looks_outside(known: Attractors) -> int:
    """Number of looks for which a path that has left a regime lies outside of its basin."""
    slowest = max(
        (
            math.log(DECAY_FACTOR) / -math.log(max(rate, 1e-12))
            for each in known.found
            if each.track is not None
            for rate in [float(each.track.multiplier[0]) ** (1.0 / each.track.periods)]
        ),
        default=float(BETWEEN_LOOKS),
    )
    return max(2, math.ceil(slowest / BETWEEN_LOOKS))


def _numbers(names: Sequence[str] | None, known: Sequence[str]) -> tuple[int, ...]:
    """Numbers of the regimes of some names, or of all."""
    if unknown := set(names or ()) - set(known):
        raise ValueError(
            f"regimes must be some of {', '.join(map(repr, known))}, got "
            f"{', '.join(map(repr, sorted(unknown)))}"
        )
    return tuple(k for k, name in enumerate(known) if names is None or name in names)


@dataclass(frozen=True, eq=False)
class Group:
    """Paths that start in one regime and are simulated together, as far as they have come.

    Parameters
    ----------
    regime
        Number of their regime.
    at
        Where the paths are.
    looks, until
        Number of looks at their states, and the number at the end of the round.
    since
        (paths,): the look since which each path lies outside its basin, or 0.
    left, left_at, ends
        (paths,): whether it has left, since which look, and for which motion.
    seen, returned
        Number of looks at paths that had not left. In `returned` of these looks the path lay
        outside its basin, and came back later.
    """

    regime: int
    at: Aloft
    looks: int
    until: int
    since: Whole
    left: NDArray[np.bool_]
    left_at: Whole
    ends: Whole
    seen: int = 0
    returned: int = 0

    @property
    def whole(self) -> bool:
        """Whether the paths were simulated up to the end of the round."""
        return self.looks >= self.until or bool(np.all(self.left))

    def noted(self, at: Aloft, here: Whole, there: Whole, outside: int) -> Group:
        """The group after another look, at which the paths `here`, all that have not left, lie in
        the basins `there`; a path has left after so many looks `outside`."""
        looks = self.looks + 1
        since, left = self.since.copy(), self.left.copy()
        left_at, ends = self.left_at.copy(), self.ends.copy()
        beyond = there != self.regime
        since[here[beyond & (since[here] == 0)]] = looks
        back = here[~beyond & (since[here] > 0)]
        returned = int(np.sum(looks - since[back]))
        since[here[~beyond]] = 0
        gone = beyond & (looks - since[here] >= outside)
        left[here[gone]] = True
        left_at[here[gone]] = since[here[gone]]
        ends[here[gone]] = there[gone]
        return Group(
            self.regime, at, looks, self.until, since, left, left_at, ends,
            self.seen + int(np.sum(~beyond)) + returned, self.returned + returned,
        )  # fmt: skip

    def noted_until(self, outside: int) -> Whole:
        """(paths,): the last look at which a departure of each path would have been noted.

        A departure is dated back to the start of the stay outside, so that one in the last
        `outside` looks cannot have been noted yet.
        """
        return np.where(self.left, self.left_at, max(self.looks - outside, 0))


@dataclass(frozen=True, eq=False)
class Departures:
    """Groups by their numbers, the groups of the present round, and how many blocks were done
    before this round and in it."""

    groups: dict[int, Group]
    round: tuple[int, ...]
    before: int = 0
    done: int = 0

    def of(self, regime: int) -> list[Group]:
        """The groups of a regime in their order."""
        return [group for _, group in sorted(self.groups.items()) if group.regime == regime]

    def left(self, regime: int) -> int:
        """Number of paths that have left a regime."""
        return int(sum(np.sum(group.left) for group in self.of(regime)))


@dataclass(frozen=True, eq=False)
class DepartureSampler(Sampler[Group, Departures]):
    """Paths in groups, each of which is simulated on by a block in each round.

    After a round, the groups of regimes that too few paths have left go on in the next one. As many
    new groups as there are join them, until there are `most` of each regime.

    Parameters
    ----------
    plan, seed
        How paths are simulated with noise.
    known, states, period
        The motions without noise, their states, and the period of the force, s.
    outside
        Number of looks for which a path that has left lies outside a basin.
    regimes, wanted
        Numbers of the regimes, and number of departures at a constant rate that makes the life time
        of each accurate enough.
    """

    plan: ModalPlan
    known: KnownMotions
    states: States
    period: float
    outside: int
    regimes: tuple[int, ...]
    wanted: int
    seed: int

    @property
    def block(self) -> int:
        """Number of paths in a group."""
        return GROUP

    @property
    def steps(self) -> int:
        """Number of steps between two looks."""
        return round(BETWEEN_LOOKS * self.period / self.plan.step)

    @property
    def looks(self) -> int:
        """Number of looks in a round."""
        return (FORGOTTEN + 1) * self.outside + LOOKS

    @property
    def most(self) -> int:
        """Largest number of groups of a regime."""
        return math.ceil(MORE_PATHS * self.wanted / GROUP)

    def numbers(self, regime: int, groups: int) -> list[int]:
        """Numbers of the first groups of a regime, of which there are at most `most`."""
        return [self.most * regime + k for k in range(min(groups, self.most))]

    @property
    def first_round(self) -> tuple[int, ...]:
        """The groups of the first round."""
        return tuple(n for regime in self.regimes for n in self.numbers(regime, FIRST_GROUPS))

    # Rounds -------------------------------------------------------------------------------------

    def group_of(
        self, sample: Departures | None, first_path: int, paths: int
    ) -> tuple[int, Group | None]:
        """The number of the group that a block simulates on, and the group unless it is new."""
        if sample is None:
            return self.first_round[first_path // GROUP], None
        number = sample.round[first_path // GROUP - sample.before]
        return number, sample.groups.get(number)

    def next_round(self, sample: Departures) -> tuple[int, ...]:
        """The groups of the round that follows a sample; none once enough paths have left."""
        behind = [each for each in self.regimes if self.departures(sample, each) < self.wanted]
        return tuple(
            number
            for regime in behind
            for number in self.numbers(regime, 2 * len(sample.of(regime)))
            if number not in sample.groups or not np.all(sample.groups[number].left)
        )

    def merge(self, sample: Departures, more: Departures) -> Departures:
        """The sample after a further block."""
        groups, done = sample.groups | more.groups, sample.done + 1
        merged = Departures(groups, sample.round, sample.before, done)
        if done < len(sample.round):
            return merged
        return Departures(groups, self.next_round(merged), sample.before + done)

    def add_up(self, pieces: list[Any]) -> Departures:
        """The sample of the first block of all."""
        return self.merge(Departures({}, self.first_round), Departures(dict(pieces), ()))

    def paths(self, sample: Departures) -> int:
        """Number of groups that were simulated on, in all rounds, times their paths."""
        return GROUP * (sample.before + sample.done)

    def is_whole(self, sample: Departures, paths: int) -> bool:
        """Whether the group of a block was simulated up to the end of its round."""
        return all(group.whole for group in sample.groups.values())

    # Paths --------------------------------------------------------------------------------------

    def sample(
        self, first_path: int, paths: int, deadline: Deadline,
        start: tuple[int, Group | None] | None = None,
    ) -> Departures:  # fmt: skip
        """The group of a block, simulated on until its next round or the deadline."""
        assert start is not None
        number, group = start
        return self.add_up([(number, self.advance(number, group or self.begun(number), deadline))])

    def simulate(self, first_path: int, paths: int) -> Group:
        """A new group."""
        return self.begun(first_path // GROUP)

    def begun(self, number: int) -> Group:
        """A new group: its paths lie in the motion of its regime."""
        regime, streams = number // self.most, np.empty((2, GROUP), np.uint64)
        seed_streams(np.uint64(self.seed), number * GROUP, streams)
        state = self.plan.start(streams)
        self._set_sines(state)
        return Group(
            regime, Aloft(state, streams, self._motion(regime)), 0, 0, np.zeros(GROUP, np.int64),
            np.zeros(GROUP, bool), np.zeros(GROUP, np.int64), np.full(GROUP, regime),
        )  # fmt: skip

    def advance(self, number: int, group: Group, deadline: Deadline) -> Group:
        """Simulate a group on, and look at its paths now and then."""
        flight = Flight(self.plan, group.at, self.seed, number * GROUP)
        group = replace(group, until=group.looks + self.looks)
        while not (group.whole or deadline.passed()):
            motion = flight.on(self.steps)
            here = np.flatnonzero(~group.left)
            group = group.noted(flight.at, here, self._regimes(motion[:, here]), self.outside)
        return group

    def _motion(self, regime: int) -> Matrix:
        """States (2 modes, paths) of the modes in a motion, at the phase of its points."""
        points = self.known.found[regime].points
        chosen = points[np.linspace(0, len(points), GROUP, endpoint=False).astype(int)]
        if self.known.found[regime].kind == PERIODIC:
            chosen = points[np.arange(GROUP) % len(points)]
        physical = self.states.physical(chosen).T
        modes = self.plan.modes
        back = np.linalg.inv(modes.shapes)
        n = modes.size
        return np.vstack([back @ physical[:n] - modes.rest[:, None], back @ physical[n:]])

    def _set_sines(self, state: Matrix) -> None:
        """Give the sines of states of the plan the phase of the points of the regimes."""
        modes, model = self.plan.modes, self.plan.model
        base = 2.0 * math.pi / self.period
        for first, omega, amplitude in modes.sines:
            turn = round(omega / base) * self.known.phase + model.signals[first // 2].phase
            row = 2 * modes.size + first
            state[row], state[row + 1] = amplitude * math.cos(turn), -amplitude * math.sin(turn)

    def _regimes(self, motion: Matrix) -> Whole:
        """The regimes in whose basins states (2 modes, paths) of the modes lie."""
        modes, n = self.plan.modes, self.plan.modes.size
        moved = modes.shapes @ (motion[:n] + modes.rest[:, None])
        states = self.states.scaled(np.vstack([moved, modes.shapes @ motion[n:]]).T)
        return self.known.ends_of(np.ascontiguousarray(states), DECIDED)

    # Answers ------------------------------------------------------------------------------------

    def survival(self, sample: Departures, regime: int) -> Survival:
        """How many paths were still in a regime at each look, and how many left it then."""
        groups = sample.of(regime)  # none where the budget ended before the first of the regime
        ends = [group.noted_until(self.outside) for group in groups]
        left = [group.left for group in groups]
        return Survival.of(
            np.concatenate([np.empty(0, np.int64), *ends]),
            np.concatenate([np.empty(0, np.bool_), *left]),
        )

    def mean_life(self, sample: Departures, regime: int) -> MeanLife:
        """The mean life time of a regime, in looks."""
        return self.survival(sample, regime).mean_life(FORGOTTEN * self.outside)

    def departures(self, sample: Departures, regime: int) -> float:
        """The number of departures at a constant rate from which the life time of a regime would be
        as accurate as it is."""
        found = self.mean_life(sample, regime)
        return 0.0 if math.isinf(found.error) else (found.value / found.error) ** 2

    def life_time(
        self, sample: Departures, described: Sequence[BasinRegime], number: int
    ) -> LifeTime:
        """The life time of a motion."""
        groups, seconds = sample.of(number), BETWEEN_LOOKS * self.period
        found, survival = self.mean_life(sample, number), self.survival(sample, number)
        known = not math.isnan(found.value)
        ends = [group.ends[group.left] for group in groups]
        regime = described[number]
        return LifeTime(
            regime=regime.name,
            kind=regime.kind,
            impact_speed_max=regime.impact_speed_max,
            life_time=seconds * found.value if known else None,
            life_time_low=seconds * found.lower,
            life_time_high=seconds * found.upper if known else None,
            left=sample.left(number),
            paths=GROUP * len(groups),
            watched=seconds * survival.watched,
            destinations=_destinations(
                np.concatenate([np.empty(0, np.int64), *ends]), [each.name for each in described]
            ),
        )


def _mixed(
    sample: Departures, described: Sequence[BasinRegime], regimes: Sequence[int]
) -> Iterator[str]:
    """Which regimes the noise mixes with others."""
    for regime in regimes:
        looks = sum(group.seen for group in sample.of(regime))
        share = sum(group.returned for group in sample.of(regime)) / max(looks, 1)
        if share > MIXED:
            yield (
                f"the noise mixes the regime '{described[regime].name}' with others: before paths "
                f"leave it, they lie {100.0 * share:.0f} % of the time outside its basin and come "
                "back, so its life time depends on how long they must stay outside"
            )


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
