"""The base of every answer: its JSON document, its table and its page for notebooks."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from stochvi.mathematics.arguments import check_methods
from stochvi.mathematics.shown_units import USUAL, shown_in, units_of
from stochvi.results.estimates import Cost
from stochvi.results.plots import drawn

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

COMMON = ("warnings", "cost", "provenance", "interrupted")
"""Fields that every answer has; they come last in documents."""

MOST_ROWS = 60
"""Largest number of rows of a table that a notebook shows; a longer table is cut in the middle."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Result:
    """The answer of a calculation.

    A kind of answer is a frozen dataclass derived from this class. It defines `to_frame` and
    `summary`, a sentence on what was found; the rest follows from its fields.

    Parameters
    ----------
    warnings
        Warnings to read before believing the numbers, a sentence each.
    cost
        Time and number of paths that the answer took.
    provenance
        Data to compute the answer again: versions, processor, seed, the scene, and in `call` the
        function with its arguments, the date and, of a checkout, the commit.
    interrupted
        Whether Ctrl-C ended the calculation: the answer then holds the results up to that moment.
    """

    warnings: Sequence[str] = ()
    cost: Cost = field(default_factory=Cost)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    interrupted: bool = False

    not_in_document: ClassVar[tuple[str, ...]] = ()
    """Fields of a kind of answer that its JSON document leaves out."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        check_methods(cls)

    def __repr__(self) -> str:
        return f"<{self.summary()}>"

    def __eq__(self, other: object) -> bool:
        """Whether the other answer is of the same kind, and has the same JSON document but for its
        cost and the record of its call: one seed gives equal answers."""
        if type(other) is not type(self):
            return NotImplemented
        return bool(_lasting(self.to_dict()) == _lasting(other.to_dict()))

    __hash__ = None  # type: ignore[assignment]

    def summary(self) -> str:
        """The answer in a sentence; by default the name of the method."""
        return str(getattr(self, "method", type(self).__name__))

    def to_frame(self) -> pd.DataFrame:
        """The answer as a tidy table."""
        raise NotImplementedError(f"{type(self).__name__} has no table")

    def in_units(self, units: str) -> pd.DataFrame:
        """The table of the answer in units of one's choice.

        Parameters
        ----------
        units
            Units with commas between them, as "mm, g": one of each quantity at most. Numbers of
            other quantities stay in SI units.

        Returns
        -------
        pandas.DataFrame
            The table, with the chosen units in the names of its columns.

        See Also
        --------
        Result.to_frame : The table in SI units.
        """
        from stochvi.results.column_units import in_chosen_units

        with shown_in(units_of(units)):
            return in_chosen_units(self.to_frame())

    def plot(self, ax: Axes | None = None, *, units: str = "") -> Axes:
        """Draw the answer.

        Parameters
        ----------
        ax
            Axes to draw in; by default those of a new figure. They take the first panel of a
            picture of several.
        units
            Units of the picture with commas between them, as "in, g"; by default mm and g, or what
            reads well.

        Returns
        -------
        matplotlib.axes.Axes
            The Axes that were drawn in, the first of several.
        """
        if not units:
            return drawn(self, ax)
        with shown_in(units_of(units)):
            return drawn(self, ax)

    def to_dict(self) -> dict[str, Any]:
        """The JSON document: only plain types, never NaN or infinity. Its numbers are in SI units,
        its sentences in the usual units, whatever is shown elsewhere."""
        with shown_in(USUAL):
            return {name: plain(value) for name, value in self._document().items()}

    def _document(self) -> dict[str, Any]:
        """The fields by name, with those that are common to all answers last.

        A kind of answer whose document has other keys, or more of them, overrides this.
        """
        names = [each.name for each in fields(self) if each.name not in self.not_in_document]
        names.sort(key=COMMON.__contains__)
        return {name: getattr(self, name) for name in names}

    def _repr_html_(self) -> str:
        remarks = "".join(f"<br>{html.escape(each, quote=False)}" for each in self._remarks())
        table = self._shown().to_html(index=False, max_rows=MOST_ROWS)
        return f"<b>{html.escape(self.summary(), quote=False)}</b>{table}{remarks}"

    def _shown(self) -> pd.DataFrame:
        """The table that a notebook shows."""
        return self.to_frame()

    def _remarks(self) -> Sequence[str]:
        """Sentences below the table in a notebook."""
        return self.warnings


check_methods(Result)


def _lasting(part: Any) -> Any:
    """A part of a document without what differs from run to run."""
    if isinstance(part, dict):
        return {name: _lasting(each) for name, each in part.items() if name not in ("cost", "call")}
    return [_lasting(each) for each in part] if isinstance(part, list) else part


def plain(value: Any) -> Any:
    """A value as plain types that JSON can hold; a number that is not finite becomes None.

    >>> plain({"speeds": np.array([1.0, np.nan]), "seen": np.bool_(True), "by": ("x", 2)})
    {'speeds': [1.0, None], 'seen': True, 'by': ['x', 2]}
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if is_dataclass(value) and not isinstance(value, type | Mapping):
        if hasattr(value, "to_dict"):
            return value.to_dict()
        return {each.name: plain(getattr(value, each.name)) for each in fields(value)}
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if hasattr(value, "iloc"):  # a table
        value = value.to_dict("records")
    if isinstance(value, Mapping):
        return {str(name): plain(each) for name, each in value.items()}
    if isinstance(value, Iterable):
        return [plain(each) for each in value]
    raise TypeError(f"{type(value).__name__} has no form in JSON")


def total_cost(costs: Iterable[Cost]) -> Cost:
    """Cost of several answers together, calculated one after the other."""
    known = list(costs)
    return Cost(
        wall_time=sum(each.wall_time for each in known),
        compile_time=sum(each.compile_time for each in known),
        steps=sum(each.steps for each in known),
        impacts=sum(each.impacts for each in known),
        paths=sum(each.paths for each in known),
        threads=max((each.threads for each in known), default=1),
    )
