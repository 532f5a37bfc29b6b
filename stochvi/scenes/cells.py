"""The cells of a line of text: what parts them, and which of them hold numbers."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence

DELIMITERS = (";", "\t", "|", ",", None)
"""What may part the cells of a line; None is any number of blanks."""

NUMBER = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eEdD][+-]?\d+)?")
"""A number with a decimal point or comma, and a Fortran exponent if it has one."""

CLOCK = re.compile(r"\d\d:\d\d:\d\d(?:[.,]\d+)?")
"""A time of day without a date."""

STAMP = re.compile(
    r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d\S*|\d{8}T\d{6}(?:[.,]\d+)?(?:Z|[+-]\d{4})?|" + CLOCK.pattern
)
"""A date of ISO 8601 with a time of day, or a time of day alone."""

MISSING = frozenset(
    ("", "nan", "na", "n/a", "null", "none", "-", "--", "---", "inf", "-inf",
     "#n/a", "#na", "#nv", "#value!", "#wert!", "#num!", "#zahl!", "#div/0!", "#ref!", "#bezug!",
     "nan(ind)", "-nan(ind)", "1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind", "1.#inf", "-1.#inf",
     "1.#nan")
)  # fmt: skip
"""Cells, in small letters, that stand for a value that was not measured; the last are those of
spreadsheets, and those that C libraries of Windows print."""


def is_number(cell: str) -> bool:
    """Whether a cell holds a number and nothing else."""
    return bool(NUMBER.fullmatch(cell))


def count_values(cells: Sequence[str]) -> int:
    """How many cells hold a number or a time stamp, or say that one is missing beside one."""
    held = sum(is_number(cell) or bool(STAMP.fullmatch(cell)) for cell in cells)
    return held and held + sum(cell.casefold() in MISSING for cell in cells)


def split_cells(line: str, delimiter: str | None) -> list[str]:
    """The cells of a line, without quotes and blanks around them."""
    if '"' in line:
        around = {"skipinitialspace": True, "delimiter": delimiter or " "}
        return [cell.strip() for cell in next(csv.reader([line.strip()], **around))]  # type: ignore[arg-type]
    if delimiter is None:
        return line.split()
    return [cell.strip() for cell in line.split(delimiter)]
