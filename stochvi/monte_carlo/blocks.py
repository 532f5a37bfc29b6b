"""Blocks of paths on any executor: named, done again where a worker is lost, handed on in order.

A block is named by (seed, first path, paths) and by nothing else, so that any worker may do it, and
do it again. Results leave in the order of their blocks through a bounded window: which worker was
quicker, and how many there are, never shows in a digit.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import math
import os
import platform
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass
from functools import cache
from typing import Any

from stochvi.monte_carlo.plans import Plan
from stochvi.monte_carlo.statistics import Layout, PathStatistics

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

MOST_ATTEMPTS = 4
"""How often a block is begun before it is given up. Schedulers do lost blocks again themselves."""

Block = tuple[int, int]
"""First path, and how many."""


class WorkersLost(Exception):
    """The executor cannot do a block, however often it is asked."""


@dataclass(frozen=True, kw_only=True)
class Done:
    """What comes back of a task: statistics of each of its blocks, where from, and CPU seconds."""

    statistics: tuple[PathStatistics, ...]
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


def simulate_blocks(
    plan: Plan, layout: Layout, seed: int, blocks: tuple[Block, ...], attempt: int = 1
) -> Done:
    """One task: a function of its arguments alone, so any worker may do it, twice if need be.

    `attempt` changes nothing but the name by which a scheduler may remember that it failed.
    """
    start = time.thread_time()
    statistics = tuple(
        PathStatistics.of(plan.averages(seed, first_path, paths), layout)
        for first_path, paths in blocks
    )
    return Done(statistics=statistics, machine=machine(), seconds=time.thread_time() - start)


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
    return len(os.sched_getaffinity(0))


@dataclass
class Crew:
    """An executor, and how it is asked. `theirs`: it was not started here, and may be far away."""

    executor: Executor
    workers: int
    theirs: bool
    block_seconds: float = math.inf

    def per_task(self, blocks: int) -> int:
        """Blocks to a task, where `blocks` are left: enough that sending it does not count, but
        work for everybody. Blocks are merged one by one either way."""
        if not self.theirs:
            return 1
        tasks = WINDOW * self.workers
        seconds = max(TASK_SECONDS, 2.0 * self.workers * SENDING_SECONDS)
        enough = math.ceil(seconds / self.block_seconds) if self.block_seconds else blocks
        return max(1, min(enough, blocks // tasks, MOST_WAITING // tasks))

    def do(
        self,
        plans: list[Plan],
        layout: Layout,
        seed: int,
        blocks: Iterable[Block],
        late: Callable[[], bool],
    ) -> Generator[tuple[Block, list[PathStatistics], str], None, None]:
        """Each block with its statistics by every plan, in order, and the machine it comes from.

        Once `late()`, no task is begun that has not been.

        Raises
        ------
        WorkersLost
            If a block cannot be done; all before it have been handed on.
        """
        waiting: deque[_Task] = deque()
        left = deque(blocks)
        try:
            while left and not late():
                count = self.per_task(len(left))
                chunk = tuple(left.popleft() for _ in range(count))
                calls = [(plan, layout, seed, chunk) for plan in plans]
                waiting.append(_Task(self.executor, calls, MOST_ATTEMPTS if self.theirs else 1))
                if len(waiting) >= WINDOW * self.workers:
                    yield from self._hand_on(waiting.popleft())
            while waiting and not (late() and waiting[0].cancel()):
                yield from self._hand_on(waiting.popleft())
        finally:
            for task in waiting:
                task.cancel()

    def _hand_on(self, task: _Task) -> Iterator[tuple[Block, list[PathStatistics], str]]:
        done = task.results()
        self.block_seconds = sum(each.seconds for each in done) / (len(done) * len(task.blocks))
        for number, block in enumerate(task.blocks):
            where = {each.machine for each in done}
            yield block, [each.statistics[number] for each in done], " | ".join(sorted(where))


Call = tuple[Plan, Layout, int, tuple[Block, ...]]
"""Arguments of `simulate_blocks`."""


class _Task:
    """Some blocks by every plan: futures that are asked for again where they fail."""

    def __init__(self, executor: Executor, calls: list[Call], attempts: int) -> None:
        self.executor, self.calls, self.attempts = executor, calls, attempts
        self.blocks = calls[0][-1]
        self.futures = [self._submit(call) for call in calls]

    def _submit(self, call: Call, attempt: int = 1) -> Future[Done]:
        try:
            return self.executor.submit(simulate_blocks, *call, attempt)
        except (BrokenExecutor, RuntimeError) as error:  # also one that was shut down
            raise WorkersLost(f"the executor takes no more work ({error})") from error

    def results(self) -> list[Done]:
        """Of every plan, each once, however often it was begun."""
        return [self._result(number) for number in range(len(self.futures))]

    def _result(self, number: int) -> Done:
        for attempt in range(1, self.attempts + 1):
            try:
                return self.futures[number].result()
            except BrokenExecutor as error:
                raise WorkersLost(f"the executor lost its workers ({error})") from error
            except Exception as error:
                if self.attempts == 1:
                    raise
                if attempt == self.attempts:
                    first, _ = self.blocks[0]
                    raise WorkersLost(
                        f"the block that starts at path {first} failed {attempt} times "
                        f"({type(error).__name__}: {error})"
                    ) from error
                self.futures[number] = self._submit(self.calls[number], attempt + 1)
        raise AssertionError("at least one attempt is made")

    def cancel(self) -> bool:
        """Whether some of it had not begun, and now never will."""
        cancelled = [future.cancel() for future in self.futures]
        return any(cancelled)
