"""What a reader is told of an answer. Chapters: facts, tables, pictures and sections; `Told`, which
a terminal prints; `Page`, the same with its origin and evidence as one HTML file."""

from __future__ import annotations

import base64
import io
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import cached_property
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from rich.cells import cell_len

from stochvi.mathematics.units import (
    DENSITY,
    HOURLY,
    LENGTH,
    MILLISECONDS,
    NUMBER,
    PERCENT,
    readable,
    spoken_mission,
)
from stochvi.results.base import (
    DataFrame,
    Result,
    Stated,
    estimate_of,
    quantities_of,
    rows_of,
    unit_of_column,
)
from stochvi.results.estimates import ERROR, NO_VALUE, Estimate, capital, count_of, plus_minus
from stochvi.views.files import time_for_pictures
from stochvi.views.tables import chance_in_words, four_digits, way_in_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.console import Console

    from stochvi.results.files import Origin


# ------------------------------------------------------------------------------
# The parts: facts, tables, pictures, sections.
# ------------------------------------------------------------------------------


class Fact(NamedTuple):
    """A quantity in words, its value with its unit, and a remark."""

    name: str
    value: str
    remark: str = ""


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A table of text: `headings` over `rows`; columns of `words` are set flush left.

    The rows with the numbers `alarms` are shown in red on a terminal.
    """

    caption: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int | Collection[str] = 1
    """Number of columns, from the left, that hold words, or the headings of these."""
    alarms: Sequence[int] = ()

    @property
    def flush_left(self) -> list[bool]:
        """Whether each column is set flush left."""
        if isinstance(self.words, int):
            return [number < self.words for number in range(len(self.headings))]
        return [heading in self.words for heading in self.headings]

    @classmethod
    def of(
        cls, caption: str, rows: Iterable[Any] | DataFrame,
        columns: str | Iterable[str | Column] = "", words: int | Collection[str] = 1,
        alarms: Sequence[int] = (), **own: Callable[..., object],
    ) -> list[Self]:  # fmt: skip
        """A table whose columns are described with semicolons between them, "heading = name {form}"
        each; none where there are no rows. Columns in which nothing is known are left out.

        The name is that of a field of a part of an answer, or of a column of a table: its number
        has the error that stands in a column beside it. Without a heading the words of the name
        stand there, with the unit that is shown. Rows of several parts are tuples of these. A form
        is the SI unit, a format, or one of `FORMS`. Cells of `own` names are made by a function of
        the row. Without `columns` there are all of them.

        >>> from stochvi.results.base import CoordinateResponse
        >>> motion = CoordinateResponse(velocity_std=Estimate(value=2.0, standard_error=0.1))
        >>> columns = "of = name; velocity_std; n = twice {.1f}; displacement_mean"
        >>> (found,) = Grid.of("motion", [("x", motion)], columns, twice=lambda *_: 2.0)
        >>> found.headings, found.rows
        (['of', 'rms velocity (m/s)', 'n'], [['x', '2.00 ± 0.20', '2.0']])
        """
        known = [each if type(each) is tuple else (each,) for each in _listed(rows)]
        if not known:
            return []
        described = columns.split(";") if isinstance(columns, str) else columns
        described = described if columns else [("", name, "") for name in _names_in(known[0])]
        found = [_column(each, known[0], own) for each in described]
        cells = [[cell(row) for row in known] for _, cell in found]
        kept = [k for k, column in enumerate(cells) if {*column} != {NO_VALUE}]
        return [
            cls(
                caption=caption, headings=[found[k][0] for k in kept], words=words, alarms=alarms,
                rows=[list(row) for row in zip(*(cells[k] for k in kept), strict=True)],
            )
        ]  # fmt: skip

    @classmethod
    def across(cls, caption: str, corner: str, cells: Mapping[tuple[str, str], str]) -> list[Self]:
        """A table of cells by the words of their row and the heading of their column, - where
        there is no cell; none without cells.

        >>> Grid.across("of", "n", {("a", "x"): "1", ("b", "x"): "2", ("b", "y"): "3"})[0].rows
        [['a', '1', '-'], ['b', '2', '3']]
        """
        headings = dict.fromkeys(heading for _, heading in cells)
        rows = [
            [words, *(cells.get((words, heading), NO_VALUE) for heading in headings)]
            for words in dict.fromkeys(words for words, _ in cells)
        ]
        return [cls(caption=caption, headings=[corner, *headings], rows=rows)] if rows else []


COLUMN = re.compile(r"(?:(.*?) = )?(\S+)(?: \{(.*)\})?")

FORMS: dict[str, Callable[[Any], str]] = {
    "likely": lambda risk: chance_in_words(risk) if risk else "0",
    "mission": spoken_mission, "count": count_of, "way": way_in_words,
    "percent": lambda share: f"{100.0 * share:.3g} %", "length": lambda x: four_digits(LENGTH(x)),
}  # fmt: skip
"""How tables write some numbers, by the name of the form."""

SHOWN = {
    "": NUMBER, "1": NUMBER, "length": LENGTH, "1/h": HOURLY, "ms": MILLISECONDS,
    "(m/s^2)^2/Hz": DENSITY, "%": PERCENT,
}  # fmt: skip
"""Quantities that tables show in other units than `readable` does, by SI units and by forms."""

Column = tuple[str, str, str]
"""A column of a table: heading, name and form, or empty."""


def _listed(rows: Any) -> list[Any]:
    """The rows of a table, or parts of an answer."""
    return rows_of(rows) if hasattr(rows, "iloc") else [*rows]


def _names_in(row: tuple[Any, ...]) -> list[str]:
    """Names of all columns of a row: stated fields of parts, or those of a table."""
    return [str(name) for part in row for name in _stated(part) or part]


def _stated(part: Any) -> Mapping[str, Stated]:
    """The stated fields of a part of an answer; none of what is no such part."""
    kind: Any = part.__class__
    return quantities_of(kind) if is_dataclass(part) else {}


def _column(
    described: str | Column, first: tuple[Any, ...], own: Mapping[str, Callable[..., object]]
) -> tuple[str, Callable[[tuple[Any, ...]], str]]:
    """The heading of a column, and what makes its cell of a row, as the `first` row knows it."""
    if isinstance(described, str):
        match = COLUMN.fullmatch(" ".join(described.split()))
        assert match is not None, described
        described = match.group(1) or "", match[2], match[3] or ""
    heading, name, form = described
    stated = next((each for part in first if (each := _stated(part).get(name))), None)
    words = name if "." in name else name.replace("_", " ")  # a key stays as it is written
    stated = stated or Stated(words, unit_of_column(name) or "")
    digits = next((word for word in form.split() if word[0] in "#+."), ".4g")
    unit = form.replace(digits, "").strip() or ("" if name in own else stated.unit)
    quantity = SHOWN.get(unit) or (NUMBER if unit in FORMS else readable(unit))

    def cell(row: tuple[Any, ...]) -> str:
        value = own[name](*row) if name in own else _found(row, name)
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return NO_VALUE
        if unit in FORMS and isinstance(value, str) == (unit == "way"):
            return FORMS[unit](value)
        if isinstance(value, Estimate):
            return plus_minus(value, quantity)
        return format(quantity(value), digits) if isinstance(value, float) else str(value)

    return quantity.heading(heading or stated.words), cell


def _found(row: tuple[Any, ...], name: str) -> Any:
    """What a name stands for in a row: the name of a part, a column, or a field of a part."""
    for part in row:
        if isinstance(part, Mapping) and name in part:
            sampled = f"{name}_error" in part or f"{name}_{ERROR}" in part
            known = estimate_of(part, name, "_") if sampled else None
            return part[name] if known is None else known
        if isinstance(part, str) and name == "name":
            return part
        if hasattr(part, name):
            return getattr(part, name)
    raise AttributeError(f"no part of a row has {name}")


def sentence(text: str) -> str:
    """A text as a sentence.

    >>> sentence("phases are independent")
    'Phases are independent.'
    """
    return f"{capital(text).removesuffix('.')}."


@dataclass(frozen=True)
class Picture:
    """A picture with its caption, drawn when a page shows it; a wide one takes the width of the
    page, and one of the `front` stands on the sheet that is signed."""

    draw: Callable[[], Axes]
    caption: str
    wide: bool = False
    front: bool = False

    @cached_property
    def uri(self) -> str:
        """The figure as SVG with letters as outlines, in a data URI, closed; the same bytes for the
        same figure. Empty where no time is left for the picture."""
        if not time_for_pictures():
            return ""
        import matplotlib.pyplot as plt

        from stochvi.views.axes import as_written

        figure = as_written(self.draw())
        memory = io.BytesIO()
        with plt.rc_context({"svg.fonttype": "path", "svg.hashsalt": "stochvi"}):
            figure.savefig(memory, format="svg", metadata={"Date": None, "Creator": None})
        plt.close(figure)
        encoded = base64.b64encode(memory.getvalue()).decode("ascii")
        return f"data:image/svg+xml;base64,{encoded}"


@dataclass(frozen=True, kw_only=True)
class Section:
    """A part of a description; an empty section is left out. A terminal prints its tables and notes
    alone, those that are `asked` for also of a brief answer."""

    title: str = ""
    lead: str = ""
    facts: Sequence[Fact] = ()
    grids: Sequence[Grid] = ()
    pictures: Sequence[Picture] = ()
    notes: Sequence[str] = ()
    asked: bool = False

    @property
    def anchor(self) -> str:
        """Name of the section in links."""
        return "".join(letter if letter.isalnum() else "-" for letter in self.title.lower())

    @property
    def empty(self) -> bool:
        """Whether the section holds nothing."""
        return not (self.lead or self.facts or self.grids or self.pictures or self.notes)


# ------------------------------------------------------------------------------
# The description of an answer, on a terminal.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Told:
    """The description of an answer: the verdict first, then its evidence.

    Parameters
    ----------
    verdict
        The verdict in one sentence; empty where tables alone answer.
    alarm
        Whether the verdict says that something is wrong: it is then shown in red.
    statements
        Sentences that complete the verdict, each a line.
    sections
        The parts that hold the evidence.
    warnings
        Sentences that a reader must know before believing any number.
    assumptions
        What the answer rests on; a page names it under its limits.
    footer
        Lines that close it.
    brief
        Whether verdict, statements and warnings are the answer: a terminal shows sections,
        assumptions and footer where it is asked for all alone.
    next
        What to do next, where that is not a page to sign: in words, the command, and the part of
        its scene file.
    """

    verdict: str = ""
    alarm: bool = False
    statements: Sequence[str] = ()
    sections: Sequence[Section] = ()
    warnings: Sequence[str] = ()
    assumptions: Sequence[str] = ()
    footer: Sequence[str] = ()
    brief: bool = False
    next: Sequence[str] = ()


def told_of(
    found: Result, grids: Sequence[Grid] = (), notes: Sequence[str] = (), *sections: Section,
    **more: Any,
) -> Told:  # fmt: skip
    """The summary of an answer over its tables and notes and more sections, with its assumptions
    and warnings; `more` are other parts of the description, or other ones."""
    own: dict[str, Any] = {
        "verdict": found.summary(),
        "sections": [Section(grids=grids, notes=notes), *sections],
        "assumptions": getattr(found, "assumptions", ()),
        "warnings": found.warnings,
    }
    return Told(**own | more)


def print_told(console: Console, told: Told, whole: bool = True) -> None:
    """Print the verdict, the statements, tables and notes of all sections, warnings and footer; of
    a brief answer that is not asked for as a `whole`, what answers alone."""
    if told.verdict:
        style = "bold red" if told.alarm else "bold"
        console.print(told.verdict, style=style, highlight=False, markup=False)
    for line in told.statements:
        console.print(line, highlight=False, markup=False)
    whole = whole or not told.brief
    _print_sections(console, [each for each in told.sections if whole or each.asked])
    if whole and told.assumptions:
        _print_line(console, f"assumptions: {'; '.join(told.assumptions)}")
    for line in told.footer if whole else ():
        _print_line(console, line)
    for warning in told.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False, markup=False)


def _print_sections(console: Console, sections: Sequence[Section]) -> None:
    for section in sections:
        for grid in section.grids:
            _print_grid(console, grid)
        for note in section.notes:
            _print_line(console, note)


def _print_line(console: Console, line: str) -> None:
    console.print(line, style="dim", highlight=False, markup=False)


def _print_grid(console: Console, grid: Grid) -> None:
    """Print a table after an empty line, as wide as it is: a terminal may wrap its lines, nothing
    is cut short."""
    every = [[cell.split("\n") for cell in row] for row in (grid.headings, *grid.rows)]
    widths = [
        max(cell_len(line) for cell in each for line in cell) for each in zip(*every, strict=True)
    ]
    console.print()
    if grid.caption:
        console.print(grid.caption, style="bold", highlight=False, markup=False)
    for number, row in enumerate(every, start=-1):
        style = "bold red" if number in grid.alarms else "bold" if number < 0 else ""
        for parts in zip_longest(*row, fillvalue=""):
            cells = [
                cell + blank if left else blank + cell
                for cell, left, width in zip(parts, grid.flush_left, widths, strict=True)
                for blank in [" " * (width - cell_len(cell))]
            ]
            line = "  ".join(cells).rstrip()
            console.print(line, style=style, highlight=False, markup=False, soft_wrap=True)


# ------------------------------------------------------------------------------
# The same as one self-contained HTML page.
# ------------------------------------------------------------------------------


TEMPLATE = "report.html"

BEFORE_UNIT = re.compile(
    r"(?<=\d) (?=(?:%|mm|cm|µm|mil|ft|m|m/s|g|Hz|kg|kN|N|lbf|h|s|min|dB|sigma|rms)\b|%)|(?<=±) "
)
"""Pattern of the blank between a number and its unit."""


@dataclass(frozen=True, kw_only=True)
class Page(Told):
    """A report: a description, with the question, the few numbers to take away, and the origin.

    Parameters
    ----------
    title, subtitle
        The scene, and the question that the report answers.
    cards
        The few numbers that a reader takes away.
    origin
        When, how and from what the page was made.
    assumed
        What the sheet that is signed names of the limits.
    """

    title: str
    subtitle: str
    cards: Sequence[Fact]
    origin: Origin
    assumed: Sequence[str] = ()

    def html(self) -> str:
        """The page; it needs no other file, no network and no script."""
        from jinja2 import Environment, PackageLoader, StrictUndefined

        environment = Environment(
            loader=PackageLoader("stochvi.views.report"),
            autoescape=True,
            undefined=StrictUndefined,
            finalize=_tied,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        environment.filters["capital"] = capital
        front = [each for section in self.sections for each in section.pictures if each.front]
        behind = [
            replace(section, pictures=[each for each in section.pictures if not each.front])
            for section in self.sections
        ]
        kept = [section for section in behind if not section.empty]
        template = environment.get_template(TEMPLATE)
        return template.render(page=self, sections=kept, front=front) + "\n"


def page_of(
    told: Told, title: str, subtitle: str, cards: Sequence[Fact], origin: Origin,
    sections: Sequence[Section] = (), limits: Sequence[str] = (), footer: Sequence[str] = (),
) -> Page:  # fmt: skip
    """The page of a description, with more sections, limits and lines behind its own."""
    bounds = Section(
        title="Limits",
        lead="Assumptions of this report, and its limits.",
        notes=[sentence(text) for text in (*told.assumptions, *limits)],
    )
    own = vars(told) | {
        "verdict": sentence(told.verdict),
        "statements": [sentence(line) for line in told.statements],
        "sections": [*told.sections, *sections, bounds],
        "footer": [*told.footer, *footer],
    }
    assumed = [sentence(text) for text in limits[:MOST_ASSUMED]]
    return Page(
        title=title, subtitle=subtitle, cards=cards, origin=origin, assumed=assumed, **own
    )  # fmt: skip


MOST_ASSUMED = 3
"""Largest number of limits that the sheet that is signed names."""


def _tied(value: object) -> object:
    """Text with blanks that keep a number and its unit on one line; other values as they are."""
    plain = isinstance(value, str) and not hasattr(value, "__html__")
    return BEFORE_UNIT.sub("\u00a0", str(value)) if plain else value
