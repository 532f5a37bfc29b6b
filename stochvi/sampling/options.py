"""The options of everything that samples: the same words in Python and on the command line."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from stochvi.results.progress import Progress

BUDGET = 60.0
"""Seconds that a calculation may take unless `budget` says otherwise."""


class WorkOptions(TypedDict, total=False):
    """How a calculation is run; none of these has an effect on its digits.

    Parameters
    ----------
    threads, executor
        Threads to start here, by default as many as there are cores. Or any
        `concurrent.futures.Executor`, as `ProcessPoolExecutor()`,
        `mpi4py.futures.MPIPoolExecutor()` or Dask's `Client(address).get_executor()` (see
        `monte_carlo.clusters`), with `threads` to correct how many tasks it does at once.
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
    """

    seed: int | None


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
    "rel_error": None, "paths": None, "duration": None, "seed": 0, "threads": None,
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
    "out",
)  # fmt: skip
"""Options on which no digit of an answer depends: a run may go on with others."""


def signature_of(function: Callable[..., Any], **defaults: Any) -> inspect.Signature:
    """The signature of a function, with the options of its `**options` one by one, and the defaults
    that the function has for some."""
    signature = inspect.signature(function)
    *named, last = signature.parameters.values()
    if last.kind is not inspect.Parameter.VAR_KEYWORD:
        return signature
    kind = last.annotation.removeprefix("Unpack[").removesuffix("]")
    annotations = KINDS[kind].__annotations__  # with those of the kinds that it extends
    options = [
        inspect.Parameter(
            name, inspect.Parameter.KEYWORD_ONLY, default=(DEFAULTS | defaults)[name],
            annotation=getattr(each, "__forward_arg__", each),
        )
        for name, each in annotations.items()
    ]  # fmt: skip
    return signature.replace(parameters=[*named, *options])


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
        raise ValueError(f"rel_error must be in [1e-6, 1), got {rel_error}")
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
