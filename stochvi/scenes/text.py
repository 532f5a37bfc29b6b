"""Tables of numbers in text as instruments, spreadsheets and people write them."""

from __future__ import annotations

import codecs
import csv
import difflib
import math
import re
from array import array
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.units import DENSITIES, DIMENSIONS, Unit, unit
from stochvi.results.errors import SceneError

Vector = NDArray[np.float64]

LARGEST_TEXT_FILE = 10_000_000
"""Largest size of a table or scene file, bytes: such files have some kilobytes."""

DELIMITERS = (";", "\t", "|", ",", None)
"""What may part the cells of a line; None is any number of blanks."""

COMMENTS = ("#", "%", "//")
"""What a line of comment starts with."""

SAMPLE = 1000
"""Number of lines at the start of a file from which its layout is found."""

LAST_HEADINGS = 3
"""Number of lines above the numbers that may name the columns and their units."""

DAY = 86_400.0
"""Length of a day, s."""

GLUE = "\0"
"""Stands for a blank at which a line is not split; decoded text holds none."""

VALUES = (*DENSITIES, "acceleration", "force")
"""Quantities of what is read over frequency or time."""

COLUMNS_LISTED = 20
"""Number of columns that a sentence lists."""

NUMBER = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eEdD][+-]?\d+)?")
CLOCK = re.compile(r"\d\d:\d\d:\d\d(?:[.,]\d+)?")
"""A time of day without a date."""

STAMP = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d\S*|" + CLOCK.pattern)
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

MISSING = frozenset(("", "nan", "na", "n/a", "null", "none", "-", "--", "---", "inf", "-inf"))
"""Cells, in small letters, that stand for a value that was not measured."""

ABSCISSAE = {
    "time": r"t|time\w*|zeit\w*|temps|date\w*|datum",
    "frequency": r"f|freq\w*|frequenz|fréquence|k?hz",
}
"""Quantity of the column that runs -> words by which headings call it."""

NAMED_UNIT = re.compile(
    r"(?:acc[a-z]*|a|beschleunigung|force|density|psd|asd|time|t|zeit|frequency|freq|f|level)"
    r"(?:[_ ][xyz])?(?:_| in | )(\w+)", re.I,
)  # fmt: skip
"""A name such as acceleration_g, accel_z_g, density_g2_per_hz or "Time ms", and its unit."""

LABELLED_UNIT = re.compile(r"(?:[xy][_ ])?(?:units?|einheit)(?:[_ ]label)?\s*[:=]\s*(\S+)", re.I)
"""A line such as "Unit: g", and the unit in it."""

ROW_OF_UNITS = re.compile(r"(?:[xy][_ ])?(?:units?|einheit)\b|(?:[xy][_ ])?unit_label", re.I)
"""What the first cell of a line of units may say, as those of LabVIEW do, far above the rows."""

COUNTING = re.compile(
    r"(?:#|no|nr|n|i|index|idx|sample\w*|point\w*|row|line|count\w*|scan\w*|rpm|order|period)\b"
    r"|#", re.I,
)  # fmt: skip
"""What the heading of a column starts with that holds neither times nor frequencies, but rises."""


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
    reason = (error.strerror or str(error)).lower()
    near = _alike(path) if isinstance(error, FileNotFoundError) else ""
    return SceneError(f"{path} cannot be read: {reason}{near}")


def _alike(path: Path) -> str:
    """A file in the folder of a missing one with nearly its name, or that there is no folder."""
    if not path.parent.is_dir():
        return f"; there is no folder {path.parent}"
    try:
        names = {each.name.lower(): each.name for each in path.parent.iterdir() if each.is_file()}
    except OSError:
        return ""
    near = [names[name] for name in difflib.get_close_matches(path.name.lower(), names, n=1)]
    return f"; did you mean {path.with_name(near[0])}?" if near and near[0].isprintable() else ""


@dataclass(frozen=True, kw_only=True)
class Heading:
    """What stands above a column: its cells from the top down, its unit, and where that stands."""

    cells: tuple[str, ...] = ()
    unit: Unit | None = None
    line: int = 0

    @property
    def name(self) -> str:
        """The lowest cell that is no unit, empty if there is no cell."""
        lowest = self.cells[-1] if self.cells else ""
        return next((cell for cell in reversed(self.cells) if not _is_unit(cell)), lowest)

    def called(self, name: str) -> bool:
        """Whether the column goes by a name, with or without the unit in it, in any case."""
        wanted = name.strip().casefold()
        return any(
            wanted in (cell.casefold(), re.sub(r"\s*[\[(].*", "", cell).casefold())
            for cell in self.cells
        )

    def mentions(self, name: str) -> bool:
        """Whether a name is one of the words of the heading, in any case."""
        return any(name.strip().casefold() in cell.casefold().split() for cell in self.cells)

    def is_of(self, quantity: str) -> bool:
        """Whether the heading says that the column holds times, or frequencies."""
        named = re.match(rf"(?:{ABSCISSAE[quantity]})\b", self.name, re.I)
        return self.unit.quantity == quantity if self.unit else named is not None

    @property
    def counts(self) -> bool:
        """Whether the heading says that the column numbers the rows, or holds rpm or orders."""
        return self.unit is None and COUNTING.match(self.name) is not None


@dataclass(frozen=True, kw_only=True)
class TextTable:
    """The rows of a text file, still text, and the headings of its columns.

    `lines` are the rows with their numbers in the file, and `remarks` all other lines; `stated` is
    the one unit of a density that the lines above the rows state, and `stated_line` the number of
    that line.
    """

    path: Path
    lines: Sequence[tuple[int, str]]
    remarks: Sequence[tuple[int, str]]
    delimiter: str | None
    headings: Sequence[Heading]
    decimal_comma: bool
    stated: Unit | None
    stated_line: int

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
        return bool(STAMP.fullmatch(_cells(self.lines[0][1], self.delimiter)[place]))

    def columns(self, *places: int) -> list[Vector]:
        """The numbers of some columns, NaN where one is missing; of time stamps, s after the first.

        Raises
        ------
        SceneError
            With the line that is not as the others are.
        """
        count = len(self.headings)
        stamped = [self.is_stamp(place) for place in places]
        found = [array("d") for _ in places]
        first: dict[int, datetime] = {}
        for line, text in self.lines:
            cells = _cells(text, self.delimiter)
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
    needed, wanted = len(names), f"{_counted(len(names))} ({', '.join(names)})"
    text = _plainly_written(decoded(path, largest).replace("\r\n", "\n").replace("\r", "\n"))
    lines = [
        (number, line)
        for number, line in enumerate(text.split("\n"), start=1)
        if line.strip(" \t\f\v\ufeff;,") and not line.startswith("sep=")
    ]
    content = [(number, plain) for number, line in lines if (plain := _uncommented(line))]
    delimiter, count, full = _layout([line for _, line in content[:SAMPLE]], needed)
    begin = 0
    for number, line in content if count else ():
        cells = _cells(line, delimiter)
        while len(cells) > count and not cells[-1]:
            cells.pop()
        values = _values(cells)
        if len(cells) == count and (values == count if full else values >= needed):
            break
        if not _is_count(line, content[begin + 1 :], delimiter, count):
            _check_heading(path, number, line, cells, count)
        begin += 1
    if not count or begin == len(content):
        for number, line in content:
            if names[0] == "time" and _number(line.strip()):
                raise SceneError(
                    f"{path}, line {number}: expected {wanted}, got {line[:60]!r}; for values "
                    "without times give fs, the sampling rate in Hz"
                )
            if re.match(r"\W{0,2}\d", line):
                dated = re.match(r"\W?\d+([-/.:])\d+\1\d+", line)
                remedy = "; write times in seconds or as 2024-05-01T12:00:00.000" if dated else ""
                raise SceneError(
                    f"{path}, line {number}: expected {wanted}, got {line[:60]!r}{remedy}"
                )
        shown = f", got {content[0][1][:60]!r}" if content else ""
        raise SceneError(f"{path} holds no rows of {wanted}{shown}")
    rows = content[begin:]
    above = [(number, line) for number, line in lines if number < rows[0][0]]
    below = [(number, line) for number, line in lines[len(above) :] if not _uncommented(line)]
    some = [_cells(line, delimiter) for _, line in rows[:SAMPLE]]
    stated, stated_line = _stated_density(above)
    _check_thousands(path, rows, delimiter)
    return TextTable(
        path=path, lines=rows, remarks=above + below, delimiter=delimiter,
        stated=stated, stated_line=stated_line,
        headings=_headings(
            above, delimiter, count, len(some[0]), bool(STAMP.fullmatch(some[0][0]))
        ),
        decimal_comma=any("," in cell for cells in some for cell in cells if _number(cell)),
    )  # fmt: skip


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
        for cell in filter(_number, _cells(row, delimiter)):
            if re.fullmatch(r"[+-]?[1-9]\d{0,2},\d{3}", cell):
                example = example or f"{path}, line {line}: {cell!r}"
            elif not cell.lstrip("+-").isdigit():
                return
    if example:
        raise SceneError(
            f"{example} may be a number with a decimal comma or thousands; expected one that can "
            "be read in one way only; write decimal points, and no sign between thousands"
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
    return (line.split("#")[0] if "#" in line else line).strip(" \ufeff")


def _number(cell: str) -> bool:
    return bool(NUMBER.fullmatch(cell))


def _values(cells: Sequence[str]) -> int:
    """How many cells hold a number or a time stamp, or say that one is missing beside one."""
    held = sum(_number(cell) or bool(STAMP.fullmatch(cell)) for cell in cells)
    return held and held + sum(cell.casefold() in MISSING for cell in cells)


def _cells(line: str, delimiter: str | None) -> list[str]:
    if '"' in line:
        around = {"skipinitialspace": True, "delimiter": delimiter or " "}
        return [cell.strip() for cell in next(csv.reader([line.strip()], **around))]  # type: ignore[arg-type]
    if delimiter is None:
        return line.split()
    return [cell.strip() for cell in line.split(delimiter)]


def _layout(lines: Sequence[str], needed: int) -> tuple[str | None, int, bool]:
    """What parts the cells of most lines that hold numbers, how many cells a line has, and whether
    all of them are numbers."""
    best = (0, 0)
    choice: tuple[str | None, int, bool] = None, 0, False
    for delimiter in DELIMITERS:
        whole: Counter[int] = Counter()
        part: Counter[int] = Counter()
        rows = [_cells(line, delimiter) for line in lines]
        # counts of cells of rows whose last cell is used, if only now and then
        used = {len(cells) for cells in rows if cells and cells[-1] and _values(cells) > needed}
        for cells in rows:
            if len(cells) > needed and not cells[-1] and len(cells) not in used:
                cells.pop()  # the delimiter ends the line
            if sum(map(bool, cells)) >= needed and (delimiter is None or len(cells) > 1):
                values = _values(cells)
                whole[len(cells)] += values == len(cells)
                part[len(cells)] += values >= needed
        for counts, full in ((whole, True), (part, False)):
            usual, number = max(((n, -count) for count, n in counts.items()), default=(0, 0))
            score = (usual, 0) if full else (0, usual)
            if score > best:
                best, choice = score, (delimiter, -number, full)
    if choice == (",", 2, True) and needed == 1 and _decimal_fractions(lines):
        return None, 1, True
    return choice


def _decimal_fractions(lines: Sequence[str]) -> bool:
    """Whether a comma in "0,07" is a decimal sign: no whole number starts with a zero."""
    pairs = [cells for line in lines if len(cells := _cells(line, ",")) == 2]
    whole = all((cell.lstrip("+-") or "0").isdigit() for cells in pairs for cell in cells)
    return whole and any(re.fullmatch(r"0\d+", cells[1]) for cells in pairs)


def _is_count(
    line: str, below: Sequence[tuple[int, str]], delimiter: str | None, count: int
) -> bool:
    """Whether a line holds nothing but the number of rows below it, as some analysers write it."""
    alone = line.strip()
    if count < 2 or not re.fullmatch(r"[0-9]{1,9}", alone):
        return False
    return int(alone) == sum(_values(_cells(row, delimiter)) >= count for _, row in below)


def _check_heading(path: Path, number: int, line: str, cells: Sequence[str], count: int) -> None:
    """A line above the rows is a heading, unless it looks like a row that is wrong."""
    numeric = [_number(cell) for cell in cells]
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


def _counted(count: int) -> str:
    return {1: "one number", 2: "two numbers"}.get(count, f"{count} numbers")


# headings ---------------------------------------------------------------------------------


def _headings(
    above: Sequence[tuple[int, str]], delimiter: str | None, count: int, longest: int, stamped: bool
) -> list[Heading]:
    """The headings of the columns, from the last lines above the rows that have as many cells, and
    from a line that says that it holds units. `longest` is the number of cells of a row with the
    empty ones at its end, which a heading may name."""
    fitting: list[tuple[int, list[str]]] = []
    for number, line in above[:-LAST_HEADINGS]:
        cells = _heading_cells(line, delimiter, count, longest, stamped)
        if cells and count > 1 and ROW_OF_UNITS.match(cells[0]):
            fitting.append((number, ["", *cells[1:]]))
    for number, line in above[-LAST_HEADINGS:]:
        if cells := _heading_cells(line, delimiter, count, longest, stamped):
            fitting.append((number, cells))
    found = []
    # the name of a column is not looked for in a line of units
    named = sorted(fitting, key=lambda each: not _holds_units(each[1]))
    for place in range(count):
        stack = tuple(row[place] for _, row in named if row[place])
        unit_line = [
            (known, number)
            for number, row in reversed(fitting)
            if (known := unit_in(row[place], all(map(_is_unit, filter(None, row)))))
        ]
        known, number = unit_line[0] if unit_line else (None, 0)
        found.append(Heading(cells=stack, unit=known, line=number))
    return found


def _holds_units(cells: Sequence[str]) -> bool:
    """Whether most cells of a heading are units."""
    filled = list(filter(None, cells))
    return 2 * sum(map(_is_unit, filled)) > len(filled)


def _heading_cells(
    line: str, delimiter: str | None, count: int, longest: int, stamped: bool
) -> list[str] | None:
    """The cells of a heading, one for each column; None of a line that has another number."""
    text = re.sub(r"^\s*(?:#|%|//)+\s*", "", line)
    # a unit in brackets belongs to the name before it
    glued = re.sub(r"\s+(?=[\[(])", GLUE, text.strip())
    for each in (delimiter, *(other for other in DELIMITERS if other != delimiter)):
        cells = _cells(glued if each is None else text, each)
        while len(cells) > count and not cells[-1]:
            cells.pop()
        if stamped and len(cells) == count + 1:
            cells = [f"{cells[0]} {cells[1]}", *cells[2:]]  # a date and a time of day
        if (len(cells) == count or (each and count < len(cells) <= longest)) and any(cells):
            return [cell.replace(GLUE, " ") for cell in cells[:count]]
    return None


def _is_unit(cell: str) -> bool:
    return _known(cell.strip("[]()")) is not None or _known(cell) is not None


def _known(spelling: str) -> Unit | None:
    """The unit of a spelling; None for what is no unit."""
    try:
        return unit(spelling)
    except ValueError:
        return None


def unit_in(text: str, alone: bool = False) -> Unit | None:
    """The unit that a heading states: in brackets, at its end, or after an underscore.

    Parameters
    ----------
    alone
        Whether the heading is of a line of units, so that a single letter is one as well.

    Examples
    --------
    >>> unit_in("ASD run 1 (g^2/Hz)").name, unit_in("PSD (m/s2)^2/Hz").name
    ('g2/Hz', '(m/s2)2/Hz')
    >>> unit_in("acceleration_g").name, unit_in("G"), unit_in("G", alone=True).name
    ('g', None, 'g')
    """
    found: Unit | None
    for inner in _bracketed(text):
        if found := _known(inner):
            return found
    words = text.strip().split()
    for start in range(len(words)):
        ending = " ".join(words[start:])
        if start and _number(words[start - 1]):
            break  # a value and its unit, as in "sampling rate: 400 Hz"
        if re.search(r"[/^²]", ending) or ending.casefold() in ("hz", "khz"):
            found = _known(ending)
            if found and (found.quantity in DIMENSIONS.values() or start == len(words) - 1):
                return found
    if after := re.search(r",\s*(\S+)$", text):
        return _known(after[1])
    if labelled := LABELLED_UNIT.fullmatch(text.strip()):
        return _known(labelled[1])
    if named := NAMED_UNIT.fullmatch(text.strip()):
        return _known(named[1].replace("_per_", "/"))
    return _known(text.strip().strip("[]()")) if alone else None


def _bracketed(text: str) -> list[str]:
    """What stands in outermost brackets after which a word ends."""
    found, depth, start = [], 0, 0
    for place, letter in enumerate(text):
        if letter in "([":
            start = place + 1 if depth == 0 else start
            depth += 1
        elif letter in ")]" and depth:
            depth -= 1
            if depth == 0 and (place + 1 == len(text) or text[place + 1] in " ,:;"):
                found.append(text[start:place])
    return found


def _stated_density(above: Sequence[tuple[int, str]]) -> tuple[Unit | None, int]:
    """The unit of a density that lines above the rows state, if they state one alone."""
    found: dict[tuple[str, bool], tuple[Unit, int]] = {}
    for number, line in above:
        pieces = [*_bracketed(line), *re.split(r"[;,\t|]", line)]
        known = [unit_in(piece) or (_known(piece) if "/" in piece else None) for piece in pieces]
        if not any(known) and "dB" not in line:
            known = [_known(word.strip("[],;:")) for word in line.split() if "/" in word]
        for each in known:
            if each and each.quantity.endswith("density"):
                found[each.name, each.decibels] = each, number
    return next(iter(found.values())) if len(found) == 1 else (None, 0)
