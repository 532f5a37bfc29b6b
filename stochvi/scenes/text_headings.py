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
        return len(cells) > 2
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
    for number, line in above:
        text = line.strip(' #%/"')
        pieces = [*_bracketed(line), *re.split(r'"?[;,\t|]"?', text)]
        known = [unit_in(piece, piece == text) or _of_fraction(piece) for piece in pieces]
        if not any(known) and "dB" not in line:
            words = [word.strip('[],;:"') for word in line.split()]
            known = [unit_in(word) or _of_fraction(word) for word in words]
        for each in known:
            if each and each.quantity in quantities:
                found[each.name, each.decibels] = each, number
    return next(iter(found.values())) if len(found) == 1 else (None, 0)


def _of_fraction(text: str) -> Unit | None:
    """The unit of a text with a slash, which no plain word has."""
    return _known(text) if "/" in text else None
