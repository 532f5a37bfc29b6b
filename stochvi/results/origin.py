"""The origin of an answer and of a report: when, by which call or command, and from which scene and
files it was made."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from functools import cache
from importlib.metadata import distribution
from pathlib import Path
from typing import Any


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
        listing=json.dumps(scene, indent=2, ensure_ascii=False),
        files=digests(map(Path, named)),
    )


MOST_LISTED = 20
"""Largest number of entries of an argument that the record of a call repeats."""

SECONDS_OF_GIT = 2.0
"""Seconds within which git must name the commit of a checkout."""

UNRECORDED = ("scene", "progress")
"""Arguments that the record of a call leaves out: the scene stands beside it."""


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
