"""Columns of numbers from files of instruments and analysers. Chapters: binary files (MATLAB, UFF,
NumPy, channels of loggers), read where damage does no harm; the one reader of all formats; units of
text columns.
"""

from __future__ import annotations

import importlib.util
import json
import math
import os
import signal
import subprocess
import sys
import warnings
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.units import DENSITIES, UNITS, Unit, listed_units, shown, unit
from stochvi.notices import InputWarning
from stochvi.results.deadline import in_command
from stochvi.results.errors import SceneError
from stochvi.scenes import foreign_reader, outside
from stochvi.scenes.foreign_reader import MOST_NUMBERS, MOST_SECONDS, READERS, REAL
from stochvi.scenes.frames import Frame
from stochvi.scenes.text_tables import (
    VALUES,
    Heading,
    TextTable,
    check_file,
    may_be_unit,
    read_text_table,
    table_of_text,
    unit_in,
)

# ------------------------------------------------------------------------------
# Arrays from binary files of other programs, read where a damaged file does no harm.
#
# Files of others are read by libraries in a process of its own with limits of memory and
# time: it takes a tenth of a second longer than to import them here. Files of numpy are read here,
# after their sizes were compared with what they claim.
# ------------------------------------------------------------------------------


LARGEST_DATA_FILE = 200_000_000
"""Largest size of a record file, bytes: an hour at 1 kHz takes about 70 million bytes as text."""

OF_EXTRAS = {
    "MATLAB 7.3": ("h5py", "files"),
    "TDMS": ("nptdms", "files"),
    "Excel": ("openpyxl", "files"),
    "MF4": ("asammdf", "mf4"),
    "IDE": ("idelib", "ide"),
    "Nastran modes": ("pyyeti", "fem"),
    "Nastran matrices": ("pyyeti", "fem"),
    "Exodus modes": ("netCDF4", "fem"),
}
"""Kind of file -> the package that reads it, and the extra by which it is installed."""

OF_HDF5 = b"MATLAB 7.3"
"""How MATLAB files begin that hold HDF5."""

LONGEST_WAIT = 10 * MOST_SECONDS
"""Longest time of a reader by the clock, s, on a machine that has other work."""


class Foreign(NamedTuple):
    """An array `y` of a file, over `x` if the file says so, and what the file says of it."""

    name: str
    x: Vector | None
    y: Vector
    facts: Mapping[str, Any]


def read_foreign(path: Path, kind: str) -> tuple[Foreign, ...]:
    """The arrays of a file of a kind of `READERS` ("MATLAB", "UFF", "IDE"), read apart, or the
    table of one whose ending a package reads.

    Raises
    ------
    SceneError
        If the file cannot be read, whatever happens to the program that reads it.
    """
    check_file(path, LARGEST_DATA_FILE)
    if kind == "MATLAB":
        with path.open("rb") as file:
            kind += " 7.3" * file.read(len(OF_HDF5)).startswith(OF_HDF5)
    package, extra = OF_EXTRAS.get(kind, ("numpy", ""))
    if importlib.util.find_spec(package) is None:
        raise SceneError(f"{path} needs the package {package}: pip install 'stochvi[{extra}]'")
    found = path.stat()
    return _read_apart(str(path), kind, (found.st_ino, found.st_size, found.st_mtime_ns))


@lru_cache(maxsize=1)
def _read_apart(path: str, kind: str, _: tuple[int, ...]) -> tuple[Foreign, ...]:
    """The arrays of a file. The same file again, as a sweep asks for it, costs nothing."""
    program = [sys.executable, "-I", foreign_reader.__file__, kind, path, json.dumps(sys.path)]
    alone = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    try:
        ended = subprocess.run(
            program, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            timeout=LONGEST_WAIT, check=False, env=os.environ | alone,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise _refusal(path, kind, f"is not read after {LONGEST_WAIT} s") from None
    head, _newline, body = ended.stdout.partition(b"\n")
    try:
        answer = json.loads(head)
    except ValueError:
        answer = {"error": "crash"}
    reason = answer.get("error")
    if reason == "short":
        raise SceneError(f"{path} ends before the numbers that it claims to hold; write it again")
    if reason == "memory":
        raise _refusal(path, kind, f"holds more than {MOST_NUMBERS:.0e} numbers, or claims to")
    if reason == "crash" and ended.returncode == -getattr(signal, "SIGXCPU", math.inf):
        raise _refusal(path, kind, f"takes more than {MOST_SECONDS} s to be read")
    if reason is not None and kind not in READERS:
        whose = outside.origin_of(outside.READERS[kind])
        why = answer.get("text", "its process ended")
        raise SceneError(f"{path} was not read by {whose}, which reads .{kind} files: {why}")
    if reason is not None:
        raise SceneError(f"{path} is not a {kind} file that can be read; write it again")
    return tuple(_arrays(answer["arrays"], body))


def _refusal(path: str, kind: str, what: str) -> SceneError:
    return SceneError(f"{path} {what}; write a {kind} file with the record alone")


def _arrays(entries: list[dict[str, Any]], body: bytes) -> Iterator[Foreign]:
    """Arrays from their facts and from the bytes of all of them."""
    place = 0
    for entry in entries:
        held: dict[str, Vector | None] = {}
        for axis in ("x", "y"):
            shape = entry.pop(axis)
            if shape is None:
                held[axis] = None
                continue
            count = math.prod(shape)
            held[axis] = np.frombuffer(body, "<f8", count, place).reshape(shape)
            place += 8 * count
        assert held["y"] is not None
        yield Foreign(entry.pop("name"), held["x"], held["y"], entry)


def read_arrays(path: Path, kind: str) -> dict[str, NDArray[Any]]:
    """The arrays of numbers by their names, of a file of a kind of `READERS` or else of NumPy. The
    real parts alone of complex ones are known of some kinds."""
    if not kind:
        return read_numpy(path)
    return {
        each.name: each.y.astype(complex) if each.facts["complex"] else each.y
        for each in read_foreign(path, kind)
    }


def read_numpy(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of numbers of a .npy or .npz file by their names; objects are never unpickled."""
    check_file(path, LARGEST_DATA_FILE)
    wrong = SceneError(f"{path} is not a NumPy file that can be read; write it again")
    try:
        if path.suffix.lower() == ".npy":
            with path.open("rb") as file:
                return dict(_numbers("data", _array(file, path.stat().st_size)))
        found: dict[str, NDArray[Any]] = {}
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if sum(each.file_size for each in members) > 8 * MOST_NUMBERS:
                raise _refusal(str(path), "NumPy", f"holds more than {MOST_NUMBERS:.0e} numbers")
            for each in members:
                with archive.open(each) as file:
                    name = each.filename.removesuffix(".npy")
                    found |= _numbers(name, _array(file, each.file_size))
        return found
    except SceneError:
        raise
    except Exception:  # numpy and zipfile raise errors of many kinds when they parse
        raise wrong from None


def _numbers(name: str, array: NDArray[Any]) -> dict[str, NDArray[Any]]:
    if array.dtype.kind not in f"{REAL}c" or array.size < 2:
        return {}
    flat = array.ravel() if max(array.shape) == array.size else array
    return {name: _plain(flat if array.dtype.kind == "c" else flat.astype(float))}


def _plain(array: NDArray[Any]) -> NDArray[Any]:
    """An array, and its real part where it has no other."""
    return array if np.any(np.imag(array)) else np.real(array)


def _array(file: Any, size: int) -> NDArray[Any]:
    """An array from its file of `size` bytes, which must hold what its header claims."""
    form = np.lib.format
    version = form.read_magic(file)
    header = {(1, 0): form.read_array_header_1_0}.get(version, form.read_array_header_2_0)(file)
    shape, fortran, dtype = header
    if dtype.hasobject or math.prod(shape) * dtype.itemsize > size:
        raise ValueError
    data = np.frombuffer(file.read(math.prod(shape) * dtype.itemsize), dtype)
    return data.reshape(shape, order="F" if fortran else "C")


# ------------------------------------------------------------------------------
# Columns of numbers from the files that instruments and analysers write: text, spreadsheets, UFF,
# MATLAB, NumPy, and channels of loggers.
# ------------------------------------------------------------------------------


UFF_SUFFIXES = (".uff", ".unv", ".ufb", ".uf")
ARRAY_SUFFIXES = (".mat", ".npy", ".npz")
CHANNEL_SUFFIXES = {".ide": "IDE", ".tdms": "TDMS", ".mf4": "MF4", ".wav": "WAV"}
EXCEL_SUFFIXES = (".xlsx", ".xlsm")
TEXT_SUFFIXES = ("", ".csv", ".txt", ".tsv", ".asc", ".dat", ".lvm")

LISTED = 20
"""Largest number of arrays, datasets or channels of a file that a sentence lists."""

SLOWEST_UNSTATED = 0.05
"""Largest interval between two times of a record at which times without a unit are taken for
seconds, s. A larger one is a rate below 20 Hz, too low for vibration: the times may be in
milliseconds, or numbers of samples."""

TIME_RESPONSE, SPECTRAL_DENSITY = 1, 9
"""Function types of UFF dataset 58 (record 6, field 1) for a record and for a spectral density."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Columns:
    """Two columns of a file, and their units.

    `x` is in Hz or s; it is None if the file holds `y` only. A missing value of `y` is NaN. `unit`
    is the unit of `y`, which the place `stated_in` of the file states, or None if the file states
    no known unit. `heading` is the text above `y`, and `unread` the part of it that looks like a
    unit but is not a known one. `lines` are the line numbers of the rows of a text file. `remarks`
    are the other texts of the file, each after its place.
    """

    x: Vector | None
    y: Vector
    unit: Unit | None = None
    stated_in: str = ""
    heading: str = ""
    unread: str = ""
    lines: Sequence[int] | None = None
    remarks: Sequence[tuple[str, str]] = ()

    def place(self, row: int) -> str:
        """The place of a row in the file, in words."""
        return f"row {row + 1}" if self.lines is None else f"line {self.lines[row]}"


def read_columns(
    path: Path | Frame,
    names: Sequence[str],
    *,
    column: int | str | None = None,
    variables: Sequence[str] | None = None,
    dataset: int | None = None,
    full_scale: float | None = None,
    function_type: int = SPECTRAL_DENSITY,
) -> Columns:
    """Two columns (or one) of a frame, or of a file, whose kind the ending of its name says.

    Parameters
    ----------
    path
        The file, or the frame that stands in its place.
    names
        Names of the two columns that are needed, or of one column if no more is needed.
    column
        For a table or a logger's recording: name of the column or channel of values, or its number
        from 1.
    variables
        For a MATLAB or NumPy file: names of the two vectors, or of one matrix of two columns.
    dataset
        For a UFF file: number of the dataset, from 1.
    full_scale
        For a sound file (.wav): its largest value, in the unit of the values.
    function_type
        Function type of the dataset 58 that is read if `dataset` is not given.

    Raises
    ------
    SceneError
        If the file does not hold what was expected, or holds several columns that could be meant.
    """
    suffix = path.suffix.lower()
    if variables is not None and suffix not in ARRAY_SUFFIXES:
        raise SceneError(
            "variables", f"is for MATLAB and NumPy files (.mat, .npz), got {path.name}"
        )
    if dataset is not None and suffix not in UFF_SUFFIXES:
        raise SceneError("dataset", f"is for UFF files (.uff, .unv), got {path.name}")
    if (full_scale is None) == (suffix == ".wav"):
        needed = (
            "must say which value" if full_scale is None else "is for sound files (.wav), whose"
        )
        raise SceneError("full_scale", f"{needed} full scale stands for, got {path.name}")
    if column is not None and suffix in (*UFF_SUFFIXES, *ARRAY_SUFFIXES):
        other = "variables" if suffix in ARRAY_SUFFIXES else "dataset"
        raise SceneError("column", f"is for text files, got {path.name}; give {other}")
    if not isinstance(path, Path):
        return _columns_of(path.table(names), names, column, function_type, of_file=False)
    if suffix in UFF_SUFFIXES:
        return _read_uff(path, names, dataset, function_type)
    if suffix in ARRAY_SUFFIXES:
        return _read_arrays(path, names, variables)
    with in_command():  # millions of lines that are not plain numbers take a minute
        if suffix in CHANNEL_SUFFIXES:
            found = _read_channels(path, CHANNEL_SUFFIXES[suffix], names, column, function_type)
            return found if full_scale is None else replace(found, y=full_scale * found.y)
        largest = LARGEST_DATA_FILE if function_type == TIME_RESPONSE else None
        return _columns_of(table_of(path, names, largest), names, column, function_type)


def table_of(source: Path | Frame, names: Sequence[str], largest: int | None = None) -> TextTable:
    """The table of a frame or a file, that has at least the columns `names`; errors as for
    `read_text_table`. Files are text, spreadsheets, or have an ending that a package reads."""
    if isinstance(source, Frame):
        return source.table(names)
    suffix = source.suffix.lower()
    if suffix in EXCEL_SUFFIXES:
        sheets = read_foreign(source, "Excel")
        if len(sheets) != 1:
            held = f"the sheets {_listed([each.name for each in sheets])}" if sheets else "nothing"
            raise SceneError(f"{source} holds {held}; write a file with the one sheet alone")
        return table_of_text(source, sheets[0].facts["text"], names)
    if suffix in TEXT_SUFFIXES or suffix[1:] not in outside.READERS:
        return read_text_table(source, names, largest)
    (found,) = read_foreign(source, suffix[1:])
    return _file_of(source, Frame(found.y, found.facts["headings"], found.facts["indexed"]), names)


def _file_of(path: Path, frame: Frame, names: Sequence[str]) -> TextTable:
    """The table of a frame that stands in a file."""
    if frame.columns.shape[1] < len(names):
        remedy = "; give fs, the sampling rate in Hz" * (names[0] == "time")
        raise SceneError(f"{path} must hold {' and '.join(names)}, got one column{remedy}")
    return replace(frame.table(names), path=path)


def _columns_of(
    table: TextTable,
    names: Sequence[str],
    column: int | str | None,
    function_type: int,
    of_file: bool = True,
) -> Columns:
    path = table.path
    record, quantity = function_type == TIME_RESPONSE, _abscissa(function_type)
    count = len(table.headings)
    chosen = None if column is None else table.column_called(column)
    if chosen is None and count > len(names) == len(table.numeric):
        chosen = table.numeric[-1]  # the others hold remarks
    x = _column_of(table, quantity, chosen, needed=len(names) > 1)
    if x is None:
        if chosen is None and count > 1:
            raise table.choose()
        place = chosen or 0
    else:
        _check_first_column(path, table, names)
        if chosen is None and count > 2:
            raise table.choose()
        place = 1 if chosen is None else chosen
    if place == x:
        which = f"number {number}" if (number := table.number(place)) else "the index"
        held = f"is {which} of {path}, which holds the {quantity}"
        raise SceneError("column", f"{held}; name another")
    table.headings[place].check_scaled()
    found = table.columns(*((place,) if x is None else (x, place)))
    known, line = table.headings[place].unit, table.headings[place].line
    others = (each for n, each in enumerate(table.headings) if n != x)
    if known is None and (not record or not any(each.unit for each in others)):
        known, line = table.stated(*(("acceleration", "force") if record else DENSITIES))
    times = found[0] if x is not None else None
    if times is not None and x is not None and not table.is_stamp(x):
        heading = table.headings[x]
        if heading.unit is not None and heading.unit.quantity != quantity:
            values = "; for values without times give fs and column" if record else ""
            raise SceneError(
                f"{path}, line {heading.line}: the first column is in {heading.unit.name}, "
                f"expected {quantity}; put the column of {quantity} first{values}"
            )
        if heading.unread and " " not in heading.unread:
            raise SceneError(
                f"{path} has the heading {shown(heading.name)} above its first column, in which "
                f"{shown(heading.unread)} is not a known unit; write {listed_units(quantity)} there"
            )
        if heading.unit is not None:
            times = heading.unit.to_si(times)
        elif record and len(names) > 1:
            _check_seconds(path, times)
    return Columns(
        x=times, y=found[-1], unit=known,
        stated_in=f"line {line} of {path}" if of_file else str(path),
        heading=" ".join(table.headings[place].cells),
        unread=(table.headings[place].unread or table.labelled) if known is None else "",
        lines=table.numbers if of_file else None,
        remarks=[(f"line {number} of {path}", text) for number, text in table.remarks],
    )  # fmt: skip


def _column_of(table: TextTable, quantity: str, chosen: int | None, *, needed: bool) -> int | None:
    """Index of the column of times or frequencies.

    It is the first column, or the only one whose heading states the quantity. None if the file
    need not have such a column, and seems to have none.

    Raises
    ------
    SceneError
        If the first column seems to hold something else that rises, such as numbers of rows.
    """
    first, count = table.headings[0], len(table.headings)
    naming = [place for place, each in enumerate(table.headings) if each.is_of(quantity)]
    if len(naming) == 1 and naming[0] > 0 and first.unit is None and not table.is_stamp(0):
        if count > 2:
            return naming[0]
        raise SceneError(
            f"{table.path} has the {quantity} in its second column, by the heading "
            f"{shown(table.headings[1].name)}; put the column of {quantity} first"
        )
    if not needed:
        if count == 1 or chosen == 0 or first.counts or not _holds_times(table):
            return None
        return 0
    if count > 1 and not table.is_stamp(0) and (first.counts or _counts_rows(table, chosen)):
        found = shown(first.name) if first.name else "the numbers of rows"
        remedy = " for a record without times give fs, and column;" if quantity == "time" else ""
        raise SceneError(
            f"{table.path} has {found} in its first column, expected the {quantity};{remedy} put "
            f"the column of {quantity} first, or write a heading that names it"
        )
    return 0


def _counts_rows(table: TextTable, chosen: int | None) -> bool:
    """Whether, of columns without headings, the first numbers the rows and another one rises."""
    if len(table.headings) < 3 or any(each.cells for each in table.headings):
        return False
    first = table.columns(0)[0]
    others = table.columns(*(n for n in table.numeric if n not in (0, chosen)))
    rise = [bool(np.all(np.diff(each) > 0.0)) for each in others]
    return bool(np.all(np.diff(first) == 1.0)) and any(rise)


def _check_seconds(path: Path, times: Vector, where: str = "its first column") -> None:
    """Refuse times without a unit that lie too far apart for seconds (`SLOWEST_UNSTATED`)."""
    interval = float(np.nanmedian(np.diff(times)))
    if interval > (1.0 + 1e-6) * SLOWEST_UNSTATED:  # beyond the rounding of binary numbers
        raise SceneError(
            f"{path} has a time every {interval:.6g} in {where}, without a unit; in "
            f"seconds the rate would be {1.0 / interval:.4g} Hz, in milliseconds "
            f"{1e3 / interval:.6g} Hz; write the unit into the heading (time (s), time (ms)) or "
            "name (time_s; two vectors in the place of a matrix), or take numbers of rows out and "
            "give fs"
        )


def _holds_times(table: TextTable) -> bool:
    """Whether the first column of a record holds times.

    Its heading states that; without a heading, a column that rises is taken for times.
    """
    first = table.headings[0]
    if table.is_stamp(0) or first.is_of("time"):
        return True
    return not first.cells and bool(np.all(np.diff(table.columns(0)[0]) > 0.0))


def _check_first_column(path: Path, table: TextTable, names: Sequence[str]) -> None:
    """Refuse a file whose headings are the usual names in another order than `names`."""
    found = [heading.name.lower() for heading in table.headings]
    if sorted(found) == sorted(names) and found != list(names):
        raise SceneError(
            f"{path} has the columns {', '.join(found)}; expected {', '.join(names)} in this order"
        )


def _abscissa(function_type: int) -> str:
    """Quantity of the first column of a record or of a density."""
    return "time" if function_type == TIME_RESPONSE else "frequency"


def _label(label: str) -> Unit | None:
    """The unit in a label that an instrument wrote; None if it is not a unit of a quantity here."""
    try:
        found = unit(label)
    except ValueError:
        return None
    return found if found.quantity in UNITS else None


# UFF --------------------------------------------------------------------------------------


def _read_uff(path: Path, names: Sequence[str], dataset: int | None, function_type: int) -> Columns:
    functions = {int(each.name): each for each in read_foreign(path, "UFF")}
    if not functions:
        raise SceneError(f"{path} holds no dataset 58 (a function at a node)")
    fitting = [n for n, each in functions.items() if each.facts["type"] == function_type]
    if dataset is None:
        if len(fitting) != 1:
            kind = "a power spectral density" if function_type == SPECTRAL_DENSITY else "a record"
            raise SceneError(
                "dataset", f"must say which of {path} is {kind}: {_listed_datasets(functions)}"
            )
        (dataset,) = fitting
    if dataset not in functions:
        raise SceneError(
            "dataset", f"must be one of {path}: {_listed_datasets(functions)}, got {dataset}"
        )
    entry = functions[dataset]
    if entry.facts["complex"]:
        raise SceneError(
            "dataset", f"{dataset} of {path} is complex, expected the real column {names[-1]}"
        )
    over, quantity = _label(entry.facts["x_unit"].strip()), _abscissa(function_type)
    x = entry.x
    if x is not None and over is not None:
        if over.quantity != quantity:
            raise SceneError(
                "dataset", f"{dataset} of {path} is over {over.name}, expected {quantity}"
            )
        x = over.to_si(x)
    elif x is not None and function_type == TIME_RESPONSE and len(names) > 1:
        _check_seconds(path, x, f"dataset {dataset}")
    # a character that is not UTF-8 is the raised 2 of an older encoding
    label = entry.facts["unit"].replace("\ufffd", "²").strip()
    Heading(cells=(f"({label})",)).check_scaled()
    known = _label(label)
    return Columns(
        x=x, y=entry.y, unit=known, stated_in=f"dataset {dataset} of {path}",
        unread="" if known or label.upper() == "NONE" else label,
        remarks=[
            (f"dataset {dataset} of {path}", entry.facts[key])
            for key in (*(f"id{n}" for n in range(1, 6)), "label")
        ],
    )  # fmt: skip


def _listed_datasets(functions: Mapping[int, Foreign]) -> str:
    return _listed(
        [
            f"dataset = {number}: {each.facts['id1'].strip() or 'without a name'} "
            f"(function type {each.facts['type']})"
            for number, each in functions.items()
        ]
    )


def _listed(entries: Sequence[str]) -> str:
    more = f"; and {len(entries) - LISTED} more" if len(entries) > LISTED else ""
    return "; ".join(entries[:LISTED]) + more


# Loggers ----------------------------------------------------------------------------------


def _read_channels(
    path: Path, kind: str, names: Sequence[str], column: int | str | None, function_type: int
) -> Columns:
    """A channel of a file of several, with its own times. Channels without any are the columns of a
    table, in which one of them may hold the times or frequencies."""
    channels = read_foreign(path, kind)
    if not channels:
        raise SceneError(
            f"{path} holds no channel of {'acceleration' * (kind == 'IDE') or 'numbers'}"
        )
    quantity = _abscissa(function_type)
    listed = [f"{n} {each.name} of {each.facts['of']}" for n, each in enumerate(channels, start=1)]
    chosen = [
        place
        for place, (each, entry) in enumerate(zip(channels, listed, strict=True))
        if column in (None, place + 1, each.name, entry, entry.partition(" ")[2])
    ]
    kin = [*range(len(channels))]
    if len(chosen) == 1:  # other groups have clocks of their own
        kin = [n for n in kin if channels[n].facts["of"] == channels[chosen[0]].facts["of"]]
    alike = {(channels[n].facts["of"], channels[n].x is None, len(channels[n].y)) for n in kin}
    table = len(alike) == 1 and channels[kin[0]].x is None
    if len(chosen) != 1 and not (table and (column is None or not chosen)):
        raise SceneError(
            "column", f"must be one channel of {path}, by number or name: {_listed(listed)}"
        )
    if table:
        headings = [
            f"{each.name} ({each.facts['unit']})" * bool(each.facts["unit"]) or each.name
            for each in (channels[n] for n in kin)
        ]
        frame = Frame(np.column_stack([channels[n].y for n in kin]), headings)
        if len(names) > 1 and not _may_hold(frame, quantity):
            stated = "states no sampling rate, and " * (quantity == "time")
            remedy = "; give fs, in Hz" * (quantity == "time")
            raise SceneError(
                f"{path} {stated}holds the {quantity} in none of its channels{remedy}; it holds "
                f"{_listed(listed)}"
            )
        if column is not None and chosen:
            column = kin.index(chosen[0]) + 1
        return _columns_of(_file_of(path, frame, names), names, column, function_type, False)
    channel = channels[chosen[0]]
    x, held = _abscissa_of(path, channel, len(names) > 1)
    if (x is not None and held != quantity) or (x is None and len(names) > 1):
        held = f"without {quantity}" if x is None else f"over {held}"
        remedy = "; give fs for it" * (x is None and quantity == "time")
        raise SceneError(f"{path} holds channel {channel.name} {held}, expected {names[0]}{remedy}")
    Heading(cells=(f"({channel.facts['unit']})",)).check_scaled()
    return Columns(
        x=x, y=channel.y, unit=_label(channel.facts["unit"]),
        stated_in=f"channel {channel.name} of {path}",
        unread=channel.facts["unit"] if _label(channel.facts["unit"]) is None else "",
    )  # fmt: skip


def _abscissa_of(path: Path, channel: Foreign, needed: bool) -> tuple[Vector | None, str]:
    """Times (s) or frequencies (Hz) of a channel, by the unit that the file states for them, and
    the word for them."""
    x, label = channel.x, str(channel.facts.get("x_unit", "s")).strip()
    known = _label(label) or _label(label.lower())
    if x is None:
        return None, ""
    if known is not None:
        return known.to_si(x), known.quantity
    if label:
        if needed:
            raise SceneError(
                f"{path} holds channel {channel.name} over {shown(label)}, which is not a known "
                f"unit ({listed_units('time', 'frequency')}); give fs for a record"
            )
        return None, ""
    if Heading(cells=(channel.facts.get("x_name", ""),)).is_of("frequency"):
        return x, "frequency"
    if needed:
        _check_seconds(path, x, f"channel {channel.name}")
    return x, "time"


def _may_hold(frame: Frame, quantity: str) -> bool:
    """Whether a channel may hold times or frequencies: by its name, or the first as it rises."""
    named = any(each.is_of(quantity) for each in frame.table(()).headings)
    return named or not np.any(np.diff(frame.columns[:, 0]) <= 0.0)


# MATLAB and NumPy -------------------------------------------------------------------------


def _read_arrays(path: Path, names: Sequence[str], variables: Sequence[str] | None) -> Columns:
    arrays = read_arrays(path, "MATLAB" if path.suffix.lower() == ".mat" else "")
    example = ", ".join(f'"{name}"' for name in names)
    if variables is None:
        choices = list(islice(_choices(arrays, len(names)), 2))
        if len(choices) != 1:
            alone = next(
                (name for (name,) in _choices(arrays, 1) if not _rises(arrays[name])), None
            )
            remedy = ""
            if len(names) == 2 and not choices and alone is not None:
                remedy = f'; for values without times give fs, and variables = ["{alone}"]'
            raise SceneError(
                "variables",
                f"must say which variables of {path} are [{example}]; it holds "
                f"{_listed_arrays(arrays)}{remedy}",
            )
        (variables,) = choices
    for name in variables:
        if name not in arrays:
            raise SceneError(
                "variables", f"names {name!r}, but {path} holds {_listed_arrays(arrays)}"
            )
    chosen = [arrays[name] for name in variables]
    if turned := [name for name in variables if np.iscomplexobj(arrays[name])]:
        raise SceneError(
            "variables", f"names {turned[0]!r}, which is complex in {path}; write its real values"
        )
    if len(chosen) == 1 and len(names) == 2 and chosen[0].ndim == 2 and 2 in chosen[0].shape:
        (matrix,) = chosen
        chosen = [*(matrix.T if matrix.shape[1] == 2 else matrix)]
    if len(chosen) != len(names) or any(array.ndim != 1 for array in chosen):
        raise SceneError(
            "variables",
            f"must name {'vectors' if len(names) == 2 else 'a vector'} [{example}]"
            f"{' or one matrix of two columns' if len(names) == 2 else ''}, "
            f"got {_listed_arrays({name: arrays[name] for name in variables})}",
        )
    if len({len(array) for array in chosen}) > 1:
        raise SceneError(
            "variables",
            "must have one length, got "
            f"{_listed_arrays({name: arrays[name] for name in variables})}",
        )
    known = _unit_of(variables[-1])  # in the name of a matrix, that of its values
    Heading(cells=(variables[-1],), unit=known).check_scaled()
    unread = Heading(cells=(variables[-1].rsplit(".", 1)[-1],), unit=known).unread
    if known is not None and known.quantity not in VALUES:
        known = None
    return Columns(
        x=_over(path, names[0], variables[0], chosen[0]) if len(chosen) == 2 else None,
        y=chosen[-1], unit=known, stated_in=f"the name {variables[-1]} in {path}", unread=unread,
    )  # fmt: skip


def _over(path: Path, quantity: str, name: str, values: Vector) -> Vector:
    """Times or frequencies in SI units, by the unit in the name of their variable."""
    known = _unit_of(name)
    if known is not None and known.quantity == ("time" if quantity == "time" else "frequency"):
        return known.to_si(values)
    if quantity == "time":
        _check_seconds(path, values, f"the variable {name}")
    return values


def _unit_of(name: str) -> Unit | None:
    """The unit in the name of a variable, "acc_g" or "run.t_ms"."""
    return unit_in(name.rsplit(".", 1)[-1])


def _choices(arrays: Mapping[str, Vector], count: int) -> Iterator[tuple[str, ...]]:
    """The variables that the columns may be: a matrix of two columns, or vectors of one length of
    which the first rises."""
    real = {name: array for name, array in arrays.items() if not np.iscomplexobj(array)}
    vectors = {name: array for name, array in real.items() if array.ndim == 1}
    if count == 1:
        yield from ((name,) for name in vectors)
        return
    yield from ((name,) for name, each in real.items() if each.ndim == 2 and 2 in each.shape)
    rises = {name: _rises(array) for name, array in vectors.items()}
    for one in (name for name, rising in rises.items() if rising):
        for two, rising in rises.items():
            if not rising and len(vectors[one]) == len(vectors[two]):
                yield one, two


def _rises(array: Vector) -> bool:
    return bool(np.all(np.diff(array) > 0.0))


def _listed_arrays(arrays: Mapping[str, Vector]) -> str:
    return (
        _listed(
            [
                f"{name[:40]} ({' x '.join(str(size) for size in array.shape)}"
                f"{', complex' * np.iscomplexobj(array)})"
                for name, array in arrays.items()
            ]
        )
        or "no arrays of numbers"
    )


# ------------------------------------------------------------------------------
# Columns of a text file in SI units, by their headings or by units that a user names.
# ------------------------------------------------------------------------------


def si_columns(
    table: TextTable, columns: Sequence[Vector], quantities: Sequence[str],
    given: Sequence[str] | None, choices: str,
) -> list[Vector]:  # fmt: skip
    """All columns of a table, converted to SI units.

    Parameters
    ----------
    columns
        The columns as they stand in the table.
    quantities
        Quantity of each column, such as "length".
    given
        Units of the columns in their order, where headings do not state them.
    choices
        Example of the key `unit`, for messages.

    Raises
    ------
    SceneError
        If a unit is missing, is of another quantity, or contradicts a heading.
    """
    named: Sequence[str | None] = given or [None] * len(columns)
    return [
        values * _stated_unit(table, place, quantity, name, given, choices).factor
        for place, (values, quantity, name) in enumerate(
            zip(columns, quantities, named, strict=True)
        )
    ]


def _stated_unit(
    table: TextTable, place: int, quantity: str, name: str | None, given: Sequence[str] | None,
    choices: str,
) -> Unit:  # fmt: skip
    table.headings[place].check_scaled()
    stated, column = table.headings[place].unit, f"column {place + 1} of {table.path}"
    if stated is None and name is not None:
        stated, _ = table.stated(quantity)
    if stated is None and name is None:
        raise SceneError("unit", f"must be {choices}, got none, and no unit stands above {column}")
    if stated is not None and stated.quantity != quantity:
        raise SceneError(
            "file",
            f"states the unit {stated.name!r} above {column}, expected one of "
            f"{quantity} ({listed_units(quantity)})",
        )
    unread = table.headings[place].unread
    if stated is None and name is not None and may_be_unit(unread):
        warnings.warn(
            f"the text {shown(unread)} above {column} is not a known unit; its values were taken "
            f"to be in {name}",
            InputWarning, stacklevel=2,
        )  # fmt: skip
    if stated is not None and name is not None and not stated.same(unit(name)):
        raise SceneError(
            "unit",
            f"is {','.join(given or ())!r}, but above {column} stands {stated.name!r}; "
            "take out the one that is wrong",
        )
    return stated or unit(str(name))
