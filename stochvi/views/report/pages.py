"""A report as one self-contained HTML page, from sections of facts, tables and pictures."""

from __future__ import annotations

import base64
import io
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from stochvi.results.base import plain
from stochvi.views.files import time_for_pictures, to_json, write_report_page, write_text

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from stochvi.results.origin import Origin

TEMPLATE = "report.html"

BEFORE_UNIT = re.compile(
    r"(?<=\d) (?=(?:%|mm|cm|µm|mil|ft|m|m/s|g|Hz|kg|kN|N|lbf|h|s|min|dB|sigma|rms)\b|%)|(?<=±) "
)
"""Pattern of the blank between a number and its unit."""


class Fact(NamedTuple):
    """A quantity in words, its value with its unit, and a remark."""

    name: str
    value: str
    remark: str = ""


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A table of text: `headings` over `rows`; the first `words` columns are set flush left."""

    caption: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int = 1
    """Number of columns, from the left, that hold words."""

    @classmethod
    def of(cls, caption: str, table: pd.DataFrame, words: int = 1) -> Grid:
        """A table with its numbers in four digits, and - where one is not known."""
        rows = [[_cell(each) for each in row] for row in table.itertuples(index=False)]
        headings = [str(name) for name in table]
        return cls(caption=capital(caption), headings=headings, rows=rows, words=words)


def _cell(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    return "-" if math.isnan(value) else f"{value:.4g}"


def capital(text: str) -> str:
    """A text with a capital letter in front."""
    return f"{text[0].upper()}{text[1:]}"


def sentence(text: str) -> str:
    """A text as a sentence.

    >>> sentence("phases are independent")
    'Phases are independent.'
    """
    return f"{capital(text).removesuffix('.')}."


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture as a data URI, which is empty where it was not drawn, and its caption; a wide one
    takes the width of the page."""

    uri: str
    caption: str
    wide: bool = False


@dataclass(frozen=True, kw_only=True)
class Section:
    """A part of a report; an empty section is left out of the page."""

    title: str
    lead: str = ""
    facts: Sequence[Fact] = ()
    grids: Sequence[Grid] = ()
    pictures: Sequence[Picture] = ()
    notes: Sequence[str] = ()

    @property
    def anchor(self) -> str:
        """Name of the section in links."""
        return "".join(letter if letter.isalnum() else "-" for letter in self.title.lower())

    @property
    def empty(self) -> bool:
        """Whether the section holds nothing."""
        return not (self.lead or self.facts or self.grids or self.pictures or self.notes)


@dataclass(frozen=True, kw_only=True)
class Page:
    """A report: the verdict first, then its evidence.

    Parameters
    ----------
    title, subtitle
        The scene, and the question that the report answers.
    verdict
        The verdict in one sentence.
    alarm
        Whether the verdict says that something is wrong: it is then shown in red.
    statements
        Sentences that complete the verdict, each a line.
    origin
        When, how and from what the page was made.
    cards
        The few numbers that a reader takes away.
    warnings
        Sentences that a reader must know before believing any number.
    sections
        The parts of the report that hold the evidence.
    footer
        Lines that close the page.
    """

    title: str
    subtitle: str
    verdict: str
    cards: Sequence[Fact]
    sections: Sequence[Section]
    origin: Origin
    alarm: bool = False
    statements: Sequence[str] = ()
    warnings: Sequence[str] = ()
    footer: Sequence[str] = ()

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
        kept = [section for section in self.sections if not section.empty]
        return environment.get_template(TEMPLATE).render(page=self, sections=kept) + "\n"


def write_page(page: Page, document: Mapping[str, Any], name: str, folder: Path) -> Path:
    """Write `report.html`, and beside it the document that holds its numbers, with the origin of
    the page under "report"; returns the path of the page."""
    found = {**document, "report": plain(page.origin)}
    write_text(to_json(found) + "\n", folder / f"{name}.json")
    write_report_page(page.html(), folder / "report.html")
    return folder / "report.html"


def _tied(value: object) -> object:
    """Text with blanks that keep a number and its unit on one line; other values as they are."""
    plain = isinstance(value, str) and not hasattr(value, "__html__")
    return BEFORE_UNIT.sub("\u00a0", str(value)) if plain else value


def shown(draw: Callable[[], Axes], caption: str, *, wide: bool = False) -> Picture:
    """The figure that holds the Axes that `draw` returns, as SVG with letters as outlines, closed;
    the same bytes for the same figure. A caption alone where no time is left for the picture."""
    if not time_for_pictures():
        return Picture(uri="", caption=f"{caption} Not drawn: no time was left; raise the budget.")
    import matplotlib.pyplot as plt

    from stochvi.views.axes import as_written

    figure = as_written(draw())
    memory = io.BytesIO()
    with plt.rc_context({"svg.fonttype": "path", "svg.hashsalt": "stochvi"}):
        figure.savefig(memory, format="svg", metadata={"Date": None, "Creator": None})
    plt.close(figure)
    encoded = base64.b64encode(memory.getvalue()).decode("ascii")
    return Picture(uri=f"data:image/svg+xml;base64,{encoded}", caption=caption, wide=wide)
