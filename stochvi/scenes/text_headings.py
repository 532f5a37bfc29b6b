"""Names and units of the columns of a text file, from the lines above its rows."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from stochvi.mathematics.units import DENSITIES, DIMENSIONS, Unit, unit
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

LABELLED_UNIT = re.compile(
    r"(?:[xy][_ ])?(?:units?|einheit(?:en)?)(?:[_ ]label)?\s*[:=]\s*(\S+)", re.I
)
"""Pattern of a line such as "Unit: g", with the unit in it."""

ROW_OF_UNITS = re.compile(r"(?:[xy][_ ])?(?:units?|einheit(?:en)?)\b|(?:[xy][_ ])?unit_label", re.I)
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

    They come from the last lines above the rows with as many cells as there are columns, and from
    lines farther above that name columns with their units. A line that names more columns than
    there are is taken for those on the left, if the others have no units: an unfilled column of
    remarks. `longest` is the number of cells of a row including empty ones at its end.

    Raises
    ------
    MisfitHeading
        If a line names columns with units, but not those of the rows: nothing says which is which.
    """
    fitting: list[tuple[int, list[str], bool]] = []
    last = len(above) - LAST_HEADINGS
    for place, (number, line) in enumerate(above):
        own = len(line) if place == len(above) - 1 else longest * (place >= last)
        cells = _heading_cells(line, delimiter, count, own, stamped)
        if cells is None or (len(cells) == count and place < last and not _names_columns(cells)):
            continue
        if len(cells) < count or any(map(_states_unit, cells[count:])):
            if _one_value(cells, count):
                continue  # `stated_unit` finds it
            raise MisfitHeading(number, len(cells))
        labelled = ROW_OF_UNITS.match(cells[0]) is not None and count > 1
        cells = _without_label(cells[:count]) if labelled else cells[:count]
        fitting.append((number, cells, labelled or all(map(_is_unit, filter(None, cells)))))
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
    line: str, delimiter: str | None, count: int, own: int, stamped: bool
) -> list[str] | None:
    """The cells of a line above the rows, if there is one for each column or the line names
    columns; otherwise None.

    A line that is parted as the rows are, and has up to `own` cells, names columns unless its first
    cell states what only the values can be in.
    """
    text = re.sub(r"^\s*(?:#|%|//)+\s*", "", line)
    # a unit in brackets belongs to the name before it
    glued = re.sub(r"(?<!\s)\s+(?=[\[(])", GLUE, text.strip())
    for each in sorted(DELIMITERS, key=lambda other: (other is None, other != delimiter)):
        split = split_cells(glued if each is None else text, each)
        cells = [cell.replace(GLUE, " ")[:LONGEST_HEADING] for cell in split]
        while len(cells) > count and not cells[-1]:
            cells.pop()
        if stamped and len(cells) == count + 1:
            cells = [f"{cells[0]} {cells[1]}", *cells[2:]]  # a date and a time of day
        if len(cells) == count and any(cells):
            return cells
        while cells and not cells[-1]:
            cells.pop()
        if each is None:
            cells = _joined(cells, count)
        parted = each is not None and each == delimiter and count < len(cells) <= own
        if len(cells) > 1 and (
            _names_columns(cells)
            or (parted and not _states_unit(cells[0]) and not any(map(is_number, cells)))
        ):
            return cells
    return None


def _names_columns(cells: Sequence[str]) -> bool:
    """Whether a line names columns: two of its cells state units, or the first one is of time or
    frequency and another one states the unit of something else. Sentences do neither."""
    if any(map(is_number, cells)):
        return False
    if ROW_OF_UNITS.match(cells[0]) or all(map(_is_unit, filter(None, cells))):
        return len(cells) > 2
    stated = [known for cell in cells[1:] if (known := unit_in(cell))]
    first = Heading(cells=(cells[0],), unit=unit_in(cells[0]))
    if any(map(first.is_of, ABSCISSAE)):
        return bool(stated) and not any(known.quantity in ABSCISSAE for known in stated)
    return len(stated) + (first.unit is not None) > 1


def _states_unit(cell: str) -> bool:
    return unit_in(cell) is not None or _is_unit(cell)


def _without_label(cells: list[str]) -> list[str]:
    """A line of units without the text before the first of them, "Units" or "Unit: mm"."""
    labelled = LABELLED_UNIT.fullmatch(cells[0])
    return [labelled[1] if labelled else "", *cells[1:]]


def _joined(cells: list[str], count: int) -> list[str]:
    """The words of a line with those of one name joined, if each of `count` names ends in a unit,
    as "Frequency [Hz] PSD of run 3 [g2/Hz]"."""
    ends = [n for n, cell in enumerate(cells, start=1) if unit_in(cell)]
    if len(ends) != count or ends[-1] < len(cells):
        return cells
    return [" ".join(cells[start:end]) for start, end in zip([0, *ends], ends, strict=False)]


def _one_value(cells: Sequence[str], count: int) -> bool:
    """Whether the cells of a line state one unit, of what only one column can hold."""
    units = {known.name: known for cell in cells if (known := unit_in(cell))}
    quantities = {known.quantity for known in units.values()}
    return len(units) == 1 and (
        quantities <= set(DENSITIES) or (count < 3 and quantities.isdisjoint(ABSCISSAE))
    )


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


def stated_unit(
    above: Sequence[tuple[int, str]], quantities: Collection[str]
) -> tuple[Unit | None, int]:
    """The unit of some quantities that the lines above the rows state, and its line; (None, 0) if
    they state none or several."""
    found: dict[tuple[str, bool], tuple[Unit, int]] = {}
    for number, line in above:
        pieces = [*_bracketed(line), *re.split(r"[;,\t|]", line.strip(" #%/"))]
        known = [unit_in(piece) or (_known(piece) if "/" in piece else None) for piece in pieces]
        if not any(known) and "dB" not in line:
            known = [_known(word.strip("[],;:")) for word in line.split() if "/" in word]
        for each in known:
            if each and each.quantity in quantities:
                found[each.name, each.decibels] = each, number
    return next(iter(found.values())) if len(found) == 1 else (None, 0)
