"""Tables of numbers in text as instruments, spreadsheets and people write them: which lines are
rows, and the numbers in them. `text_headings.py` reads the names and units of columns,
`text_cells.py` splits a line."""

from __future__ import annotations

import codecs
import difflib
import io
import math
import re
from array import array
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import overload

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.units import DENSITIES, Unit
from stochvi.results.errors import SceneError, reason_of
from stochvi.scenes.text_cells import (
    CLOCK,
    DELIMITERS,
    MISSING,
    STAMP,
    count_values,
    is_number,
    split_cells,
)
from stochvi.scenes.text_headings import (
    Heading,
    MisfitHeading,
    headings_above,
    stated_unit,
)

LARGEST_TEXT_FILE = 10_000_000
"""Largest size of a table or scene file, bytes: such files have some kilobytes."""

COMMENTS = ("#", "%", "//")
"""Start of a line of comment."""

HASH = re.compile(r"(?<!1\.)#(?!N/?A|NV|VALUE!|WERT!|NUM!|ZAHL!|DIV/0!|REF!|BEZUG!)")
"""Start of a comment within a line: no part of 1.#QNAN, and of no error of a spreadsheet."""

SAMPLE = 1000
"""Number of lines at the start of a file from which its layout is found."""

DAY = 86_400.0
"""Length of a day, s."""

VALUES = (*DENSITIES, "acceleration", "force")
"""Quantities of what is read over frequency or time."""

MOST_COLUMNS = 10_000
"""Largest number of columns of a table; a logger has some hundred channels."""

COLUMNS_LISTED = 20
"""Number of columns that a sentence lists."""

SLASHED = re.compile(r'^("?\d{4})/(\d\d)/(\d\d)(?=[T ;,|\t]+\d\d:\d\d)', re.M)
"""A date with slashes at the start of a line, year first, 2024/05/01 before a time of day."""

SPLIT_STAMP = re.compile(r'^("?\d{4}-\d\d-\d\d)[ ;,|\t]+(?=\d\d:\d\d)', re.M)
DAY_FIRST = re.compile(
    r'^("?)(\d\d?)\.(\d\d?)\.(\d{4})[ ;|\t]+(\d\d:\d\d:\d\d)(?:\.(\d+)|,(\d+)(?=[;|\s"]))?', re.M
)
"""A German time stamp at the start of a line, 14.03.2025 08:15:02,120; a semicolon may part it."""

GROUPED = re.compile(r"(?<=\d)[\u2009\u202f](?=\d{3}(?!\d))")
"""A thin space between thousands, as a typesetter writes them."""

GROUPED_IN_CELL = re.compile(r"(?<=\d)\u00a0(?=\d{3}(?!\d))")
"""A no-break space between thousands, as spreadsheets write them."""

DASH = re.compile(r"(?<!\d)[\u2010-\u2013\u2212](?=[.,]?\d)")
"""A typeset minus sign; after a digit it may also stand for "to"."""

POWER_OF_TEN = re.compile(
    r"(?<=\d)[^\S\n]*[\u00d7xX·⋅*][^\S\n]*10"
    r"(?:(?:\^|\*\*)[^\S\n]*\{?([+-]?\d+)\}?|([-+\u2010-\u2013\u2212]\d+)|([⁺⁻]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+))"
)
"""The power in "1.0 x 10^-2", "1.0 x 10-2" or "1.0·10⁻²"; "10 2" has lost too much to be one."""

PLAIN = str.maketrans("⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹\u2010\u2011\u2012\u2013\u2212", "+-0123456789-----")
"""Typeset digits and signs of a power, and those that Python reads."""


def read_text(path: Path, largest: int | None = None) -> str:
    """The text of a small UTF-8 file; a sentence for everything that it may be instead.

    `largest` is the size in bytes from which a file is refused, by default `LARGEST_TEXT_FILE`.
    """
    check_file(path, largest or LARGEST_TEXT_FILE)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise SceneError(f"{path} is not text: expected UTF-8, got binary data") from None
    except OSError as error:
        raise _unreadable(path, error) from None


def check_file(path: Path, largest: int) -> None:
    """Raise `SceneError` unless `path` is a file of at most `largest` bytes."""
    try:
        if "\0" in str(path):
            raise SceneError(f"{str(path)!r} cannot be read: a file name holds no null character")
        size = path.stat().st_size
        if not path.is_file():
            got = "a folder" if path.is_dir() else "a device or a pipe"
            raise SceneError(f"{path} cannot be read: expected a text file, got {got}")
        if size > largest:
            raise SceneError(f"{path} holds {size} bytes, expected a text of at most {largest}")
    except OSError as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: OSError) -> SceneError:
    near = _alike(path) if isinstance(error, FileNotFoundError) else ""
    return SceneError(f"{path} cannot be read: {reason_of(error)}{near}")


def _alike(path: Path) -> str:
    """A file in the folder of a missing one with nearly its name, or where it was looked for."""
    if not path.parent.is_dir():
        return f"; there is no folder {path.parent}"
    try:
        names = {each.name.lower(): each.name for each in path.parent.iterdir() if each.is_file()}
    except OSError:
        return ""
    near = [names[name] for name in difflib.get_close_matches(path.name.lower(), names, n=1)]
    if near and near[0].isprintable():
        return f"; did you mean {path.with_name(near[0])}?"
    return f"; it was looked for in the folder {path.parent.resolve()}"


LARGE_TEXT = 1_000_000
"""Size of a text file, bytes, from which its rows are read at once where they are plain."""

PART = 100_000
"""Length of each part of a large text from which its layout is found, bytes."""

PLAIN_BYTES = b"0123456789+-.eE,; \t|\r\n"
"""Bytes of plain rows of numbers."""

MANY_ROWS = 1000
"""Number of rows from which a table is worth being read at once."""


@dataclass(frozen=True, kw_only=True)
class TextTable:
    """The rows of a text file, still text, and the headings of its columns.

    `lines` are the rows with their numbers in the file, `above` the lines above them, and `remarks`
    all other lines. `numeric` are the places of the columns that hold numbers or time stamps.
    """

    path: Path
    lines: Sequence[tuple[int, str]]
    above: Sequence[tuple[int, str]]
    remarks: Sequence[tuple[int, str]]
    delimiter: str | None
    headings: Sequence[Heading]
    decimal_comma: bool
    numeric: Sequence[int]
    values: NDArray[np.float64] | None = None
    """All columns, (rows, columns), of a large table that was read at once."""

    @property
    def numbers(self) -> Sequence[int]:
        """The numbers of the lines of the rows in the file."""
        if self.values is not None:
            return range(self.lines[0][0], self.lines[0][0] + len(self.lines))
        return [number for number, _ in self.lines]

    def stated(self, *quantities: str) -> tuple[Unit | None, int]:
        """The one unit of some quantities that the lines above the rows state, and its line."""
        return stated_unit(self.above, quantities)

    def column_called(self, column: int | str) -> int:
        """Place of a column, from 0, by its name or its number, which counts from 1."""
        if isinstance(column, int):
            if not 1 <= column <= len(self.headings):
                raise SceneError([("column", f"is {column}, but {self.path} {self._holds()}")])
            return column - 1
        found = [place for place, each in enumerate(self.headings) if each.called(column)]
        if not found:
            found = [place for place, each in enumerate(self.headings) if each.mentions(column)]
        if len(found) != 1:
            which = "several columns with" if found else "no column with"
            raise SceneError(
                [("column", f"is {column!r}, but {self.path} has {which} this name: it "
                  f"{self._holds()}")]
            )  # fmt: skip
        return found[0]

    def choose(self) -> SceneError:
        """The refusal of a file that holds more columns than are read."""
        places = range(len(self.headings))
        stated = [
            n for n in places if (known := self.headings[n].unit) and known.quantity in VALUES
        ]
        place = stated[-1] if stated else places[-1]
        name = self.headings[place].name
        by = f"{name!r} or column = {place + 1}" if name else place + 1
        return SceneError(
            [("column", f"must say which column of {self.path} holds the values (column = {by}): "
              f"it {self._holds()}")]
        )  # fmt: skip

    def _holds(self) -> str:
        listed = [
            f"{n} {each.name[:40]}".strip()
            for n, each in enumerate(self.headings[:COLUMNS_LISTED], start=1)
        ]
        more = len(self.headings) - len(listed)
        return f"holds the columns {', '.join(listed)}" + (f" and {more} more" if more else "")

    def is_stamp(self, place: int) -> bool:
        """Whether a column holds dates with times of day."""
        return bool(STAMP.fullmatch(self._first_cells[place]))

    @cached_property
    def _first_cells(self) -> list[str]:
        return split_cells(self.lines[0][1], self.delimiter)

    def columns(self, *places: int) -> list[Vector]:
        """The numbers of some columns, NaN where one is missing; time stamps as s after the first.

        Raises
        ------
        SceneError
            With the line that is not as the others are.
        """
        if self.values is not None:
            return [self.values[:, place].copy() for place in places]
        count = len(self.headings)
        stamped = [self.is_stamp(place) for place in places]
        if not any(stamped) and (plain := self._plain_columns(count)) is not None:
            return [plain[:, place].copy() for place in places]
        found = [array("d") for _ in places]
        first: dict[int, datetime] = {}
        for line, text in self.lines:
            cells = split_cells(text, self.delimiter)
            while len(cells) > count and not cells[-1]:
                cells.pop()
            if len(cells) != count:
                raise _wrong_row(self.path, line, text, count, "above")
            for place, is_stamp, values in zip(places, stamped, found, strict=True):
                if self.decimal_comma and "." in cells[place] and not is_stamp:
                    raise self._no_number(line, place, cells[place])
                if is_stamp:
                    stamp = self._stamp(line, place, cells[place])
                    elapsed = (stamp - first.setdefault(place, stamp)).total_seconds()
                    # a clock that falls by more than half a day has passed midnight
                    while (
                        CLOCK.fullmatch(cells[place]) and values and elapsed < values[-1] - DAY / 2
                    ):
                        elapsed += DAY
                    values.append(elapsed)
                else:
                    values.append(self._value(line, place, cells[place]))
        columns = [np.frombuffer(values, dtype=float).copy() for values in found]
        for column in columns:
            column[~np.isfinite(column)] = np.nan
        return columns

    def _plain_columns(self, count: int) -> NDArray[np.float64] | None:
        """All columns of a large table of plain numbers, (rows, columns), in a tenth of the time
        that a look at every cell takes; None where a cell is anything else."""
        if self.decimal_comma or len(self.lines) < MANY_ROWS:
            return None
        try:
            found = np.loadtxt(
                [text for _, text in self.lines], delimiter=self.delimiter, comments=None, ndmin=2
            )
        except ValueError:
            return None
        if found.shape != (len(self.lines), count):
            return None
        found[~np.isfinite(found)] = np.nan
        return found

    def _value(self, line: int, place: int, cell: str) -> float:
        try:
            return float(cell)
        except ValueError:
            pass
        try:
            return float(self._plain(cell))
        except ValueError:
            if cell.casefold() not in MISSING:
                raise self._no_number(line, place, cell) from None
        return math.nan

    def _stamp(self, line: int, place: int, cell: str) -> datetime:
        try:
            clock = CLOCK.fullmatch(cell)
            found = datetime.fromisoformat(f"1970-01-01T{cell}" if clock else cell)
        except ValueError:
            raise SceneError(
                f"{self.path}, line {line}: expected a time stamp (2024-05-01T12:00:00.000Z) in "
                f"column {place + 1}, got {cell[:40]!r}"
            ) from None
        return found if found.tzinfo else found.replace(tzinfo=UTC)

    def _plain(self, cell: str) -> str:
        """A number with a decimal comma or a Fortran exponent as Python writes it."""
        if self.decimal_comma:
            cell = cell.replace(",", ".")
        return re.sub("[dD]", "e", cell)

    def _no_number(self, line: int, place: int, cell: str) -> SceneError:
        got = (
            f"{self.path}, line {line}: expected a number in column {place + 1}, got {cell[:40]!r}"
        )
        if self.decimal_comma and "." in cell:
            return SceneError(
                f"{got} in a file with decimal commas; write one decimal sign, and no sign between "
                "thousands"
            )
        return SceneError(f"{got}; mend it, or begin the line with # to leave it out")


def read_table(
    path: Path, names: Sequence[str] = ("frequency_hz", "density")
) -> tuple[Vector, ...]:
    """Columns of numbers, one for each of `names`, from a text file that has no others.

    Raises `SceneError` for anything that is not that many numbers, and for a heading that names the
    columns in another order.
    """
    return all_columns(read_text_table(path, names), names)


def all_columns(table: TextTable, names: Sequence[str]) -> tuple[Vector, ...]:
    """All columns of a table that has one for each of `names`; errors as for `read_table`."""
    path = table.path
    if len(table.headings) != len(names):
        line, text = table.lines[0]
        raise SceneError(
            f"{path}, line {line}: expected {_counted(len(names))} ({', '.join(names)}), got "
            f"{text.strip()[:60]!r}"
        )
    found = [heading.name.lower() for heading in table.headings]
    if sorted(found) == sorted(names) and found != list(names):
        raise SceneError(
            f"{path} has the columns {', '.join(found)}; expected {', '.join(names)} in this order"
        )
    columns = table.columns(*range(len(names)))
    for values in columns:
        if np.isnan(values).any():
            line = table.lines[int(np.argmax(np.isnan(values)))][0]
            raise SceneError(
                f"{path}, line {line}: a number is missing; mend the line or leave it out"
            )
    return tuple(columns)


def decoded(path: Path, largest: int | None = None) -> str:
    """The text of a file: by its byte-order mark, else UTF-8, UTF-16 or Latin-1 (Windows 1252)."""
    check_file(path, largest or LARGEST_TEXT_FILE)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise _unreadable(path, error) from None
    for mark, name in (
        (codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):  # fmt: skip
        if content.startswith(mark):
            encodings = [name]
            break
    else:
        # text of digits in UTF-16 has a zero in every second byte
        start = content[:SAMPLE]
        odd, even = start[1::2].count(0), start[0::2].count(0)
        wide = "utf-16-le" if odd > even else "utf-16-be"
        encodings = [wide] if 2 * max(odd, even) > len(start) // 2 else ["utf-8", "cp1252"]
    for name in encodings:
        try:
            text = content.decode(name)
        except UnicodeDecodeError:
            continue
        if not re.search(r"[\x00-\x08\x0e-\x1f]", text):
            return text
    raise SceneError(
        f"{path} is not text: expected UTF-8, UTF-16 or Latin-1, got binary data; export it as CSV"
    )


def read_text_table(path: Path, names: Sequence[str], largest: int | None = None) -> TextTable:
    """The rows of a text file that hold at least as many numbers or time stamps as `names`.

    Cells may be parted by commas, semicolons, tabs, bars or blanks, and quoted; decimal signs are
    points or commas. What stands above the first row names the columns.

    Raises
    ------
    SceneError
        With the line, what was got and what helps.
    """
    check_file(path, largest or LARGEST_TEXT_FILE)
    if (
        path.stat().st_size > LARGE_TEXT and (plain := _read_at_once(path, names)) is not None
    ):  # fmt: skip
        return plain
    return _table_of(path, decoded(path, largest), names)


class PlainRows(Sequence[tuple[int, str]]):
    """The rows of a table that was read at once: their lines, and the text of the first one."""

    def __init__(self, first: tuple[int, str], count: int) -> None:
        self._first, self._count = first, count

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, place: int) -> tuple[int, str]: ...
    @overload
    def __getitem__(self, place: slice) -> Sequence[tuple[int, str]]: ...
    def __getitem__(self, place: int | slice) -> tuple[int, str] | Sequence[tuple[int, str]]:
        if isinstance(place, slice):
            return [self[n] for n in range(*place.indices(self._count))]
        if not 0 <= place < self._count:
            raise IndexError(place)
        return self._first if place == 0 else (self._first[0] + place, "")


def _read_at_once(path: Path, names: Sequence[str]) -> TextTable | None:
    """A large table whose rows hold nothing but numbers, in a tenth of the time that a look at
    every cell takes; None for any other, which is read line by line.

    Its layout comes from its beginning, its middle and its end.
    """
    content = path.read_bytes().rstrip(b"\r\n")
    begin = content.find(b"\n", PART) + 1
    if not begin or b"\0" in content[:begin] or b"\r" in content[:begin].replace(b"\r\n", b""):
        return None
    middle = content.find(b"\n", len(content) // 2) + 1
    end = content.rfind(b"\n", 0, len(content) - PART) + 1
    parts = content[:begin] + content[middle : middle + content[middle:].find(b"\n", PART) + 1]
    try:
        text = (parts + content[end:]).decode("utf-8-sig")
        part = _table_of(path, text, names)
    except (UnicodeDecodeError, SceneError):
        return None
    row = part.lines[0][0]
    start = 0
    for _ in range(row - 1):
        start = content.find(b"\n", start) + 1
    body = content[start:].removeprefix(codecs.BOM_UTF8)
    if start > begin or body.translate(None, PLAIN_BYTES):
        return None
    if part.decimal_comma:
        if b"." in body or part.delimiter == ",":
            return None
        body = body.replace(b",", b".")
    body = body.replace(b"\r\n", b"\n")
    sign = (part.delimiter or " ").encode()
    first, _, _ = body.partition(b"\n")
    if ends := len(first) - len(first.rstrip(sign)):  # delimiters that end the lines
        body = (body + b"\n").replace(ends * sign + b"\n", b"\n").rstrip(b"\n")
    try:
        found = np.loadtxt(io.BytesIO(body), delimiter=part.delimiter, comments=None, ndmin=2)
    except ValueError:
        return None
    if found.shape != (body.count(b"\n") + 1, len(part.headings)):
        return None
    found[~np.isfinite(found)] = np.nan
    return replace(part, lines=PlainRows(part.lines[0], len(found)), values=found)


def _table_of(path: Path, written: str, names: Sequence[str]) -> TextTable:
    """The rows and headings of a text, as `read_text_table` finds them in a file."""
    needed, wanted = len(names), f"{_counted(len(names))} ({', '.join(names)})"
    text = _plainly_written(written.replace("\r\n", "\n").replace("\r", "\n"))
    lines = [
        (number, line)
        for number, line in enumerate(text.split("\n"), start=1)
        if line.strip(" \t\f\v\ufeff;,") and not line.startswith("sep=")
    ]
    content = [(number, plain) for number, line in lines if (plain := _uncommented(line))]
    sample = [line for _, line in content[:SAMPLE]]
    if (width := max(map(_most_cells, sample), default=0)) > MOST_COLUMNS:
        raise SceneError(
            f"{path} must have at most {MOST_COLUMNS} columns, got {width}; write those alone that "
            "are needed"
        )
    delimiter, count, full = _layout(sample, needed)
    begin = 0
    for number, line in content if count else ():
        cells = split_cells(line, delimiter)
        while len(cells) > count and not cells[-1]:
            cells.pop()
        values = count_values(cells)
        if len(cells) == count and (values == count if full else values >= needed):
            break
        if not _is_count(line, content[begin + 1 :], delimiter, count):
            _check_heading(path, number, line, cells, count)
        begin += 1
    if not count or begin == len(content):
        for number, line in content:
            if names[0] == "time" and is_number(line.strip()):
                raise SceneError(
                    f"{path}, line {number}: expected {wanted}, got {line[:60]!r}; for values "
                    "without times give fs, the sampling rate in Hz"
                )
            if re.match(r"\W{0,2}\d", line):
                dated = re.match(r"\W?\d+([-/.:])\d+\1\d+", line)
                remedy = "; write times in seconds or as 2024-05-01T12:00:00.000" if dated else ""
                raise SceneError(
                    f"{path}, line {number}: expected {wanted}, got {_shown(line)}{remedy}"
                )
        shown = f", got {_shown(content[0][1])} in line {content[0][0]}" if content else ""
        raise SceneError(f"{path} holds no rows of {wanted}{shown}")
    rows = content[begin:]
    above = [(number, line) for number, line in lines if number < rows[0][0]]
    below = [(number, line) for number, line in lines[len(above) :] if not _uncommented(line)]
    some = [split_cells(line, delimiter) for _, line in rows[:SAMPLE]]
    _check_thousands(path, rows, delimiter)
    if count > 2:
        _check_commas(path, rows, delimiter)
    try:
        headings = headings_above(
            above, delimiter, count, len(some[0]), bool(STAMP.fullmatch(some[0][0]))
        )
        numeric = [
            place
            for place in range(count)
            if any(count_values(row[place : place + 1]) for row in some)
        ]
        for place, each in enumerate(headings):
            if each.unit and place not in numeric:
                raise MisfitHeading(each.line, count)
    except MisfitHeading as heading:
        raise SceneError(
            f"{path}, line {heading.line}: names {_columns(heading.count)} with units, but the "
            f"rows below have {count}; write one name above each column"
        ) from None
    return TextTable(
        path=path, lines=rows, above=above, remarks=above + below, delimiter=delimiter,
        headings=headings, numeric=numeric,
        decimal_comma=any("," in cell for cells in some for cell in cells if is_number(cell)),
    )  # fmt: skip


def _shown(line: str) -> str:
    """A line of a file that is no table, in quotes; in words where it may hold a secret."""
    if re.fullmatch(r"[\d\s.,;:|/+\-eEdDTZ'\"]*", line):
        return repr(line[:60])
    return f"a text of {len(line)} characters"


def _plainly_written(text: str) -> str:
    """Typeset numbers and German time stamps as Python reads them, line by line.

    >>> _plainly_written("1\u2009000  1.5 × 10⁻⁴ –3")
    '1000  1.5e-4 -3'
    >>> _plainly_written("1.3.2025 08:15:02,120;0,5")
    '2025-03-01T08:15:02.120;0,5'
    """
    if not text.isascii():
        text = DASH.sub("-", GROUPED.sub("", text))
        if any(delimiter in text for delimiter in ";\t|"):
            text = GROUPED_IN_CELL.sub("", text)
    if re.search(r"[\u00d7xX·⋅*][^\S\n]*10", text):
        text = POWER_OF_TEN.sub(
            lambda found: "e" + (found[1] or found[2] or found[3]).translate(PLAIN), text
        )
    if SLASHED.search(text):
        text = SLASHED.sub(r"\1-\2-\3", text)
    if DAY_FIRST.search(text):
        text = DAY_FIRST.sub(_iso_stamp, text)
    return SPLIT_STAMP.sub(r"\1T", text) if SPLIT_STAMP.search(text) else text


def _iso_stamp(found: re.Match[str]) -> str:
    quote, day, month, year, time, point, comma = found.groups()
    fraction = point or comma
    return f"{quote}{year}-{month:0>2}-{day:0>2}T{time}" + (f".{fraction}" if fraction else "")


def _check_thousands(path: Path, rows: Sequence[tuple[int, str]], delimiter: str | None) -> None:
    """Refuse numbers of which nothing says whether their commas are decimal or part thousands."""
    example = ""
    for line, row in rows[:SAMPLE]:
        for cell in filter(is_number, split_cells(row, delimiter)):
            if re.fullmatch(r"[+-]?[1-9]\d{0,2},\d{3}", cell):
                example = example or f"{path}, line {line}: {cell!r}"
            elif not cell.lstrip("+-").isdigit():
                return
    if example:
        raise SceneError(
            f"{example} may be a number with a decimal comma or thousands; expected one that can "
            "be read in one way only; write decimal points, and no sign between thousands"
        )


def _check_commas(path: Path, rows: Sequence[tuple[int, str]], delimiter: str | None) -> None:
    """Refuse rows in which commas part cells and are decimal signs as well: "0,25,1,5"."""
    if delimiter != "," or any("." in row for _, row in rows[:SAMPLE]):
        return
    for line, row in rows[:SAMPLE]:
        if any(re.fullmatch(r"[+-]?0\d+", cell) for cell in split_cells(row, delimiter)):
            raise SceneError(
                f"{path}, line {line}: {row[:60]!r} has a number that begins with 0 after a comma, "
                "so that commas seem to be decimal signs as well as to part columns; export it "
                "with semicolons between columns, or with decimal points"
            )


def _wrong_row(path: Path, line: int, text: str, count: int, where: str) -> SceneError:
    return SceneError(
        f"{path}, line {line}: expected {_counted(count)} as in the lines {where} it, got "
        f"{text.strip()[:60]!r}; mend it, or begin the line with # to leave it out"
    )


def _uncommented(line: str) -> str:
    """A line without its comment; empty if it is nothing else."""
    if line.lstrip(" \ufeff").startswith(COMMENTS):
        return ""
    return (HASH.split(line)[0] if "#" in line else line).strip(" \ufeff")


def _most_cells(line: str) -> int:
    """Number of cells of a line by the delimiter that it has most of; 0 of one that begins with no
    number."""
    if not re.match(r"\W{0,3}\d", line):
        return 0
    return max(len(line.split()), *(1 + line.count(each) for each in DELIMITERS if each))


def _layout(lines: Sequence[str], needed: int) -> tuple[str | None, int, bool]:
    """Delimiter of most lines that hold numbers, number of cells of a line, and whether all of them
    are numbers."""
    most = {True: 0, False: 0}
    choices: dict[bool, tuple[str | None, int, bool]] = dict.fromkeys(most, (None, 0, False))
    for delimiter in DELIMITERS:
        whole: Counter[int] = Counter()
        part: Counter[int] = Counter()
        rows = [split_cells(line, delimiter) for line in lines]
        # number of cells of a row -> how many are used, if only now and then
        used: dict[int, int] = {}
        for cells in rows:
            if count_values(cells) >= needed:
                used[len(cells)] = max(_filled(cells), used.get(len(cells), 0))
        for cells in rows:
            parted = len(cells) > 1
            # delimiters end the line
            del cells[max(needed, _filled(cells), used.get(len(cells), 0)) :]
            if sum(map(bool, cells)) >= needed and (delimiter is None or parted):
                values = count_values(cells)
                whole[len(cells)] += values == len(cells)
                part[len(cells)] += values >= needed
        for counts, full in ((whole, True), (part, False)):
            usual, number = max(((n, -count) for count, n in counts.items()), default=(0, 0))
            if usual > most[full]:
                most[full], choices[full] = usual, (delimiter, -number, full)
    # a few rows without remarks do not make numbers of those that have them
    choice = choices[2 * most[True] > most[False]]
    if choice == (",", 2, True) and needed == 1 and _decimal_fractions(lines):
        return None, 1, True
    return choice


def _filled(cells: Sequence[str]) -> int:
    """Number of cells of a row without the empty ones at its end."""
    return max((n for n, cell in enumerate(cells, start=1) if cell), default=0)


def _decimal_fractions(lines: Sequence[str]) -> bool:
    """Whether a comma in "0,07" is a decimal sign: no whole number starts with a zero."""
    pairs = [cells for line in lines if len(cells := split_cells(line, ",")) == 2]
    whole = all((cell.lstrip("+-") or "0").isdigit() for cells in pairs for cell in cells)
    return whole and any(re.fullmatch(r"0\d+", cells[1]) for cells in pairs)


def _is_count(
    line: str, below: Sequence[tuple[int, str]], delimiter: str | None, count: int
) -> bool:
    """Whether a line holds nothing but the number of rows below it, as some analysers write it."""
    alone = line.strip()
    if count < 2 or not re.fullmatch(r"[0-9]{1,9}", alone):
        return False
    return int(alone) == sum(count_values(split_cells(row, delimiter)) >= count for _, row in below)


def _check_heading(path: Path, number: int, line: str, cells: Sequence[str], count: int) -> None:
    """A line above the rows is a heading, unless it looks like a row that is wrong."""
    numeric = [is_number(cell) for cell in cells]
    typing_error = (
        len(cells) == count and any(numeric) and re.match(r"[+-]?[.,]?[\dOo][.,\d]?", cells[0])
        and not all(numeric) and not re.match(r"[Oo][^.,\d]", cells[0])
    )  # fmt: skip
    # numbers with a quote too many, but not a date such as 01.05.2024 or 2024-05-01
    broken = re.fullmatch(r"[\s\"'\d.,;|+eEdD-]*\d[\s\"'\d.,;|+eEdD-]*", line) and not re.search(
        r"\d{4}-\d\d-\d\d|\d+\.\d+\.\d{4}", line
    )
    if all(numeric) or typing_error or broken:
        raise _wrong_row(path, number, line, count, "below")


def _columns(count: int) -> str:
    return "one column" if count == 1 else f"{count} columns"


def _counted(count: int) -> str:
    return {1: "one number", 2: "two numbers"}.get(count, f"{count} numbers")
