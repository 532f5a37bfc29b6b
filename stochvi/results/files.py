"""Files of answers. Chapters: writing whole or not at all; the origin of an answer; cores and CPU
time of the machine; short names of classes in files."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import re
import sys
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from stochvi.results.errors import SceneError

# ------------------------------------------------------------------------------
# Writing of files: each is written whole or not at all, even by several processes at once.
# ------------------------------------------------------------------------------


REPLACE_ATTEMPTS = 5
"""Number of attempts to replace a file, which on Windows another program may have open briefly."""

REPLACE_PAUSE = 0.02
"""Seconds between two attempts to replace a file."""


def write_whole(data: bytes, path: Path, *, durable: bool = False, follow: bool = True) -> None:
    """Write a file whole or not at all.

    With `durable`, the file is on the disk when this function returns. With `follow`, the target of
    a symbolic link is written; otherwise the file replaces the link.

    The bytes are first written to a hidden file in the same folder, which then replaces the file.
    Two processes that write the same file never mix their bytes. A process that is killed in
    between (`kill -9`) leaves the hidden file behind.

    Raises
    ------
    OSError
        It names the file that was asked for. No hidden file remains.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "Is a folder, expected a file name", str(path))
    try:
        _write_then_replace(data, Path(os.path.realpath(path)) if follow else path, durable)
    except OSError as error:  # this error names the hidden file, or no file
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def _write_then_replace(data: bytes, path: Path, durable: bool) -> None:
    part = path.with_name(f".{path.name}.{uuid.uuid4().hex[:16]}")
    try:
        with open(part, "xb") as file:  # with the permissions that the user gives new files
            file.write(data)
            file.flush()
            if durable:
                os.fsync(file.fileno())
        _replace(part, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(part)
        raise


def _replace(part: Path, path: Path) -> None:
    """Put the file `part` in place of `path`.

    Windows refuses this while any other program, such as a virus scanner, has `path` open, which
    is usually over soon; other systems never refuse it for that reason.
    """
    for _ in range(REPLACE_ATTEMPTS - 1):
        try:
            return os.replace(part, path)
        except PermissionError:
            time.sleep(REPLACE_PAUSE)
    os.replace(part, path)


# ------------------------------------------------------------------------------
# The origin of an answer and of a report: when, by which call or command, and from which scene and
# files it was made.
# ------------------------------------------------------------------------------


class SceneDocument(dict[str, Any]):
    """The plain document of a scene, which knows the scene that it was `made_from` in this process:
    functions in it have no keys. Copies, and documents of other processes, are plain dicts."""

    made_from: Any = None

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)


@dataclass(frozen=True, kw_only=True)
class InputFile:
    """A file that an answer rests on: its name, and the SHA-256 digest of its bytes."""

    name: str
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Origin of a report: the data that make it repeatable and checkable.

    Parameters
    ----------
    time
        Date and time with the offset from UTC (ISO 8601).
    version, libraries, seed
        Version of stochvi, versions of the libraries on which the digits depend, and seed of the
        random numbers.
    repeatable
        Whether these give the same digits again: the clock ended no part of the calculation.
    command
        The command line; empty if a Python program made the report.
    listing
        The scene file as it was given (TOML), or the document of a scene made in Python (JSON).
    files
        The scene file, and every table and record that it names.
    question
        Digest of the command, its scene file and its options: a report may replace an older one
        with the same digest.
    """

    time: str
    version: str
    libraries: Mapping[str, str] = field(default_factory=dict)
    seed: int | None = None
    repeatable: bool = True
    command: str = ""
    listing: str = ""
    files: tuple[InputFile, ...] = ()
    question: str = ""


def origin_of(provenance: Mapping[str, Any]) -> Origin:
    """The origin of an answer that a Python program asked for."""
    scene = provenance.get("scene") or {}
    named = dict.fromkeys(name for name in named_files(scene) if Path(name).is_file())
    return Origin(
        time=now(),
        version=provenance.get("version", ""),
        libraries=provenance.get("libraries") or {},
        seed=provenance.get("seed"),
        repeatable=not provenance.get("budget_decided"),
        listing=json.dumps(scene, indent=2, ensure_ascii=False),
        files=digests(map(Path, named)),
    )


MOST_LISTED = 20
"""Largest number of entries of an argument that the record of a call repeats."""

SECONDS_OF_GIT = 2.0
"""Seconds within which git must name the commit of a checkout."""

UNRECORDED = ("scene", "progress", "rng")
"""Arguments that the record of a call leaves out: the scene stands beside it, and the seed that was
drawn."""


def call_of(function: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """The record of a call, for the provenance of its answer: function, arguments, time, commit."""
    return {
        "function": function,
        "arguments": {
            name: _recorded(value) for name, value in arguments.items() if name not in UNRECORDED
        },
        "date": now(),
        "commit": commit(),
    }


def _recorded(value: Any) -> Any:
    """An argument in plain types: a long one by its size, one that is no data by its kind."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "document"):
        return value.document()
    if isinstance(value, Mapping):
        return {str(name): _recorded(each) for name, each in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        short = len(value) <= MOST_LISTED
        return [_recorded(each) for each in value] if short else f"{len(value)} entries"
    return type(value).__name__


@cache
def commit() -> str | None:
    """The commit of the source that runs, with "-dirty" behind it where files differ from it; None
    where it is not known, as of a released wheel, whose version says it."""
    import subprocess  # here, because `stochvi --help` needs neither
    from importlib.metadata import distribution

    source = distribution("stochvi").read_text("direct_url.json")
    if source is not None and (found := json.loads(source).get("vcs_info", {}).get("commit_id")):
        return str(found)
    checkout = Path(__file__).parents[2]
    if not (checkout / ".git").exists():
        return None
    try:
        described = subprocess.run(
            ["git", "-C", str(checkout), "describe", "--always", "--dirty", "--abbrev=40",
             "--exclude=*"],
            capture_output=True, text=True, check=True, timeout=SECONDS_OF_GIT,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return None
    return described.stdout.strip() or None


def now() -> str:
    """Local date and time with the offset from UTC, to the second (ISO 8601).

    >>> now()[4], now()[10]
    ('-', ' ')
    """
    return datetime.now().astimezone().isoformat(sep=" ", timespec="seconds")


def digests(files: Iterable[Path]) -> tuple[InputFile, ...]:
    """The SHA-256 digest of each file that exists; a file that is named twice appears once."""
    found = [file for file in dict.fromkeys(files) if file.is_file()]
    return tuple(
        InputFile(name=str(file), sha256=hashlib.sha256(file.read_bytes()).hexdigest())
        for file in found
    )


def named_files(part: Any) -> Iterator[str]:
    """Values of every key `file` of a scene document.

    >>> list(named_files({"excitation": [{"kind": "psd", "file": "my.csv"}], "title": "x"}))
    ['my.csv']
    """
    for key, value in part.items() if isinstance(part, Mapping) else enumerate(part):
        if key == "file" and isinstance(value, str) and "\0" not in value:
            yield value
        elif isinstance(value, Mapping | list):
            yield from named_files(value)


# ------------------------------------------------------------------------------
# Number of cores and CPU time of the machine, on every operating system.
# ------------------------------------------------------------------------------


def usable_cores() -> int:
    """Number of processor cores that this process may use; at least 1.

    Python 3.13 knows the number. Before that, Linux knows to which cores a process is bound;
    macOS and Windows know only how many cores there are. `NUMBA_NUM_THREADS`, by which users of
    numba give a process fewer threads, lowers the number.

    >>> usable_cores() >= 1
    True
    """
    asked = os.environ.get("NUMBA_NUM_THREADS", "")
    cores = _cores()
    return min(cores, int(asked)) if asked.isdecimal() and int(asked) else cores


def _cores() -> int:
    if hasattr(os, "process_cpu_count"):
        return os.process_cpu_count() or 1
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def thread_seconds() -> float:
    """CPU seconds of the calling thread, for differences between two calls.

    On Windows it is wall time: CPU time comes in ticks of 1/64 s there, too coarse for a block of
    paths.
    """
    return time.perf_counter() if sys.platform == "win32" else time.thread_time()


# ------------------------------------------------------------------------------
# Short names by which files know the classes of this package.
#
# A saved answer and a checkpoint name the classes of their parts by room and class,
# `isolators:Sizing`, so that a class may move between the files of its room. Files that older
# versions wrote name modules, `stochvi.isolators.sizing.answer:Sizing`; they are read as well.
# ------------------------------------------------------------------------------


PACKAGE = Path(__file__).parents[1]

NAME = re.compile(r"(?:stochvi\.)?([a-z_]+(?:\.[a-z_]+)*):([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)")


RENAMED = {"MissionSizing": "Sizing"}
"""Names of classes that older files know by another one."""


def name_of(kind: type) -> str:
    """Return the short name of a class.

    Examples
    --------
    >>> from stochvi.results.estimates import Estimate
    >>> name_of(Estimate)
    'results:Estimate'
    """
    return f"{_room_of(kind.__module__.partition('.')[2])}:{kind.__qualname__}"


def kind_of(name: str) -> Any:
    """Return the class of a short name, or of the module and class that an older file names.

    Raises
    ------
    SceneError
        If there is no such class in its room, or more than one.
    """
    parts = NAME.fullmatch(name)
    if parts is None:
        raise SceneError(f"{name} is no part of this package")
    room, (outer, *inner) = _room_of(parts[1]), parts[2].split(".")
    outer = RENAMED.get(outer, outer)
    places = _places(room).get(outer, [])
    if not places:
        raise SceneError(f"{name} is no part of this package")
    if len(places) > 1:
        raise SceneError(f"{name} names {len(places)} classes of this package")
    kind: Any = getattr(import_module(places[0]), outer)
    for each in inner:
        kind = getattr(kind, each)
    return kind


def _room_of(module: str) -> str:
    """The room of a module, named without the package; each method is a room of its own."""
    parts = module.split(".")
    return ".".join(parts[: 2 if parts[0] == "methods" else 1])


@cache
def _places(room: str) -> dict[str, list[str]]:
    """The modules of a room that define a class, by the name of the class."""
    folder = PACKAGE.joinpath(*room.split("."))
    files = [folder.with_suffix(".py"), *sorted(folder.rglob("*.py"))]
    found: dict[str, list[str]] = {}
    for file in (each for each in files if each.is_file()):
        parts = file.relative_to(PACKAGE.parent).with_suffix("").parts
        module = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        for name in re.findall(r"^class (\w+)", file.read_text(encoding="utf-8"), re.MULTILINE):
            found.setdefault(name, []).append(module)
    return found
