"""Checkpoints: the state of a run on disk, written atomically and bound to one scene.

A checkpoint is one line, "stochvi checkpoint 2" and the SHA-256 of the rest of the file, followed
by a JSON document with the scene, the arguments, the versions, the processor and the state. Floats
are written with all their digits, so that a resumed run gives the same bits as one that was never
stopped.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge
from pydantic import ConfigDict, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from stochvi.mathematics.units import plain_number
from stochvi.methods.monte_carlo.blocks import BlockStatistics, machine
from stochvi.methods.monte_carlo.path_statistics import Layout, PathStatistics, StepPairs
from stochvi.methods.monte_carlo.plan import Plan
from stochvi.results.atomic_files import write_whole
from stochvi.results.errors import CheckpointError
from stochvi.results.intervals import PathMoments
from stochvi.scenes.scene import Scene

HEADER, FORMAT = "stochvi checkpoint", 2
"""First words of a checkpoint file, and the number of its format, which follows them."""

LONG_SECONDS = 10.0
"""Seconds of simulation above which a checkpoint is renamed and not overwritten when a new run is
given the same file."""


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


class AskedDocument(TypedDict):
    """`Asked` as plain types."""

    __pydantic_config__ = STRICT  # type: ignore[misc]
    rel_error: float | None
    paths: int | None
    duration: float | None
    seed: int | None
    speed_threshold: float | None
    slow_impacts: bool


class Document(TypedDict):
    """What the body of a checkpoint holds."""

    __pydantic_config__ = STRICT  # type: ignore[misc]
    scene: dict[str, Any]
    asked: AskedDocument
    machine: str
    proof: str
    state: StateDocument


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
        fine, pairs = block
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
    """A scene and arguments, with the state of the run.

    `proof` is a digest of the averages of two short paths: it changes with the tables that a scene
    names and with the arithmetic of the machine.
    """

    path: Path
    scene: Mapping[str, Any]
    asked: Asked
    machine: str
    proof: str = ""
    state: Mapping[str, Any]

    def write(self) -> None:
        """Write the file as a whole or not at all; it is on the disk on return."""
        document = {
            "scene": self.scene,
            "asked": asdict(self.asked),
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
            found: Any = TypeAdapter(Document).validate_python(json.loads(body))
        except ValidationError as error:
            first = error.errors()[0]
            raise _incomplete(path, ".".join(map(str, first["loc"]))) from error
        except (ValueError, RecursionError) as error:
            raise _incomplete(path) from error
        asked = Asked(**found["asked"])
        if asked.paths is None and asked.rel_error is None:
            raise _incomplete(path, "asked")
        return cls(path=path, **(found | {"asked": asked}))

    def asked_again(self, given: Asked) -> Asked:
        """The arguments of the earlier run; CheckpointError if some of `given` differ from them."""
        for name, value in asdict(given.plain()).items():
            before = getattr(self.asked, name)
            if value is not None and value is not False and value != before:
                had = f"{self._instead_of(name)}, not with {name} {value}"
                if before is not None:
                    had = f"{name} {before}, not {value}"
                raise CheckpointError(
                    f"{self.path} is of a run with {had}; leave {name} out "
                    "to go on with it, or start again without the checkpoint"
                )
        return self.asked

    def _instead_of(self, name: str) -> str:
        """Words for the arguments of the earlier run where it had no value for `name`."""
        if name == "rel_error":
            return f"{self.asked.paths} paths"
        return f"rel_error {self.asked.rel_error}" if name == "paths" else f"no {name}"

    def check(self, scene: Scene, proof: str = "") -> None:
        """CheckpointError if it belongs to another scene, to other versions or to another
        processor."""
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
        """The state from which a run goes on; CheckpointError if it is incomplete."""
        try:
            return State.from_document(self.state, plan.layout)
        except ValueError as error:
            raise _incomplete(self.path, str(error)) from error


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
        self, path: Path, scene: Scene, asked: Asked, state: State, proof: str, interval: float,
        new: bool = True,
    ) -> None:  # fmt: skip
        self.path, self.asked, self.proof, self.interval = path.resolve(), asked, proof, interval
        self.scene, self.machine = plain_scene(scene), machine()
        try:
            _check_place(self.path)
            if new:
                _keep_damaged(self.path)
                _set_aside(self.path)
            self.keep(state)
        except OSError as error:
            raise CheckpointError(
                f"{self.path} cannot be written: {error.strerror or error}; name another file for "
                "the checkpoint"
            ) from error

    def due(self) -> bool:
        """Whether the interval since the last checkpoint is over."""
        return time.perf_counter() - self.written >= self.interval

    def keep(self, state: State) -> None:
        """Write the checkpoint. After a failure the next attempt follows when the interval is
        over."""
        self.written = time.perf_counter()
        Checkpoint(
            path=self.path,
            scene=self.scene,
            asked=self.asked,
            machine=self.machine,
            proof=self.proof,
            state=state.document(),
        ).write()
        self.written = time.perf_counter()


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
        return float(state["seconds"]) if state["fine"]["count"] else 0.0
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
