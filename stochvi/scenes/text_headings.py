"""Names and units of the columns of a text file, from the lines above its rows."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from stochvi.mathematics.units import DIMENSIONS, Unit, unit
from stochvi.scenes.text_cells import DELIMITERS, is_number, split_cells

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
    r"(?:(?:acc[a-z]*[_ ])?(?:psd|asd)|acc[a-z]*|a|beschleunigung|force|density|time(?:stamp)?|t|"
    r"zeit|frequency|freq|f|level)"
    r"(?:[_ ][xyz])?(?:_| in | )(\S+)", re.I,
)  # fmt: skip
"""Pattern of a name with a unit, such as acceleration_g, density_g2_per_hz or "Time ms"."""

QUANTITY_OVER_UNIT = re.compile(r"[^\W\d_]+\s*/\s*(\S+)")
"""Pattern of a name over its unit, "f/kHz", the heading of a column by ISO 80000-1."""

LABELLED_UNIT = re.compile(r"(?:[xy][_ ])?(?:units?|einheit)(?:[_ ]label)?\s*[:=]\s*(\S+)", re.I)
"""Pattern of a line such as "Unit: g", with the unit in it."""

ROW_OF_UNITS = re.compile(r"(?:[xy][_ ])?(?:units?|einheit)\b|(?:[xy][_ ])?unit_label", re.I)
"""Pattern of the first cell of a line of units, which LabVIEW writes far above the rows."""

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
    def unread(self) -> str:
        """The text in place of a unit, if it is not a known unit; otherwise empty."""
        if self.unit is not None or not self.name:
            return ""
        over = QUANTITY_OVER_UNIT.fullmatch(self.name)
        found = [*_bracketed(self.name), *([over[1]] if over else [])]
        return next((text for text in found if re.search(r"[^\W\d]", text)), "")

    @property
    def counts(self) -> bool:
        """Whether the heading states that the column holds row numbers, rpm or orders."""
        return self.unit is None and COUNTING.match(self.name) is not None


def headings_above(
    above: Sequence[tuple[int, str]], delimiter: str | None, count: int, longest: int, stamped: bool
) -> list[Heading]:
    """The headings of the columns.

    They come from lines above the rows: the last ones with as many cells as there are columns, and
    those that state that they hold units. `longest` is the number of cells of a row including empty
    ones at its end, which a heading may name.
    """
    fitting: list[tuple[int, list[str]]] = []
    for number, line in above[:-LAST_HEADINGS]:
        cells = _heading_cells(line, delimiter, count, longest, stamped)
        if cells and count > 1 and ROW_OF_UNITS.match(cells[0]):
            fitting.append((number, ["", *cells[1:]]))
    for number, line in above[-LAST_HEADINGS:]:
        if cells := _heading_cells(line, delimiter, count, longest, stamped):
            fitting.append((number, cells))
    found = []
    # lines of units come last, because the name of a column is not looked for there
    named = sorted(fitting, key=lambda each: not _holds_units(each[1]))
    of_units = [all(map(_is_unit, filter(None, row))) for _, row in fitting]
    for place in range(count):
        stack = tuple(row[place] for _, row in named if row[place])
        unit_line = [
            (known, number)
            for (number, row), alone in zip(reversed(fitting), reversed(of_units), strict=True)
            if (known := unit_in(row[place], alone))
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
    """The cells of a heading, one for each column; None for a line with another number of cells."""
    text = re.sub(r"^\s*(?:#|%|//)+\s*", "", line)
    # a unit in brackets belongs to the name before it
    glued = re.sub(r"(?<!\s)\s+(?=[\[(])", GLUE, text.strip())
    for each in (delimiter, *(other for other in DELIMITERS if other != delimiter)):
        cells = split_cells(glued if each is None else text, each)
        while len(cells) > count and not cells[-1]:
            cells.pop()
        if stamped and len(cells) == count + 1:
            cells = [f"{cells[0]} {cells[1]}", *cells[2:]]  # a date and a time of day
        if (len(cells) == count or (each and count < len(cells) <= longest)) and any(cells):
            return [cell.replace(GLUE, " ")[:LONGEST_HEADING] for cell in cells[:count]]
    return None


def _is_unit(cell: str) -> bool:
    inner = cell[1:-1] if cell[:1] + cell[-1:] in ("[]", "()") else cell
    return _known(inner) is not None or _known(cell) is not None


def _known(spelling: str) -> Unit | None:
    """The unit of a spelling; None if it is not a known unit."""
    try:
        return unit(spelling)
    except ValueError:
        return None


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
    for inner in _bracketed(text):
        if found := _known(inner):
            return found
    words = re.sub(r"(?<=\w)(?=[\[(])", " ", text).split()
    for start in range(len(words)):
        ending = " ".join(words[start:])
        if start and is_number(words[start - 1]):
            break  # a value and its unit, as in "sampling rate: 400 Hz"
        signs = re.search(r"[/^²⁻]", ending) or ending.casefold() in ("hz", "khz", "cpm")
        if signs or re.search(r"[a-zA-Z)]-\d", ending):
            found = _known(ending)
            usual = found and found.quantity in DIMENSIONS.values()
            if usual or (found and signs and start == len(words) - 1):
                return found
    if over := QUANTITY_OVER_UNIT.fullmatch(text.strip()):
        found = _known(over[1])
        return found if found and found.quantity in DIMENSIONS.values() else None
    if after := re.search(r",\s*(\S+)$", text):
        return _known(after[1])
    if labelled := LABELLED_UNIT.fullmatch(text.strip()):
        return _known(labelled[1])
    if named := NAMED_UNIT.fullmatch(text.strip()):
        name = re.sub(r"_per_|(?<=\d)_(?=[a-z])|(?<=\bm)_(?=s)", "/", named[1], flags=re.I)
        return _known(name)
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


def stated_density(above: Sequence[tuple[int, str]]) -> tuple[Unit | None, int]:
    """The unit of a density that the lines above the rows state, and its line; (None, 0) if they
    state none or several."""
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
