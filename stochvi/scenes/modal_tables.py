"""Natural modes from files: tables of text, mode shapes of measurements and of finite elements.

Reading gives the keys of a structure of kind "modes".
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stochvi.results.errors import SceneError
from stochvi.scenes.foreign_files import Foreign, read_foreign
from stochvi.scenes.readers import UFF_SUFFIXES
from stochvi.scenes.text_tables import read_text_table

OWN_COLUMNS = ("frequency_hz", "zeta", "Q", "modal_mass", "participation")
"""Columns of a table of modes that are no points."""

SHAPES = {
    **dict.fromkeys(UFF_SUFFIXES, ("UFF modes", "datasets 55 of normal modes")),
    ".op2": ("Nastran modes", "mode shapes (DISPLACEMENT(PLOT) = ALL, PARAM,POST,-1)"),
    **dict.fromkeys(
        (".exo", ".e", ".ex2", ".g"), ("Exodus modes", "nodal variables disp*x, *y, *z")
    ),
}
"""Ending of a file of mode shapes -> its kind, and what it must hold."""

DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
"""Directions of the motion of a node in a file of mode shapes, in their order."""

RIGID_MOTION = 1e-6
"""Frequency of a mode, by that of the highest mode of its file, below which it is rounding for 0:
no spring holds this motion. Finite elements leave 1e-7 or so."""

NODE = re.compile(r"(\d+)\.(-?)(r?[xyz])")
"""How a node and a direction are written."""

NAMES_LISTED = 8
"""Number of nodes or columns that a sentence lists."""


def read_modes(file: str, points: Mapping[str, str] | None) -> dict[str, Any]:
    """Keys of a structure of kind "modes" from a file, which the ending of its name tells apart.

    Parameters
    ----------
    file
        Name of the file: mode shapes of UFF (.uff, .unv, .ufb, .uf), Nastran (.op2) or Exodus
        (.exo, .e), or a table of text.
    points
        Column of each point, by its name, or node and direction of mode shapes. Without points,
        every further column of a table is one.

    Raises
    ------
    SceneError
        If the file does not hold what is needed.
    """
    path = Path(file)
    kind, content = SHAPES.get(path.suffix.lower(), ("", ""))
    found = _from_shapes(path, points, kind, content) if kind else _from_text(path, points)
    return {"source": path.name} | found


def _from_text(path: Path, points: Mapping[str, str] | None) -> dict[str, Any]:
    table = read_text_table(path, ("frequency_hz", "zeta"))
    names = [heading.name for heading in table.headings]
    columns = dict(zip(names, table.columns(*range(len(names))), strict=True))
    if "frequency_hz" not in columns:
        raise SceneError(
            f"{path} needs a heading with the columns frequency_hz, zeta and the points, got "
            f"{', '.join(names[:NAMES_LISTED]) or 'none'}"
        )
    for name, values in columns.items():
        if np.isnan(values).any():
            line = table.lines[int(np.argmax(np.isnan(values)))][0]
            raise SceneError(f"{path}, line {line}: has no number in the column {name}")
    wanted = points or {name: name for name in names if name not in OWN_COLUMNS}
    for name, column in wanted.items():
        if column not in columns:
            raise SceneError(
                f"{path} has no column {column!r} for the point {name!r}: it has "
                f"{', '.join(names[:NAMES_LISTED])}"
            )
    own = {name: columns[name].tolist() for name in OWN_COLUMNS if name in columns}
    return own | {"shapes": {name: columns[column].tolist() for name, column in wanted.items()}}


def _from_shapes(
    path: Path, points: Mapping[str, str] | None, kind: str, content: str
) -> dict[str, Any]:
    modes = read_foreign(path, kind)
    if not modes:
        raise SceneError(f"{path} needs {content}, got none; export the mode shapes")
    turned = [each.name for each in modes if each.facts["complex"]]
    if turned:
        raise SceneError(
            f"{path} must hold real normal modes, got complex ones, the modes "
            f"{', '.join(turned[:NAMES_LISTED])}; export normal modes"
        )
    cases = len({each.facts.get("case") for each in modes})
    if cases > 1:
        raise SceneError(f"{path} must hold the modes of one subcase, got {cases}; export one")
    nodes = [] if modes[0].x is None else modes[0].x.astype(int).tolist()
    if not points:
        raise SceneError(
            'needs points beside file, as points = { tip = "12.z" } with node and direction; '
            f"{path} has the nodes {', '.join(map(str, nodes[:NAMES_LISTED]))}"
            f"{' and more' if len(nodes) > NAMES_LISTED else ''}"
        )
    frequency = np.array([each.facts["frequency_hz"] for each in modes])
    frequency = np.where(frequency < RIGID_MOTION * frequency.max(), 0.0, frequency)
    free = int(np.sum(frequency == 0.0))
    if free > len(DIRECTIONS):
        raise SceneError(
            f"{path} must hold natural modes, got {free} shapes of 0 Hz, of which at most "
            f"{len(DIRECTIONS)} can be free motions: the others are static ones, as of a "
            "Craig-Bampton reduction; export the natural modes alone, or the matrices (kind = "
            '"matrices")'
        )
    found: dict[str, Any] = {
        "frequency_hz": frequency.tolist(),
        "shapes": {
            name: [_motion(path, each, place) for each in modes] for name, place in points.items()
        },
    }
    masses = [each.facts["modal_mass"] for each in modes]
    if all(masses):
        found["modal_mass"] = masses
    ratios = [each.facts["zeta"] for each in modes]
    if any(ratios):
        found["zeta"] = ratios
    return found


def _motion(path: Path, mode: Foreign, place: str) -> float:
    """Motion of a node along a direction in a mode."""
    read = NODE.fullmatch(place.replace(" ", ""))
    if read is None:
        raise SceneError(
            f"points must be nodes with a direction, as '12.z' or '12.-z', got {place!r}"
        )
    node, sign, direction = int(read[1]), -1.0 if read[2] else 1.0, DIRECTIONS.index(read[3])
    nodes = np.empty(0) if mode.x is None else mode.x
    (row,) = np.nonzero(nodes == node)
    if len(row) != 1 or direction >= mode.y.shape[1]:
        listed = ", ".join(f"{each:.0f}" for each in nodes[:NAMES_LISTED])
        raise SceneError(
            f"{path} has no motion {place!r} in mode {mode.name}: it has the nodes {listed}"
            f"{' and more' if len(nodes) > NAMES_LISTED else ''}, along "
            f"{', '.join(DIRECTIONS[: mode.y.shape[1]])}"
        )
    return sign * float(mode.y[row[0], direction])
