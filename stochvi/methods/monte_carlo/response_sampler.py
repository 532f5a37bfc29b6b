"""The sampler of `simulate`: averages over paths, some of which are simulated at two steps.

Its blocks are cut in time, not in paths: a step of a few paths costs nearly as much as of many.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stochvi.methods.monte_carlo.path_statistics import PathStatistics, StepPairs
from stochvi.methods.monte_carlo.plan import RELAXATIONS, Plan, Underway
from stochvi.results.deadline import NEVER, Deadline
from stochvi.sampling.blocks import FULL_LANES, PIECE_SECONDS, Block, blocks_of
from stochvi.sampling.sampler import Sampler
from stochvi.sampling.stop_flag import GivenUp, given_up_after

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
