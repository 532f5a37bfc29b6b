"""Natural modes from files: text with a row for each mode, and universal files (dataset 55)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stochvi.results.errors import SceneError
from stochvi.scenes.foreign_files import Foreign, read_foreign
from stochvi.scenes.readers import UFF_SUFFIXES
from stochvi.scenes.text_tables import read_text_table

COLUMNS = ("frequency_hz", "zeta", "modal_mass", "participation")
"""Columns of a text file with modes that are no points; all but the first may be left out."""

DIRECTIONS = ("x", "y", "z")
"""Directions of the displacements at a node of a universal file."""

LISTED = 12
"""Largest number of nodes that a sentence lists."""


def read_modes(path: Path, points: Mapping[str, str] | None) -> dict[str, Any]:
    """The keys of `GivenModes` from a file.

    Parameters
    ----------
    path
        A text file with the columns `frequency_hz` and those of points, or a universal file.
    points
        What of the file is taken for each named point: of a text file the name of a column, by
        default all columns of points under their own names; of a universal file a node and a
        direction, as "12 z".

    Raises
    ------
    SceneError
        If the file does not hold the modes, or a point is not in it.
    """
    if path.suffix.lower() in UFF_SUFFIXES:
        return _from_universal_file(path, points)
    return _from_text(path, points)


def _from_text(path: Path, points: Mapping[str, str] | None) -> dict[str, Any]:
    table = read_text_table(path, COLUMNS[:1])
    names = [heading.name for heading in table.headings]
    columns = dict(zip(names, table.columns(*range(len(names))), strict=True))
    if COLUMNS[0] not in columns:
        raise SceneError(f"{path} must have a column frequency_hz, got {', '.join(names)}")
    for name, values in columns.items():
        if np.isnan(values).any():
            line = table.lines[int(np.argmax(np.isnan(values)))][0]
            raise SceneError(f"{path}, line {line}: the number of {name} is missing; write it")
    known = [name for name in names if name not in COLUMNS]
    wanted = points or dict(zip(known, known, strict=True))
    found = {name: columns[name].tolist() for name in COLUMNS if name in columns}
    for point, column in wanted.items():
        if column not in known:
            raise SceneError(
                [(f"shapes.{point}", f"must be a column of {path} ({', '.join(known)}), got "
                  f"{column!r}")]
            )  # fmt: skip
    return found | {"shapes": {point: columns[name].tolist() for point, name in wanted.items()}}


def _from_universal_file(path: Path, points: Mapping[str, str] | None) -> dict[str, Any]:
    modes = sorted(read_foreign(path, "UFF modes"), key=lambda mode: float(mode.facts["frequency"]))
    if not modes:
        raise SceneError(f"{path} must hold normal modes (dataset 55, analysis type 2), got none")
    if not points:
        raise SceneError(
            [("shapes", "must name points by nodes of the file, as { tip = '12 z' }, got none")]
        )
    found: dict[str, Any] = {
        "frequency_hz": [float(mode.facts["frequency"]) for mode in modes],
        "shapes": {point: _at(modes, path, point, place) for point, place in points.items()},
    }
    mass = [float(mode.facts["mass"]) for mode in modes]
    if all(each > 0.0 for each in mass):
        found["modal_mass"] = mass
    damping = [float(mode.facts["damping"]) for mode in modes]
    if any(each > 0.0 for each in damping):
        found["zeta"] = damping
    return found


def _at(modes: list[Foreign], path: Path, point: str, place: str) -> list[float]:
    """Displacements in all modes of a node in a direction, as "12 z"."""
    node, _, direction = place.strip().rpartition(" ")
    shapes = []
    for mode in modes:
        nodes = mode.y[:, 0].astype(int)
        if direction not in DIRECTIONS or not node.isdigit() or int(node) not in nodes:
            listed = ", ".join(map(str, nodes[:LISTED]))
            more = ", ..." if len(nodes) > LISTED else ""
            raise SceneError(
                [(f"shapes.{point}", f"must be a node of {path} ({listed}{more}) and x, y or z, as "
                  f"'{nodes[0]} z', got {place!r}")]
            )  # fmt: skip
        row = int(np.argmax(nodes == int(node)))
        shapes.append(float(mode.y[row, 1 + DIRECTIONS.index(direction)]))
    return shapes
