"""Tables of numbers in text, as instruments, spreadsheets and people write them. Chapters: cells of
a line; names and units of columns; which lines are rows, and their numbers."""

from __future__ import annotations

import codecs
import csv
import difflib
import io
import math
import re
from array import array
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import overload

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.units import (
    DENSITIES,
    DIMENSIONS,
    PREFIX_APART,
    ROOT,
    SPELLINGS,
    Unit,
    unit,
)
from stochvi.results.errors import SceneError, reason_of

# ------------------------------------------------------------------------------
# The cells of a line of text: how they are separated, and which of them hold numbers.
# ------------------------------------------------------------------------------


DELIMITERS = (";", "\t", "|", ",", None)
"""Delimiters that may separate the cells of a line; None stands for any number of blanks."""

NUMBER = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eEdD][+-]?\d+)?")
"""Pattern of a number with a decimal point or comma; its exponent may begin with d (Fortran)."""

CLOCK = re.compile(r"\d\d:\d\d:\d\d(?:[.,]\d+)?")
"""Pattern of a time of day without a date."""

STAMP = re.compile(
    r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d\S*|\d{8}T\d{6}(?:[.,]\d+)?(?:Z|[+-]\d{4})?|" + CLOCK.pattern
)
"""Pattern of an ISO 8601 date with a time of day, or of a time of day alone."""

MISSING = frozenset(
    ("", "nan", "na", "n/a", "null", "none", "-", "--", "---", "inf", "-inf",
     "#n/a", "#na", "#nv", "#value!", "#wert!", "#num!", "#zahl!", "#div/0!", "#ref!", "#bezug!",
     "nan(ind)", "-nan(ind)", "1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind", "1.#inf", "-1.#inf",
     "1.#nan")
)  # fmt: skip
"""Texts, in small letters, of cells without a measured value. They include the errors of
spreadsheets, and the texts for infinity and NaN that C libraries of Windows print."""


STARTS_FORMULA = re.compile(r"\s*[=+\-@\uff1d\uff0b\uff0d\uff20].|[\t\r\n]", re.S)
"""Start of a text that a spreadsheet runs as a formula, also with signs of full width, and after
blanks, which some leave out."""

LINE_ENDS = re.compile(r"\r\n?|[\n\v\f\x1c-\x1e\x85\u2028\u2029]")
"""Characters that may end a row of a table for one of its readers."""


def as_text(cell: str) -> str:
    """A text as a spreadsheet shows it and does not run it, in one line, with an apostrophe before
    a formula.

    >>> as_text("=1+1"), as_text("-0.5"), as_text("lower"), as_text("a\\r=1+1")
    ("'=1+1", '-0.5', 'lower', 'a =1+1')
    """
    formula = STARTS_FORMULA.match(cell) and not is_number(cell)
    return ("'" if formula else "") + LINE_ENDS.sub(" ", cell)


def is_number(cell: str) -> bool:
    """Whether a cell holds a number and nothing else."""
    return bool(NUMBER.fullmatch(cell))


def count_values(cells: Sequence[str]) -> int:
    """Number of cells with a number or time stamp; if there are any, cells for missing values count
    as well."""
    held = sum(is_number(cell) or bool(STAMP.fullmatch(cell)) for cell in cells)
    return held and held + sum(cell.casefold() in MISSING for cell in cells)


def split_cells(line: str, delimiter: str | None) -> list[str]:
    """The cells of a line, without quotes and blanks around them."""
    if '"' in line:
        around = {"skipinitialspace": True, "delimiter": delimiter or " "}
        try:
            return [cell.strip() for cell in next(csv.reader([line.strip()], **around))]  # type: ignore[arg-type]
        except csv.Error:  # a cell of more than 131,072 characters is no number
            pass
    if delimiter is None:
        return line.split()
    return [cell.strip() for cell in line.split(delimiter)]


# ------------------------------------------------------------------------------
# Names and units of the columns of a text file, from the lines above its rows.
# ------------------------------------------------------------------------------


LAST_HEADINGS = 3
"""Number of lines above the numbers that may name the columns and their units."""

LONGEST_HEADING = 1000
"""Number of characters of a cell in which a name or a unit is looked for."""

GLUE = "\0"
"""Character in place of a blank at which a line is not split; decoded text never contains it."""

ABSCISSAE = {
    "time": r"t|time\w*|zeit\w*|temps|date\w*|datum",
    "frequency": r"f|freq\w*|frequenz|fréquence|k?hz",
}
"""Quantity of the column of times or frequencies -> pattern of its names in headings."""

NAMED_UNIT = re.compile(
    r"(?:(?:acc[a-z]*[_ ])?(?:psd|asd)|acc[a-z]*|a|beschleunigung|force|kraft|deflection|weg|y|"
    r"density|time(?:stamp)?|t|zeit|frequency|freq|f|level)"
    r"(?:[_ ][xyz])?(?:_| in | )(\S+)", re.I,
)  # fmt: skip
"""Pattern of a name with a unit, such as acceleration_g, density_g2_per_hz or "Time ms"."""

ANY_UNIT = re.compile(r".*(?: in |_(?=g\b|..))(\S+)", re.I)
"""Pattern of any name with a unit, such as "Kraft in kN" or seat_mg. Some letters are units as
well as indices: only g counts after an underscore."""

QUANTITY_OVER_UNIT = re.compile(r"[^/]*\w\s*/\s*(\S+)")
"""Pattern of a name over its unit, "f/kHz", the heading of a column by ISO 80000-1."""

RAW = r"(?:[mµu]?V|[np]C|[cC]ounts?|LSB|[Dd]igits?|(?i:(?:milli)?volts?))"
"""Pattern of a unit that a logger writes for values not yet scaled to a quantity."""

UNSCALED = re.compile(
    rf"[\[(]\s*({RAW}(?:(?:\^?2|²)?\s*/[^\])]+)?)\s*[\])]|(?:^|[_/ ])([mµu]V|[np]C|(?<=/)V)$|"
    r"(?<= in )(V)$|\b(?i:(volts?|millivolts?|voltage|spannung))\b"
)
"""Pattern of a heading with such a unit. V alone may also name what is vertical."""

SENSITIVITY = re.compile(
    rf"(?<![^\s,;])[^\s,;]*{RAW}\s*(?:/|\bper\b)\s*(?!Hz)\S+|"
    rf"(?<!\S)\S+\s*(?:/|\bper\b)\s*{RAW}\b"
)
"""Pattern of the sensitivity of a sensor, "100 mV/g", whose g is not the unit of the values. It
begins where words do, so that the time it takes is that of a reading."""

LABELLED_UNIT = re.compile(
    r"(?:[xy][_ ])?(?:units?|einheit(?:en)?)(?:[_ ]label)?\s*[:=]\s*(\S+)", re.I
)
"""Pattern of a line such as "Unit: g", with the unit in it."""

ROW_OF_UNITS = re.compile(r"(?:[xy][_ ])?(?:units?|einheit(?:en)?)\b|(?:[xy][_ ])?unit_label", re.I)
"""Pattern of the first cell of a line of units, which LabVIEW writes far above the rows."""

ONE_ABSCISSA = re.compile(
    rf"(?:{'|'.join(ABSCISSAE.values())})(?:\s*[\[(/]\s*|_|\s+in\s+)[^\s\])]+[\])]?", re.I
)
"""Pattern of the heading of a column of times or frequencies with its unit, and nothing else."""

COUNTING = re.compile(
    r"(?:#|no|nr|n|i|index|idx|sample\w*|point\w*|row|line|count\w*|scan\w*|rpm|order|period|"
    r"speed|drehzahl|omega|ω)\b"
    r"|#", re.I,
)  # fmt: skip
"""Pattern of the start of the heading of a column that rises without being time or frequency."""


@dataclass(frozen=True, kw_only=True)
class Heading:
    """The heading of a column: its cells from the top down, its unit, and the line of the unit."""

    cells: tuple[str, ...] = ()
    unit: Unit | None = None
    line: int = 0

    @property
    def name(self) -> str:
        """The lowest cell that is not a unit, or the lowest if all are units; empty if none."""
        lowest = self.cells[-1] if self.cells else ""
        return next((cell for cell in reversed(self.cells) if not _is_unit(cell)), lowest)

    def called(self, name: str) -> bool:
        """Whether a cell is the name `name`, with or without a unit in brackets, ignoring case."""
        wanted = name.strip().casefold()
        return any(
            wanted in (cell.casefold(), re.sub(r"\s*[\[(].*", "", cell).casefold())
            for cell in self.cells
        )

    def mentions(self, name: str) -> bool:
        """Whether a name is one of the words of the heading, ignoring case."""
        return any(name.strip().casefold() in cell.casefold().split() for cell in self.cells)

    def is_of(self, quantity: str) -> bool:
        """Whether the heading states that the column holds the quantity, "time" or "frequency"."""
        named = re.match(rf"(?:{ABSCISSAE[quantity]})\b", self.name, re.I)
        return self.unit.quantity == quantity if self.unit else named is not None

    @property
    def contradiction(self) -> Unit | None:
        """Another unit of the same quantity that one of the cells states."""
        known = self.unit
        stated = (unit_in(cell, alone=_is_unit(cell)) for cell in self.cells)
        alike = (each for each in stated if known and each and each.quantity == known.quantity)
        return next((each for each in alike if known and not each.same(known)), None)

    @property
    def unread(self) -> str:
        """The text in place of a unit, if it is not a known unit; otherwise empty."""
        if self.unit is not None or not self.name:
            return ""
        over = QUANTITY_OVER_UNIT.fullmatch(self.name)
        found = [*_bracketed(self.name), *([over[1]] if over else [])]
        found += re.findall(r"(?<=[ _])V$|^[cC]ounts?$", self.name)  # or of what is vertical
        named = (pattern.fullmatch(self.name) for pattern in (NAMED_UNIT, ANY_UNIT))
        found += filter(may_be_unit, (*(each[1] for each in named if each), *self.cells[1:]))
        texts = [text for text in found if re.search(r"[^\W\d]", text)]
        return next(filter(may_be_unit, texts), next(iter(texts), ""))

    @property
    def unscaled(self) -> str:
        """The unit of a logger, "mV", for values that are not scaled to a quantity; else empty."""
        if self.unit is not None:
            return ""
        found = [next(filter(None, m.groups())) for m in map(UNSCALED.search, self.cells) if m]
        bare = [cell.strip("[]()") for cell in self.cells[1:]]  # in a line of units
        return next((text for text in (*found, *bare) if text in found or text == "V"), "")

    def check_scaled(self) -> None:
        """Refuse values that are not scaled to a quantity, whatever unit a scene says."""
        if found := self.unscaled:
            raise SceneError(
                "file",
                f"has the heading {' '.join(self.cells)!r} above its values, expected "
                f"no {found}; divide the values by the sensitivity of the sensor (V per g; a "
                "density by its square), and mend the heading",
            )

    @property
    def counts(self) -> bool:
        """Whether the heading states that the column holds row numbers, rpm or orders."""
        return self.unit is None and COUNTING.match(self.name) is not None


def headings_above(
    above: Sequence[tuple[int, str]], delimiter: str | None, count: int, longest: int, stamped: bool
) -> list[Heading]:
    """The headings of the columns.

    They come from the last lines above the rows with as many cells as there are columns. Lines
    farther above count if they name columns with their units. A line that names more columns than
    there are is taken for those on the left, if the others have no units: an unfilled column of
    remarks. `longest` is the number of cells of a row including empty ones at its end.

    Raises
    ------
    MisfitHeading
        If a line names columns with units, but not those of the rows: nothing says which is which.
    """
    fitting: list[tuple[int, list[str], bool]] = []
    last, misfit = len(above) - LAST_HEADINGS, None
    for place, (number, line) in enumerate(above):
        own = len(line) if place == len(above) - 1 else longest * (place >= last)
        cells = _heading_cells(line, delimiter, count, longest, own, stamped)
        if cells is None:
            continue
        names = _names_columns(cells) or (delimiter and any(map(_is_abscissa, cells)))
        if len(cells) == count and place < last and not names:
            continue
        if len(cells) != count and not _fits_from_the_left(cells, count):
            over = any(map(_is_abscissa, cells[len(cells) > count :]))
            if _one_value(line, cells, count) or not (over or any(map(_states_unit, cells))):
                continue
            misfit = misfit or MisfitHeading(number, len(cells))
            continue
        labelled = ROW_OF_UNITS.match(cells[0]) is not None and count > 1
        cells = _without_label(cells[:count]) if labelled else cells[:count]
        fitting.append((number, cells, labelled or _all_units(cells)))
    # a sentence above the headings may name units as well
    if misfit is not None and not any(
        number > misfit.line and all(map(_states_unit, row)) for number, row, _ in fitting
    ):
        raise misfit
    found = []
    # lines of units come last, because the name of a column is not looked for there
    named = sorted(fitting, key=lambda each: not _holds_units(each[1]))
    for place in range(count):
        stack = tuple(row[place] for _, row, _ in named if row[place])
        unit_line = [
            (known, number)
            for number, row, alone in reversed(fitting)
            if (known := unit_in(row[place], alone))
        ]
        known, number = unit_line[0] if unit_line else (None, 0)
        found.append(Heading(cells=stack, unit=known, line=number))
    return found


def _holds_units(cells: Sequence[str]) -> bool:
    """Whether most cells of a heading are units."""
    filled = list(filter(None, cells))
    return 2 * sum(map(_is_unit, filled)) > len(filled)


class MisfitHeading(Exception):
    """A heading in line `line` that names `count` columns with units, another number than the rows
    have."""

    def __init__(self, line: int, count: int) -> None:
        self.line, self.count = line, count


def _heading_cells(
    line: str, delimiter: str | None, count: int, longest: int, own: int, stamped: bool
) -> list[str] | None:
    """The cells of a line above the rows, if there is one for each column or the line names
    columns; otherwise None.

    A line that is parted as the rows are, and has up to `own` cells, names columns. It does not
    where its first cell states what only the values can be in.
    """
    text = re.sub(r"^\s*(?:#|%|//)+\s*", "", line)
    # a unit in brackets belongs to the name before it
    glued = re.sub(r"(?<![\s\])-])\s+(?=[\[(])", GLUE, text.strip())
    for each in sorted(DELIMITERS, key=lambda other: (other is None, other != delimiter)):
        split = split_cells(glued if each is None else text, each)
        cells = [cell.replace(GLUE, " ")[:LONGEST_HEADING] for cell in split]
        if each is None and delimiter and delimiter in text:
            continue
        if not any(cells):
            continue
        if each is None and len(cells) != count and _all_units(text.split()):
            cells = text.split()
        # of a line with empty cells within, those at its end may be of columns that are missing
        if all(cells[:count]) or (each == delimiter and len(cells) <= longest):
            while len(cells) > count and not cells[-1]:
                cells.pop()
        if stamped and len(cells) == count + 1:
            cells = [f"{cells[0]} {cells[1]}", *cells[2:]]  # a date and a time of day
        if each == delimiter and count < len(cells) == longest:
            # as wide as the rows are with the empty cells at their ends
            return cells if any(map(_states_unit, cells[count:])) else cells[:count]
        if count == 1 and (unit_in(cells[0]) or _all_units(cells)):
            return cells[:1] if cells[0] else cells
        if len(cells) == count > 1 and (each or not _is_sentence(cells, delimiter)):
            return cells
        several = len(cells) > 1
        while all(cells[:count]) and not cells[-1]:
            cells.pop()
        if each is None:
            cells = _joined(cells, count)
        parted = each is not None and each == delimiter and len(cells) <= own
        is_row = not _states_unit(cells[0]) if len(cells) > count else _names_abscissa(cells)
        is_row &= parted and not any(map(is_number, cells))
        if several and (is_row or _names_columns(cells)):
            return cells
    # nor may the unit of times or frequencies be passed over where it stands alone
    text = text.strip().strip('"')
    alone = unit_in(text, alone=True) if _is_unit(text) else None
    scaled = alone and alone.quantity in ABSCISSAE and alone.factor != 1.0
    return [text] if count == 1 or scaled or _scales(text) else None


def _names_columns(cells: Sequence[str]) -> bool:
    """Whether a line names columns: two of its cells state units, or the first one is of time or
    frequency and another one states the unit of something else. Sentences do neither."""
    if any(map(is_number, cells)):
        return False
    if ROW_OF_UNITS.match(cells[0]):
        return len(cells) > 2 or cells[0] == "Y_Unit_Label"
    if _all_units(cells):
        return True
    stated = [known for cell in cells if (known := unit_in(cell))]
    if len(stated) > 1 or any(map(_scales, cells)):
        return True
    return _is_abscissa(cells[0]) and any(each.quantity not in ABSCISSAE for each in stated)


def _scales(cell: str) -> bool:
    """Whether a cell names times or frequencies in another unit than s and Hz."""
    known = unit_in(cell) if ONE_ABSCISSA.fullmatch(cell.strip()) else None
    return known is not None and known.factor != 1.0


def _is_abscissa(cell: str) -> bool:
    """Whether a cell names a column of times or frequencies; F and T may be others."""
    return cell not in ("F", "T") and any(
        map(Heading(cells=(cell,), unit=unit_in(cell)).is_of, ABSCISSAE)
    )


def _names_abscissa(cells: Sequence[str]) -> bool:
    """Whether a cell is a name of times or frequencies and nothing else."""
    pattern = "|".join(ABSCISSAE.values())
    return any(re.fullmatch(pattern, cell, re.I) for cell in cells)


def _is_sentence(words: Sequence[str], delimiter: str | None) -> bool:
    """Whether the words of a line are no names of columns: they begin as no heading does, and there
    are numbers among them, or the cells of the rows are not parted by blanks."""
    named = _is_abscissa(words[0]) or unit_in(words[0]) is not None
    doubtful = delimiter is not None or any(map(is_number, words))
    return doubtful and not named and not _names_columns(words)


def _fits_from_the_left(cells: Sequence[str], count: int) -> bool:
    """Whether the first cells of a line that names too many columns must be those of the rows: all
    up to the last one with a unit state units, or time or frequency."""
    sure = [_states_unit(cell) or _is_abscissa(cell) for cell in cells]
    last = max((n for n, known in enumerate(sure, start=1) if known), default=0)
    return last <= count < len(cells) and all(sure[:last])


def _all_units(cells: Sequence[str]) -> bool:
    """Whether a line holds units alone, with "-" for none."""
    return all(_is_unit(cell) for cell in cells if cell.strip("[-]"))


def _states_unit(cell: str) -> bool:
    return unit_in(cell) is not None or _is_unit(cell)


def _without_label(cells: list[str]) -> list[str]:
    """A line of units without the text before the first of them, "Units" or "Unit: mm"."""
    labelled = LABELLED_UNIT.fullmatch(cells[0])
    return [labelled[1] if labelled else "", *cells[1:]]


def _joined(cells: list[str], count: int) -> list[str]:
    """The words of a line with those of one name joined, if each of `count` names ends in a unit.

    >>> _joined("Frequency [Hz] PSD of run [g2/Hz]".split(), 2)
    ['Frequency [Hz]', 'PSD of run [g2/Hz]']
    """
    ends = [n for n, cell in enumerate(cells, start=1) if unit_in(cell)]
    if len(ends) != count or ends[-1] < len(cells):
        return cells
    return [" ".join(cells[start:end]) for start, end in zip([0, *ends], ends, strict=False)]


def _one_value(line: str, cells: Sequence[str], count: int) -> bool:
    """Whether a line states one unit, of what only one column can hold, and `stated_unit` finds it
    there."""
    alone = _all_units(cells)
    units = {known.name: known for cell in cells if (known := unit_in(cell, alone))}
    quantities = {known.quantity for known in units.values()}
    alike = quantities <= set(DENSITIES) or (count < 3 and quantities.isdisjoint(ABSCISSAE))
    return len(units) == 1 and alike and stated_unit([(0, line)], quantities)[0] is not None


def _is_unit(cell: str) -> bool:
    inner = cell[1:-1] if cell[:1] + cell[-1:] in ("[]", "()") else cell
    return _known(inner) is not None or _known(cell) is not None


def _known(spelling: str) -> Unit | None:
    """The unit of a spelling; None if it is not a known unit."""
    try:
        return unit(spelling)
    except ValueError:
        return None


def may_be_unit(text: str) -> bool:
    """Whether a text that is no known unit has the signs of one, or a unit among its words.

    >>> [may_be_unit(text) for text in ("1e-3 g", "g/1000", "counts", "V", "front left")]
    [True, True, True, True, False]
    """
    words = {word.removesuffix("s") for word in re.findall(r"[A-Za-zµμ]+", text)}
    return bool(re.search(r"[/^²√]|^V$|ounts?$", text) or not words.isdisjoint(SPELLINGS))


def unit_in(text: str, alone: bool = False) -> Unit | None:
    """The unit that a heading states: in brackets, at its end, after a slash or an underscore.

    Parameters
    ----------
    alone
        Whether the heading is in a line of units, so that a single letter is a unit as well.

    Examples
    --------
    >>> unit_in("ASD run 1 (g^2/Hz)").name, unit_in("PSD (m/s2)^2/Hz").name
    ('g2/Hz', '(m/s2)2/Hz')
    >>> unit_in("acceleration_g").name, unit_in("G"), unit_in("G", alone=True).name
    ('g', None, 'g')
    >>> unit_in("t/ms").name, unit_in("psd_m2_s4_Hz").name
    ('ms', '(m/s2)2/Hz')
    """
    found: Unit | None
    if len(text) > LONGEST_HEADING:
        return None
    text = PREFIX_APART.sub(r"\1", SENSITIVITY.sub(" ", text))
    text = ROOT.sub(lambda found: f"√{found[1]}" if found[1] else found[0], text)
    for inner in _bracketed(text):
        if found := _known(inner):
            return found
    words = re.sub(r"(?<=\w)(?=[\[(])", " ", text).split()
    for start in range(len(words)):
        ending = " ".join(words[start:])
        if start and is_number(words[start - 1].lstrip("±")):
            break  # a value and its unit, as in "sampling rate: 400 Hz"
        signs = re.search(r"[/^²⁻]", ending) or ending.casefold() in ("hz", "khz", "cpm")
        if signs or re.search(r"[a-zA-Z)]-\d", ending):
            found = _known(ending)
            usual = found and found.quantity in DIMENSIONS.values()
            if usual or (found and signs and start == len(words) - 1 and not ending[0].isdigit()):
                return found
    if after := re.search(r",\s*(\S+)$", text):
        return _known(after[1])
    if labelled := LABELLED_UNIT.fullmatch(text.strip()):
        return _known(labelled[1])
    if named := NAMED_UNIT.fullmatch(text.strip()):
        name = re.sub(r"_per_|(?<=\d)_(?=[a-z])|(?<=\bm)_(?=s)", "/", named[1], flags=re.I)
        if found := _known(name):
            return found
    for pattern in (ANY_UNIT, QUANTITY_OVER_UNIT):
        stated = pattern.fullmatch(text.strip())
        found = _known(stated[1]) if stated else None
        if found and found.quantity in DIMENSIONS.values():
            return found
    return _known(text.strip().strip("[]()")) if alone else None


def _bracketed(text: str) -> list[str]:
    """The texts within outermost brackets that are followed by the end of a word."""
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


def stated_unit(
    above: Sequence[tuple[int, str]], quantities: Collection[str]
) -> tuple[Unit | None, int]:
    """The unit of some quantities that the lines above the rows state, and its line; (None, 0) if
    they state none or several."""
    found: dict[tuple[str, bool], tuple[Unit, int]] = {}
    for number, whole in above:
        line = SENSITIVITY.sub(" ", whole)
        text = line.strip(' #%/"')
        pieces = [*_bracketed(line), *re.split(r'"?[;,\t|]"?', text)]
        known = [unit_in(piece, piece == text) or _of_fraction(piece) for piece in pieces]
        if not any(known) and "dB" not in line:
            words = [word.strip('[],;:"±') for word in line.split()]
            known = [
                each
                for before, word in pairwise(["", *words])
                if (each := unit_in(word) or _of_fraction(word))
                # "range 500 m/s2" is no unit of the values
                and (each.quantity in DENSITIES or not is_number(before))
            ]
        for each in known:
            if each and each.quantity in quantities:
                found[each.name, each.decibels] = each, number
    return next(iter(found.values())) if len(found) == 1 else (None, 0)


def _of_fraction(text: str) -> Unit | None:
    """The unit of a text with a slash, which no plain word has."""
    return _known(text) if "/" in text else None


# ------------------------------------------------------------------------------
# Tables of numbers in text as instruments, spreadsheets and people write them: which lines are
# rows, and the numbers in them. The chapters before read names and units of columns, and split a
# line.
# ------------------------------------------------------------------------------


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

PIECE = 4_000_000
"""Length of each part of a large text that is read at once, bytes: some tenths of a second."""

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
    indexed: bool = False
    """Whether the first column is the index of a frame, which is not counted."""

    def number(self, place: int) -> int:
        """The number of a column, from 1; 0 of an index."""
        return place + 1 - self.indexed

    @property
    def numbers(self) -> Sequence[int]:
        """The numbers of the lines of the rows in the file."""
        if self.values is not None:
            return range(self.lines[0][0], self.lines[0][0] + len(self.lines))
        return [number for number, _ in self.lines]

    def stated(self, *quantities: str) -> tuple[Unit | None, int]:
        """The one unit of some quantities that the lines above the rows state, and its line."""
        return stated_unit(self.above, quantities)

    @property
    def labelled(self) -> str:
        """The text after "Unit:" above the rows, if it is no known unit, but may be one."""
        found = [label[1] for _, line in self.above for label in LABELLED_UNIT.finditer(line)]
        return next((text for text in found if not _known(text) and may_be_unit(text)), "")

    def column_called(self, column: int | str) -> int:
        """Place of a column, from 0, by its name or its number, which counts from 1."""
        if isinstance(column, int):
            if not 1 <= column <= self.number(len(self.headings) - 1):
                raise SceneError("column", f"is {column}, but {self.path} {self._holds()}")
            return column - 1 + self.indexed
        found = [place for place, each in enumerate(self.headings) if each.called(column)]
        if not found:
            found = [place for place, each in enumerate(self.headings) if each.mentions(column)]
        if not found:
            entries = enumerate(self._listed, start=int(self.indexed))
            found = [place for place, entry in entries if entry == column]
        if len(found) != 1:
            which = "several columns with" if found else "no column with"
            raise SceneError(
                "column",
                f"is {column!r}, but {self.path} has {which} this name: it {self._holds()}",
            )
        return found[0]

    def choose(self) -> SceneError:
        """The refusal of a file that holds more columns than are read."""
        places = range(len(self.headings))
        stated = [
            n for n in places if (known := self.headings[n].unit) and known.quantity in VALUES
        ]
        place = stated[-1] if stated else places[-1]
        name = self.headings[place].name
        number = self.number(place)
        by = f"{name!r} or column = {number}" if name else number
        return SceneError(
            "column",
            f"must say which column of {self.path} holds the values (column = {by}): "
            f"it {self._holds()}",
        )

    @property
    def _listed(self) -> list[str]:
        """The first columns, as messages list them."""
        counted = self.headings[self.indexed :][:COLUMNS_LISTED]
        return [f"{number} {each.name[:40]}".strip() for number, each in enumerate(counted, 1)]

    def _holds(self) -> str:
        listed = self._listed
        more = self.number(len(self.headings) - 1) - len(listed)
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
        if re.fullmatch(r"[\d.,]+\s*(?:[-\u2013]|to|bis)\s*[\d.,]+", cell):
            return SceneError(f"{got}; write its two ends in rows of their own")
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


def out_of_order(values: Vector, cut: str) -> tuple[int, str]:
    """The first row whose value is out of order, and what to do: `cut` where another table or run
    begins, else to sort. Sorting would mix two tables.

    >>> out_of_order(np.array([1.0, 2.0, 3.0, 1.0, 2.0, 3.0]), "keep one table")
    (3, 'keep one table, as a second one seems to begin there')
    """
    steps = np.diff(values)
    # most fall: several tables in descending order
    rising = -values if np.sum(steps < 0.0) > np.sum(steps > 0.0) else values
    rows = np.flatnonzero(np.diff(rising) < 0.0) + 1
    if rows[0] > 1 and rows[-1] + 1 < len(values) and np.all(rising[rows] <= rising[1]):
        return int(rows[0]), f"{cut}, as a second one seems to begin there"
    return int(rows[0]), f"sort the rows, or {cut} if a second one begins there"


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
    return table_of_text(path, decoded(path, largest), names)


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
        part = table_of_text(path, text, names)
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
        found = np.concatenate([
            np.loadtxt(io.BytesIO(lines), delimiter=part.delimiter, comments=None, ndmin=2)
            for lines in _pieces(body)
        ])  # fmt: skip
    except ValueError:
        return None
    if found.shape != (body.count(b"\n") + 1, len(part.headings)):
        return None
    found[~np.isfinite(found)] = np.nan
    return replace(part, lines=PlainRows(part.lines[0], len(found)), values=found)


def _pieces(body: bytes) -> Iterator[bytes]:
    """Lines in pieces: between two of them Python hears of Ctrl-C."""
    start = 0
    while start < len(body):
        end = body.find(b"\n", start + PIECE) + 1 or len(body)
        yield body[start:end]
        start = end


def table_of_text(path: Path, written: str, names: Sequence[str]) -> TextTable:
    """The rows and headings of a text, as `read_text_table` finds them in a file."""
    needed, wanted = len(names), f"{_counted(len(names))} ({', '.join(names)})"
    text = _plainly_written(written.replace("\r\n", "\n").replace("\r", "\n"))
    if text.startswith("LabVIEW Measurement"):
        text = _as_one_packet(text)
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
            filled = any(any(row[place : place + 1]) for row in some)
            if each.unit and filled and place not in numeric:
                raise MisfitHeading(each.line, count)
            if each.unit and (other := each.contradiction):
                raise SceneError(
                    f"{path}, line {each.line}: states {each.unit.name!r} for column {place + 1}, "
                    f"and {other.name!r} in another line of its heading; take out the one that is "
                    "wrong"
                )
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


def _as_one_packet(text: str) -> str:
    """A file of LabVIEW as one table, line by line, without the headers of later packets of rows
    and without remarks beside rows.

    Times that are not written come from the header of their packet. Those that begin anew are later
    by the difference of the time stamps of two packets.
    """
    sign = "," if re.search(r"^Separator,", text, re.M) else "\t"
    point = "," if re.search(r"^Decimal_Separator\W,", text, re.M) else "."
    about: dict[str, list[str]] = {}
    begun: tuple[int, float] | None = None
    packets, row, last, later, found = 0, -1, -math.inf, 0.0, []
    for line in text.split("\n"):
        key, *cells = (cell.strip() for cell in line.split(sign))
        if key == "Channels":
            row = -1
        if row < 0:
            about[key] = cells
            found.append("" if packets else line)
            if key == "X_Value":
                packets, row = packets + 1, 0
            continue
        unwritten = about.get("X_Columns", [""])[0] == "No"
        if unwritten and any(cells):
            start, step = (_number(about.get(name, [""])[0], point) for name in ("X0", "Delta_X"))
            key = str(start + row * step)
        time = _number(key, point)
        if not math.isfinite(time):  # a blank line; or one that is refused by its number
            found.append(line)
            continue
        if row == 0:
            stamp = _labview_stamp(about)
            begun = begun or stamp
            later = 0.0
            if stamp and begun and time <= last:
                later = (stamp[0] - begun[0]) * 86400.0 + stamp[1] - begun[1]
        row, last = row + 1, time + later
        if unwritten or later:
            key = f"{last:.15g}".replace(".", point)
        channels = int(_number(about["Channels"][0], point))
        columns = 2 * channels if about.get("X_Columns") == ["Multi"] else 1 + channels
        found.append(sign.join([key, *cells][:columns]))
    return "\n".join(found)


def _number(cell: str, point: str) -> float:
    """The number in a cell, or NaN."""
    return float(cell.replace(point, ".")) if is_number(cell) else math.nan


def _labview_stamp(about: dict[str, list[str]]) -> tuple[int, float] | None:
    """Day, and second of it, at which a packet of rows begins."""
    try:
        day = datetime.strptime(about["Date"][0], "%Y/%m/%d").toordinal()
        hours, minutes, seconds = about["Time"][0].replace(",", ".").split(":")
        return day, 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)
    except (KeyError, IndexError, ValueError):
        return None


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
