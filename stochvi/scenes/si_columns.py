"""Columns of a text file in SI units, by their headings or by units that a user names."""

from __future__ import annotations

from collections.abc import Sequence

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.units import Unit, listed_units, unit
from stochvi.results.errors import SceneError
from stochvi.scenes.text_tables import TextTable


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
        values * _unit_of(table, place, quantity, name, given, choices).factor
        for place, (values, quantity, name) in enumerate(
            zip(columns, quantities, named, strict=True)
        )
    ]


def _unit_of(
    table: TextTable, place: int, quantity: str, name: str | None, given: Sequence[str] | None,
    choices: str,
) -> Unit:  # fmt: skip
    stated, column = table.headings[place].unit, f"column {place + 1} of {table.path}"
    if stated is None and name is not None:
        stated, _ = table.stated(quantity)
    if stated is None and name is None:
        raise SceneError(
            [("unit", f"must be {choices}, got none, and no unit stands above {column}")]
        )
    if stated is not None and stated.quantity != quantity:
        raise SceneError(
            [("file", f"states the unit {stated.name!r} above {column}, expected one of "
              f"{quantity} ({listed_units(quantity)})")]
        )  # fmt: skip
    if stated is not None and name is not None and not stated.same(unit(name)):
        raise SceneError(
            [("unit", f"is {','.join(given or ())!r}, but above {column} stands {stated.name!r}; "
              "take out the one that is wrong")]
        )  # fmt: skip
    return stated or unit(str(name))
