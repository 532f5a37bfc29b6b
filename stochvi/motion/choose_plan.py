"""How a model is simulated. Chapters: the sampler of `simulate`; what the first paths take; choice
of the plan, and conditions; stationary records of many paths; logs of every impact; motion of gaps
without impacts."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property, wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.engine.arithmetic import COLUMNS, Log
from stochvi.mathematics.numerics import Matrix, Vector, Waves
from stochvi.mathematics.spectra import (
    Table,
    Tables,
    beyond,
    bin_amplitudes,
    damping_at,
    eigenvalues,
    gains,
)
from stochvi.mathematics.units import density_from_intensity
from stochvi.model.coverage import (
    beyond_one_oscillator,
    free_motion,
    functions_of_arrays,
    not_compiled,
    relaxing,
    unstable,
    without_energy,
    without_noise,
)
from stochvi.model.modal import ModalForm
from stochvi.model.model import UPPER, Model, Pair, model_of, with_dampers
from stochvi.model.scales import default_thresholds, with_linear_part
from stochvi.motion.kernels.flight import CORNER_SHARE
from stochvi.motion.modal import ModalPlan, plan_modal
from stochvi.motion.modal_tables import (
    _block_length,
    plan_modal_tables,
    seconds_of_plan,
    streams_of_block,
)
from stochvi.motion.plan import (
    RELAXATIONS,
    Histories,
    PathStatistics,
    Plan,
    Statistic,
    StepPairs,
    Underway,
    check_statistics,
    losses_of,
)
from stochvi.motion.synthesis import (
    BLOCK_RELAXATIONS,
    BLOCK_SAMPLES,
    LARGEST_BLOCK,
    LARGEST_LOSS,
    LOWEST_FREQUENCY,
    MOST_SAMPLES,
    SAMPLES_PER_PERIOD,
    WHITE_LOSS,
    _even_fast_length,
    _filtered,
    folded,
    synthesised,
)
from stochvi.motion.white import plan_white, with_linear_part_at_stops
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.files import thread_seconds
from stochvi.sampling.calculations import (
    FEWEST_AT_ONCE,
    FULL_LANES,
    PIECE_SECONDS,
    SHORTEST,
    Block,
    GivenUp,
    Sampler,
    blocks_of,
    given_up_after,
)
from stochvi.scenes.excitations.drawn import Pulses
from stochvi.scenes.impact_laws import RigidLaw
from stochvi.scenes.scene import Scene

# ------------------------------------------------------------------------------
# The sampler of `simulate`: averages over paths, some of which are simulated at two steps.
#
# Its blocks are cut in time, not in paths: a step of a few paths costs nearly as much as of many.
# ------------------------------------------------------------------------------


FEWEST_PAIRS = 64
"""Number of the first paths of a run that are all simulated at twice the step too."""

FIRST_STEPS, MORE_STEPS = 2, 4
"""Number of steps in the first piece of a block, and the factor by which the next ones may be
longer."""

SHORTEST_STEP = 1e-9
"""Time in seconds of a step of a block for which the clock measured zero."""

Averages = NDArray[np.float64]
"""Time averages (rows, paths)."""


@dataclass(frozen=True)
class PathsOf:
    """Statistics of some paths; of those of them that were simulated at twice the step too, which
    may be none; and the number of counted steps of each path, fewer than those of the plan where
    the deadline passed first."""

    fine: PathStatistics
    pairs: StepPairs
    steps: int


@dataclass(frozen=True)
class ResponseSampler(Sampler[Any, PathsOf]):
    """Time averages of the paths of a plan; with `all_pairs` all of them at twice the step too."""

    plan: Plan
    seed: int
    all_pairs: bool = False

    @property
    def block(self) -> int:
        """Number of paths that are simulated together."""
        return self.plan.block

    def simulate(self, first_path: int, paths: int) -> Any:
        """Averages of whole paths; see `averages_in_time`."""
        return averages_in_time(self.plan, self.seed, first_path, paths, NEVER, self.all_pairs)

    def add_up(self, pieces: list[Any]) -> PathsOf:
        """Statistics of a block."""
        ((fine, pairs, steps),) = pieces
        layout = self.plan.layout
        known = StepPairs.of(pairs, layout) if pairs.shape[1] else StepPairs.none(layout)
        return PathsOf(PathStatistics.of(fine, layout), known, steps)

    def sample(self, first_path: int, paths: int, deadline: Deadline) -> PathsOf:
        """Statistics of a block, over the steps that it has made where the deadline passes."""
        return self.add_up(
            [averages_in_time(self.plan, self.seed, first_path, paths, deadline, self.all_pairs)]
        )

    def merge(self, sample: PathsOf, more: PathsOf) -> PathsOf:
        """Statistics of both groups of paths."""
        pairs = sample.pairs.merge(more.pairs) if more.pairs.count else sample.pairs
        if not sample.pairs.count:
            pairs = more.pairs
        return PathsOf(sample.fine.merge(more.fine), pairs, sample.steps)

    def paths(self, sample: PathsOf) -> int:
        """Number of paths."""
        return sample.fine.count

    def is_whole(self, sample: PathsOf, paths: int) -> bool:
        """Whether all paths of a block have made all their steps."""
        return sample.fine.count == paths and sample.steps == self.plan.steps

    def merge_cut(self, sample: PathsOf | None, cut: PathsOf) -> PathsOf:
        """Paths that end early are used only if there are no others."""
        return cut if sample is None else sample


def averages_in_time(
    plan: Plan, seed: int, first_path: int, paths: int, deadline: Deadline, all_pairs: bool = False
) -> tuple[Averages, Averages, int]:
    """Averages of a block of paths; those of `paths_at_both_steps`, with the rows at twice the step
    after those at the step, of all paths if `all_pairs`; and the number of counted steps of each.

    A deadline cuts the block in time. In the first block of a run FULL_LANES paths come first,
    because there is no answer without them. They go on until they have been counted for a
    relaxation time, and end there if the deadline has passed. After a later deadline the paths that
    have not ended are left out. `GivenUp` where there are no averages in time.
    """
    size = paths if deadline == NEVER or first_path else FULL_LANES
    done: list[tuple[Averages, Averages, int]] = []
    made = 0
    while made < paths and not (done and deadline.passed()):
        size = min(size, paths - made)
        began = time.perf_counter()
        try:
            needed = first_path == 0 and not done
            part = _averages_of_group(
                plan, seed, first_path + made, size, deadline, needed, all_pairs
            )
        except GivenUp:
            if not done:
                raise
            break
        if done and part[2] < plan.steps:
            break
        done.append(part)
        if part[2] < plan.steps:
            break
        made += size
        each = (time.perf_counter() - began) / size
        size = paths - made if each * (paths - made) < deadline.left else FULL_LANES
    fine, pairs, steps = zip(*done, strict=True)
    return np.concatenate(fine, axis=1), np.concatenate(pairs, axis=1), min(steps)


def _averages_of_group(
    plan: Plan,
    seed: int,
    first_path: int,
    paths: int,
    deadline: Deadline,
    needed: bool,
    all_pairs: bool,
) -> tuple[Averages, Averages, int]:
    """Averages of paths that are simulated together; see `averages_in_time`."""
    fine = plan.begin(seed, first_path, paths)
    both = list(paths_at_both_steps(plan, first_path, paths))
    if all_pairs:
        both = [(first_path, paths)]
    coarse = [plan.coarser().begin(seed, first, number) for first, number in both]
    go_on([fine, *coarse], deadline, needed)
    if any(each.made < least_steps(each) for each in (fine, *coarse)):
        raise GivenUp
    averages = fine.averages()
    pairs = [np.empty((2 * len(averages), 0))]
    for (first, number), each in zip(both, coarse, strict=True):
        known = averages[:, first - first_path : first - first_path + number]
        pairs.append(np.concatenate([known, each.averages()]))
    return averages, np.concatenate(pairs, axis=1), fine.counted


def least_steps(paths: Underway) -> int:
    """Number of steps after which paths have been counted for a relaxation time."""
    return min(paths.total, paths.burn_in + math.ceil(paths.burn_in / RELAXATIONS))


def go_on(groups: Sequence[Underway], deadline: Deadline, needed: bool = False) -> None:
    """Simulate groups of paths to their ends together, or until the deadline passes; where their
    averages are `needed`, until there are averages at least.

    They are cut in time, all after the same share of their steps, in pieces of PIECE_SECONDS. Fewer
    paths at a time would take as long: a step of a few paths costs hardly less than that of many.
    A piece that takes longer all the same is given up (`stop_flag`), with `GivenUp`.
    """
    longest = max(group.total for group in groups)
    made, steps = 0, longest if deadline == NEVER else FIRST_STEPS
    with given_up_after(deadline) if deadline != NEVER else nullcontext():
        while made < longest:
            short = any(group.made < least_steps(group) for group in groups)
            if deadline.passed() and not (needed and short):
                return
            began = time.perf_counter()
            made = min(made + steps, longest)
            for group in groups:
                group.reach(math.ceil(made / longest * group.total))
            each = (time.perf_counter() - began) / steps
            left = min(PIECE_SECONDS, deadline.left)
            steps = max(FIRST_STEPS, min(MORE_STEPS * steps, int(left / max(each, SHORTEST_STEP))))


def paths_at_both_steps(plan: Plan, first_path: int, paths: int) -> Iterator[Block]:
    """Blocks of those among some paths that are simulated at twice the step as well.

    They are groups of successive paths, the first ones of each block if blocks are large, and
    chosen by the numbers of the paths alone: the share of those that a run has made depends neither
    on its goal nor on what was left of a block.
    """
    if plan.elastic:
        return
    if plan.coarse_share == 1.0:
        yield first_path, paths
        return
    every = round(1.0 / plan.coarse_share)
    group = max(FEWEST_PAIRS, plan.block // every)
    for first, number in blocks_of(first_path, first_path + paths, group):
        if first // group % every == 0:
            yield first, number


# ------------------------------------------------------------------------------
# What the first paths of a plan take: no more is begun than there is time for.
# ------------------------------------------------------------------------------


PRICE_SHARE, LEAST_PRICE, MOST_PRICE = 0.02, 0.05, 0.25
"""Fraction of the time left after which a trial is long enough to predict the time of a path. Its
smallest and largest values in s follow."""

GROWN_SHARE = 0.25
"""A trial has enough steps if this share of its time comes on top of that of the first trial."""

PATIENCE_SECONDS = 0.5
"""Seconds beyond the budget that the first two paths may take, without which there is no answer."""


def seconds_of_first_paths(
    plan: Plan, seed: int, deadline: Deadline, paths: int = FEWEST_AT_ONCE, share: float = 1.0
) -> float:
    """CPU seconds that the first `paths` paths take for a share of their steps, predicted from
    their first ones.

    Some works on paths cannot be interrupted, and the number of impacts in a step is not known in
    advance. The trials become longer until the prediction is short, or rests on a fair share of
    the time that is left. What a trial takes before its first step, to draw the states from which
    paths start, does not grow with its steps: the prediction rests on the seconds by which a trial
    takes longer than the first one. It is 0 without a deadline, and for plans that synthesise
    paths: the price of their blocks does not grow with the number of steps that are asked for.
    """
    steps, wanted = FIRST_STEPS, share * plan.steps_per_path
    enough = max(min(PRICE_SHARE * deadline.left, MOST_PRICE), LEAST_PRICE)
    longer = plan.shortest(MORE_STEPS * steps).steps_per_path > plan.shortest(steps).steps_per_path
    if not longer or math.isinf(deadline.moment):
        return 0.0
    first = plan.shortest(steps)
    _seconds_of(first, seed, paths)  # kernels are loaded where they are called first
    at_least = took = _seconds_of(first, seed, paths)
    made = first.steps_per_path
    while steps < wanted:
        if took * wanted / made <= PIECE_SECONDS:
            return took * wanted / made
        if took >= deadline.left:
            return took
        more = took - at_least
        if took >= enough and more >= GROWN_SHARE * took:
            return at_least + more * (wanted - first.steps_per_path) / (made - first.steps_per_path)
        # the last trial is not much longer than it has to be
        longest = 1.0 + max(enough, at_least) / max(more or took, SHORTEST)
        steps = math.ceil(steps * min(MORE_STEPS, longest))
        trial = plan.shortest(steps)
        took, made = _seconds_of(trial, seed, paths), trial.steps_per_path
    return 0.0


def _seconds_of(trial: Plan, seed: int, paths: int) -> float:
    """CPU seconds that some paths take."""
    began = thread_seconds()
    trial.averages(seed, 0, paths)
    return thread_seconds() - began


def check_price(
    plans: Sequence[Plan], seed: int, deadline: Deadline, paths: int = FEWEST_AT_ONCE,
    whole: bool = True,
) -> None:  # fmt: skip
    """Raise `NotConverged` where the first paths by each of these plans take longer than there is,
    and `Interrupted` where Ctrl-C came before they were begun.

    Where paths need not be `whole` they may end a relaxation time after their burn-in.
    """
    seconds = 0.0
    for plan in plans:
        least = plan.burn_in * (1.0 + 1.0 / RELAXATIONS)
        share = 1.0 if whole else min(1.0, least / (plan.burn_in + plan.duration))
        seconds += seconds_of_first_paths(plan, seed, deadline, paths, share)
        if deadline.interrupted:
            raise deadline.fell_short("before any path was simulated", "")
        if seconds > deadline.left + PATIENCE_SECONDS:
            what = "" if whole else "the burn-in of "
            raise NotConverged(
                f"the budget of {deadline.budget:g} s is too short for {what}{paths} paths, "
                f"which take at least {seconds:.2g} s, of which {deadline.left:.2g} s are left; "
                "raise budget, or shorten the paths (duration)"
            )


# ------------------------------------------------------------------------------
# Choice of the plan for a model, and the conditions of `simulate`.
# ------------------------------------------------------------------------------


def unmet(model: Model) -> list[str]:
    """The conditions of `simulate` that a model does not meet, as far as the model alone shows."""
    found = [*functions_of_arrays(model, with_branches=True), *not_compiled(model)]
    if model.branches and model.modulations:
        found += relaxing(model)
    return [*found, *without_noise(model, with_sines=True), *unstable(model)]


LOG = logging.getLogger(__name__)
"""Tells plans."""

Asked = ParamSpec("Asked")


def told(make: Callable[Asked, Plan]) -> Callable[Asked, Plan]:
    """Tell each plan to the logger, at DEBUG."""

    @wraps(make)
    def run(*args: Asked.args, **options: Asked.kwargs) -> Plan:
        plan = make(*args, **options)
        LOG.debug(
            "plan: %s; %d states, step %.4g s, burn-in %.4g s, paths of %.4g s",
            plan.method, plan.states, plan.step, plan.burn_in, plan.duration,
        )  # fmt: skip
        return plan

    return run


@told
def make_plan(
    model: Model,
    speed_threshold: float | None = None,
    duration: float | None = None,
    slow_impacts: bool = False,
    corner_share: float = CORNER_SHARE,
    deadline: Deadline = NEVER,
    statistics: Mapping[str, Statistic] | None = None,
) -> Plan:
    """Choose the scheme that the excitation and the stops call for, its step and its lengths.

    Parameters
    ----------
    speed_threshold
        Speed in m/s of the slowest impact that rates count; None for the default of the plan.
    duration
        Counted seconds of a path; None for the default of the plan.
    slow_impacts, corner_share
        Whether steps near a stop are refined, and to which length (`white.WhitePlan`).
    deadline
        When the simulation has to end: a plan is not begun that takes longer itself.
    statistics
        Functions of the motion that are averaged, which the kernel of any structure does.

    Raises
    ------
    NotApplicable
        With every condition that the model does not meet.
    NotConverged
        If the plan takes longer than there is.
    """
    if conditions := unmet(model):
        raise NotApplicable("simulate", conditions)
    if model.functions or model.moves_stops or statistics:
        check_statistics(statistics or {}, model)
        plan = plan_several(model, speed_threshold, duration, slow_impacts)
        return replace(plan, statistics=dict(statistics or {}))
    seconds = seconds_of_plan(model)
    if seconds > deadline.left + PATIENCE_SECONDS:
        lines = sum(len(table.frequency_hz) for table, _ in model.tables)
        raise NotConverged(
            f"the budget of {deadline.budget:g} s is too short for the plan of "
            f"{len(model.coordinates)} coordinates under {lines} lines of tables, which takes "
            f"about {seconds:.2g} s, of which {deadline.left:.2g} s are left; raise budget, or "
            "give tables of fewer lines"
        )
    another = model.tables or model.drawn or model.branches or _one_mass_falls(model)
    if another or model.summed or without_energy(model) or beyond_one_oscillator(model):
        return plan_several(model, speed_threshold, duration, slow_impacts)
    return plan_white(model, speed_threshold, duration, slow_impacts, corner_share)


def _one_mass_falls(model: Model) -> bool:
    """Whether a load accelerates a mass that no spring holds."""
    return model.single and model.restoring is None and model.omega == 0.0 and model.load != 0.0


def plan_several(
    model: Model, speed_threshold: float | None, duration: float | None, slow_impacts: bool = False
) -> ModalPlan:
    """The plan in modal coordinates, without tables or contacts where the model has none."""
    threshold: float | Mapping[str, float] | None = speed_threshold
    model = with_dampers(model)
    if model.functions:
        linear = with_linear_part(model)
        threshold = default_thresholds(model, linear) if threshold is None else threshold
        model = with_linear_part_at_stops(model, linear)
    plan: ModalPlan
    if model.tables or model.drawn or model.sampled_modulations:
        plan = plan_modal_tables(model, threshold, duration)
    else:
        plan = plan_modal(model, threshold, duration)
    return plan.resolving_slow_impacts() if slow_impacts else plan


# ------------------------------------------------------------------------------
# Stationary records of many paths, a block at a time, with the excitation where it is known.
#
# Statistics of records (spectra, for example) ask for the `Histories` of a block of paths and keep
# only what they compute from them.
# ------------------------------------------------------------------------------


BLOCK_NUMBERS = 2**23
"""Largest number of floats in the records of a block of paths: 64 MB, and a few times as much while
the records are reduced."""

MOST_PATHS = 256
"""Largest number of paths in a block of histories."""


@dataclass(frozen=True, kw_only=True)
class HistoryPlan:
    """The plan by which records of a scene are made.

    `fastest`, rad/s, is the largest frequency of: modes, signals, motions from stop to stop, and
    falls of an unrestrained mass back to its stop. `speed`, m/s, is the largest rms speed of a gap.
    """

    plan: Plan
    duration: float
    slowest: float
    fastest: float
    speed: float

    @property
    def model(self) -> Model:
        """The model that is simulated."""
        return self.plan.model

    @property
    def step(self) -> float:
        """Sampling interval, s."""
        return self.plan.step

    @property
    def samples(self) -> int:
        """Samples of a record."""
        return self.plan.history_samples(self.duration)

    @property
    def block(self) -> int:
        """Number of paths that are recorded together."""
        return max(1, min(MOST_PATHS, BLOCK_NUMBERS // self.plan.record_size(self.samples)))

    def sampled(self, step: float, duration: float) -> HistoryPlan:
        """The plan at a sampling interval of at most `step`, in records of `duration` seconds."""
        return replace(self, plan=self.plan.sampled(step, duration), duration=duration)

    def histories(self, seed: int, first_path: int, paths: int) -> Histories:
        """Records of the paths first_path, first_path + 1, ...: a function of its arguments."""
        found = self.plan.histories(seed, first_path, paths, self.samples)
        # a shorter record would give wrong averages over the time of `samples`
        made = found.displacement.shape[2]
        if made != self.samples:
            raise AssertionError(f"a record has {made} samples, {self.samples} were promised")
        return found


def plan_histories(scene: Scene, deadline: Deadline = NEVER) -> HistoryPlan:
    """The plan of records for any scene that `simulate` covers.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> plan = plan_histories(scene).sampled(step=0.1, duration=50.0)
    >>> plan.histories(seed=1, first_path=0, paths=3).displacement.shape
    (1, 3, 500)
    """
    return histories_of(make_plan(model_of(scene), deadline=deadline))


def histories_of(plan: Plan) -> HistoryPlan:
    """The plan of records by a plan of paths of the usual length."""
    model = plan.model
    speed = max(plan.speeds, default=0.0)
    gaps = [pair.play for pair in model.pairs if pair.play is not None]
    frequencies = [model.modal.fastest, *(math.pi * speed / gap for gap in gaps)]
    if model.rates is not None and model.omega == 0.0 and speed > 0.0:
        frequencies.append(math.pi * abs(model.load) / speed)  # back after 2 speed / load
    return HistoryPlan(
        plan=plan,
        duration=plan.duration,
        slowest=plan.relaxation,
        fastest=max(frequencies),
        speed=speed,
    )


# ------------------------------------------------------------------------------
# Logs of every impact in a block of paths: its time, its pair and its speed.
# ------------------------------------------------------------------------------


Made = TypeVar("Made")

FIRST_ROWS = 2**20
"""Number of impacts that the first log of a block holds; if there are more, the block is simulated
again with a log of the right size."""


@dataclass(frozen=True, kw_only=True)
class ImpactLog:
    """Impacts of one pair in a block of paths, by path and then by time.

    `path` is the number of the path within the block; `time` is in seconds from the start of the
    counted part; `speed`, m/s, is negative at the lower stop. On a compliant stop an impact is
    the first touch. `lost` is the energy that each one takes, J, where it was asked for: on a
    compliant stop the work of its force.
    """

    path: NDArray[np.int64]
    time: Vector
    speed: Vector
    lost: Vector | None = None

    def kept(self, which: NDArray[Any]) -> ImpactLog:
        """Some of the impacts."""
        lost = None if self.lost is None else self.lost[which]
        return ImpactLog(
            path=self.path[which], time=self.time[which], speed=self.speed[which], lost=lost
        )


@dataclass(frozen=True, kw_only=True)
class ImpactPlan:
    """The plan by which the impacts of a scene are logged one by one.

    `relaxation` is the relaxation time of the energy, s; `fastest` the largest frequency of the
    motion, rad/s; `speeds` are the rms speeds of the pairs, m/s; `corner_share` is that of
    `white.WhitePlan` where slow impacts are resolved, else None.
    """

    source: Plan
    thresholds: dict[str, float]
    relaxation: float
    fastest: float
    speeds: dict[str, float]
    corner_share: float | None

    @property
    def duration(self) -> float:
        """Counted seconds of a path."""
        return self.source.steps * self.source.step

    @property
    def step(self) -> float:
        """Step of the motion, s; impacts are found within it."""
        return self.source.step

    @property
    def block(self) -> int:
        """Number of paths that are simulated together."""
        return self.source.block

    def impacts(self, seed: int, first_path: int, paths: int) -> dict[str, ImpactLog]:
        """Impacts of the paths first_path, first_path + 1, ..., by pair, with what they take."""
        source = self.source
        averages, logs = logged_impacts(
            lambda log: source.averages(seed, first_path, paths, log=log),
            self.thresholds,
            energies=True,
        )
        whole, found = losses_of(source.model, source.layout, averages, self.duration), {}
        for pair, lost in zip(source.model.pairs, whole, strict=True):
            every = with_losses(pair, logs[pair.name], lost)
            found[pair.name] = every.kept(np.abs(every.speed) >= self.thresholds[pair.name])
        return found


def with_losses(pair: Pair, log: ImpactLog, whole: Matrix) -> ImpactLog:
    """The impacts of a pair, in a log with `energies`, with the energy that each of them takes.

    The stops take the energies `whole` (2, paths) in the paths, J.
    """
    assert log.lost is not None
    for stop in pair.stops:
        own = np.flatnonzero(np.sign(log.speed) == stop.side)
        speed, path = np.abs(log.speed[own]), log.path[own]
        if isinstance(stop.law, RigidLaw):
            kept = stop.restitution_square_at(speed)
            log.lost[own] = 0.5 * pair.mass * (1.0 - kept) * speed**2
            continue
        # what the stop has taken until the next impact on it
        before, after = pair.mass * log.lost[own], whole[int(stop.side == UPPER)][path]
        follows = np.flatnonzero(np.diff(path) == 0)
        after[follows] = before[follows + 1]
        log.lost[own] = after - before
    return log


def logged_impacts(
    simulate: Callable[[Log], Made], pairs: Iterable[str], *, energies: bool = False
) -> tuple[Made, dict[str, ImpactLog]]:
    """Result of `simulate` with a log that is long enough, and the impacts in it by pair.

    Parameters
    ----------
    simulate
        Simulates the same paths in every call, and writes their impacts into the log.
    pairs
        Names of all pairs, in their order.
    energies
        Whether `lost` gets the energy that a compliant stop has taken before each impact, per unit
        of the reduced mass. Slow impacts on such stops are then logged as well.
    """
    rows = FIRST_ROWS
    while True:
        taken = np.zeros(rows if energies else 0)
        log = Log(np.empty((rows, COLUMNS)), np.zeros(1, np.int64), 0.0, taken)
        made = simulate(log)
        count = int(log.count[0])
        if count <= rows:
            break
        rows = count
    # the log holds all paths step by step: a stable sort keeps the order in time of each
    order = np.argsort(log.events[:count, 0], kind="stable")
    path, number, time, speed = log.events[order].T
    every = ImpactLog(
        path=path.astype(np.int64), time=time, speed=speed, lost=taken[order] if energies else None
    )
    found = {name: every.kept(number == pair) for pair, name in enumerate(pairs)}
    return made, found


def plan_impacts(
    scene: Scene,
    speed_threshold: float | None = None,
    duration: float | None = None,
    slow_impacts: bool = False,
    corner_share: float = CORNER_SHARE,
    deadline: Deadline = NEVER,
) -> ImpactPlan:
    """The plan to log the impacts of a scene with an impact pair that `simulate` covers.

    `corner_share` is that of `WhitePlan`, where `slow_impacts` are resolved.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(upper=1.0, law=Restitution(coefficient=0.8))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> log = plan_impacts(scene).impacts(seed=1, first_path=0, paths=2)["stops"]
    >>> bool((log.speed > 0.0).all())  # an upper stop alone
    True
    """
    model = model_of(scene)
    if not model.pairs:
        raise NotApplicable("impacts", "the scene must have an impact pair, got none")
    plan = make_plan(model, speed_threshold, duration, slow_impacts, corner_share, deadline)
    # whether no threshold, length or slow impacts are asked for
    usual = speed_threshold is None and duration is None and not slow_impacts
    histories = histories_of(plan if usual else make_plan(model, deadline=deadline))
    thresholds = dict(plan.layout.thresholds)
    return ImpactPlan(
        source=plan.unbroken(histories.duration if duration is None else duration),
        thresholds=thresholds,
        relaxation=histories.slowest,
        fastest=histories.fastest,
        speeds=dict(zip(thresholds, plan.speeds, strict=True)),
        corner_share=corner_share if slow_impacts else None,
    )


# ------------------------------------------------------------------------------
# Motion of the gaps of a linear structure under Gaussian noise, without impacts and sines.
#
# The response is a sum over bins of frequency, as in `modal_tables`; white and filtered noise
# become tables, so that all of it is synthesised, and no step is taken.
# ------------------------------------------------------------------------------


FINER = 8
"""How much finer the motion after a shock is sampled for its frequencies."""

CARRIES = 0.01
"""Share of the velocity variance of a gap from which a mode counts among those that move it."""


@dataclass(frozen=True, kw_only=True)
class GapResponse:
    """Synthesis of the gaps of a structure without stops, from their mean positions (SI units).

    Parameters
    ----------
    modes
        The structure, with one row of `gaps` for each gap.
    tables
        One-sided densities of all noises, with the modal forces per unit of what they describe.
    velocities
        (gaps,): exact velocity variances, m^2/s^2.
    relaxation
        Time constant of the slowest mode, s.
    fastest
        Frequency of the fastest mode that moves a gap, rad/s.
    samples, block_length
        Number of samples of a record, which repeats itself, and its length, s.
    """

    modes: ModalForm
    tables: Tables
    velocities: Vector
    relaxation: float
    fastest: float
    samples: int
    block_length: float

    @property
    def gaps(self) -> int:
        """Number of gaps."""
        return len(self.modes.gaps)

    @property
    def step(self) -> float:
        """Sampling interval, s."""
        return self.block_length / self.samples

    def block(self, gaps: int) -> int:
        """Number of paths that are synthesised together where each has so many gaps: a power of two
        with a few megabytes of samples."""
        fitting = max(1, min(LARGEST_BLOCK, BLOCK_SAMPLES // (self.samples * gaps)))
        return 1 << (fitting.bit_length() - 1)

    def with_step(self, step: float) -> GapResponse:
        """The same records at a chosen sampling interval, s."""
        return replace(self, samples=_even_fast_length(self.block_length / step))

    def with_block(self, length: float) -> GapResponse:
        """Records of a chosen length, s, at about the same sampling interval."""
        return replace(self, block_length=length).with_step(self.step)

    @cached_property
    def amplitudes(self) -> Waves:
        """Complex amplitudes of each bin, (bins, gaps, tables); the last quarter is scaled up, so
        that the velocity variance beyond the bins is not lost."""
        count = self.samples // 2
        matrices = np.diag(self.modes.squares), self.modes.dynamic
        found = [
            bin_amplitudes(table, force, *matrices, self.block_length, count)[0]
            for table, force in self.tables
        ]
        waves: Waves = np.einsum("tbm,gm->bgt", np.array(found), self.modes.gaps)
        return folded(waves, self.velocities, self.block_length)

    def records(
        self, seed: int, first_path: int, paths: int, chosen: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """(paths, samples, 2 gaps): each of the chosen gaps (m) and its rate (m/s), in turn."""
        waves, scale = self.amplitudes[:, chosen], self.fastest
        streams = streams_of_block(seed, first_path, paths, 0)
        free = synthesised(waves, streams, self.samples, self.block_length, scale)
        found = np.empty((paths, self.samples, 2 * len(chosen)))
        found[:, :, 0::2] = free.real.transpose(2, 0, 1)
        found[:, :, 1::2] = scale * free.imag.transpose(2, 0, 1)
        return found

    def correlations(self, lags: int) -> NDArray[np.float64]:
        """Correlations of the records: E[y_j(-t) y_k(0)], and the first and second derivative of
        E[y_j(t) y_k(0)] there, at t of 0 ... `lags` samples: (3, lags + 1, gaps j, gaps k)."""
        waves = self.amplitudes
        turn = 2j * np.pi / self.block_length * np.arange(1, len(waves) + 1)[:, None]
        before = -np.arange(lags + 1)
        found = np.empty((3, lags + 1, self.gaps, self.gaps))
        spectrum = np.empty((self.samples, self.gaps), complex)
        for gap in range(self.gaps):
            cross = np.einsum("bjt,bt->bj", waves, waves[:, gap].conj())
            for order in range(3):
                spectrum[:] = 0.0
                spectrum[1 : len(waves) + 1] = turn**order * cross
                found[order, :, :, gap] = scipy.fft.ifft(spectrum, axis=0, norm="forward").real[
                    before
                ]
        return found

    def shock_responses(self, rows: Matrix, force: Vector, pulses: Pulses) -> Vector:
        """Displacements rows . q and their velocities (rows, samples, 2) after a shock of size 1
        from rest, at the sampling interval; `force` (modes,) is that of a unit on the modes."""
        assert pulses.shock is not None
        fine = FINER * self.samples
        f = np.arange(fine // 2 + 1) / self.block_length
        moved = gains(f, np.diag(self.modes.squares), self.modes.dynamic, force) @ rows.T
        waves = pulses.shock.transform_evenly(2.0 * np.pi / self.block_length, len(f))
        moved *= (pulses.size * waves)[:, None]
        found = [
            scipy.fft.irfft((2j * np.pi * f[:, None]) ** order * moved, fine, axis=0)[::FINER]
            for order in (0, 1)
        ]
        return np.asarray(np.stack(found, axis=-1) * fine / self.block_length).swapaxes(0, 1)


def plan_gaps(model: Model, directions: Matrix) -> GapResponse:
    """Choose sampling and lengths for the gaps `directions` . q (gaps, n) of a structure.

    Raises
    ------
    NotApplicable
        Where the motion without stops is not a stationary Gaussian process, or where its times lie
        too far apart.
    """
    modes = model.modal._replace(gaps=directions @ model.modal.shapes)
    law = free_motion(model, with_sines=True).law
    n = modes.size
    moving = law.covariance[n : 2 * n, n : 2 * n]
    velocities = np.einsum("gm,mk,gk->g", modes.gaps, moving, modes.gaps)
    shares = modes.gaps**2 * np.diag(moving)
    carrying = np.any(shares >= CARRIES * velocities[:, None], axis=0)
    fastest = math.sqrt(float(np.max(modes.squares[carrying])))
    damped = eigenvalues(np.diag(modes.squares), modes.dynamic)
    if modes.branches is not None:
        fastest = max(fastest, float(damped.imag.max()))
    relaxation = float(np.max(-1.0 / damped.real))
    tables = with_tables(model).modal.tables
    modes = modes._replace(tables=tables)
    length = _block_length(modes, BLOCK_RELAXATIONS * max(relaxation, 1.0 / fastest))
    rate = SAMPLES_PER_PERIOD * fastest / (2.0 * math.pi)
    frequency, left = beyond(tables, np.diag(modes.squares), modes.dynamic, modes.gaps)
    enough = np.flatnonzero(np.all(left <= LARGEST_LOSS * left[0], axis=1))
    cut = float(frequency[enough[0]] if len(enough) else frequency[-1])
    needed = max(rate, 2.0 * cut) * length
    if needed * len(modes.gaps) > MOST_SAMPLES:
        raise NotApplicable(
            "first_crossings",
            f"a record of {len(modes.gaps)} gaps needs {needed:.2g} samples, at most "
            f"{MOST_SAMPLES // len(modes.gaps)} are made: the fastest motion and the slowest "
            "decay are too far apart",
        )
    return GapResponse(
        modes=modes,
        tables=tables,
        velocities=velocities,
        relaxation=relaxation,
        fastest=fastest,
        samples=_even_fast_length(needed + 2.0),
        block_length=length,
    )


def with_tables(model: Model) -> Model:
    """The model with every noise as a density: white noise up to where hardly any of its velocity
    variance is left, filtered noise as far as its filter lets it. Sines stay."""
    modes = model.modal
    tables = list(model.tables)
    natural = np.sqrt(modes.squares[modes.squares > 0.0])
    slowest, fastest = float(np.min(natural)), float(np.max(natural))
    for signal in model.without_sines().signals:
        tables.append((_filtered(signal, slowest), signal.direction))
    widest = float(np.max(np.diag(modes.damping)))
    if modes.branches is not None:
        damped = eigenvalues(np.diag(modes.squares), modes.dynamic)
        fastest = max(fastest, float(damped.imag.max()))
        (relaxing,) = damping_at(modes.dynamic, np.array([slowest]))
        widest = float(np.max(np.diag(relaxing.real)))
    highest = max(
        widest / (math.pi**2 * WHITE_LOSS), SAMPLES_PER_PERIOD * fastest / (2.0 * math.pi)
    )
    for intensity, direction in model.whites:
        flat = Table(
            frequency_hz=np.array([LOWEST_FREQUENCY * slowest / (2.0 * math.pi), highest]),
            density=np.full(2, density_from_intensity(intensity)),
        )
        tables.append((flat, direction))
    return replace(model, whites=(), signals=model.sines, tables=tuple(tables))


def shaken_by_tables(model: Model) -> Model:
    """The model `with_tables`; one mass stands on a base that they shake, so that its absolute
    acceleration is known: what spring, damper and stops give it."""
    tables, one = with_tables(with_dampers(model)), len(model.coordinates) == 1
    return tables.shaken_by_base() if one and not tables.base_alone_moves else tables
