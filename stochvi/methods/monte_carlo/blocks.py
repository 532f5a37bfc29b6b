"""Driver of blocks of paths, through which everything that samples runs its work on an executor.

The work on a block is a picklable function of (first path, paths) alone, so that any worker may do
it, and do it again where a worker is lost. Results are handed on in the order of their blocks, so
that they depend neither on the number of workers nor on their speed.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import math
import platform
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
)
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import cache
from itertools import chain, islice
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from stochvi.methods.monte_carlo.block_results import Block, Entry, kept_results
from stochvi.methods.monte_carlo.path_statistics import Layout, PathStatistics, StepPairs
from stochvi.methods.monte_carlo.plan import RELAXATIONS, Plan, Underway
from stochvi.methods.monte_carlo.stop_flag import GivenUp, given_up_after
from stochvi.results.deadline import NEVER, Deadline, graceful_interrupt
from stochvi.results.errors import NotConverged, StochviError
from stochvi.results.machine import thread_seconds, usable_cores

WINDOW = 4
"""Number of tasks per worker that may be under way or wait to be merged in order. It bounds the
memory, and keeps workers busy while one of them is slow."""

TASK_SECONDS = 0.5
"""Shortest work in seconds of one task for an external executor: a hundred times the cost of
sending a task, and no more than a checkpoint may lose."""

SENDING_SECONDS = 0.003
"""CPU time in seconds in which a Dask client and its scheduler send a task and get its result back
(measured; a pool of processes takes a tenth). Tasks last so long that this keeps all workers
busy."""

MOST_WAITING = 2**17
"""Largest number of blocks that are under way or wait to be merged, for any number of workers: they
take about 300 MB."""

LATE = 3.0
"""A task is late if it takes this many times the expected time while a task begun after it has
ended. It is then begun a second time, as a slow or dead machine would hold up all results behind
it."""

LOOK_SECONDS = 0.5
"""Seconds between two checks for lost or late tasks while the first result is awaited, or half the
expected time of a task if that is longer."""

SHORTEST_BLOCK = 1e-6
"""Time in seconds of a block or a path for which the clock measured zero."""

MOST_ATTEMPTS = 4
"""Number of times that a block is begun on an external executor before the run gives up. Schedulers
repeat lost blocks themselves as well."""

LANES = 16
"""Pieces of a block that have more paths than this number have a multiple of it, because the loops
of the kernels over paths fill vectors of 8 numbers."""

FULL_LANES = 64
"""Number of paths that take hardly longer per step of each than many paths do: at 64 a kernel takes
1.1 times as long, at 16 1.4 times, at 2 ten times (one oscillator, white noise, rigid stops)."""

FEWEST_PAIRS = 64
"""Number of the first paths of a run that are all simulated at twice the step too."""

FEWEST_AT_ONCE = 2
"""Number of paths in the first piece of a block, whose time says how large the next one may be: the
smallest that gives a standard error."""

FIRST_STEPS, MORE_STEPS = 2, 4
"""Number of steps in the first trial that predicts the time of a path, and the factor by which each
further trial is longer."""

PRICE_SHARE, LEAST_PRICE, MOST_PRICE = 0.02, 0.05, 0.25
"""A trial is long enough to predict the time of a path once it has taken this share of the time
that is left, within these two numbers of seconds."""

PIECE_SECONDS = 0.25
"""Largest expected time in seconds of a piece of a block, so that a budget is overrun by no
more."""

SHORTEST_STEP = 1e-9
"""Time in seconds of a step of a block for which the clock measured zero."""

PATIENCE_SECONDS = 0.5
"""Seconds beyond the budget that the first two paths may take, without which there is no answer."""

Piece = TypeVar("Piece")

Averages = NDArray[np.float64]
"""Time averages (rows, paths)."""

Work = Callable[[int, int, Deadline], Any]
"""A function `work(first_path, paths, deadline)` of a block. Where the block takes long, it returns
the results of the first paths when the deadline has passed, and raises `GivenUp` if there are
none."""


class BlockDone(NamedTuple):
    """A block with the result of every work on it, the machines that computed them, and whether all
    works certainly had the time to finish it."""

    block: Block
    results: list[Any]
    machines: list[str]
    whole: bool


class WorkersLost(Exception):
    """The executor failed to compute a block in all attempts."""


@dataclass(frozen=True, kw_only=True)
class Done:
    """Result of a task: the results of each of its blocks, the machine, the CPU time in seconds,
    and the number of the first blocks that no deadline can have cut short."""

    results: tuple[Any, ...]
    machine: str
    seconds: float
    whole: int


@cache
def machine() -> str:
    """Versions of the libraries and the processor, on which the digits of a path depend.

    The processor is named as the compiler of the kernels names it, with a digest of its features.
    """
    from numba.core.registry import cpu_target

    _, processor, features = cpu_target.target_context.codegen().magic_tuple()
    kind = hashlib.sha256(features.encode()).hexdigest()[:8]
    names = ("stochvi", "numpy", "scipy", "numba", "llvmlite")
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in names)
    return (
        f"{versions}, Python {platform.python_version()}, {platform.system()} "
        f"{platform.machine()} {processor} (features {kind})"
    )


def do_blocks(
    work: Work, blocks: tuple[Block, ...], deadline: Deadline = NEVER, attempt: int = 1,
    needed: bool = True,
) -> Done:  # fmt: skip
    """Do the work on the blocks of one task, in order.

    Once the deadline has passed, the blocks that are left are not begun, but the first one is if it
    is `needed`. A block that is given up has no result. A result is a function of the arguments
    alone, so that any worker may compute it, and compute it again. `attempt` has no effect but to
    give each attempt a key of its own, as a scheduler may remember that a key failed.
    """
    start = thread_seconds()
    results: list[Any] = []
    whole = 0
    for first_path, paths in blocks:
        if deadline.passed() and (results or not needed):
            break
        began = time.perf_counter()
        try:
            results.append(work(first_path, paths, deadline))
        except GivenUp:
            break
        # a work leaves paths out where less time is left than one path takes, thus than all took
        if whole == len(results) - 1 and deadline.left > time.perf_counter() - began:
            whole = len(results)
    seconds = thread_seconds() - start
    return Done(results=tuple(results), machine=machine(), seconds=seconds, whole=whole)


class BlockStatistics(NamedTuple):
    """Statistics of a block of paths, and those of its paths that were simulated at twice the step
    too, which may be none; and the number of counted steps of each path, fewer than those of the
    plan where the deadline passed first."""

    fine: PathStatistics
    pairs: StepPairs
    steps: int


def block_statistics(
    plan: Plan,
    layout: Layout,
    seed: int,
    first_path: int,
    paths: int,
    deadline: Deadline = NEVER,
    all_pairs: bool = False,
) -> BlockStatistics:
    """Statistics of a block of paths, over what they have made if the deadline passes."""
    fine, pairs, steps = averages_in_time(plan, seed, first_path, paths, deadline, all_pairs)
    known = StepPairs.of(pairs, layout) if pairs.shape[1] else StepPairs.none(layout)
    return BlockStatistics(PathStatistics.of(fine, layout), known, steps)


def averages_in_time(
    plan: Plan, seed: int, first_path: int, paths: int, deadline: Deadline, all_pairs: bool = False
) -> tuple[Averages, Averages, int]:
    """Averages of a block of paths; those of `paths_at_both_steps`, with the rows at twice the step
    after those at the step, of all paths if `all_pairs`; and the number of counted steps of each.

    A deadline cuts the block in time. Of the first block of a run, without which there is no
    answer, FULL_LANES paths come first: they go on until they have been counted for a relaxation
    time, and end there if the deadline has passed. Where it passes later, paths are left out that
    have not ended by then. `GivenUp` where there are no averages in time.
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
    for first, number in blocks_of(first_path, paths, group):
        if first // group % every == 0:
            yield first, number


def seconds_of_first_paths(
    plan: Plan, seed: int, deadline: Deadline, paths: int = FEWEST_AT_ONCE, share: float = 1.0
) -> float:
    """CPU seconds that the first `paths` paths take for a share of their steps, predicted from
    their first ones.

    Some works on paths cannot be interrupted, and the number of impacts in a step is not known in
    advance. The trials become longer until the prediction is short, or rests on a fair share of
    the time that is left. It is 0 without a deadline, and for plans that synthesise paths: the
    price of their blocks does not grow with the number of steps that are asked for.
    """
    steps, wanted = FIRST_STEPS, share * plan.steps_per_path
    enough = max(min(PRICE_SHARE * deadline.left, MOST_PRICE), LEAST_PRICE)
    longer = plan.shortest(MORE_STEPS * steps).steps_per_path > plan.shortest(steps).steps_per_path
    while longer and math.isfinite(deadline.moment) and steps < wanted:
        trial = plan.shortest(steps)
        if steps == FIRST_STEPS:  # kernels are loaded where they are called first
            _seconds_of(trial, seed, paths)
        took = _seconds_of(trial, seed, paths)
        predicted = took * wanted / trial.steps_per_path
        if predicted <= PIECE_SECONDS or took >= enough:
            return predicted
        # the last trial is not much longer than it has to be
        steps = math.ceil(steps * min(MORE_STEPS, 1.0 + enough / max(took, SHORTEST_BLOCK)))
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


def in_pieces(
    make: Callable[[int, int], Piece], first_path: int, paths: int, deadline: Deadline
) -> list[Piece]:
    """Results of `make(first_path, paths)` for successive pieces of a block of paths.

    The deadline is checked between pieces; once it has passed, or a path would take clearly longer
    than there is left, the remaining paths are left out, but never those of the first piece, which
    has FEWEST_AT_ONCE of them. A piece that takes longer all the same is given up (`stop_flag`),
    with `GivenUp` where it is the first. The paths do not depend on the pieces.
    """
    if deadline == NEVER:
        return [make(first_path, paths)]
    done: list[Piece] = []
    made, size, each = 0, FEWEST_AT_ONCE, 0.0
    try:
        with given_up_after(deadline):
            while made < paths and (not made or 0.0 < deadline.left > each - PIECE_SECONDS):
                size = min(size, paths - made)
                began = time.perf_counter()
                done.append(make(first_path + made, size))
                each = max((time.perf_counter() - began) / size, SHORTEST_BLOCK)
                made += size
                left = min(PIECE_SECONDS, deadline.left)
                # a few paths take hardly longer than two, so that their price is that of a piece
                more = min(MORE_STEPS * size, FULL_LANES) if each * size < deadline.left else 1
                size = max(more, int(left / each))
                size -= size % LANES if size > LANES else 0
    except GivenUp:
        if not done:
            raise
    return done


def blocks_between(first_path: int, end: float, size: int) -> Iterator[Block]:
    """Blocks of one size up to a path `end`, which may be infinite; the last one may be smaller."""
    while first_path < end:
        yield first_path, int(min(size, end - first_path))
        first_path += size


def blocks_of(first_path: int, paths: int, size: int) -> Iterator[Block]:
    """Blocks of `paths` paths, cut at the multiples of `size`."""
    end = first_path + paths
    while first_path < end:
        count = min(size - first_path % size, end - first_path)
        yield first_path, count
        first_path += count


def workers_of(executor: Executor) -> int:
    """Number of tasks that an executor does at once, where it states it (pools of threads and
    processes, MPI, Dask); else the number of usable cores."""
    client: Any = getattr(executor, "_client", None)
    if hasattr(client, "nthreads"):
        return max(1, sum(int(threads) for threads in client.nthreads().values()))
    for name in ("num_workers", "_max_workers"):
        if isinstance(number := getattr(executor, name, None), int):
            return max(1, number)
    return usable_cores()


@dataclass
class Crew:
    """An executor with its number of workers, and the tasks under way on it.

    `external_executor` says that the caller supplied it, so that its workers may be far away;
    `block_seconds` is the measured CPU time of a block.
    """

    executor: Executor
    workers: int
    external_executor: bool
    block_seconds: float = math.inf
    waiting: deque[_Task] = field(default_factory=deque, init=False)

    def per_task(self, blocks: float) -> int:
        """Number of blocks in a task, of `blocks` in all.

        Tasks of an external executor last so long that one sender keeps all workers busy. They are
        shortened where some workers would get none, unless sending so many tasks would take longer
        than the last of them.
        """
        if not self.external_executor or math.isinf(self.block_seconds):
            return 1
        each = max(self.block_seconds, SHORTEST_BLOCK)
        enough = max(TASK_SECONDS, 2.0 * self.workers * SENDING_SECONDS) / each
        fair = max(blocks / self.workers, math.sqrt(blocks * SENDING_SECONDS / each))
        return math.ceil(min(enough, fair))

    @property
    def window(self) -> int:
        """Largest number of tasks under way: 1 on an external executor until the time of a block is
        known."""
        return (
            1
            if self.external_executor and math.isinf(self.block_seconds)
            else WINDOW * self.workers
        )

    def do(
        self,
        works: Sequence[Work],
        blocks: Iterator[Block],
        total: float,
        deadline: Deadline = NEVER,
        late: Callable[[], bool] | None = None,
        at_least: int = 1,
    ) -> Generator[BlockDone, None, None]:
        """Do every work on each block, and hand the results on in the order of the blocks.

        `total` is the number of blocks. Once `late()` is true, by default when the deadline has
        passed, no further task is begun, but at least `at_least` tasks are begun and finished. A
        block that is under way at the deadline is handed on as the works left it, as the last one.
        Where the deadline alone decides, a task that waits for a worker until then is left out too.

        Raises
        ------
        WorkersLost
            If a block cannot be computed; all blocks before it have been handed on.
        """
        waiting, decided_by_caller = self.waiting, late is not None
        late = late or deadline.passed
        begun, attempts = 0, MOST_ATTEMPTS if self.external_executor else 1
        try:
            while (begun < at_least or not late()) and (
                chunk := tuple(islice(blocks, self.per_task(total)))
            ):
                # the deadline is checked within blocks that take long or an unknown time
                quick = self.block_seconds < PIECE_SECONDS
                calls = [(work, chunk, NEVER if quick else deadline) for work in works]
                needed = decided_by_caller or begun < at_least
                waiting.append(_Task(self.executor, calls, attempts, needed))
                begun += 1
                while len(waiting) >= min(self.window, max(1, MOST_WAITING // len(chunk))):
                    if not (yield from self._hand_on(waiting)):
                        return
            while waiting and not (begun > at_least and late() and waiting[0].cancel()):
                if not (yield from self._hand_on(waiting)):
                    return
        finally:
            self.cancel()

    def results(
        self,
        work: Work,
        blocks: Iterable[Block],
        deadline: Deadline = NEVER,
        late: Callable[[], bool] | None = None,
        at_least: int = 0,
    ) -> Iterator[Any]:
        """Result of each block in order, as in `do`; by default no task must be finished.

        The number of blocks may be infinite. Raises `NotConverged` if the executor loses its
        workers, and where a block is needed of which not even two paths were done in time
        (`Interrupted` after Ctrl-C). Blocks whose results the run has kept are not done again.
        """
        kept, left = kept_results(), iter(blocks)
        total = len(blocks) if isinstance(blocks, Sequence) else math.inf
        handed_on = False
        known = {} if kept is None else kept.of(work)
        for block in left:
            entry = known.get(block[0])
            if entry is None or entry.blocks != [block]:
                left = chain([block], left)
                break
            yield entry.value
            handed_on, at_least = True, 0
            total -= 1
        for done in self._new_results(work, left, total, deadline, late, at_least):
            if kept is not None and done.whole:
                kept.add(known, Entry([done.block], done.results[0]))
            yield done.results[0]
            handed_on = True
        if at_least and not handed_on:
            raise deadline.fell_short("before two paths were simulated", "raise budget")

    def merged(
        self,
        work: Work,
        blocks: Sequence[Block],
        merge: Callable[[Any, Any], Any],
        deadline: Deadline = NEVER,
        at_least: int = 0,
    ) -> Iterator[Any]:
        """The results of all blocks so far, merged in their order, after each block; see `results`.

        A run that keeps results keeps the merged one alone, which may be much smaller.
        """
        kept = kept_results()
        known = {} if kept is None else kept.of(work)
        entry = known.get(blocks[0][0]) if blocks else None
        if entry is None or entry.blocks != [*blocks[: len(entry.blocks)]]:
            entry = Entry([], None)
        total, left = entry.value, blocks[len(entry.blocks) :]
        if entry.blocks:
            yield total
            at_least = 0
        handed_on, whole = bool(entry.blocks), True
        for done in self._new_results(work, iter(left), len(left), deadline, None, at_least):
            total = merge(total, done.results[0]) if handed_on else done.results[0]
            handed_on, whole = True, whole and done.whole
            if kept is not None and whole:
                entry.blocks.append(done.block)
                entry.value = total
                kept.add(known, entry)
            yield total
        if at_least and not handed_on:
            raise deadline.fell_short("before two paths were simulated", "raise budget")

    def _new_results(
        self, work: Work, blocks: Iterator[Block], total: float, deadline: Deadline,
        late: Callable[[], bool] | None, at_least: int,
    ) -> Iterator[BlockDone]:  # fmt: skip
        """Blocks that are done now; see `results`."""
        self.block_seconds = math.inf  # unknown for this work
        try:
            yield from self.do([work], blocks, total, deadline, late, at_least)
        except WorkersLost as error:
            raise NotConverged(f"{error}; start workers that do the work, and ask again") from error

    def cancel(self) -> None:
        """Cancel every task that has not begun."""
        while self.waiting:
            self.waiting.popleft().cancel()

    def _hand_on(self, waiting: deque[_Task]) -> Generator[BlockDone, None, bool]:
        """Hand on the blocks of the oldest task, and measure the time of a block; return False if
        some of its blocks were left out because the deadline passed."""
        task = waiting[0]
        expected = self.block_seconds * len(task.blocks)

        def repeat_lost_and_late(waited: float) -> None:
            overtaken = False  # whether a task begun later has ended, so that this one has begun
            for each in reversed(waiting):
                each.resubmit(also_late=overtaken and waited > LATE * expected)
                overtaken = overtaken or each.done()

        interval = max(LOOK_SECONDS, expected / 2.0) if math.isfinite(expected) else LOOK_SECONDS
        done = task.results(repeat_lost_and_late, interval)
        waiting.popleft()
        self.block_seconds = sum(each.seconds for each in done) / (len(done) * len(task.blocks))
        where = [each.machine for each in done]
        for number, block in enumerate(task.blocks):
            if any(number >= len(each.results) for each in done):
                return False
            whole = all(number < each.whole for each in done)
            yield BlockDone(block, [each.results[number] for each in done], where, whole)
        return True


def start_crew(executor: Executor | None, threads: int | None) -> Crew:
    """A crew on the given executor, or on new threads."""
    if executor is not None:
        return Crew(executor, threads or workers_of(executor), external_executor=True)
    workers = threads or usable_cores()
    return Crew(ThreadPoolExecutor(workers), workers, external_executor=False)


@contextmanager
def sampling() -> Iterator[None]:
    """Within it Ctrl-C makes deadlines pass, and linear algebra uses one thread.

    The matrices here are small, and between two products the threads of a library such as OpenBLAS
    wait in a loop that keeps a core from the paths: with them a simulation of three masses on two
    cores took 1.6 times as long.
    """
    with graceful_interrupt(), threadpool_limits(1, user_api="blas"):
        yield


@contextmanager
def crew_of(executor: Executor | None, threads: int | None) -> Iterator[Crew]:
    """A crew within a `with` block, in which Ctrl-C makes deadlines pass. At its end no task is
    left that may still begin, and threads that were started for it have ended."""
    check_executor(executor)
    crew = start_crew(executor, threads)
    try:
        with sampling():
            yield crew
    finally:
        crew.cancel()
        if not crew.external_executor:
            crew.executor.shutdown(cancel_futures=True)


def check_executor(executor: Executor | None) -> None:
    """Raise ValueError if an executor has no `submit`."""
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise ValueError(
            "executor must be a concurrent.futures.Executor, as ProcessPoolExecutor(), got "
            f"{executor!r}"
        )


Call = tuple[Work, tuple[Block, ...], Deadline]
"""First arguments of `do_blocks`."""


class _Task:
    """Some blocks, with one call of `do_blocks` for every work on them."""

    def __init__(self, executor: Executor, calls: list[Call], attempts: int, needed: bool) -> None:
        self.blocks = calls[0][1]
        self.calls = [_Call(executor, call, attempts, needed) for call in calls]

    def results(self, check: Callable[[float], None], interval: float) -> list[Done]:
        """Result of every work; see `_Call.result`."""
        return [call.result(check, interval) for call in self.calls]

    def done(self) -> bool:
        """Whether every call has ended."""
        return all(call.done() is not None for call in self.calls)

    def resubmit(self, *, also_late: bool) -> None:
        """Submit the calls again that failed, and with `also_late` those that have not ended."""
        for call in self.calls:
            call.resubmit(also_late)

    def cancel(self) -> bool:
        """Cancel all calls; return whether there is one that had not begun."""
        cancelled = [call.cancel() for call in self.calls]
        return any(cancelled)


class _Call:
    """A call of `do_blocks` on an executor, submitted again where it failed or is late.

    All attempts give the same result; that of the first which ends is taken.
    """

    def __init__(self, executor: Executor, call: Call, attempts: int, needed: bool) -> None:
        self.executor, self.call, self.attempts, self.needed = executor, call, attempts, needed
        self.futures: list[Future[Done]] = []
        self.begun = 0
        self._submit()

    def _submit(self) -> None:
        self.begun += 1
        try:
            self.futures.append(
                self.executor.submit(do_blocks, *self.call, self.begun, self.needed)
            )
        except Exception as error:  # each kind of executor has its own errors
            raise WorkersLost(
                f"the executor takes no more work ({type(error).__name__}: {error})"
            ) from error

    def result(self, check: Callable[[float], None], interval: float) -> Done:
        """Wait for the result; after every `interval` s, call `check` with the seconds waited."""
        if self.attempts == 1:
            return self.futures[0].result()
        waited = 0.0
        while True:
            future = self.done() or self.futures[0]
            try:
                found = future.result(timeout=interval)
            except Exception as error:
                if isinstance(error, TimeoutError) and not future.done():
                    waited += interval
                    check(waited)
                else:
                    self._lost(future, error)
            else:
                if isinstance(found, Done):
                    self.cancel()
                    return found
                kind = type(found).__name__
                self._lost(future, TypeError(f"a task returned {kind}, not results of blocks"))

    def done(self) -> Future[Done] | None:
        """The first attempt that has ended, or None."""
        return next((future for future in self.futures if future.done()), None)

    def _lost(self, future: Future[Done], error: BaseException) -> None:
        if isinstance(error, StochviError):
            raise error  # raised by the work itself: it would be raised again
        if isinstance(error, BrokenExecutor):
            raise WorkersLost(f"the executor lost its workers ({error})") from error
        if self.begun >= self.attempts:
            raise WorkersLost(
                f"the block that starts at path {self.call[1][0][0]} failed {self.begun} times "
                f"({type(error).__name__}: {error})"
            ) from error
        self.futures.remove(future)
        if not self.futures:
            self._submit()

    def resubmit(self, also_late: bool) -> None:
        """Submit again if the call failed, or once if it has not ended and `also_late` is true."""
        if future := self.done():
            error = CancelledError() if future.cancelled() else future.exception()
            if error is not None:
                self._lost(future, error)
        elif also_late and len(self.futures) == 1 and self.begun < self.attempts:
            self._submit()

    def cancel(self) -> bool:
        """Cancel all attempts; return whether none of them had begun."""
        cancelled = [future.cancel() for future in self.futures]
        return all(cancelled)
