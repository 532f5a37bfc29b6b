"""The run of a calculation that samples: its workers, deadline, checkpoint and progress; and the
loop that adds blocks of paths until there are enough."""

from __future__ import annotations

import functools
import inspect
import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field, is_dataclass, replace
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar, overload

import numpy as np

from stochvi.mathematics.units import bound_to, plain_number
from stochvi.results.deadline import Deadline, Progress, clock_decides, part_of, stood_still
from stochvi.results.errors import Interrupted, NotConverged
from stochvi.results.estimates import Cost
from stochvi.sampling.calculations import (
    DEFAULTS,
    WITHOUT_DIGITS,
    BegunBlock,
    Block,
    Sampler,
    blocks_of,
    check_options,
    more_paths,
    signature_of,
    with_drawn_seed,
)
from stochvi.sampling.checkpoints import (
    Checkpoint,
    CheckpointWriter,
    Entry,
    digest_of,
    from_plain,
    to_plain,
)
from stochvi.sampling.workers import WorkerPool, pool_of
from stochvi.scenes.scene import Scene

P = ParamSpec("P")
Answer = TypeVar("Answer")
Sample = TypeVar("Sample")

ENDLESS = 2**62
"""Number of paths of a run that ends at its deadline alone."""

REPORT_SECONDS = 0.2
"""Seconds between two reports of progress within a round."""


@dataclass(frozen=True)
class Taken(Generic[Sample]):
    """State of the loop: a sample, the number of its paths, whether there are as many as were
    wanted, and the kinds of machines that made it."""

    sample: Sample
    paths: int
    enough: bool
    machines: tuple[str, ...]


@dataclass
class Run:
    """Settings of a calculation that samples.

    `rel_error`, `paths` and `duration` are None where they are left out, or no option. `began` is
    the time at which the calculation began, s, on a clock that stands still while kernels are
    compiled. `latest` is the last sample of the loop, for an answer where an exception ends it.
    """

    pool: WorkerPool
    deadline: Deadline
    progress: Progress | None = None
    seed: int = 0
    rel_error: float | None = None
    paths: int | None = None
    duration: float | None = None
    began: float = field(default_factory=lambda: time.time() - stood_still())
    latest: Any = field(default=None, init=False)

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> Run:
        """The run of a `sampled` calculation, from its options; its budget begins now."""
        return cls(
            pool=options["executor"], deadline=Deadline.after(options["budget"]),
            progress=options["progress"], seed=options.get("seed") or 0,
            rel_error=options.get("rel_error"), paths=options.get("paths"),
            duration=options.get("duration"),
        )  # fmt: skip

    @property
    def accuracy(self) -> float:
        """The relative error of a calculation that has one in any case."""
        assert self.rel_error is not None
        return self.rel_error

    @property
    def workers(self) -> int:
        """Number of workers."""
        return self.pool.workers

    def cost(self, **work: int) -> Cost:
        """The time that the calculation took so far, and the work that was done in it."""
        return Cost(
            wall_time=time.time() - stood_still() - self.began, threads=self.workers, **work
        )

    def tell(self, done: float, text: str) -> None:
        """Tell the fraction that is done, and a sentence, where progress is asked for."""
        if self.progress is not None:
            self.progress(done, text)

    def part(
        self, low: float = 0.0, high: float = 1.0, words: str = "",
        deadline: Deadline | None = None, **changed: Any,
    ) -> Run:  # fmt: skip
        """The run of a part of the calculation, which takes the fraction done from `low` to `high`
        until a deadline; with some fields `changed`."""
        progress = part_of(self.progress, low, high, words)
        return replace(self, progress=progress, deadline=deadline or self.deadline, **changed)

    def begin(self) -> None:
        """Write the first checkpoint, if there is one; else it is written before the first block.
        The arguments must be checked."""
        if self.pool.checkpoint is not None:
            self.pool.checkpoint.begin()

    def work(self) -> dict[str, Any]:
        """The `WorkOptions` of another calculation that is a part of this one: it has the workers,
        the checkpoint and the rest of the time of this run."""
        return {"executor": self.pool, "budget": self.deadline.rest, "progress": self.progress}

    def options(self, deadline: Deadline | None = None, **more: Any) -> dict[str, Any]:
        """The options of another calculation that is a part of this one, until a deadline; it has
        the seed of this run, too."""
        return self.part(deadline=deadline).work() | {"seed": self.seed} | more

    def until(
        self,
        sampler: Sampler[Any, Sample],
        first: int,
        more: Callable[[Sample], float] = lambda _: 0,
        *,
        deadline: Deadline | None = None,
        needed: int = 1,
        start: Callable[[Sample | None, int, int], Any] | None = None,
        tell: Callable[[Sample], tuple[float, str]] | None = None,
    ) -> Taken[Sample]:
        """Sample `first` paths, and after each round as many `more` as its sample asks for, until
        it asks for none.

        Blocks are merged in their order. Every decision but the end at the deadline depends on
        merged samples alone. A run that resumes therefore decides like one that never stopped.

        Once the deadline has passed, the block under way is cut. It is part of the answer, and no
        part of the checkpoint: the clock chose where it was cut, and a run that resumes does the
        block again as a whole. So no digit depends on load, and at most the blocks under way are
        lost, one for each worker: some tenths of a second, or seconds of many coupled modes.

        Parameters
        ----------
        needed
            Number of paths that are sampled even where the deadline passes before.
        start
            Function that returns the state from which the paths of a block go on, where they do:
            of the sample before the round, or with some of its blocks, and the first path and
            number of paths of the block.
        tell
            Fraction done and a sentence, for the progress; by default those of the paths of the
            round.

        Raises
        ------
        NotConverged
            If the deadline passed before there were any paths (`Interrupted` after Ctrl-C), or the
            executor loses its workers.
        """
        deadline = deadline or self.deadline
        kept = self.pool.checkpoint
        entry = Entry.empty() if kept is None else kept.of(sampler)
        entry.goal = entry.goal or first
        self.pool.block_seconds = math.inf  # unknown for this sampler
        sample: Sample | None = entry.sample
        speak = Reporter(self.progress, sampler, tell)
        while True:
            numbered = blocks_of(entry.paths, entry.goal, sampler.block)
            blocks: Iterator[BegunBlock] = numbered
            if start is not None:
                blocks = _goes_on(numbered, functools.partial(start, sample))
            total = math.ceil((entry.goal - entry.paths) / sampler.block)
            with closing(self.pool.do(sampler, blocks, total, deadline, needed)) as made:
                for (_, paths, *_), new, machine in made:
                    if not sampler.is_whole(new, paths):
                        sample = sampler.merge_cut(sample, new)
                        break
                    sample = new if sample is None else sampler.merge(sample, new)
                    self.latest = entry.sample = sample
                    entry.paths += paths
                    entry.machines = tuple(dict.fromkeys((*entry.machines, machine)))
                    if kept is not None:
                        kept.keep_if_due()
                    speak(sample, entry.goal)
            if sample is None:
                raise deadline.fell_short("before two paths were simulated", "raise budget")
            whole = entry.paths >= entry.goal
            wanted = more(sample) if whole else math.inf
            if not whole:  # a worker may have seen it alone
                clock_decides()
            if not wanted or not whole or deadline.passed():
                return Taken(sample, sampler.paths(sample), not wanted, entry.machines)
            entry.goal = entry.paths + math.ceil(wanted / sampler.block) * sampler.block

    def to_accuracy(
        self,
        sampler: Sampler[Any, Sample],
        first: int,
        error: Callable[[Sample], float],
        rel_error: float,
        most_unseen: float = math.inf,
        **how: Any,
    ) -> Taken[Sample]:
        """As `until`, until the relative `error` of a sample of at least `first` paths is at most
        `rel_error`; or until there are `most_unseen` paths, where it is still infinite then."""

        def more(sample: Sample) -> float:
            paths, known = sampler.paths(sample), error(sample)
            hopeless = math.isinf(known) and paths >= most_unseen
            return 0.0 if hopeless else more_paths(paths, known, rel_error)

        def tell(sample: Sample) -> tuple[float, str]:
            # a smaller sample may be too small for an error, and must not be judged for its sake
            known = error(sample) if sampler.paths(sample) >= first else math.inf
            return (rel_error / max(known, rel_error)) ** 2, sampler.describe(sample)

        return self.until(sampler, first, more, tell=tell, **how)


def _goes_on(blocks: Iterator[Block], start: Callable[..., Any]) -> Iterator[BegunBlock]:
    """Blocks with what they go on from."""
    return ((*block, start(*block)) for block in blocks)


class Reporter(Generic[Sample]):
    """Tells now and then how much is done; the fraction never falls."""

    def __init__(
        self, progress: Progress | None, sampler: Sampler[Any, Sample],
        tell: Callable[[Sample], tuple[float, str]] | None,
    ) -> None:  # fmt: skip
        self.progress, self.sampler, self.tell = progress, sampler, tell
        self.shown, self.at = 0.0, -math.inf

    def __call__(self, sample: Sample, goal: float) -> None:
        """Tell it, if a round has ended or some time has passed."""
        paths = self.sampler.paths(sample)
        early = paths < goal and time.perf_counter() - self.at < REPORT_SECONDS
        if self.progress is None or early:
            return
        self.at = time.perf_counter()
        done, text = paths / goal, ""
        if self.tell is not None:
            done, text = self.tell(sample)
        self.shown = min(max(self.shown, done), 1.0)
        self.progress(self.shown, text or self.sampler.describe(sample))


# Calculations that sample -----------------------------------------------------------------------


@overload
def sampled(calculate: Callable[P, Answer], /) -> Callable[P, Answer]: ...
@overload
def sampled(**defaults: Any) -> Callable[[Callable[P, Answer]], Callable[P, Answer]]: ...
def sampled(calculate: Any = None, **defaults: Any) -> Any:
    """Give a calculation with `**options: Unpack[SamplingOptions]` all that these promise.

    Options are checked; workers are started, or those of the calculation that asks are shared; and
    all samples that it asks for, however deep within it, are kept in the checkpoint. A run that
    goes on takes the arguments of the earlier run where they are left out. The calculation gets its
    options as they are, complete and with the pool as `executor`: `Run.of` reads them.

    Parameters
    ----------
    defaults
        Values of options that this calculation has instead of the usual ones.
    """
    if calculate is None:
        return functools.partial(sampled, **defaults)
    signature = signature_of(calculate, **defaults)
    own = {
        name: each.default
        for name, each in list(signature.parameters.items())[1:]
        if name not in WITHOUT_DIGITS
    }

    @functools.wraps(calculate)
    def run(*args: Any, **given: Any) -> Any:
        bound = bound_to(signature, calculate.__name__.lstrip("_"), *args, **with_drawn_seed(given))
        bound.apply_defaults()
        named = {name: each for name, each in bound.arguments.items() if name != "rng"}
        named |= {name: each for name, each in defaults.items() if named[name] is None}
        if "seed" in named:
            named["seed"] = named["seed"] or 0
        named |= {name: plain_number(each) for name, each in named.items() if name in DEFAULTS}
        check_options(named)
        first = next(iter(named.values()))
        scene = getattr(first, "scene", first)  # an answer is of its scene
        with pool_of(named["executor"], named["threads"]) as pool:
            outer = pool.checkpoint
            begun = _begun(calculate.__name__.lstrip("_"), scene, own, named)
            pool.checkpoint = begun or outer
            answer = functools.partial(calculate, **named | {"executor": pool})
            try:
                return answer() if begun is None else _kept(answer, begun)
            finally:
                pool.checkpoint = outer

    run.__signature__ = signature  # type: ignore[attr-defined]
    return run


def _begun(
    command: str, scene: Scene, own: Mapping[str, Any], named: dict[str, Any]
) -> CheckpointWriter | None:
    """Writer of the checkpoint, if there is one; `named` gets the arguments of the run that is
    resumed."""
    file = named["resume"] if named["checkpoint"] is None else named["checkpoint"]
    if file is None:
        return None
    asked = {name: _plain(named[name]) for name in own}
    begun, before = Checkpoint.begun(Path(file), command, scene, asked), None
    if named["resume"] is not None:
        before = Checkpoint.read(Path(named["resume"]))
        before.check(command, scene)
        required = [name for name, each in own.items() if each is inspect.Parameter.empty]
        changed = {name: each for name, each in asked.items() if each != _plain(own[name])}
        begun.asked = before.asked_again(changed, required)
        begun.samples, begun.seconds = before.samples, before.seconds
        taken = {name: each for name, each in begun.asked.items() if each != _plain(named[name])}
        named.update({name: _hashable(value) for name, value in taken.items()})
    new = before is None or before.path != begun.path
    return CheckpointWriter(begun, named["checkpoint_interval"], new)


def _kept(calculate: Callable[[], Any], writer: CheckpointWriter) -> Any:
    """The answer, or the error with the answer so far; the checkpoint is written at the end."""
    try:
        try:
            found = calculate()
            writer.begin()
        finally:
            writer.keep()
    except (NotConverged, Interrupted) as error:
        error.partial = writer.noted(error.partial)
        raise
    return writer.noted(found)


def _plain(value: Any) -> Any:
    """An argument as JSON holds it; the digest of what JSON cannot hold."""
    value = value.tolist() if isinstance(value, np.ndarray) else plain_number(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Mapping):
        return {str(name): _plain(each) for name, each in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return to_plain(value)
    return [*map(_plain, value)] if isinstance(value, tuple | list) else digest_of(value)


def _hashable(value: Any) -> Any:
    """An argument as it was before `_plain`."""
    if isinstance(value, dict) and "record" in value:
        return from_plain(value)
    return tuple(value) if isinstance(value, list) else value
