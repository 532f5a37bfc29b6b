"""What public calculations share. Chapters: the decorator `calculation`; paths that are given up at
a deadline; blocks of paths and their pieces; the class `Sampler`; the options of everything that
samples."""

from __future__ import annotations

import functools
import inspect
import math
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeAlias, TypedDict, TypeVar

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.units import (
    CHECKS,
    USUAL,
    argument_checker,
    outside_of_share,
    shown,
    shown_in,
)
from stochvi.results.base import Result
from stochvi.results.deadline import (
    NEVER,
    Deadline,
    Progress,
    asked_for,
    decisions_of_the_clock,
    ended_by,
    showing,
    shown_in_notebooks,
    watched,
)
from stochvi.results.errors import (
    Interrupted,
    NotApplicable,
    NotConverged,
    SceneError,
    StochviError,
    beyond_arithmetic,
)
from stochvi.results.files import call_of
from stochvi.scenes.scene import Scene
from stochvi.scenes.validation import Spelt

# ------------------------------------------------------------------------------
# What public calculations share: arguments are checked, progress is shown, a budget ends them, and
# answers record their call.
# ------------------------------------------------------------------------------


P = ParamSpec("P")
T = TypeVar("T")


def _check_scene(name: str, value: object) -> None:
    if not isinstance(value, Scene):
        raise SceneError(
            f'{name} must be a Scene, as load_scene("FILE.toml") makes it, got {shown(value)}'
        )


CHECKS["Scene"] = _check_scene


def calculation(function: Callable[P, T]) -> Callable[P, T]:
    """A public calculation.

    Before it begins, its scene and its plain arguments are checked against their annotations. It
    never sees an `rng`, but the `seed` that this draws. Its progress is shown in a notebook, with
    the compiling of kernels. A `budget` that is long over ends it (see `ended_by`); messages name
    this budget also where a part of it has run out. An answer, also one that falls short, records
    the call in its provenance, and whether the clock decided on a part of it.
    """
    check, signature = argument_checker(function), inspect.signature(function)
    parameters = signature.parameters
    budget = parameters.get("budget")
    draws = "rng" in signature_of(function).parameters

    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        bound = check(*args, **(with_drawn_seed(kwargs) if draws else kwargs))
        given = bound.arguments
        with ExitStack() as around:
            # what an answer says of its calculation does not depend on who reads it
            around.enter_context(shown_in(USUAL))
            if "progress" in parameters:
                wanted = shown_in_notebooks(function.__name__, given.get("progress"))
                given["progress"] = around.enter_context(showing(around.enter_context(wanted)))
            if budget is not None:
                seconds = given.get("budget", budget.default)
                if seconds is not None and not 0.0 < seconds < math.inf:
                    raise ValueError(
                        f"budget must be a positive number of seconds, got {shown(seconds)}"
                    )
                around.enter_context(asked_for(seconds))
                if not watched():
                    around.enter_context(ended_by(seconds))
            before = decisions_of_the_clock()
            try:
                answer: T = recorded(function(*bound.args, **bound.kwargs), given, before)
            except (NotConverged, Interrupted) as error:
                error.partial = recorded(error.partial, given, before)
                raise
            except (ArithmeticError, np.linalg.LinAlgError) as error:
                if isinstance(error, StochviError):
                    raise
                scenes = [each for each in given.values() if isinstance(each, Scene)]
                document = scenes[0].document(as_written=True) if scenes else {}
                why = f"the scene {beyond_arithmetic(error, {**given, **document})}"
                raise NotApplicable(function.__name__, why) from error
        return answer

    def recorded(answer: Any, given: Mapping[str, Any], before: int) -> Any:
        if not isinstance(answer, Result):
            return answer
        defaults = {
            name: each.default
            for name, each in parameters.items()
            if each.default is not inspect.Parameter.empty
        }
        late = {"budget_decided": True} if decisions_of_the_clock() > before else {}
        return answer.with_provenance(
            call=call_of(function.__name__, {**defaults, **given}), **late
        )

    spelt = [each.replace(annotation=Spelt(each.annotation)) for each in parameters.values()]
    returned = Spelt(signature.return_annotation)
    run.__signature__ = inspect.Signature(spelt, return_annotation=returned)  # type: ignore[attr-defined]
    return run


# ------------------------------------------------------------------------------
# A path that takes long is given up once its answer is due, as its kernel looks at a flag.
#
# Every kernel that advances paths (`run_white`, `run_modes`) looks at it in every step. A path that
# is given up leaves no result, so that no number depends on the clock. Blocks of `simulate` are cut
# in time before that (`choose_plan.go_on`), and their paths end between two steps.
# ------------------------------------------------------------------------------


Flag = NDArray[np.uint8]
"""One number, 0 as long as kernels go on."""

WAIT_SECONDS = 1.0
"""Seconds after the deadline, or after Ctrl-C, for which paths under way are waited for: half of
the 2 s within which a command ends after Ctrl-C, as its answer has yet to be written."""

LOOK_SECONDS = 0.1
"""Seconds between two looks at the deadline while paths are under way."""

_own = threading.local()


class GivenUp(Exception):
    """Paths were given up on the way, as their answer was due."""


def stop_flag() -> Flag:
    """The flag at which the kernels look that this thread calls."""
    if not hasattr(_own, "flag"):
        _own.flag = np.zeros(1, np.uint8)
    flag: Flag = _own.flag
    return flag


def check_flag() -> None:
    """Raise `GivenUp` if the flag of this thread is set."""
    if stop_flag()[0]:
        raise GivenUp


@contextmanager
def given_up_after(deadline: Deadline) -> Iterator[None]:
    """Set the flag of this thread WAIT_SECONDS after the deadline, if this block lasts so long."""
    before, flag, ended = stop_flag(), np.zeros(1, np.uint8), threading.Event()

    def watch() -> None:
        end: Deadline | None = None
        while not ended.wait(LOOK_SECONDS):
            if end is None and deadline.passed():
                end = Deadline(time.time() + WAIT_SECONDS)
            if end is not None and end.passed():
                flag[0] = 1
                return

    _own.flag = flag
    threading.Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        ended.set()
        _own.flag = before


# ------------------------------------------------------------------------------
# Blocks of paths, and the pieces into which a deadline cuts the work on one of them.
# ------------------------------------------------------------------------------


Piece = TypeVar("Piece")

Block = tuple[int, int]
"""Number of the first path of a block, and number of its paths."""

BegunBlock = tuple[int, int, *tuple[Any, ...]]
"""A block, followed by what its paths go on from where they do not begin."""

LANES = 16
"""A piece of a block with more paths than this has a multiple of it: the loops of the kernels over
paths fill vectors of 8 numbers."""

FULL_LANES = 64
"""Number of paths that take hardly longer per step of each than many paths do: at 64 a kernel takes
1.1 times as long, at 16 1.4 times, at 2 ten times (one oscillator, white noise, rigid stops)."""

FEWEST_AT_ONCE = 2
"""Number of paths in the first piece of a block, whose time says how large the next one may be: the
smallest that gives a standard error."""

MORE = 4
"""Factor by which a piece may be larger than the one before."""

PIECE_SECONDS = 0.25
"""Largest expected time in seconds of a piece of a block, so that a budget is overrun by no
more."""

SHORTEST = 1e-6
"""Time in seconds of a block or a path for which the clock measured zero."""


def blocks_of(first_path: int, end: float, size: int) -> Iterator[Block]:
    """Blocks of the paths from `first_path` up to `end`, which may be infinite, cut at the
    multiples of `size`.

    >>> list(blocks_of(5, 12, 4))
    [(5, 3), (8, 4)]
    """
    while first_path < end:
        count = int(min(size - first_path % size, end - first_path))
        yield first_path, count
        first_path += count


def in_pieces(
    make: Callable[[int, int], Piece], first_path: int, paths: int, deadline: Deadline
) -> list[Piece]:
    """Results of `make(first_path, paths)` for successive pieces of a block of paths.

    The deadline is checked between pieces. The remaining paths are left out once it has passed, or
    a path would take clearly longer than the time left. The first piece, of FEWEST_AT_ONCE paths,
    is never left out. A piece that takes longer all the same is given up (`stop_flag`), with
    `GivenUp` where it is the first. The paths do not depend on the pieces.
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
                each = max((time.perf_counter() - began) / size, SHORTEST)
                made += size
                left = min(PIECE_SECONDS, deadline.left)
                # a few paths take hardly longer than two, so that their price is that of a piece
                more = min(MORE * size, FULL_LANES) if each * size < deadline.left else 1
                size = max(more, int(left / each))
                size -= size % LANES if size > LANES else 0
    except GivenUp:
        if not done:
            raise
    return done


# ------------------------------------------------------------------------------
# A sampler: how a block of paths is simulated, and what is added up, merged and counted of it.
# ------------------------------------------------------------------------------


Sample = TypeVar("Sample")

MARGIN, LEAST_GROWTH, MOST_GROWTH = 1.1, 0.1, 3.0
"""Factor on the number of missing paths, and the limits of its ratio to the number of paths so
far."""


class Sampler(ABC, Generic[Piece, Sample]):
    """A plan of paths together with a reducer; all else of a simulation is done for it.

    A sampler holds the seed and what describes its paths, and is sent to workers: a dataclass whose
    arrays are cached properties, which are made anew there. All its results are
    functions of these fields and of the numbers of the paths alone. `digest_of` these fields names
    its results in a checkpoint, so that these must consist of what `to_plain` can keep.
    """

    @property
    @abstractmethod
    def block(self) -> int:
        """Number of paths that one call simulates together."""

    @abstractmethod
    def simulate(self, first_path: int, paths: int) -> Piece:
        """Simulate the paths first_path, first_path + 1, ...; the result has a row for each."""

    @abstractmethod
    def add_up(self, pieces: list[Piece]) -> Sample:
        """The sample of a block, whose paths were simulated in these pieces."""

    @abstractmethod
    def merge(self, sample: Sample, more: Sample) -> Sample:
        """The sample of both groups of paths, the second of which follow the first."""

    @abstractmethod
    def paths(self, sample: Sample) -> int:
        """Number of paths in a sample."""

    def sample(self, first_path: int, paths: int, deadline: Deadline) -> Sample:
        """The sample of a block, or of its first paths where the deadline passes before its end.

        Raises `GivenUp` where there are none.
        """
        return self.add_up(in_pieces(self.simulate, first_path, paths, deadline))

    def is_whole(self, sample: Sample, paths: int) -> bool:
        """Whether the sample of a block holds all of it."""
        return self.paths(sample) == paths

    def merge_cut(self, sample: Sample | None, cut: Sample) -> Sample:
        """The sample with a block behind it that the deadline has cut."""
        return cut if sample is None else self.merge(sample, cut)

    def describe(self, sample: Sample) -> str:
        """A sentence for the progress."""
        return f"{self.paths(sample)} paths"


class ListSampler(Sampler[Any, list[Any]]):
    """A sampler whose sample is the list of its blocks: what is concatenated is so once a round."""

    def merge(self, sample: list[Any], more: list[Any]) -> list[Any]:
        """The blocks of both."""
        return [*sample, *more]


class TrialSampler(ListSampler):
    """A sampler whose blocks are made as a whole or given up, as a part of one would over-represent
    what happens early; its sample is the list of their results."""

    @abstractmethod
    def trial(self, first_path: int, paths: int, deadline: Deadline) -> Any:
        """The result of a block; `GivenUp` if the deadline passes before its end."""

    def simulate(self, first_path: int, paths: int) -> Any:
        """The result of a block."""
        return self.trial(first_path, paths, NEVER)

    def add_up(self, pieces: list[Any]) -> list[Any]:
        """The results."""
        return pieces

    def sample(self, first_path: int, paths: int, deadline: Deadline, *start: Any) -> list[Any]:
        """The result of a block, which may go on from a start."""
        return [self.trial(first_path, paths, deadline, *start)]

    def paths(self, sample: list[Any]) -> int:
        """Number of paths."""
        return len(sample) * self.block

    def is_whole(self, sample: list[Any], paths: int) -> bool:
        """True, as blocks are made as a whole."""
        return True


def more_paths(paths: int, error: float, rel_error: float) -> int:
    """Number of paths to add to `paths`, whose relative error is `error`, for `rel_error`; 0 if
    they suffice.

    Errors fall with the square root of the number of paths; they are known less well than that.
    Between a tenth and three times as many paths are added.

    >>> more_paths(100, 0.02, 0.01), more_paths(100, 0.01, 0.01)
    (300, 0)
    """
    if error <= rel_error:
        return 0
    growth = (error / rel_error) ** 2 - 1.0
    return math.ceil(paths * min(max(MARGIN * growth, LEAST_GROWTH), MOST_GROWTH))


# ------------------------------------------------------------------------------
# The options of everything that samples: the same words in Python and on the command line.
# ------------------------------------------------------------------------------


BUDGET = 60.0
"""Seconds that a calculation may take unless `budget` says otherwise."""


DRAWN_BELOW = 2**53
"""Bound of a seed that is drawn: JSON readers keep a whole number below it to its last digit."""

Random: TypeAlias = (
    "np.random.Generator | np.random.BitGenerator | np.random.SeedSequence | int | None"
)
"""What draws a seed, as `numpy.random.default_rng` takes it."""


class WorkOptions(TypedDict, total=False):
    """How a calculation is run; none of these has an effect on its digits.

    Parameters
    ----------
    threads, executor
        Threads to start here, by default as many as there are cores. Or any
        `concurrent.futures.Executor`, as `ProcessPoolExecutor()`,
        `mpi4py.futures.MPIPoolExecutor()` or Dask's `Client(address).get_executor()` (see
        `sampling.workers`), with `threads` to correct how many tasks it does at once.
    budget
        Seconds after which `NotConverged` is raised with the answer so far, compilation apart:
        60 if left out, None for no limit. Ctrl-C does the same, with `Interrupted`.
    progress
        A function that is called with the fraction done and a sentence.
    checkpoint, checkpoint_interval
        File to keep all samples in, written at once, then every so many seconds, and at the end. A
        checkpoint that is there is replaced, and kept as FILE.earlier if it took longer than 10 s;
        any other file is refused.
    resume
        Checkpoint to go on from, with the arguments of its run, to the digits of a run that never
        stopped. It is also written on, unless `checkpoint` names another. That of a run that ended
        gives its answer again.
    """

    threads: int | None
    executor: Executor | None
    budget: float | None
    progress: Progress | None
    checkpoint: str | Path | None
    checkpoint_interval: float
    resume: str | Path | None


class RunOptions(WorkOptions, total=False):
    """The options of a calculation that draws random numbers.

    Parameters
    ----------
    seed
        Seed of the random numbers, 0 if left out. The streams belong to (seed, path): the same
        seed gives the same digits on any number of threads, and on machines of one kind.
    rng
        Whatever `numpy.random.default_rng` takes, in the place of a seed: it draws the seed.
    """

    seed: int | None
    rng: Random


class AccuracyOptions(RunOptions, total=False):
    """The options of a simulation that ends at an accuracy.

    Parameters
    ----------
    rel_error
        Relative standard error to reach.
    """

    rel_error: float | None


class SamplingOptions(AccuracyOptions, total=False):
    """The options of a simulation that ends at an accuracy, or at a number of paths.

    Parameters
    ----------
    paths, duration
        Number of paths instead of an accuracy, and their length after burn-in, s.

    See Also
    --------
    stochvi.simulate : A calculation that takes them; the manual has a table of all of them.

    Examples
    --------
    >>> asked: SamplingOptions = {"rel_error": 0.02, "seed": 1, "budget": 10.0}
    """

    paths: int | None
    duration: float | None


DEFAULTS: dict[str, Any] = {
    "rel_error": None, "paths": None, "duration": None, "seed": 0, "rng": None, "threads": None,
    "executor": None, "budget": BUDGET, "progress": None, "checkpoint": None,
    "checkpoint_interval": 1.0, "resume": None,
}  # fmt: skip
"""Values of options that are left out."""

KINDS: dict[str, Any] = {
    kind.__name__: kind for kind in (WorkOptions, RunOptions, AccuracyOptions, SamplingOptions)
}
"""Kinds of options by the name that annotates `**options`."""

WITHOUT_DIGITS = (
    "threads", "executor", "budget", "progress", "checkpoint", "checkpoint_interval", "resume",
    "out", "rng",
)  # fmt: skip
"""Options on which no digit of an answer depends, beside the seed that `rng` has drawn: a run may
go on with others."""


def signature_of(function: Callable[..., Any], **defaults: Any) -> inspect.Signature:
    """The signature of a function, with the options of its `**options` one by one, and the defaults
    that the function has for some."""
    signature = inspect.signature(function)
    *named, last = signature.parameters.values()
    if last.kind is not inspect.Parameter.VAR_KEYWORD:
        return signature
    kind = last.annotation.removeprefix("Unpack[").removesuffix("]")
    if kind not in KINDS:  # keys of something else
        return signature
    annotations = KINDS[kind].__annotations__  # with those of the kinds that it extends
    options = [
        inspect.Parameter(
            name, inspect.Parameter.KEYWORD_ONLY, default=(DEFAULTS | defaults).get(name),
            annotation=getattr(each, "__forward_arg__", each),
        )
        for name, each in annotations.items()
    ]  # fmt: skip
    return signature.replace(parameters=[*named, *options])


def with_drawn_seed(given: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments with the seed that their `rng` draws, if there is one, in its place.

    >>> with_drawn_seed({"rng": np.random.default_rng(1), "paths": 8})
    {'paths': 8, 'seed': 4610079356560476}
    """
    rest = {name: each for name, each in given.items() if name != "rng"}
    rng = given.get("rng")
    if rng is None:
        return rest
    if rest.get("seed") is not None:
        raise ValueError("give seed or rng, not both")
    try:
        return rest | {"seed": int(np.random.default_rng(rng).integers(DRAWN_BELOW))}
    except (TypeError, ValueError):
        raise ValueError(
            "rng must be a Generator or SeedSequence of numpy, or what default_rng makes one of, "
            f"got {shown(rng)}"
        ) from None


def check_options(given: Mapping[str, Any]) -> None:
    """Raise ValueError for options that make no sense."""
    for name in ("paths", "threads", "seed"):
        number = given.get(name)
        if number is not None and not isinstance(number, (int, np.integer)):
            raise ValueError(f"{name} must be a whole number, got {number!r}")
    rel_error, paths, threads = (given.get(name) for name in ("rel_error", "paths", "threads"))
    if rel_error is not None and paths is not None:
        raise ValueError("give rel_error or paths, not both")
    if rel_error is not None and not 1e-6 <= rel_error < 1.0:
        raise outside_of_share("rel_error", "in [1e-6, 1)", rel_error)
    if paths is not None and paths < 2:
        raise ValueError(f"paths must be at least 2 for a standard error, got {paths}")
    if threads is not None and threads < 1:
        raise ValueError(f"threads must be at least 1, got {threads}")
    if not 0 <= (given.get("seed") or 0) < 2**63:
        raise ValueError(f"seed must be in [0, 2^63), got {given['seed']}")
    for name in ("duration", "budget", "checkpoint_interval"):
        seconds = given.get(name)
        if seconds is not None and not 0.0 < seconds < math.inf:
            raise ValueError(f"{name} must be a positive number of seconds, got {seconds}")
    for name in ("checkpoint", "resume"):
        if given.get(name) is not None and str(given[name]) == "":
            raise ValueError(f"{name} must name a file, got ''")
