"""Impact pairs from a table: a row for each of many gaps."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stochvi.mathematics.units import shown
from stochvi.results.errors import SceneError
from stochvi.scenes.frames import ARRAY, table_with_words
from stochvi.scenes.readers import table_of
from stochvi.scenes.text_tables import Heading, TextTable, split_cells

WORDS, LENGTHS = ("name", "on", "between"), ("lower", "upper", "tolerance")
"""Columns of text, and columns of lengths with their unit."""

LARGEST = 10_000_000
"""Largest size of such a table, bytes."""

TWO_NAMES = re.compile(r"(\S+)(?:\s*[;,|/]\s*|\s+)(\S+)")
"""Pattern of the names of two points in a cell."""


def read_pairs(source: Any) -> list[dict[str, Any]]:
    """The keys of an impact pair for each row of a table: of the file of that name, or of a frame
    or a dictionary of columns.

    Raises `SceneError` with the line, or the column, that is not understood.
    """
    if isinstance(source, str):
        path = Path(source)
        table = table_of(path, ("upper",), LARGEST)
    elif isinstance(source, Mapping) or hasattr(source, "columns") or hasattr(source, "data_vars"):
        path = Path(ARRAY)
        table = table_with_words(source)
    else:
        sentence = "must be the name of a table, a frame, or { file = ..., law = ... }"
        raise SceneError("pairs", f"{sentence}, got {shown(source)}")
    places = {_name_of(table, heading): n for n, heading in enumerate(table.headings)}
    if len(places) < len(table.headings) or not {"lower", "upper"} & places.keys():
        raise SceneError(f"{path} needs lower or upper, and each column once, {_got(table)}")
    metres = {
        name: table.columns(places[name])[0] * _factor(table, name, places[name])
        for name in LENGTHS
        if name in places
    }
    found = []
    for row, (line, text) in enumerate(table.lines):
        cells = split_cells(text, table.delimiter)
        keys: dict[str, Any] = {name: cells[places[name]] for name in WORDS if name in places}
        keys |= {name: float(each[row]) for name, each in metres.items() if np.isfinite(each[row])}
        keys = {name: each for name, each in keys.items() if each != ""}
        if "between" in keys:
            two = TWO_NAMES.fullmatch(keys["between"])
            if two is None:
                raise SceneError(
                    f"{path}, line {line}: between must hold two names, as 'tip seat', got "
                    f"{keys['between'][:40]!r}"
                )
            keys["between"] = two.groups()
        found.append({"name": f"{path.stem} {'line' if path.suffix else 'row'} {line}"} | keys)
    return found


def _name_of(table: TextTable, heading: Heading) -> str:
    """The key that a column holds."""
    plain = heading.name.casefold()
    for name in (*WORDS, *LENGTHS):
        with_unit = heading.unit is not None and re.match(rf"{name}(?:_| in )", plain)
        if heading.called(name) or with_unit:
            return name
    raise SceneError(
        f"{table.path} has a column {heading.name!r}, expected {', '.join((*WORDS, *LENGTHS))}; "
        "take it out"
    )


def _factor(table: TextTable, name: str, place: int) -> float:
    """Metres in the unit that the heading of a column of lengths states."""
    unit = table.headings[place].unit
    if unit is None or unit.quantity != "length":
        raise SceneError(
            f"{table.path} needs the unit of a length in the heading of {name}, as '{name} (mm)', "
            f"got {' '.join(table.headings[place].cells)!r}"
        )
    return unit.factor


def _got(table: TextTable) -> str:
    return f"got {', '.join(each.name for each in table.headings)}"
