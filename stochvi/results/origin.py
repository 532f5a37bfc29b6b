"""Where a report comes from: when, by which command, from which scene and files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any


@dataclass(frozen=True, kw_only=True)
class InputFile:
    """A file that an answer rests on: its name, and the SHA-256 digest of its bytes."""

    name: str
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Origin:
    """What a report states of its making, so that it can be made again and checked.

    Parameters
    ----------
    time
        Date and time with the offset from UTC (ISO 8601).
    version, libraries, seed
        Of stochvi and of the libraries that decide the digits, and of the random numbers.
    command
        The command line; empty where a Python program asked.
    listing
        The scene as it was given (TOML), or its document (JSON) where it was made in Python.
    files
        The scene file, and every table and record that it names.
    question
        Digest of command, scene file and question: a report of the same may be renewed.
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


def now() -> str:
    """Date and time here, to the second.

    >>> now()[4], now()[10]
    ('-', ' ')
    """
    return datetime.now().astimezone().isoformat(sep=" ", timespec="seconds")


def digests(files: Iterable[Path]) -> tuple[InputFile, ...]:
    """Each of the files that are there with its SHA-256 digest, each once."""
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
