"""Sections of a clearance report on changed scenes: tolerances, production and sensitivity."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from stochvi.isolators.production_risk.spreads import in_words
from stochvi.isolators.sizing.answer import spoken_percent
from stochvi.mathematics.shown_units import LENGTH
from stochvi.views.production import (
    COSTS,
    plot_costs,
    plot_units,
    risk_in_words,
    tolerances_in_rows,
    units_heading,
    units_in_rows,
)
from stochvi.views.report.pages import Grid, Picture, Section, sentence, shown
from stochvi.views.sizing import plot_sensitivity
from stochvi.views.tables import Heading, with_headings
from stochvi.views.words import UNKNOWN, clearances_of_changes, four_digits

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators.production_risk.answer import Production
    from stochvi.isolators.sizing.review import Review


def worst_case_section(review: Review) -> Section:
    """Each tolerance at its ends, and the worst within all of them; empty without tolerances."""
    table = review.worst_case
    if table is None:
        return Section(title="Tolerances")
    return Section(
        title="Tolerances",
        lead="The clearance for the same target, from the static equilibrium of the mount as "
        "stated, and the probability of any impact that then remains: "
        f"{review.tolerances.in_words()}. Each is at its ends first. Last is the largest "
        "requirement within all of them: the response of the mount is searched over the whole "
        "region, and the scene that is found there is sized.",
        grids=[_changes_grid(table, "Each row is sized anew")],
        pictures=_change_bars(table),
        notes=_notes_of(table),
    )


def production_section(found: Production | None) -> Section:
    """The risk of the production; empty without distributions of tolerances."""
    if found is None:
        return Section(title="Production")
    return Section(
        title="Production",
        lead=f"Units differ: {in_words(found.spreads)}. "
        + " ".join(sentence(line) for line in risk_in_words(found)),
        grids=[
            Grid.of(COSTS, tolerances_in_rows(found)),
            Grid.of(units_heading(found), units_in_rows(found)),
        ],
        pictures=[
            shown(lambda: plot_units(found), "Units by their probability of any impact."),
            shown(lambda: plot_costs(found), "Clearance that each tolerance costs."),
        ],
        notes=[sentence(found.method)],
    )


def sensitivity_section(table: pd.DataFrame | None) -> Section:
    """The changed scenes of `sensitivity`."""
    if table is None:
        return Section(title="Sensitivity")
    return Section(
        title="Sensitivity",
        lead="The clearance for the same target if mount, environment or stops are not as stated, "
        "and the probability of any impact that then remains.",
        grids=[_changes_grid(table, "One thing changed at a time, the rest as stated")],
        pictures=_change_bars(table),
        notes=_notes_of(table),
    )


def _changes_grid(table: pd.DataFrame, caption: str) -> Grid:
    def number(value: float, text: Callable[[float], str]) -> str:
        return UNKNOWN if math.isnan(value) else text(value)

    lengths: dict[str, Heading] = {"sigma": ("linear rms ()", LENGTH)} if "sigma" in table else {}
    lengths |= clearances_of_changes(table)
    shown = with_headings(table, lengths)
    return Grid(
        caption=caption,
        headings=["change", *shown, "by (%)", "any impact, clearance as stated"],
        rows=[
            [
                row["change"],
                *(number(each, four_digits) for each in places),
                number(row["clearance_change"], lambda x: f"{100.0 * x:+.3g}"),
                number(row["probability"], spoken_percent),
            ]
            for row, places in zip(table.to_dict("records"), shown.to_numpy(), strict=True)
        ],
    )


def _change_bars(table: pd.DataFrame) -> list[Picture]:
    known = table.dropna(subset=["clearance_change"])
    if len(known) < 2:
        return []
    return [shown(lambda: plot_sensitivity(known), "Change of the clearance, per cent.")]


def _notes_of(table: pd.DataFrame) -> list[str]:
    return [f"{row['change']}: {row['note']}" for row in table.to_dict("records") if row["note"]]
