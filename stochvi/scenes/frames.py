"""Columns of numbers that Python has in the place of a file: arrays, series and frames.

Arrays of numpy, frames of pandas and xarray, and dictionaries of columns become the same table that
a text file becomes. All that is checked of a file is therefore checked of them. They are told by
what they offer, so that no package is imported.
"""

from __future__ import annotations

import hashlib
import math
import numbers
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any
from weakref import WeakValueDictionary

import numpy as np
from pydantic import BeforeValidator, PlainSerializer
from pydantic.json_schema import SkipJsonSchema

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.results.errors import SceneError
from stochvi.scenes.text_tables import Heading, PlainRows, TextTable, unit_in

KNOWN: WeakValueDictionary[int, Frame] = WeakValueDictionary()
"""The frames of the scenes of this process, whose digests stand in documents for them. Equal frames
stand here each, as one of them may be given up before the other."""


class Frame:
    """Columns of numbers, and what is written above each of them.

    Parameters
    ----------
    columns
        The numbers, (rows, columns); NaN where one is missing.
    names
        A name for each column, with its unit where it has one: "acc (g)"; empty for none.
    indexed
        Whether the first column is the index of a series or a frame.
    """

    def __init__(self, columns: Matrix, names: Sequence[str], indexed: bool = False) -> None:
        self.columns, self.names, self.indexed = columns, tuple(names), indexed
        digest = hashlib.sha256(repr((self.names, columns.shape)).encode())
        digest.update(np.ravel(columns).astype("<f8", copy=False).data)
        self.digest = f"sha256:{digest.hexdigest()}"
        KNOWN[id(self)] = self

    @classmethod
    def of(cls, values: Any) -> Frame:
        """The columns of whatever holds numbers.

        Parameters
        ----------
        values
            An array, a list, a Series, a frame of pandas or xarray, or a dictionary of columns; or
            the digest of a frame that a scene of this process holds.

        Raises
        ------
        SceneError
            If it does not hold real numbers in rows and columns.

        Examples
        --------
        >>> frame = Frame.of({"time (s)": [0.0, 0.5], "acc (g)": [1.0, -1.0]})
        >>> frame.names, frame.columns.tolist()
        (('time (s)', 'acc (g)'), [[0.0, 1.0], [0.5, -1.0]])
        """
        if isinstance(values, Frame):
            return values
        if isinstance(values, str):
            held = next((each for each in list(KNOWN.values()) if each.digest == values), None)
            if held is None:
                raise SceneError(
                    f"must be numbers, got {values[:19]!r}, the digest of numbers that only the "
                    "process had which made the scene; give them again, or write them to a file"
                )
            return held
        named, index = _columns(values)
        parts = [part for part in (index, *named) if part is not None]
        numbers = [_numbers(part, name) for name, part in parts]
        if len(lengths := {len(each) for each in numbers}) != 1:
            raise SceneError(f"must hold columns of one length, got lengths {sorted(lengths)}")
        columns = np.column_stack(numbers)
        if len(columns) < 2:
            raise SceneError(f"must hold at least two rows, got {len(columns)}")
        return cls(columns, [_heading(name, part) for name, part in parts], index is not None)

    suffix = ""
    """No ending of a name tells a format."""

    @property
    def name(self) -> str:
        """What answers call it: the name of its only column of values."""
        values = self.names[self.indexed :]
        return (values[0] if len(values) == 1 else "") or "values"

    def __str__(self) -> str:
        return ARRAY

    def __repr__(self) -> str:
        return f"<{len(self.columns)} rows, {self.digest[:19]}>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Frame) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    def __reduce__(self) -> Any:
        return Frame, (self.columns, self.names, self.indexed)

    def table(self, needed: Sequence[str]) -> TextTable:
        """The table that a file of these columns would be, for readers that need some columns."""
        columns, names = self.columns, self.names
        if columns.shape[1] < len(needed):
            remedy = f"give a Series with the {needed[0]} as its index, or two columns"
            if needed[0] == "time":
                remedy = f"give fs, the sampling rate in Hz, or {remedy.removeprefix('give ')}"
            raise SceneError(f"must hold {' and '.join(needed)}, got one column; {remedy}")
        first = ";".join(f"{value!r}" for value in columns[0].tolist())
        table = _table(names, PlainRows((1, first), len(columns)), ";", columns)
        return replace(table, indexed=self.indexed)


def table_with_words(values: Any) -> TextTable:
    """The table of a frame that holds words beside numbers. An index without a name is a column
    called name.

    >>> table_with_words({"name": ["lid", "seat"], "upper (mm)": [2.0, float("nan")]}).lines
    [(1, 'lid\\t2.0'), (2, 'seat\\t')]
    """
    named, index = _columns(values)
    parts: list[Column] = [] if index is None else [(index[0] or "name", index[1])]
    columns = {_heading(name, part): _cells(part) for name, part in [*parts, *named]}
    if len({len(cells) for cells in columns.values()}) != 1:
        raise SceneError("must hold columns of one length")
    rows = ("\t".join(cells) for cells in zip(*columns.values(), strict=True))
    return _table(columns, [*enumerate(rows, start=1)], "\t")


def _table(names: Iterable[str], lines: Any, delimiter: str, values: Any = None) -> TextTable:
    headings = [Heading(cells=(name,) if name else (), unit=unit_in(name)) for name in names]
    return TextTable(
        path=Path(ARRAY), lines=lines, above=[], remarks=[], delimiter=delimiter,
        decimal_comma=False, numeric=range(len(headings)), values=values, headings=headings,
    )  # fmt: skip


def _cells(part: Any) -> list[str]:
    """A column as a file has it."""
    return [_cell(value) for value in (part.values if hasattr(part, "values") else part)]


def _cell(value: Any) -> str:
    """A number or a text; nothing for what is missing."""
    if isinstance(value, numbers.Real):
        return repr(float(value)) if math.isfinite(value) else ""
    return " ".join(str(value).split()) if isinstance(value, str) else ""


ARRAY = "array"
"""What messages call a frame, where they would name a file."""


Column = tuple[str, Any]
"""The name of a column, or "", and its numbers."""


def _columns(values: Any) -> tuple[list[Column], Column | None]:
    """The columns of anything, and its index where it has one that does not count rows."""
    if hasattr(values, "coords"):  # of xarray
        if len(values.dims) != 1:
            raise SceneError(
                f"must have one dimension, got {list(values.dims)}; choose by isel or sel"
            )
        (along,) = values.dims
        index = (str(along), values.coords[along]) if along in values.coords else None
        several = hasattr(values, "data_vars")
        inner = values.data_vars if several else {values.name or "": values}
        return [(str(name), inner[name]) for name in inner], index
    rows: Any = getattr(values, "index", None)
    index = None
    if hasattr(rows, "name") and (rows.name is not None or getattr(rows, "step", None) != 1):
        index = str(rows.name or ""), rows
    if isinstance(values, Mapping) or hasattr(values, "columns"):
        names = list(getattr(values, "columns", values))
        return [(_label(name), values[name]) for name in names], index
    if hasattr(values, "to_numpy"):
        return [(str(values.name or ""), values)], index
    if getattr(getattr(values, "dtype", None), "names", None):
        return [(name, values[name]) for name in values.dtype.names], None
    if _is_quantity(values):
        return [("", values)], None
    array = np.ma.asanyarray(values)
    if array.ndim != 2:
        return [("", array)], None
    wide = array if array.shape[0] >= array.shape[1] else array.T
    return [("", column) for column in wide.T], None


def _label(name: Any) -> str:
    """The name of a column, or those of all its levels."""
    return " ".join(map(str, name)) if isinstance(name, tuple) else str(name)


def _numbers(part: Any, name: str) -> Vector:
    """A column as numbers, times as seconds after the first; NaN where one is missing."""
    if getattr(part, "tz", None) is not None:
        part = part.tz_convert(None)
    part = part.magnitude if _is_quantity(part) else part
    given = part.to_numpy() if hasattr(part, "to_numpy") else np.ma.asanyarray(part)
    if given.dtype.kind in "mM":
        return np.asarray((given - given[0]) / np.timedelta64(1, "s"), float)
    if given.dtype.kind in "bcSU" or given.ndim != 1:
        got = f"{given.ndim} dimensions" if given.ndim != 1 else f"{given.dtype} numbers"
        raise SceneError(f"must hold columns of real numbers, got {got} {name}".rstrip())
    try:
        if given.dtype.kind == "O":  # numbers of pandas that may be missing
            given = part.to_numpy(dtype=float, na_value=np.nan)
        found: Vector = np.ma.asanyarray(given).astype(float).filled(np.nan)
    except (AttributeError, TypeError, ValueError):
        raise SceneError(f"must hold columns of real numbers, got others {name}".rstrip()) from None
    found[~np.isfinite(found)] = np.nan
    return found


def _heading(name: str, part: Any) -> str:
    """What stands above a column: its name, with the unit that its attributes state."""
    if getattr(getattr(part, "dtype", None), "kind", "") in ("m", "M"):
        return "time (s)"
    stated = getattr(part, "attrs", {})
    unit = stated.get("units") or stated.get("unit") or _unit_of_quantity(part)
    if not isinstance(unit, str):
        return name
    named, known = unit_in(name), unit_in(f"({unit})")
    if named is None:
        return f"{name} ({unit})".lstrip()
    if known is None or not known.same(named):
        raise SceneError(
            f"has {named.name!r} in the name {name!r}, but {unit!r} in its attributes; take out "
            "the one that is wrong"
        )
    return name


def _unit_of_quantity(part: Any) -> str | None:
    """The unit of a column that is a quantity of pint, itself or within an array of xarray."""
    held: Any = part if _is_quantity(part) else getattr(part, "data", None)
    return f"{held.units:~}" if _is_quantity(held) else None


def _is_quantity(values: Any) -> bool:
    """Whether this is a quantity of pint, and no array with a coordinate of such a name."""
    return hasattr(values, "magnitude") and hasattr(values, "units") and not hasattr(values, "dims")


Values = Annotated[
    SkipJsonSchema[Any], BeforeValidator(Frame.of), PlainSerializer(lambda frame: frame.digest)
]
"""Numbers in the place of a file, which the document of a scene knows by their digest."""


def source_of(keys: Any) -> tuple[str, Path | Frame] | None:
    """The key by which a part gets its numbers from elsewhere, "file" or "values", and where they
    are; None for a part with numbers of its own."""
    if not isinstance(keys, dict):
        return None
    if isinstance(keys.get("file"), str):
        if keys.get("values") is not None:
            raise ValueError("takes file or values, got both")
        return "file", Path(keys["file"])
    if keys.get("values") is None:
        return None
    try:
        return "values", Frame.of(keys["values"])
    except SceneError as error:
        raise SceneError([("values", text) for _, text in error.problems]) from None
