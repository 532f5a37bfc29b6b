"""Calculations that keep the results of their blocks in a checkpoint, and go on from it."""

from __future__ import annotations

import functools
import hashlib
import inspect
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from stochvi.mathematics.units import plain_number
from stochvi.methods.monte_carlo.block_results import BlockResults, keeping
from stochvi.methods.monte_carlo.checkpoints import Checkpoint, Files, Keeper
from stochvi.results.base import Result
from stochvi.results.errors import Interrupted, NotConverged
from stochvi.results.origin import named_files
from stochvi.scenes.scene import Scene

P = ParamSpec("P")
Answer = TypeVar("Answer", bound=Result)

OF_FILES = ("checkpoint", "checkpoint_interval", "resume")
"""Arguments that name the files of a run; they are for `resumable` alone."""

WITHOUT_DIGITS = ("threads", "executor", "budget", "progress", *OF_FILES)
"""Arguments on which no digit of an answer depends: a run may go on with others."""


def resumable(calculate: Callable[P, Answer]) -> Callable[P, Answer]:
    """Give a calculation `checkpoint`, `checkpoint_interval` and `resume`, as `simulate` has them.

    The calculation must have these arguments; it need not read them. While it runs, all results of
    blocks that it asks the driver for are kept (`block_results`), however deep within it, and the
    checkpoint is written when it is due. A run that goes on takes the arguments of the earlier run
    where they are left out, and gets the results that are known from the checkpoint.
    """
    signature = inspect.signature(calculate)
    defaults = {
        name: each.default
        for name, each in signature.parameters.items()
        if name not in ("scene", *WITHOUT_DIGITS)
    }

    @functools.wraps(calculate)
    def run(*scenes: P.args, **given: P.kwargs) -> Answer:
        bound = signature.bind(*scenes, **given)
        bound.apply_defaults()
        named = dict(bound.arguments)
        scene = named.pop("scene")
        files = Files(*(named[name] for name in OF_FILES))
        files.check()
        if files.target is None:
            return calculate(*scenes, **given)
        return _Run(calculate.__name__, scene, files, defaults, named).answer(calculate)

    return run


class _Run:
    """A calculation under way that keeps the results of its blocks."""

    def __init__(
        self, command: str, scene: Scene, files: Files, defaults: Mapping[str, Any],
        given: Mapping[str, Any],
    ) -> None:  # fmt: skip
        self.scene, self.files, self.started = scene, files, time.perf_counter()
        named = {name: _plain(given[name]) for name in defaults}
        before, proof = files.before(), digest_of_files(scene)
        if before is not None:
            before.check(command, scene, proof)
            required = [name for name, each in defaults.items() if each is inspect.Parameter.empty]
            changed = {name: named[name] for name in named if named[name] != defaults[name]}
            named = before.asked_again(changed, required)
        self.arguments = {**given, **{name: _hashable(value) for name, value in named.items()}}
        assert files.target is not None
        self.begun = Checkpoint.begun(files.target, command, scene, named, proof)
        self.results = BlockResults() if before is None else before.results()
        self.results.begins, self.results.changed = self.begin, self.keep_if_due
        self.earlier_seconds = 0.0 if before is None else float(before.state["seconds"])
        self.keeper: Keeper | None = None

    def answer(self, calculate: Callable[..., Answer]) -> Answer:
        """The answer, or the error with the answer so far; the checkpoint is written at the end."""
        try:
            try:
                with keeping(self.results):
                    found = calculate(self.scene, **self.arguments)
                self.begin()
            finally:
                self.keep()
        except (NotConverged, Interrupted) as error:
            error.response = error.response and self.noted(error.response)
            raise
        return self.noted(found)

    def begin(self) -> None:
        """Write the first checkpoint: once the arguments are checked, before any block is done."""
        if self.keeper is None:
            self.keeper = Keeper(self.begun, self.state(), self.files.interval, self.files.new)

    def keep_if_due(self) -> None:
        """Write the checkpoint if the interval since the last is over."""
        if self.keeper is not None and self.keeper.due():
            self.keep()

    def keep(self) -> None:
        """Write the checkpoint, if the run has begun."""
        if self.keeper is not None:
            self.keeper.keep(self.state())

    def state(self) -> dict[str, Any]:
        """The state for the checkpoint."""
        seconds = self.earlier_seconds + time.perf_counter() - self.started
        return {"results": self.results.document(), "seconds": seconds}

    def noted(self, answer: Answer) -> Answer:
        """The answer with the time of the earlier run in its cost, and a warning if the checkpoint
        does not hold it."""
        if self.earlier_seconds:
            wall_time = answer.cost.wall_time + self.earlier_seconds
            answer = replace(answer, cost=replace(answer.cost, wall_time=wall_time))
        return answer if self.keeper is None else self.keeper.noted(answer)


def _plain(value: Any) -> Any:
    """An argument as JSON holds it."""
    return [_plain(each) for each in value] if isinstance(value, tuple) else plain_number(value)


def _hashable(value: Any) -> Any:
    """An argument as it was before `_plain`."""
    return tuple(value) if isinstance(value, list) else value


def digest_of_files(scene: Scene) -> str:
    """Digest of the bytes of all files that a scene names."""
    digest = hashlib.sha256()
    for name in named_files(scene.document()):
        file = Path(name)
        digest.update(file.read_bytes() if file.is_file() else b"")
    return digest.hexdigest()
