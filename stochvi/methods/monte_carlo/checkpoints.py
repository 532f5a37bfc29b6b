"""Checkpoints: the state of a run on disk, written atomically and bound to one scene.

A checkpoint is one line, "stochvi checkpoint 3" and the SHA-256 of the rest of the file, followed
by a JSON document with the command, the scene, the arguments, the versions, the processor and the
state: `State` of `simulate`, or the results of blocks (`block_results`) of all else. Floats are
written with all their digits, so that a resumed run gives the same bits as one that was never
stopped.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import re
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar

import numpy as np
from annotated_types import Ge, Len, MinLen
from pydantic import ConfigDict, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from stochvi.mathematics.units import plain_number
from stochvi.methods.monte_carlo.block_results import BlockResults
from stochvi.methods.monte_carlo.blocks import BlockStatistics, machine
from stochvi.methods.monte_carlo.path_statistics import Layout, PathStatistics, StepPairs
from stochvi.methods.monte_carlo.plan import Plan
from stochvi.results.atomic_files import write_whole
from stochvi.results.base import Result
from stochvi.results.errors import CheckpointError, reason_of
from stochvi.results.intervals import PathMoments
from stochvi.scenes.scene import Scene

HEADER, FORMAT = "stochvi checkpoint", 3
"""First words of a checkpoint file, and the number of its format, which follows them."""

LONG_SECONDS = 10.0
"""Seconds of simulation above which a checkpoint is renamed and not overwritten when a new run is
given the same file."""

WRITING_SHARE = 0.05
"""Largest share of the time of a run that goes into writing checkpoints: large ones are written
less often than asked for."""

Answer = TypeVar("Answer", bound=Result)

STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
"""How a checkpoint is checked: no value is converted, no key left out or added."""

Count = Annotated[int, Ge(0)]


class PartDocument(TypedDict):
    """`PathStatistics` or `StepPairs` as plain types, without their layout."""

    __pydantic_config__ = STRICT  # type: ignore[misc]
    count: Count
    mean: list[float]
    scatter: list[list[float]]


class StateDocument(TypedDict):
    """`State` as plain types."""

    __pydantic_config__ = STRICT  # type: ignore[misc]
    fine: PartDocument
    pairs: PartDocument
    goal: Count
    steps: Count
    refinements: Count
    machines: list[str]
    seconds: Annotated[float, Ge(0.0)]


@dataclass(frozen=True, kw_only=True)
class Asked:
    """The arguments of `simulate` on which its digits depend."""

    rel_error: float | None = None
    paths: int | None = None
    duration: float | None = None
    seed: int | None = None
    speed_threshold: float | None = None
    slow_impacts: bool = False

    def settled(self) -> Asked:
        """The arguments with defaults filled in: seed 0, and a relative error of 1 % if no number
        of paths is given."""
        plain = self.plain()
        rel_error = 0.01 if plain.rel_error is None and plain.paths is None else plain.rel_error
        return replace(plain, rel_error=rel_error, seed=0 if plain.seed is None else plain.seed)

    def plain(self) -> Asked:
        """The arguments with NumPy numbers converted to Python numbers, which JSON can hold."""
        return Asked(**{name: plain_number(value) for name, value in asdict(self).items()})

    def given(self) -> dict[str, Any]:
        """Those that were not left out."""
        named = asdict(self.plain()).items()
        return {name: value for name, value in named if value is not None and value is not False}


class AskedDocument(TypedDict):
    """`Asked` as plain types."""

    __pydantic_config__ = STRICT  # type: ignore[misc]
    rel_error: float | None
    paths: int | None
    duration: float | None
    seed: int | None
    speed_threshold: float | None
    slow_impacts: bool


class SimulationDocument(TypedDict):
    """What the body of a checkpoint of `simulate` holds."""

    __pydantic_config__ = STRICT  # type: ignore[misc]
    command: str
    scene: dict[str, Any]
    asked: AskedDocument
    machine: str
    proof: str
    state: StateDocument


class EntryDocument(TypedDict):
    """An `Entry` of `block_results` as plain types."""

    __pydantic_config__ = STRICT  # type: ignore[misc]
    blocks: Annotated[list[Annotated[list[Count], Len(2, 2)]], MinLen(1)]
    value: Any


class ResultsDocument(TypedDict):
    """The results of the blocks of a run as plain types, and the seconds that it took."""

    __pydantic_config__ = STRICT  # type: ignore[misc]
    results: dict[str, list[EntryDocument]]
    seconds: Annotated[float, Ge(0.0)]


class Document(TypedDict):
    """What the body of a checkpoint of any other command holds."""

    __pydantic_config__ = STRICT  # type: ignore[misc]
    command: str
    scene: dict[str, Any]
    asked: dict[str, Any]
    machine: str
    proof: str
    state: ResultsDocument


@dataclass(frozen=True, kw_only=True)
class State:
    """Results of a run after some blocks. It is replaced as a whole, never within a block.

    `goal` is the number of paths at which the current round ends, `refinements` the number of times
    that the plan was refined, `machines` the kinds of machines that simulated blocks, `seconds` the
    time spent.
    """

    fine: PathStatistics
    pairs: StepPairs
    goal: int = 0
    steps: int = 0
    refinements: int = 0
    machines: tuple[str, ...] = ()
    seconds: float = 0.0

    @classmethod
    def start(cls, layout: Layout) -> State:
        """The state of a run that has not begun."""
        return cls(fine=PathStatistics.none(layout), pairs=StepPairs.none(layout))

    def with_block(self, block: BlockStatistics, steps: int, where: Sequence[str]) -> State:
        """The state after one more block, from its statistics and the number of its steps."""
        fine, pairs, _ = block
        return replace(
            self,
            fine=self.fine.merge(fine),
            pairs=self.pairs.merge(pairs) if pairs.count else self.pairs,
            steps=self.steps + steps,
            machines=tuple(dict.fromkeys((*self.machines, *where))),
        )

    def of_layout(self, layout: Layout) -> State:
        """The same numbers of a plan whose rows are expected to have other values."""
        return replace(
            self,
            fine=replace(self.fine, layout=layout),
            pairs=replace(self.pairs, layout=layout),
        )

    def document(self) -> dict[str, Any]:
        """The state as types that JSON can hold."""
        plain = {field.name: getattr(self, field.name) for field in fields(self)}
        for name in ("fine", "pairs"):
            part: PathMoments = plain[name]
            plain[name] = {
                "count": part.count,
                "mean": part.mean.tolist(),
                "scatter": part.scatter.tolist(),
            }
        return plain | {"machines": list(self.machines)}

    @classmethod
    def from_document(cls, plain: Mapping[str, Any], layout: Layout) -> State:
        """Read the state from the document; `layout` is that of the scene. ValueError if the tables
        do not have the size of the layout."""
        parts: dict[str, PathMoments] = {}
        for name, none in (
            ("fine", PathStatistics.none(layout)),
            ("pairs", StepPairs.none(layout)),
        ):
            part = plain[name]
            parts[name] = replace(
                none,
                count=part["count"],
                mean=np.array(part["mean"], float),
                scatter=np.array(part["scatter"], float),
            )
            for table in ("mean", "scatter"):
                if getattr(parts[name], table).shape != getattr(none, table).shape:
                    raise ValueError(
                        f"state.{name} has not the {len(none.mean)} rows of this scene"
                    )
        return cls(**{**plain, **parts, "machines": tuple(plain["machines"])})


@dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """A command, its scene and its arguments, with the state of the run.

    `proof` is a digest of what the scene alone does not tell: for `simulate` of the averages of two
    short paths, which changes with the tables that a scene names and with the arithmetic of the
    machine; for all else of the files that the scene names.
    """

    path: Path
    command: str
    scene: Mapping[str, Any]
    asked: Mapping[str, Any]
    machine: str
    proof: str = ""
    state: Mapping[str, Any]

    @classmethod
    def begun(
        cls, path: Path, command: str, scene: Scene, asked: Mapping[str, Any], proof: str = ""
    ) -> Checkpoint:
        """The checkpoint of a run on this machine, without a state yet."""
        return cls(
            path=path.resolve(), command=command, scene=plain_scene(scene), asked=asked,
            machine=machine(), proof=proof, state={},
        )  # fmt: skip

    def write(self) -> None:
        """Write the file as a whole or not at all; it is on the disk on return."""
        document = {
            "command": self.command,
            "scene": self.scene,
            "asked": self.asked,
            "machine": self.machine,
            "proof": self.proof,
            "state": self.state,
        }
        body = json.dumps(document, allow_nan=False).encode()
        write_whole(_header(body) + body, self.path, durable=True)

    @classmethod
    def read(cls, path: Path) -> Checkpoint:
        """Read a file; CheckpointError unless it is a checkpoint without damage."""
        if path.exists() and not _is_checkpoint(path):
            raise CheckpointError(f"{path} is not a checkpoint of stochvi")
        text = path.read_bytes()
        header, newline, body = text.partition(b"\n")
        number = re.match(rf"{HEADER} (\d+) [0-9a-f]{{64}}$".encode(), header)
        if number and int(number[1]) != FORMAT:
            raise CheckpointError(
                f"{path} was written by another version of stochvi (format {int(number[1])}, here "
                f"{FORMAT}); go on with that version, or start again without it"
            )
        if header + newline != _header(body):
            raise CheckpointError(
                f"{path} is damaged: it was cut short or changed since it was written (its "
                "checksum does not match); start again without it"
            )
        try:
            document = json.loads(body)
            simulated = isinstance(document, dict) and document.get("command") == "simulate"
            kind: Any = SimulationDocument if simulated else Document
            found: Any = TypeAdapter(kind).validate_python(document)
        except ValidationError as error:
            first = error.errors()[0]
            raise _incomplete(path, ".".join(map(str, first["loc"]))) from error
        except (ValueError, RecursionError) as error:
            raise _incomplete(path) from error
        asked = found["asked"]
        if simulated and asked["paths"] is None and asked["rel_error"] is None:
            raise _incomplete(path, "asked")
        return cls(path=path, **found)

    def asked_again(self, given: Mapping[str, Any], required: Sequence[str] = ()) -> dict[str, Any]:
        """The arguments of the earlier run; CheckpointError if some of those `given` now differ
        from them. Those that are `required` cannot be left out."""
        for name, value in given.items():
            before = self.asked.get(name)
            if value != before:
                had = f"{self._instead_of(name)}, not with {name} {value}"
                if before is not None:
                    had = f"{name} {before}, not {value}"
                remedy = f"give {name} {before}" if name in required else f"leave {name} out"
                raise CheckpointError(
                    f"{self.path} is of a run with {had}; {remedy} to go on with it, or start "
                    "again without the checkpoint"
                )
        return dict(self.asked)

    def _instead_of(self, name: str) -> str:
        """Words for the arguments of the earlier run where it had no value for `name`."""
        paths, rel_error = self.asked.get("paths"), self.asked.get("rel_error")
        if name == "rel_error" and paths is not None:
            return f"{paths} paths"
        if name == "paths" and rel_error is not None:
            return f"rel_error {rel_error}"
        return f"no {name}"

    def check(self, command: str, scene: Scene, proof: str = "") -> None:
        """CheckpointError if it belongs to another command or scene, to other versions or to
        another processor."""
        if command != self.command:
            raise CheckpointError(
                f"{self.path} is of {self.command}, not of {command}; go on with it by "
                f"{self.command}, or start again without it"
            )
        if differing := _difference(self.scene, plain_scene(scene)):
            raise CheckpointError(f"{self.path} is of another scene: {differing}")
        if self.machine != machine():
            raise CheckpointError(
                f"{self.path} is of another version or processor, where digits differ: it was made "
                f"with {self.machine}; here is {machine()}"
            )
        if proof and self.proof and proof != self.proof:
            raise CheckpointError(
                f"{self.path} is of another scene: the same words give other paths now (a table "
                "that the scene names has changed, or the package itself)"
            )

    def resumed(self, plan: Plan) -> State:
        """The state from which a simulation goes on; CheckpointError if it is incomplete."""
        try:
            return State.from_document(self.state, plan.layout)
        except ValueError as error:
            raise _incomplete(self.path, str(error)) from error

    def results(self) -> BlockResults:
        """The results of blocks from which a run goes on; CheckpointError if they are
        incomplete."""
        found = BlockResults()
        try:
            found.take(self.state["results"])
        except ValueError as error:
            raise _incomplete(self.path, str(error)) from error
        return found


class Files(NamedTuple):
    """The files of a run: its checkpoint, the seconds from one writing of it to the next, and the
    checkpoint from which the run goes on."""

    checkpoint: str | Path | None
    interval: float
    resume: str | Path | None

    def check(self) -> None:
        """ValueError for an empty name and for an interval that is not a time."""
        for name, file in (("checkpoint", self.checkpoint), ("resume", self.resume)):
            if file is not None and str(file) == "":
                raise ValueError(f"{name} must name a file, got ''")
        if not 0.0 < self.interval < math.inf:
            raise ValueError(
                f"checkpoint_interval must be a positive number of seconds, got {self.interval}"
            )

    @property
    def target(self) -> Path | None:
        """The file to which the run writes its checkpoints."""
        target = self.resume if self.checkpoint is None else self.checkpoint
        return None if target is None else Path(target)

    @property
    def new(self) -> bool:
        """Whether that file is not the one from which the run goes on."""
        if self.target is None or self.resume is None:
            return True
        return self.target.resolve() != Path(self.resume).resolve()

    def before(self) -> Checkpoint | None:
        """The checkpoint from which the run goes on; None for a run from the start."""
        return None if self.resume is None else Checkpoint.read(Path(self.resume))


class Keeper:
    """Writes the checkpoint of a run: at the start, and when the interval since the last is over.

    It replaces a checkpoint but no other file. The checkpoint of another run (`new`) that took
    longer than LONG_SECONDS is first renamed to FILE.earlier, and a damaged one to FILE.damaged.

    Raises
    ------
    CheckpointError
        If another file is there, or this one cannot be written at the start.
    """

    def __init__(
        self, begun: Checkpoint, state: Mapping[str, Any], interval: float, new: bool = True
    ) -> None:
        self.begun, self.interval, self.failure = begun, interval, ""
        path = begun.path
        try:
            _check_place(path)
            if new:
                _keep_damaged(path)
                _set_aside(path)
            self._write(state)
        except OSError as error:
            raise CheckpointError(
                f"{path} cannot be written: {reason_of(error)}; name another file for "
                "the checkpoint"
            ) from error

    def due(self) -> bool:
        """Whether the interval since the last checkpoint is over."""
        wait = max(self.interval, self.writing / WRITING_SHARE)
        return time.perf_counter() - self.written >= wait

    def keep(self, state: Mapping[str, Any]) -> None:
        """Write the checkpoint now.

        If that fails, for example on a full disk, `failure` gives the reason and the run goes on;
        the next attempt follows when the interval is over.
        """
        try:
            self._write(state)
            self.failure = ""
        except OSError as error:
            self.failure = (
                f"the checkpoint {self.begun.path} could not be written: {reason_of(error)}; it "
                "holds what it held before"
            )

    def _write(self, state: Mapping[str, Any]) -> None:
        began = self.written = time.perf_counter()
        self.writing = 0.0
        replace(self.begun, state=state).write()
        self.written = time.perf_counter()
        self.writing = self.written - began

    def noted(self, answer: Answer) -> Answer:
        """The answer with a warning if the checkpoint does not hold it."""
        if not self.failure or self.failure in answer.warnings:
            return answer
        return replace(answer, warnings=[*answer.warnings, self.failure])


def _check_place(path: Path) -> None:
    """CheckpointError if the file is neither empty nor a checkpoint."""
    if path.is_dir():
        raise CheckpointError(f"{path} is a folder; name a file in it for the checkpoint")
    if path.exists() and not _is_checkpoint(path) and not _is_empty(path):
        raise CheckpointError(f"{path} is there and is no checkpoint of stochvi; name another file")


def _is_checkpoint(path: Path) -> bool:
    """Whether it is a regular file, no device or pipe, that begins like a checkpoint."""
    if not path.is_file():
        return False
    with open(path, "rb") as file:
        return file.read(len(HEADER)) == HEADER.encode()


def _is_empty(path: Path) -> bool:
    return path.is_file() and path.stat().st_size == 0


def _set_aside(path: Path) -> None:
    """Rename a checkpoint that took long to FILE.earlier, unless the one there took longer."""
    earlier = path.with_name(path.name + ".earlier")
    if _seconds_in(path) > max(LONG_SECONDS, _seconds_in(earlier)):
        with contextlib.suppress(FileNotFoundError):  # another run has renamed it
            os.replace(path, earlier)


def _keep_damaged(path: Path) -> None:
    """Rename a checkpoint that cannot be read to FILE.damaged, with a UserWarning that says so."""
    if not path.exists() or _is_empty(path):
        return
    try:
        Checkpoint.read(path)
    except CheckpointError as error:
        aside = path.with_name(path.name + ".damaged")
        os.replace(path, aside)
        reason = str(error).rpartition("; ")[0]
        warnings.warn(f"{reason}; it was renamed to {aside.name}", stacklevel=2)


def _seconds_in(path: Path) -> float:
    """Seconds of simulation in a checkpoint; 0 if no run can resume from it."""
    try:
        state = Checkpoint.read(path).state
        begun = state["results"] if "results" in state else state["fine"]["count"]
        return float(state["seconds"]) if begun else 0.0
    except (CheckpointError, FileNotFoundError, KeyError, TypeError):
        return 0.0


def _incomplete(path: Path, where: str = "") -> CheckpointError:
    place = f" ({where})" if where else ""
    return CheckpointError(
        f"{path} does not hold what a checkpoint of this version holds{place}; start again without "
        "it"
    )


def plain_scene(scene: Scene) -> dict[str, Any]:
    """The scene as JSON holds it, with files named without their folders, since a path may differ
    from machine to machine."""
    document: dict[str, Any] = json.loads(json.dumps(scene.document()))
    return {key: _without_folders(value) for key, value in document.items()}


def _without_folders(part: Any) -> Any:
    if isinstance(part, list):
        return [_without_folders(each) for each in part]
    if not isinstance(part, dict):
        return part
    return {
        key: Path(value).name if key == "file" else _without_folders(value)
        for key, value in part.items()
    }


def _difference(there: Any, here: Any, key: str = "") -> str:
    """A phrase about the first key in which two documents differ; empty if they are equal."""
    if isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        there, here = dict(enumerate(there)), dict(enumerate(here))
    if isinstance(there, dict) and isinstance(here, dict):
        for name in [*there, *(name for name in here if name not in there)]:
            place = f"{key}.{name}".lstrip(".")
            if found := _difference(there.get(name), here.get(name), place):
                return found
        return ""
    return "" if there == here else f"{key} is {_short(there)} in it, {_short(here)} here"


def _short(value: Any) -> str:
    text = "not there" if value is None else json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _header(body: bytes) -> bytes:
    return f"{HEADER} {FORMAT} {hashlib.sha256(body).hexdigest()}\n".encode()
