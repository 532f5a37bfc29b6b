"""The driver of blocks of paths: everything that samples runs its work on an executor by it.

The work on a block is a picklable function of (first path, paths) alone, so that any worker may do
it, and do it again where a worker is lost. Results leave in the order of their blocks through a
bounded window: which worker was quicker, and how many there are, never shows in a digit.
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
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import islice
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from stochvi.methods.monte_carlo.plan import Plan
from stochvi.methods.monte_carlo.statistics import Layout, PathStatistics
from stochvi.results.deadline import NEVER, Deadline, heeding_ctrl_c
from stochvi.results.errors import NotConverged, StochviError
from stochvi.results.machine import thread_seconds, usable_cores

WINDOW = 4
"""Tasks per worker that may wait to be merged in order: bounds memory, hides stragglers."""

TASK_SECONDS = 0.5
"""Work of one task for somebody else's executor, at least: a hundred times what it costs to send
it, and no more than a checkpoint may lose."""

SENDING_SECONDS = 0.003
"""CPU of a Dask client and its scheduler to send a task and to get its result back, measured; a
pool of processes takes a tenth. Tasks last so long that this keeps all workers at work."""

MOST_WAITING = 2**17
"""Blocks that may be under way or wait to be merged, however many workers: some 300 MB."""

LATE = 3.0
"""Times what a task should take, after which what others overtook is begun a second time: a few
slow or dead machines would hold up all that waits to be merged in order."""

LOOK_SECONDS = 0.5
"""Between looks at tasks that are lost or late, while the first in line is waited for; or half of
what a task should take, if that is longer."""

SHORTEST_BLOCK = 1e-6
"""Seconds, where the clock saw none."""

MOST_ATTEMPTS = 4
"""How often a block is begun before it is given up. Schedulers do lost blocks again themselves."""

LANES = 16
"""Paths of the smallest piece of a block: the loops of the kernels over paths fill vectors of 8
numbers."""

LONG_PATH = 2.0e5
"""Steps of a path from which the first piece of a block has only `FEWEST_AT_ONCE` paths: 16 of them
would take a second or more."""

FEWEST_AT_ONCE = 2
"""Paths of the first piece where paths are long: as many as a standard error needs."""

PIECE_SECONDS = 0.25
"""Seconds that a piece of a block takes at most, as far as the piece before tells: a budget is
overrun by no more."""

Piece = TypeVar("Piece")

Block = tuple[int, int]
"""First path, and how many."""


Work = Callable[[int, int, Deadline], Any]
"""What is done with a block: `work(first_path, paths, deadline)`. A block that may take long ends
at its deadline with what it has."""

BlockDone = tuple[Block, list[Any], list[str]]
"""A block with the result of every work, and the machines that they come from."""


class WorkersLost(Exception):
    """The executor cannot do a block, however often it is asked."""


@dataclass(frozen=True, kw_only=True)
class Done:
    """What comes back of a task: results of each of its blocks, where from, and CPU seconds."""

    results: tuple[Any, ...]
    machine: str
    seconds: float


@cache
def machine() -> str:
    """Everything that the digits of a path hang on beside the scene: versions and processor.

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
    work: Work, blocks: tuple[Block, ...], deadline: Deadline = NEVER, attempt: int = 1
) -> Done:
    """One task: a function of its arguments alone, so any worker may do it, twice if need be.

    Once the deadline has passed, the blocks that are left are not begun. `attempt` changes nothing
    but the name by which a scheduler may remember that it failed.
    """
    start = thread_seconds()
    results: list[Any] = []
    for first_path, paths in blocks:
        results.append(work(first_path, paths, deadline))
        if deadline.passed():
            break
    return Done(results=tuple(results), machine=machine(), seconds=thread_seconds() - start)


def path_statistics(
    plan: Plan,
    layout: Layout,
    seed: int,
    first_path: int,
    paths: int,
    deadline: Deadline = NEVER,
) -> PathStatistics:
    """Statistics of a block of paths, or of its first paths where the deadline passes."""
    return PathStatistics.of(averages_in_time(plan, seed, first_path, paths, deadline), layout)


def averages_in_time(
    plan: Plan, seed: int, first_path: int, paths: int, deadline: Deadline
) -> NDArray[np.float64]:
    """The averages of a block of paths, or of its first paths where the deadline passes."""
    long = plan.steps_per_path > LONG_PATH
    parts = in_pieces(partial(plan.averages, seed), first_path, paths, deadline, long=long)
    return np.concatenate(parts, axis=1)


def in_pieces(
    make: Callable[[int, int], Piece], first_path: int, paths: int, deadline: Deadline,
    *, long: bool = False,
) -> list[Piece]:  # fmt: skip
    """What `make(first_path, paths)` gives of a block of paths, some after the other.

    Between pieces the clock is looked at; where the deadline has passed, the paths that are left
    are left out, but for those of the first piece. The paths do not depend on the pieces. Where
    paths are `long`, the first piece has only `FEWEST_AT_ONCE`.
    """
    if deadline == NEVER:
        return [make(first_path, paths)]
    done: list[Piece] = []
    made, size = 0, FEWEST_AT_ONCE if long else LANES
    while made < paths and not (made and deadline.passed()):
        size = min(size, paths - made)
        began = time.perf_counter()
        done.append(make(first_path + made, size))
        each = max((time.perf_counter() - began) / size, SHORTEST_BLOCK)
        made += size
        left = min(PIECE_SECONDS, deadline.left)
        size = LANES * max(1, int(left / each / LANES))
    return done


def blocks_between(first_path: int, end: float, size: int) -> Iterator[Block]:
    """Blocks of one size up to an end, which may be infinite; the last one may be smaller."""
    while first_path < end:
        yield first_path, int(min(size, end - first_path))
        first_path += size


def blocks_of(first_path: int, paths: int, size: int) -> Iterator[Block]:
    """Blocks that start at multiples of `size` where they can."""
    end = first_path + paths
    while first_path < end:
        count = min(size - first_path % size, end - first_path)
        yield first_path, count
        first_path += count


def workers_of(executor: Executor) -> int:
    """How many tasks an executor does at once: pools of threads and processes, MPI and Dask say;
    else as many as there are cores here."""
    client: Any = getattr(executor, "_client", None)
    if hasattr(client, "nthreads"):
        return max(1, sum(int(threads) for threads in client.nthreads().values()))
    for name in ("num_workers", "_max_workers"):
        if isinstance(number := getattr(executor, name, None), int):
            return max(1, number)
    return usable_cores()


@dataclass
class Crew:
    """An executor, and how it is asked. `external_executor` says that it was not started here
    and may be far away."""

    executor: Executor
    workers: int
    external_executor: bool
    block_seconds: float = math.inf
    waiting: deque[_Task] = field(default_factory=deque, init=False)

    def per_task(self, blocks: float) -> int:
        """Blocks to a task, of so many in all. They are merged one by one either way.

        Enough that one sender keeps all workers at work, but some for everybody; unless that makes
        so many tasks that sending them takes longer than the last of them.
        """
        if not self.external_executor or math.isinf(self.block_seconds):
            return 1
        each = max(self.block_seconds, SHORTEST_BLOCK)
        enough = max(TASK_SECONDS, 2.0 * self.workers * SENDING_SECONDS) / each
        fair = max(blocks / self.workers, math.sqrt(blocks * SENDING_SECONDS / each))
        return math.ceil(min(enough, fair))

    @property
    def window(self) -> int:
        """Tasks that may be under way; one, far away, until it is known how long a block takes."""
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
        """Each block in order, once every work on it is done.

        `total` is how many blocks there are. Once it is `late()`, by default once the deadline has
        passed, no task is begun that has not been, but `at_least` so many are begun and finished
        in any case. A block that is under way at the deadline is handed on as the works left it,
        and is the last one.

        Raises
        ------
        WorkersLost
            If a block cannot be done; all before it have been handed on.
        """
        waiting, late = self.waiting, late or deadline.passed
        begun, attempts = 0, MOST_ATTEMPTS if self.external_executor else 1
        try:
            while (begun < at_least or not late()) and (
                chunk := tuple(islice(blocks, self.per_task(total)))
            ):
                # the clock is looked at within blocks that are long, or may be
                quick = self.block_seconds < PIECE_SECONDS
                calls = [(work, chunk, NEVER if quick else deadline) for work in works]
                waiting.append(_Task(self.executor, calls, attempts))
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
    ) -> Iterator[Any]:
        """The result of each block in order, as `do` hands them on: none may be done in time.

        The blocks may be without end. Raises `NotConverged` if the executor loses its workers.
        """
        self.block_seconds = math.inf  # of this work nothing is known
        total = len(blocks) if isinstance(blocks, Sequence) else math.inf
        try:
            done = self.do([work], iter(blocks), total, deadline, late, at_least=0)
            for _, (result,), _ in done:
                yield result
        except WorkersLost as error:
            raise NotConverged(f"{error}; start workers that do the work, and ask again") from error

    def cancel(self) -> None:
        """Take back every task that has not begun."""
        while self.waiting:
            self.waiting.popleft().cancel()

    def _hand_on(self, waiting: deque[_Task]) -> Generator[BlockDone, None, bool]:
        """The blocks of the task that is first in line, and what it takes to get them; False if
        some of them were left out for the deadline."""
        task = waiting[0]
        expected = self.block_seconds * len(task.blocks)

        def look(waited: float) -> None:
            overtaken = False  # by a task that was begun after it: it does not just wait its turn
            for each in reversed(waiting):
                each.ask_again(also_late=overtaken and waited > LATE * expected)
                overtaken = overtaken or each.done()

        known = math.isfinite(expected)
        done = task.results(look, max(LOOK_SECONDS, expected / 2.0) if known else LOOK_SECONDS)
        waiting.popleft()
        self.block_seconds = sum(each.seconds for each in done) / (len(done) * len(task.blocks))
        where = [each.machine for each in done]
        for number, block in enumerate(task.blocks):
            if any(number >= len(each.results) for each in done):
                return False
            yield block, [each.results[number] for each in done], where
        return True


def start_crew(executor: Executor | None, threads: int | None) -> Crew:
    """A crew on somebody's executor, or on threads of its own."""
    if executor is not None:
        return Crew(executor, threads or workers_of(executor), external_executor=True)
    workers = threads or usable_cores()
    return Crew(ThreadPoolExecutor(workers), workers, external_executor=False)


@contextmanager
def crew_of(executor: Executor | None, threads: int | None) -> Iterator[Crew]:
    """The same for a while, in which Ctrl-C makes deadlines pass. At its end no task is left that
    may still begin, and threads of its own have ended."""
    check_executor(executor)
    crew = start_crew(executor, threads)
    try:
        with heeding_ctrl_c():
            yield crew
    finally:
        crew.cancel()
        if not crew.external_executor:
            crew.executor.shutdown(cancel_futures=True)


def check_executor(executor: Executor | None) -> None:
    """ValueError for what takes no tasks."""
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise ValueError(
            "executor must be a concurrent.futures.Executor, as ProcessPoolExecutor(), got "
            f"{executor!r}"
        )


Call = tuple[Work, tuple[Block, ...], Deadline]
"""Arguments of `do_blocks`."""


class _Task:
    """Some blocks by every work."""

    def __init__(self, executor: Executor, calls: list[Call], attempts: int) -> None:
        self.blocks = calls[0][1]
        self.asked = [_Asked(executor, call, attempts) for call in calls]

    def results(self, look: Callable[[float], None], every: float) -> list[Done]:
        """Of every work, each once, however often it was begun."""
        return [asked.result(look, every) for asked in self.asked]

    def done(self) -> bool:
        """Whether all of it is."""
        return all(asked.done() is not None for asked in self.asked)

    def ask_again(self, *, also_late: bool) -> None:
        """For what is lost; and a second time for what is not done, if that is late."""
        for asked in self.asked:
            asked.ask_again(also_late)

    def cancel(self) -> bool:
        """Whether some of it had not begun, and now never will."""
        cancelled = [asked.cancel() for asked in self.asked]
        return any(cancelled)


class _Asked:
    """A call of `do_blocks` that was asked for, again where it failed or is late. All tries
    give the same; the first that is done is taken."""

    def __init__(self, executor: Executor, call: Call, attempts: int) -> None:
        self.executor, self.call, self.attempts = executor, call, attempts
        self.tries: list[Future[Done]] = []
        self.begun = 0
        self._ask()

    def _ask(self) -> None:
        self.begun += 1
        try:
            self.tries.append(self.executor.submit(do_blocks, *self.call, self.begun))
        except Exception as error:  # broken, shut down, out of reach: whatever it calls that
            raise WorkersLost(
                f"the executor takes no more work ({type(error).__name__}: {error})"
            ) from error

    def result(self, look: Callable[[float], None], every: float) -> Done:
        """Wait for it; `look` is called every so many seconds with those that this took so far."""
        if self.attempts == 1:
            return self.tries[0].result()
        waited = 0.0
        while True:
            future = self.done() or self.tries[0]
            try:
                found = future.result(timeout=every)
            except Exception as error:
                if isinstance(error, TimeoutError) and not future.done():
                    waited += every
                    look(waited)
                else:
                    self._lost(future, error)
            else:
                if isinstance(found, Done):
                    self.cancel()
                    return found
                kind = type(found).__name__
                self._lost(future, TypeError(f"a task returned {kind}, not results of blocks"))

    def done(self) -> Future[Done] | None:
        """A try that is over, if there is one."""
        return next((future for future in self.tries if future.done()), None)

    def _lost(self, future: Future[Done], error: BaseException) -> None:
        if isinstance(error, StochviError):
            raise error  # what the work says itself, which another worker would say as well
        if isinstance(error, BrokenExecutor):
            raise WorkersLost(f"the executor lost its workers ({error})") from error
        if self.begun >= self.attempts:
            raise WorkersLost(
                f"the block that starts at path {self.call[1][0][0]} failed {self.begun} times "
                f"({type(error).__name__}: {error})"
            ) from error
        self.tries.remove(future)
        if not self.tries:
            self._ask()

    def ask_again(self, also_late: bool) -> None:
        """If it is lost; or not done and late, and was asked for once."""
        if future := self.done():
            error = CancelledError() if future.cancelled() else future.exception()
            if error is not None:
                self._lost(future, error)
        elif also_late and len(self.tries) == 1 and self.begun < self.attempts:
            self._ask()

    def cancel(self) -> bool:
        """Whether it had not begun, and now never will."""
        cancelled = [future.cancel() for future in self.tries]
        return all(cancelled)
