"""Short names by which files know the classes of this package.

A saved answer and a checkpoint name the classes of their parts by room and class,
`isolators:Sizing`, so that a class may move between the files of its room. Files that older
versions wrote name modules, `stochvi.isolators.sizing.answer:Sizing`; they are read as well.
"""

from __future__ import annotations

import re
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).parents[1]

NAME = re.compile(r"(?:stochvi\.)?([a-z_]+(?:\.[a-z_]+)*):([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)")


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
    ValueError
        If there is no such class in its room, or more than one.
    """
    parts = NAME.fullmatch(name)
    if parts is None:
        raise ValueError(f"{name} is no part of this package")
    room, (outer, *inner) = _room_of(parts[1]), parts[2].split(".")
    places = _places(room).get(outer, [])
    if not places:
        raise ValueError(f"{name} is no part of this package")
    if len(places) > 1:
        raise ValueError(f"{name} names {len(places)} classes of this package")
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
