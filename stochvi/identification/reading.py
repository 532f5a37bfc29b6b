"""A test of a stop from the file that a user has of it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, TypedDict, Unpack

import numpy as np

from stochvi.identification.measurements import (
    DropRecord,
    ForceCurve,
    Measurement,
    Rebounds,
    check_mass,
)
from stochvi.mathematics.arguments import checked
from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.units import STANDARD_GRAVITY, listed_units
from stochvi.mathematics.units import unit as unit_called
from stochvi.results.errors import SceneError
from stochvi.scenes.records import CUT_OFF, cut_off, read_record
from stochvi.scenes.si_columns import si_columns
from stochvi.scenes.text_tables import all_columns, read_text_table

Kind = Literal["speeds", "times", "force", "drop"]

LAYOUTS: Mapping[str, tuple[Mapping[str, str], ...]] = {
    "speeds": ({"approach": "speed", "rebound": "speed"},),
    "times": ({"time": "time"},),
    "force": (
        {"deflection": "length", "force": "force"},
        {"time": "time", "deflection": "length", "force": "force"},
    ),
}
"""Quantities of the columns of each kind of file, by the names of the columns."""

EXAMPLES = {"speeds": "'m/s,m/s'", "times": "'s'", "force": "'mm,N', or 's,mm,N' with times"}
"""Examples of units, for messages."""


class RecordKeys(TypedDict, total=False):
    """Arguments of `stochvi.scenes.read_record` for a file."""

    fs: float | None
    column: int | str | None


@checked
def read_test(
    path: str | Path,
    kind: Kind,
    *,
    unit: str | None = None,
    mass: float | None = None,
    height: float | None = None,
    timing_error: float = 0.0,
    pendulum: bool = False,
    **record: Unpack[RecordKeys],
) -> Measurement:
    """A test of a stop from its file.

    Parameters
    ----------
    path
        A table of text; for a drop any file that records are read from.
    kind
        "speeds": columns of the speeds of approach and rebound. "times": times of successive
        impacts. "force": deflection and force, with the times in front where the speed matters.
        "drop": times and accelerations of one impact.
    unit
        Units of the columns, as "mm,N", where no headings state them.
    mass
        Mass that met the stop, kg; needed for a drop.
    height
        Height of the drop, m, for "times" and "drop".
    timing_error
        Standard deviation of a time of an impact, s.
    pendulum
        Whether gravity does not press the mass onto the stop.
    **record
        Sampling rate `fs` (1/s) and `column` of a record, as for `stochvi.scenes.read_record`.

    Returns
    -------
    Measurement
        `Rebounds`, a `ForceCurve` or a `DropRecord`.

    Raises
    ------
    SceneError
        If the file does not hold such a test.

    See Also
    --------
    stochvi.identify : The law of the stop.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "pad.csv"
    >>> _ = file.write_text("deflection (mm),force (N)\\n1,100\\n2,210\\n3,300\\n")
    >>> read_test(file, "force").observed.tolist()
    [100.0, 210.0, 300.0]
    """
    path = Path(path)
    check_mass(mass)
    if kind == "drop":
        return _drop(path, unit, mass, height, pendulum, record)
    if kind not in LAYOUTS:
        raise ValueError(f"kind must be 'speeds', 'times', 'force' or 'drop', got {kind!r}")
    found = _columns(path, kind, unit)
    match kind:
        case "speeds":
            return Rebounds(**found)
        case "times":
            return Rebounds.of_times(found["time"], height=height, timing_error=timing_error)
    times = found.pop("time", None)
    speed = None if times is None else _speed(path, times, found["deflection"])
    return ForceCurve(**found, speed=speed, mass=mass)


def _columns(path: Path, kind: str, given: str | None) -> dict[str, Vector]:
    """The columns of a table by their names, SI units."""
    layouts = LAYOUTS[kind]
    table = read_text_table(path, tuple(layouts[0]))
    layout = next((each for each in layouts if len(each) == len(table.headings)), layouts[0])
    columns = all_columns(table, tuple(layout))
    units = None if given is None else [each.strip() for each in given.split(",")]
    if units is not None and len(units) != len(layout):
        raise SceneError(
            [("unit", f"must name {len(layout)} units, as {EXAMPLES[kind]}, got {given!r}")]
        )
    converted = si_columns(table, columns, tuple(layout.values()), units, EXAMPLES[kind])
    return dict(zip(layout, converted, strict=True))


def _speed(path: Path, times: Vector, deflection: Vector) -> Vector:
    """The rate of the deflection, by differences of neighbours."""
    if len(times) < 3 or np.any(np.diff(times) <= 0.0):
        raise SceneError(f"{path} must have at least three rising times in its first column")
    return np.gradient(deflection, times)


def _drop(
    path: Path, given: str | None, mass: float | None, height: float | None, pendulum: bool,
    keys: RecordKeys,
) -> DropRecord:  # fmt: skip
    if mass is None:
        raise ValueError("mass must be given for a drop (kg), got none")
    record, columns = read_record(path, **keys)
    if cut_off(record.values):
        warnings.warn(f"record {path.name}: {CUT_OFF}", stacklevel=4)
    known = columns.unit
    if given is not None:
        named = unit_called(given)
        if known is not None and not known.same(named):
            raise SceneError(
                [("unit", f"is {given!r}, but {columns.stated_in} states {known.name!r}; take out "
                  "the one that is wrong")]
            )  # fmt: skip
        known = named
    if known is None or known.quantity != "acceleration":
        got = "none" if known is None else repr(known.name)
        raise SceneError(
            [("unit", f"must be one of acceleration ({listed_units('acceleration')}), got {got}")]
        )
    return DropRecord(
        acceleration=known.to_si(record.values), fs=record.fs, mass=mass, height=height,
        gravity=0.0 if pendulum else STANDARD_GRAVITY,
    )  # fmt: skip
