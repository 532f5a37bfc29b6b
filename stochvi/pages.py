"""A report as one self-contained HTML page, from sections of facts, tables and pictures."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TEMPLATE = "report.html"


class Fact(NamedTuple):
    """A quantity in words, its value with its unit, and a remark."""

    name: str
    value: str
    remark: str = ""


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A table: `headings` over `rows`, all as text; `numeric` columns are set flush right."""

    caption: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int = 1
    """How many columns from the left hold words."""


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture as a data URI, and what it shows."""

    uri: str
    caption: str


@dataclass(frozen=True, kw_only=True)
class Section:
    """A part of a report; empty ones are left out of the page."""

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
        """Whether it says nothing."""
        return not (self.lead or self.facts or self.grids or self.pictures or self.notes)


@dataclass(frozen=True, kw_only=True)
class Page:
    """A report: the verdict first, then what it rests on.

    Parameters
    ----------
    title, subtitle
        What was asked of what.
    verdict
        One sentence.
    cards
        The few numbers that a reader takes away.
    warnings
        What must be known before any number is believed.
    sections
        The evidence.
    footer
        Versions, seed, date: what is needed to make the page again.
    """

    title: str
    subtitle: str
    verdict: str
    cards: Sequence[Fact]
    sections: Sequence[Section]
    warnings: Sequence[str] = ()
    footer: Sequence[str] = ()

    def html(self) -> str:
        """The page; it needs no other file, no network and no script."""
        from jinja2 import Environment, PackageLoader, StrictUndefined

        environment = Environment(
            loader=PackageLoader("stochvi"),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        kept = [section for section in self.sections if not section.empty]
        return environment.get_template(TEMPLATE).render(page=self, sections=kept) + "\n"


def shown(ax: Axes, caption: str) -> Picture:
    """The figure of these Axes as SVG with letters as outlines, closed; the same bytes for the
    same figure."""
    import matplotlib.pyplot as plt

    figure = ax.get_figure(root=True)
    assert figure is not None
    memory = io.BytesIO()
    with plt.rc_context({"svg.fonttype": "path", "svg.hashsalt": "stochvi"}):
        figure.savefig(memory, format="svg", metadata={"Date": None, "Creator": None})
    plt.close(figure)
    encoded = base64.b64encode(memory.getvalue()).decode("ascii")
    return Picture(uri=f"data:image/svg+xml;base64,{encoded}", caption=caption)
