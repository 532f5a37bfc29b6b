"""Checkpoints of samples on disk. Chapters: results of blocks as JSON types, and digests; the file,
bound to one scene."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import math
import os
import re
import time
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MethodType
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    NonNegativeFloat,
    NonNegativeInt,
    PlainSerializer,
    ValidationError,
)

from stochvi.results.base import Result
from stochvi.results.errors import CheckpointError, reason_of
from stochvi.results.files import kind_of, name_of, named_files, write_whole
from stochvi.sampling.workers import machine
from stochvi.scenes.scene import Scene

# ------------------------------------------------------------------------------
# Results of blocks as types that JSON can hold, and back with every digit; digests of works.
#
# Arrays are written by their bytes, records (dataclasses and named tuples of this package) by their
# class and their fields.
# ------------------------------------------------------------------------------


def to_plain(value: Any) -> Any:
    """A value as types that JSON can hold. TypeError for what no result of a block consists of."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float) and not isinstance(value, np.generic):
        return value if math.isfinite(value) else {"float": repr(value)}
    if isinstance(value, np.ndarray | np.generic):
        array = np.asarray(value)
        if array.dtype.kind not in "biuf":
            raise TypeError(f"an array of {array.dtype} cannot be kept in a checkpoint")
        return {
            "array": base64.b64encode(array.tobytes()).decode(),
            "dtype": array.dtype.str,
            "shape": list(array.shape),
        }
    names = _fields_of(type(value))
    if names is not None:
        plain = {name: to_plain(getattr(value, name)) for name in names}
        return {"record": name_of(type(value)), "fields": plain}
    if isinstance(value, list):
        return [to_plain(each) for each in value]
    if isinstance(value, tuple):
        return {"tuple": [to_plain(each) for each in value]}
    if isinstance(value, dict):
        return {"dict": [[to_plain(key), to_plain(each)] for key, each in value.items()]}
    raise TypeError(f"a {type(value).__name__} cannot be kept in a checkpoint")


def from_plain(plain: Any) -> Any:
    """The value of a document of `to_plain`. ValueError if it is none."""
    try:
        return _from_plain(plain)
    except (AttributeError, ImportError, KeyError, TypeError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error


def _from_plain(plain: Any) -> Any:
    if isinstance(plain, list):
        return [_from_plain(each) for each in plain]
    if not isinstance(plain, dict):
        return plain
    if "float" in plain:
        return float(plain["float"])
    if "array" in plain:
        array = np.frombuffer(base64.b64decode(plain["array"]), np.dtype(plain["dtype"]))
        array = array.reshape(plain["shape"]).copy()
        return array if array.ndim else array[()]
    if "tuple" in plain:
        return tuple(_from_plain(each) for each in plain["tuple"])
    if "dict" in plain:
        return {_from_plain(key): _from_plain(each) for key, each in plain["dict"]}
    kind = kind_of(plain["record"])
    if _fields_of(kind) is None:
        raise ValueError(f"{plain['record']} is no record")
    return kind(**{key: _from_plain(each) for key, each in plain["fields"].items()})


def _fields_of(kind: Any) -> list[str] | None:
    """Names of the fields of a dataclass or a named tuple; None for other types."""
    if isinstance(kind, type) and is_dataclass(kind):
        return [field.name for field in fields(kind)]
    if isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields"):
        return list(kind._fields)
    return None


def digest_of(value: Any) -> str:
    """Digest of all that a function and its arguments consist of: the same in every process.

    What an object has calculated from its fields and kept (`cached_property`) does not enter.

    Examples
    --------
    >>> digest_of(partial(max, 1.0)) == digest_of(partial(max, 1.0))
    True
    >>> digest_of(partial(max, 1.0)) == digest_of(partial(max, 1.5))
    False
    """
    digest = hashlib.sha256()
    for piece in _pieces(value, ()):
        digest.update(len(piece).to_bytes(8, "little") + piece)
    return digest.hexdigest()


def _pieces(value: Any, within: tuple[int, ...]) -> Iterable[bytes]:
    """Bytes that determine a value; `within` are the objects that it is a part of."""
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        yield f"{type(value).__name__} {value!r}".encode()
        return
    if id(value) in within:
        yield f"object {within.index(id(value))}".encode()
        return
    within = (*within, id(value))
    kind = type(value)
    if isinstance(value, np.ndarray) and value.dtype != object:
        yield f"array {value.dtype.str} {value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
        return
    if isinstance(value, type | FunctionType | BuiltinFunctionType | np.ufunc):
        name = getattr(value, "__qualname__", "") or value.__name__
        yield f"{getattr(value, '__module__', '')} {name}".encode()
        cells = getattr(value, "__closure__", None) or ()
        parts: Iterable[Any] = [cell.cell_contents for cell in cells]
    elif isinstance(value, MethodType):
        parts = [value.__func__, value.__self__]
    elif isinstance(value, partial):
        parts = [value.func, value.args, value.keywords]
    elif hasattr(value, "py_func"):  # compiled by numba
        parts = [value.py_func]
    else:
        yield f"{kind.__module__} {kind.__qualname__}".encode()
        parts = _parts(value)
    for part in parts:
        yield from _pieces(part, within)
    yield b"end"


def _parts(value: Any) -> Iterable[Any]:
    """The values of which an object consists, in an order that is the same in every process."""
    if isinstance(value, Mapping):
        return [each for item in value.items() for each in item]
    if isinstance(value, set | frozenset):
        return sorted(value, key=repr)
    if isinstance(value, list | tuple):
        return value
    if isinstance(value, BaseModel):
        known = {name: getattr(value, name) for name in type(value).model_fields}
        return [known, value.__pydantic_private__]
    names = _fields_of(type(value))
    if names is not None:
        return [getattr(value, name) for name in names]
    reduced: Any = value.__reduce_ex__(2)  # as copying and pickling take it apart
    if isinstance(reduced, str):
        return [reduced]
    arguments, state = (*reduced, None)[1:3]
    if isinstance(state, dict):
        kind = type(value)
        cached = [each for each in state if isinstance(getattr(kind, each, None), cached_property)]
        state = {name: each for name, each in state.items() if name not in cached}
    return [arguments, state]


# ------------------------------------------------------------------------------
# Checkpoints: the samples of a run on disk, written atomically and bound to one scene.
#
# The first line of a checkpoint is "stochvi checkpoint 4" with the SHA-256 of the rest of the file.
# A JSON document follows: command, scene, arguments, versions, processor and samples. A sample is a
# function of its sampler and of the blocks in it alone. It is therefore kept under a digest of the
# sampler, and is taken when the same sampler is asked for again: a resumed run takes the way of one
# that never stopped, and finds the samples that it had. Floats are written with all their digits.
# ------------------------------------------------------------------------------


HEADER, FORMAT = "stochvi checkpoint", 11
"""First words of a checkpoint file, and the number of its format, which follows them."""

LONG_SECONDS = 10.0
"""Seconds of simulation above which a checkpoint is renamed and not overwritten when a new run is
given the same file."""

WRITING_SHARE = 0.05
"""Largest share of the time of a run that goes into writing checkpoints: large ones are written
less often than asked for."""

Answer = TypeVar("Answer", bound=Result)


class Checked(BaseModel):
    """A part of a checkpoint: no value is converted as it is read, no key left out or added."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


class Entry(Checked):
    """The sample of the first `paths` paths of a sampler, from whole blocks; the number of paths at
    which its present round ends, and the kinds of machines that made it."""

    paths: NonNegativeInt
    goal: NonNegativeInt
    machines: tuple[str, ...]
    sample: Annotated[Any, BeforeValidator(from_plain), PlainSerializer(to_plain)]

    @classmethod
    def empty(cls) -> Entry:
        """That of a sampler without paths."""
        return cls(paths=0, goal=0, machines=(), sample=None)


class Checkpoint(Checked):
    """A command, its scene and its arguments, with the samples of the run by the digests of their
    samplers, and the seconds that it took. `proof` is a digest of the files that the scene names.
    """

    path: Path = Field(default=Path(), exclude=True)
    command: str
    scene: dict[str, Any]
    asked: dict[str, Any]
    machine: str
    proof: str
    samples: dict[str, Entry]
    seconds: NonNegativeFloat

    @classmethod
    def begun(cls, path: Path, command: str, scene: Scene, asked: dict[str, Any]) -> Checkpoint:
        """The checkpoint of a run on this machine, without a sample yet."""
        return cls(
            path=path.resolve(), command=command, scene=plain_scene(scene), asked=asked,
            machine=machine(), proof=digest_of_files(scene), samples={}, seconds=0.0,
        )  # fmt: skip

    def write(self) -> None:
        """Write the file as a whole or not at all; it is on the disk on return."""
        body = self.model_dump_json().encode()
        write_whole(_header(body) + body, self.path, durable=True)

    @classmethod
    def read(cls, path: Path) -> Checkpoint:
        """Read a file; CheckpointError unless it is a checkpoint without damage."""
        if path.exists() and not _is_checkpoint(path):
            raise CheckpointError(f"{path} is not a checkpoint of stochvi")
        header, newline, body = path.read_bytes().partition(b"\n")
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
            found = cls.model_validate_json(body)
        except ValidationError as error:
            where = ".".join(map(str, error.errors()[0]["loc"]))
            raise CheckpointError(
                f"{path} does not hold what a checkpoint of this version holds"
                f"{f' ({where})' if where else ''}; start again without it"
            ) from error
        found.path = path.resolve()
        return found

    def asked_again(self, given: Mapping[str, Any], required: Sequence[str] = ()) -> dict[str, Any]:
        """The arguments of the earlier run; CheckpointError if some of those `given` now differ
        from them. Those that are `required` cannot be left out."""
        for name, value in given.items():
            before = self.asked.get(name)
            if value != before:
                old, new = _worded(before), _worded(value)
                had = f"{self._instead_of(name)}, not with {name} {new}"
                if before is not None:
                    had = f"{name} {old}, not {new}"
                remedy = f"give {name} {old}" if name in required else f"leave {name} out"
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

    def check(self, command: str, scene: Scene) -> None:
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
        if digest_of_files(scene) != self.proof:
            raise CheckpointError(
                f"{self.path} is of another scene: a file that the scene names has changed"
            )


class CheckpointWriter:
    """Gives samplers their samples, and writes the checkpoint of a run: at its start, when the
    interval since the last is over, and at the end.

    It replaces a checkpoint but no other file. The checkpoint of another run (`new`) that took
    longer than LONG_SECONDS is first renamed to FILE.earlier, and a damaged one to FILE.damaged.
    """

    def __init__(self, checkpoint: Checkpoint, interval: float, new: bool) -> None:
        self.checkpoint, self.interval, self.new = checkpoint, interval, new
        self.before, self.started = checkpoint.seconds, time.perf_counter()
        self.failure, self.ready = "", False

    def of(self, sampler: Any) -> Entry:
        """The sample of a sampler, which may be empty, to be replaced as it grows."""
        self.begin()
        return self.checkpoint.samples.setdefault(digest_of(sampler), Entry.empty())

    def begin(self) -> None:
        """Write the first checkpoint: once the arguments are checked, before any block is done.

        CheckpointError if another file is there, or this one cannot be written.
        """
        if self.ready:
            return
        path = self.checkpoint.path
        try:
            _check_place(path)
            if self.new:
                _set_aside(path)
            self._write()
        except OSError as error:
            raise CheckpointError(
                f"{path} cannot be written: {reason_of(error)}; name another file for "
                "the checkpoint"
            ) from error
        self.ready = True

    def keep_if_due(self) -> None:
        """Write the checkpoint if the interval since the last is over."""
        wait = max(self.interval, self.writing / WRITING_SHARE)
        if time.perf_counter() - self.written >= wait:
            self.keep()

    def keep(self) -> None:
        """Write the checkpoint now, if the run has begun.

        If that fails, for example on a full disk, `failure` gives the reason and the run goes on;
        the next attempt follows when the interval is over.
        """
        if not self.ready:
            return
        try:
            self._write()
            self.failure = ""
        except OSError as error:
            self.failure = (
                f"the checkpoint {self.checkpoint.path} could not be written: {reason_of(error)}; "
                "it holds what it held before"
            )

    def _write(self) -> None:
        began = self.written = time.perf_counter()
        self.writing = 0.0
        self.checkpoint.seconds = self.before + began - self.started
        self.checkpoint.write()
        self.written = time.perf_counter()
        self.writing = self.written - began

    def noted(self, answer: Answer) -> Answer:
        """The answer with the time of the earlier run in its cost, and a warning if the checkpoint
        does not hold it."""
        if not isinstance(answer, Result):
            return answer
        if self.before:
            cost = answer.cost
            wall_time = cost.wall_time + self.before
            tenfold = cost.tenfold_wall_time
            if tenfold is not None and cost.wall_time:
                tenfold *= wall_time / cost.wall_time
            cost = replace(cost, wall_time=wall_time, tenfold_wall_time=tenfold)
            answer = replace(answer, cost=cost)
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
    """Rename a checkpoint that took long to FILE.earlier, unless the one there took longer.

    One that cannot be read is renamed to FILE.damaged, with a UserWarning that says so.
    """
    if not path.exists() or _is_empty(path):
        return
    earlier, damaged = (path.with_name(f"{path.name}.{word}") for word in ("earlier", "damaged"))
    known = LONG_SECONDS
    with contextlib.suppress(CheckpointError, FileNotFoundError):
        known = max(known, _seconds_in(earlier))
    try:
        if _seconds_in(path) > known:
            os.replace(path, earlier)
    except FileNotFoundError:  # another run has renamed it
        pass
    except CheckpointError as error:
        os.replace(path, damaged)
        reason = str(error).rpartition("; ")[0]
        warnings.warn(f"{reason}; it was renamed to {damaged.name}", stacklevel=2)


def _seconds_in(path: Path) -> float:
    """Seconds of simulation in a checkpoint; 0 if it has no paths."""
    found = Checkpoint.read(path)
    return found.seconds if any(entry.paths for entry in found.samples.values()) else 0.0


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


def digest_of_files(scene: Scene) -> str:
    """Digest of the bytes of all files that a scene names."""
    digest = hashlib.sha256()
    for name in named_files(scene.document()):
        file = Path(name)
        digest.update(file.read_bytes() if file.is_file() else b"")
    return digest.hexdigest()


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


def _worded(value: Any) -> str:
    """An argument as a message names it."""
    return str(from_plain(value) if isinstance(value, dict) and "record" in value else value)


def _short(value: Any) -> str:
    text = "not there" if value is None else json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _header(body: bytes) -> bytes:
    return f"{HEADER} {FORMAT} {hashlib.sha256(body).hexdigest()}\n".encode()
