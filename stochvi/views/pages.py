"""What a reader is told of an answer. Chapters: facts, tables, pictures and sections; `Told`, which
a terminal prints; `Page`, the same with its origin and evidence as one HTML file."""

from __future__ import annotations

import base64
import io
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from rich.cells import cell_len

from stochvi.mathematics.units import ACCELERATION, LENGTH, NUMBER, ShownQuantity, shown_as
from stochvi.results.base import DataFrame, Result, plain, quantities_of, rows_of
from stochvi.results.estimates import NO_VALUE, Estimate, capital, plus_minus
from stochvi.views.files import time_for_pictures, to_json, write_report_page, write_text

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
        cls,
        caption: str,
        table: DataFrame | Sequence[Mapping[str, Any]],
        words: int | Collection[str] | None = 1,
        forms: Mapping[str, str] = {},
    ) -> Self:
        """A table with its numbers in four digits, or in the form of their column, and - where one
        is not known. Without `words` they stand wherever not every cell is a number."""
        known = rows_of(table)
        headings = [*known[0]] if known else [str(name) for name in table]
        rows = [[_cell(row[name], forms.get(name, ".4g")) for name in headings] for row in known]
        if words is None:
            columns = zip(headings, zip(*rows, strict=True), strict=True)
            words = [name for name, cells in columns if not all(map(_is_number, cells))]
        return cls(caption=caption, headings=headings, rows=rows, words=words)

    @classmethod
    def by(
        cls, caption: str, columns: Mapping[str, Callable[..., object]],
        rows: Iterable[tuple[Any, ...]], words: int | Collection[str] = 1,
        alarms: Sequence[int] = (),
    ) -> list[Self]:  # fmt: skip
        """A table described by its columns, each a heading with the cell that it makes of a row:
        a text, or a number that gets four digits. None where there are no rows.

        >>> Grid.by("roots", {"n": str, "root": lambda n: n**0.5}, [(2,), (9,)])[0].rows
        [['2', '1.414'], ['9', '3']]
        """
        found = [[_cell(cell(*row), ".4g") for cell in columns.values()] for row in rows]
        if not found:
            return []
        headings = [*columns]
        return [cls(caption=caption, headings=headings, rows=found, words=words, alarms=alarms)]

    @classmethod
    def stated(
        cls, caption: str, rows: Sequence[tuple[Any, ...]], words: int | Collection[str] = 1,
        names: Sequence[str] = (),
    ) -> list[Self]:  # fmt: skip
        """A table whose rows are parts of an answer, by the words and units that their classes
        state, in the units that are shown. It has all stated fields, or those with these `names`.

        >>> from stochvi.results.base import CoordinateResponse
        >>> motion = CoordinateResponse(velocity_std=Estimate(value=2.0, standard_error=0.1))
        >>> found = Grid.stated("motion", [(motion,)])[0].known()
        >>> found.headings, found.rows
        (['rms velocity (m/s)'], [['2.00 ± 0.20']])
        """
        columns: dict[str, Callable[..., object]] = {}
        for number, part in enumerate(rows[0] if rows else ()):
            kind: Any = type(part)
            stated = quantities_of(kind)
            for name in names or stated:
                known = stated[name]
                quantity = USUALLY.get(known.unit) or shown_as(known.unit)
                cell = partial(_part_of_row, number, name, quantity)
                columns[quantity.heading(known.words)] = cell
        return cls.by(caption, columns, rows, words)

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

    def known(self) -> Self:
        """The table without the columns in which nothing is known."""
        kept = [k for k in range(len(self.headings)) if {row[k] for row in self.rows} != {NO_VALUE}]
        return replace(
            self,
            headings=[self.headings[k] for k in kept],
            rows=[[row[k] for k in kept] for row in self.rows],
        )


def records(table: Any, name: str = "") -> list[tuple[dict[str, Any]]]:
    """The rows of a table, or of that in a field of an answer, for `Grid.by`."""
    return [(row,) for row in rows_of(table, name)]


USUALLY = {"": NUMBER, "1": NUMBER, "m": LENGTH, "m/s^2": ACCELERATION}
"""How tables of parts of answers show units, others in the SI unless one is chosen."""


def _part_of_row(number: int, name: str, quantity: ShownQuantity, *row: Any) -> object:
    """The cell of a stated field of one of the parts of a row."""
    value = getattr(row[number], name)
    if isinstance(value, Estimate):
        return plus_minus(value, quantity)
    return quantity(value) if isinstance(value, float) else value


def _cell(value: object, form: str) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NO_VALUE
    return format(value, form) if isinstance(value, float) else str(value)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell == NO_VALUE
    return True


def sentence(text: str) -> str:
    """A text as a sentence.

    >>> sentence("phases are independent")
    'Phases are independent.'
    """
    return f"{capital(text).removesuffix('.')}."


@dataclass(frozen=True, kw_only=True)
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


def shown(draw: Callable[[], Axes], caption: str, **where: bool) -> Picture:
    """The picture that `draw` makes, with its caption; `where` says whether it is wide, and whether
    it is of the front."""
    return Picture(draw=draw, caption=caption, **where)


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


def write_page(page: Page, document: Mapping[str, Any], name: str, folder: Path) -> Path:
    """Write `report.html`, and beside it the document that holds its numbers, with the origin of
    the page under "report"; returns the path of the page."""
    found = {**document, "report": plain(page.origin)}
    write_text(to_json(found) + "\n", folder / f"{name}.json")
    write_report_page(page.html(), folder / "report.html")
    return folder / "report.html"
