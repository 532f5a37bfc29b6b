"""The cells of a line of text: how they are separated, and which of them hold numbers."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence

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
