"""Workers: threads, processes, Dask or MPI. Chapters: tasks, and their results in order; a Dask
cluster; compiling, which no budget pays for.

A task is some blocks of paths of one sampler. Its result is a function of the sampler and the
blocks alone. Any worker may do it, and do it again where a worker is lost. Results are merged in
the order of their blocks, so that no digit depends on the number or speed of workers.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.metadata
import io
import math
import pickle
import platform
from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
)
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from itertools import islice
from threading import Timer
from typing import TYPE_CHECKING, Any, NamedTuple

from numba.core.event import Event, Listener, register
from threadpoolctl import ThreadpoolController

from stochvi.results.deadline import (
    NEVER,
    Deadline,
    announce,
    ctrl_c_was_heard,
    graceful_interrupt,
    start_clock,
    stop_clock,
)
from stochvi.results.errors import Interrupted, NotConverged, StochviError
from stochvi.results.files import thread_seconds, usable_cores
from stochvi.sampling.calculations import PIECE_SECONDS, SHORTEST, BegunBlock, GivenUp, Sampler

if TYPE_CHECKING:
    from stochvi.sampling.checkpoints import CheckpointWriter

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
"""Seconds between two checks for lost or late tasks while the first result is awaited. Half the
expected time of a task is taken instead if it is longer."""

MOST_ATTEMPTS = 4
"""Number of times that a task is begun on an external executor before the run gives up. Schedulers
repeat lost tasks themselves as well."""

KEPT_SAMPLERS = 8
"""Number of samplers that a worker keeps, with all that it has calculated for their paths."""


class Done(NamedTuple):
    """Result of a task: the samples of its first blocks, the machine, and the CPU time in s."""

    samples: tuple[Any, ...]
    machine: str
    seconds: float


class BlockDone(NamedTuple):
    """A block with its sample and the machine that made it."""

    block: BegunBlock
    sample: Any
    machine: str


class WorkersLost(NotConverged):
    """The executor failed to do a task in all attempts."""


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


# What is sent -----------------------------------------------------------------------------------


class _SmallPickler(pickle.Pickler):
    """Leaves out what objects have calculated from their fields and kept (`cached_property`)."""

    def reducer_override(self, value: Any) -> Any:
        kept = [
            name
            for name in getattr(value, "__dict__", ())
            if isinstance(getattr(type(value), name, None), cached_property)
        ]
        if not kept:
            return NotImplemented
        function, arguments, state, *more = value.__reduce_ex__(pickle.HIGHEST_PROTOCOL)
        return function, arguments, {n: v for n, v in state.items() if n not in kept}, *more


def packed(value: Any) -> bytes:
    """The fields of a value, as they are sent to another process.

    Raises
    ------
    ValueError
        If it holds a function that another process does not find by its name.
    """
    file = io.BytesIO()
    try:
        _SmallPickler(file, pickle.HIGHEST_PROTOCOL).dump(value)
    except (pickle.PicklingError, AttributeError) as error:
        raise ValueError(
            "executor must have threads for functions that no file holds, got processes "
            f"({error}); write the functions into a file that they can import"
        ) from None
    return file.getvalue()


@lru_cache(KEPT_SAMPLERS)
def unpacked(packet: bytes) -> Any:
    """The value of a packet, once for all tasks of a worker that bring it."""
    return pickle.loads(packet)


@cache
def _linear_algebra() -> ThreadpoolController:
    return ThreadpoolController()


@contextmanager
def one_thread() -> Iterator[None]:
    """Within it linear algebra uses one thread.

    The matrices here are small. Between two products the threads of a library such as OpenBLAS wait
    in a loop, which keeps a core from the paths. With them a simulation of three masses on two
    cores took 1.6 times as long. The digits of modes may also depend on the number of threads.
    """
    with _linear_algebra().limit(limits=1, user_api="blas"):
        yield


def do_task(
    sampler: Sampler[Any, Any] | bytes, blocks: tuple[BegunBlock, ...], deadline: Deadline,
    needed: int = 0, attempt: int = 1,
) -> Done:  # fmt: skip
    """Do the blocks of a task in their order, those that start at path `needed` or later until the
    deadline. A block that is given up has no sample.

    `attempt` has no effect but to give each attempt a key of its own, as a scheduler may remember
    that a key failed.
    """
    began = thread_seconds()
    samples: list[Any] = []
    one: Sampler[Any, Any] = unpacked(sampler) if isinstance(sampler, bytes) else sampler
    with one_thread() if isinstance(sampler, bytes) else nullcontext():
        for first_path, paths, *start in blocks:
            if deadline.passed() and first_path >= needed:
                break
            try:
                samples.append(one.sample(first_path, paths, deadline, *start))
            except GivenUp:
                break
    return Done(tuple(samples), machine(), thread_seconds() - began)


# Who does it ------------------------------------------------------------------------------------


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
class WorkerPool:
    """The workers of a run, and the tasks under way on them.

    It may stand for the `executor` of a calculation that another one asks, which then shares its
    workers and its checkpoint. `external` says that the caller supplied the executor, so that its
    workers may be far away; `checkpoint` keeps the samples, where one is asked for;
    `block_seconds` is the measured CPU time of a block.
    """

    executor: Executor
    workers: int
    external: bool
    checkpoint: CheckpointWriter | None = None
    block_seconds: float = math.inf

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Future[Any]:
        """Give the workers a call to do, as any executor does."""
        return self.executor.submit(function, *arguments)

    def per_task(self, blocks: float) -> int:
        """Number of blocks in a task, of `blocks` in all.

        Tasks of an external executor last so long that one sender keeps all workers busy. They are
        shortened where some workers would get none, unless sending so many tasks would take longer
        than the last of them.
        """
        if not self.external or math.isinf(self.block_seconds):
            return 1
        each = max(self.block_seconds, SHORTEST)
        enough = max(TASK_SECONDS, 2.0 * self.workers * SENDING_SECONDS) / each
        fair = max(blocks / self.workers, math.sqrt(blocks * SENDING_SECONDS / each))
        return math.ceil(min(enough, fair))

    @property
    def window(self) -> int:
        """Largest number of tasks under way: 1 on an external executor until the time of a block is
        known."""
        if self.external and math.isinf(self.block_seconds):
            return 1
        return WINDOW * self.workers

    def do(
        self, sampler: Sampler[Any, Any], blocks: Iterator[BegunBlock], total: float,
        deadline: Deadline = NEVER, needed: int = 0,
    ) -> Generator[BlockDone, None, None]:  # fmt: skip
        """Sample blocks, of which there are `total`, and hand them on in their order.

        Once the deadline has passed no further task is begun, and one that waits for a worker is
        left out; but the blocks that start before path `needed` are done. The block that is under
        way at the deadline is handed on as far as it got, as the last one.

        Raises
        ------
        WorkersLost
            If a task cannot be done; all blocks before it have been handed on.
        """
        waiting: deque[_Task] = deque()
        sent: Any = packed(sampler) if self.external else sampler
        try:
            while chunk := tuple(islice(blocks, self.per_task(total))):
                if deadline.passed() and chunk[0][0] >= needed:
                    break
                # the deadline is checked within blocks that take long or an unknown time
                until = NEVER if self.block_seconds < PIECE_SECONDS else deadline
                waiting.append(_Task(self, (sent, chunk, until, needed)))
                while len(waiting) >= min(self.window, max(1, MOST_WAITING // len(chunk))):
                    if not (yield from self._hand_on(waiting)):
                        return
            while waiting:
                late = deadline.passed() and waiting[0].blocks[0][0] >= needed
                if late and waiting[0].cancel():
                    return
                if not (yield from self._hand_on(waiting)):
                    return
        finally:
            for task in waiting:
                task.cancel()

    def _hand_on(self, waiting: deque[_Task]) -> Generator[BlockDone, None, bool]:
        """Hand on the blocks of the oldest task, and measure the time of a block; return False if
        some of its blocks were left out because the deadline passed."""
        task = waiting[0]
        expected = self.block_seconds * len(task.blocks)

        def repeat_lost_and_late(waited: float) -> None:
            overtaken = False  # whether a task begun later has ended, so that this one has begun
            for each in reversed(waiting):
                each.resubmit(also_late=overtaken and waited > LATE * expected)
                overtaken = overtaken or each.done() is not None

        interval = max(LOOK_SECONDS, expected / 2.0) if math.isfinite(expected) else LOOK_SECONDS
        done = task.result(repeat_lost_and_late, interval)
        waiting.popleft()
        self.block_seconds = done.seconds / len(task.blocks)
        for block, sample in zip(task.blocks, done.samples, strict=False):
            yield BlockDone(block, sample, done.machine)
        return len(done.samples) == len(task.blocks)


class _Task:
    """A call of `do_task` on an executor, submitted again where it failed or is late.

    All attempts give the same result; that of the first which ends is taken.
    """

    def __init__(self, pool: WorkerPool, call: tuple[Any, ...]) -> None:
        self.executor, self.call = pool.executor, call
        self.attempts = MOST_ATTEMPTS if pool.external else 1
        self.blocks: tuple[BegunBlock, ...] = call[1]
        self.futures: list[Future[Done]] = []
        self.begun = 0
        self._submit()

    def _submit(self) -> None:
        self.begun += 1
        try:
            self.futures.append(self.executor.submit(do_task, *(*self.call, self.begun)))
        except Exception as error:  # each kind of executor has its own errors
            raise _lost(f"takes no more work ({type(error).__name__}: {error})") from error

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
                    self._failed(future, error)
            else:
                if isinstance(found, Done):
                    self.cancel()
                    return found
                kind = type(found).__name__
                self._failed(future, TypeError(f"a task returned {kind}, not samples of blocks"))

    def done(self) -> Future[Done] | None:
        """The first attempt that has ended, or None."""
        return next((future for future in self.futures if future.done()), None)

    def _failed(self, future: Future[Done], error: BaseException) -> None:
        if isinstance(error, StochviError):
            raise error  # raised by the work itself: it would be raised again
        if isinstance(error, BrokenExecutor):
            raise _lost(f"lost its workers ({error})") from error
        if self.begun >= self.attempts:
            raise _lost(
                f"failed {self.begun} times to simulate the block that starts at path "
                f"{self.blocks[0][0]} ({type(error).__name__}: {error})"
            ) from error
        self.futures.remove(future)
        if not self.futures:
            self._submit()

    def resubmit(self, *, also_late: bool) -> None:
        """Submit again if the call failed, or once if it has not ended and `also_late` is true."""
        if future := self.done():
            error = CancelledError() if future.cancelled() else future.exception()
            if error is not None:
                self._failed(future, error)
        elif also_late and len(self.futures) == 1 and self.begun < self.attempts:
            self._submit()

    def cancel(self) -> bool:
        """Cancel all attempts; return whether none of them had begun."""
        cancelled = [future.cancel() for future in self.futures]
        return all(cancelled)


def _lost(what: str) -> WorkersLost:
    return WorkersLost(
        f"the executor {what}; start workers that do the work, and ask again, or go on from the "
        "checkpoint if there is one"
    )


@contextmanager
def pool_of(executor: Executor | WorkerPool | None, threads: int | None) -> Iterator[WorkerPool]:
    """A pool within a `with` block, in which Ctrl-C makes deadlines pass. At its end no task is
    left that may still begin, and threads that were started for it have ended."""
    if isinstance(executor, WorkerPool):
        yield executor
        return
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise ValueError(
            "executor must be a concurrent.futures.Executor, as ProcessPoolExecutor(), got "
            f"{executor!r}"
        )
    workers = threads or (usable_cores() if executor is None else workers_of(executor))
    pool = WorkerPool(
        executor or ThreadPoolExecutor(workers), workers, external=executor is not None
    )
    try:
        with graceful_interrupt(), one_thread():
            yield pool
    finally:
        if not pool.external:
            pool.executor.shutdown(cancel_futures=True)


# ------------------------------------------------------------------------------
# Executor that simulates on the machines of a Dask cluster.
#
# A cluster on this machine is one command each for the scheduler and the workers, in an environment
# that has `pip install 'stochvi[distributed]'`:
#
#     dask scheduler --port 8786
#     dask worker tcp://localhost:8786 --nworkers 4 --nthreads 1
#
# and `dask worker tcp://head:8786 --nworkers -1` on every other machine, or under a batch system.
# Then `stochvi simulate scene.toml --dask tcp://head:8786`. Workers must have the same versions of
# stochvi and its libraries, and the same kind of processor; else the digits depend on the worker,
# and the response has a warning. Under MPI, `mpiexec -n 64 python -m mpi4py.futures job.py` with
# `simulate(..., executor=MPIPoolExecutor())` in job.py.
# ------------------------------------------------------------------------------


CONNECT_SECONDS = 10.0
"""Seconds to wait for the answer of a scheduler."""


@contextlib.contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """Executor of the Dask cluster whose scheduler listens at `address`, "tcp://host:8786".

    Raises
    ------
    ValueError
        If Dask is not installed, no scheduler answers, or there are no workers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise ValueError("--dask needs Dask: pip install 'stochvi[distributed]'") from None
    try:
        client = Client(address, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise ValueError(
            f"--dask: no scheduler answers at {address} ({type(error).__name__}); start one with "
            "'dask scheduler --port 8786' and name it as tcp://host:8786"
        ) from None
    with client:
        if not client.nthreads():
            raise ValueError(
                f"--dask: the scheduler at {address} has no workers; start some with "
                f"'dask worker {address} --nworkers 4'"
            )
        yield client.get_executor(pure=False)


# ------------------------------------------------------------------------------
# Compiling is announced, and no budget pays for it: the clock of all deadlines stands still.
#
# Kernels are compiled once on each machine. The time in which compiled kernels are loaded from the
# disk counts for a budget, as any other time does. Ctrl-C ends compiling at the next of its passes.
# ------------------------------------------------------------------------------


ANNOUNCED_SECONDS = 1.0
"""Seconds of compiling after which it is announced."""


@contextmanager
def outside_budgets() -> Iterator[None]:
    """Stop the clock of all deadlines within the `with` block, and announce it if it takes long."""
    speaker = Timer(ANNOUNCED_SECONDS, announce, ["compiling, once on each machine"])
    speaker.daemon = True
    speaker.start()
    stop_clock()
    try:
        yield
    finally:
        start_clock()
        speaker.cancel()


def check_ctrl_c() -> None:
    """Raise `Interrupted` if Ctrl-C was heard, whose answer nobody waits for in compiling."""
    if ctrl_c_was_heard():
        raise Interrupted("interrupted by Ctrl-C while kernels were compiled; nothing was kept")


class _Compiling(Listener):  # type: ignore[misc]
    """Listener to compilation. numba calls it before and after it compiles a function with those
    that it calls; a kernel calls it before and after it waits for another process."""

    def __init__(self) -> None:
        self.under_way: list[AbstractContextManager[Any]] = []

    def on_start(self, event: Event) -> None:
        self.under_way.append(outside_budgets())
        self.under_way[-1].__enter__()

    def on_end(self, event: Event) -> None:
        self.under_way.pop().__exit__(None, None, None)


class _Passing(Listener):  # type: ignore[misc]
    """Listener that is called before each of the some forty passes of compiling a function, and
    before each look whether another process has compiled it."""

    def on_start(self, event: Event) -> None:
        check_ctrl_c()

    def on_end(self, event: Event) -> None:
        pass


@cache
def leave_out_of_budgets() -> None:
    """Let no deadline of this process count the time in which numba compiles from now on."""
    compiling, passing = _Compiling(), _Passing()
    for kind in ("numba:compile", "stochvi:wait"):
        register(kind, compiling)
    for kind in ("numba:run_pass", "stochvi:look"):
        register(kind, passing)
