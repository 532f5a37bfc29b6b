"""The page of a sizing of several pairs: clearance by clearance, and the risk of any impact."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from stochvi.isolators.sizing.answer import MOST_NAMED, spoken_mission, spoken_percent
from stochvi.mathematics.shown_units import LENGTH
from stochvi.results.base import plain
from stochvi.results.column_units import named_with_units
from stochvi.results.origin import Origin, origin_of
from stochvi.views.box import modes_in_rows, one_axis_in_rows, plot_box
from stochvi.views.files import try_picture, write_table
from stochvi.views.pairs import (
    TOLERANCES,
    coordinates_in_rows,
    draw_pairs_risk,
    interval_in_words,
    pairs_in_words,
    places_heading,
    places_in_rows,
    plot_pairs_clearances,
    plot_pairs_risk,
    required_in_rows,
    tolerances_in_rows,
    worst_places,
)
from stochvi.views.report.changes import production_section, sensitivity_section
from stochvi.views.report.environment import excitations_section
from stochvi.views.report.pages import Fact, Grid, Page, Section, shown, write_page
from stochvi.views.report.records import record_cards
from stochvi.views.schematic import draw_gaps
from stochvi.views.words import NO_TOLERANCES

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators.screening import Screening
    from stochvi.isolators.sizing.answer import Sizing


def write_pairs_report(
    sizing: Sizing,
    folder: str | Path,
    origin: Origin | None = None,
    sensitivity: pd.DataFrame | None = None,
) -> Path:
    """Write `report.html`, `size.json`, the tables and `risk.png`; returns the path of the page."""
    folder = Path(folder)
    page = pairs_page(sizing, origin or origin_of(sizing.provenance), sensitivity)
    added = {} if sensitivity is None else {"sensitivity": plain(sensitivity)}
    path = write_page(page, sizing.to_dict() | added, "size", folder)
    tables = {
        "risk": sizing.curve,
        "pairs": sizing.pairs,
        "required": sizing.required,
        "tolerances": sizing.tolerances,
        "sensitivity": sensitivity,
    }
    for name, table in tables.items():
        if table is not None:
            lengths = dict.fromkeys([*sizing.clearances, "lower", "upper"], "m")
            write_table(named_with_units(table), folder / f"{name}.csv", lengths)
    try_picture(lambda: draw_pairs_risk(sizing, sizing.scene.title), folder / "risk.png")
    return path


def pairs_page(sizing: Sizing, origin: Origin, sensitivity: pd.DataFrame | None = None) -> Page:
    """The page of a sizing of several pairs."""
    mission, own = spoken_mission(sizing.mission), record_cards(sizing.record)
    gaussian, heading = _clearance_cards(sizing), places_heading(sizing)
    three, any_hit = sizing.three_sigma.probability.value, sizing.probability
    assert any_hit is not None
    return Page(
        title=sizing.scene.title or "Clearances of several pairs",
        subtitle=f"Probability that any of {len(sizing.pairs)} pairs is hit in {mission}",
        verdict=f"{sizing.verdict()[0].upper()}{sizing.verdict()[1:]}.",
        statements=[f"{sizing.calculated()[0].upper()}{sizing.calculated()[1:]}."],
        alarm=sizing.doubtful is not None,
        cards=[
            *(own + gaussian if sizing.doubtful else gaussian + own),
            Fact(
                "Probability of any impact",
                spoken_percent(any_hit.value),
                f"{interval_in_words(any_hit)}, 95 %; as calculated",
            ),
            *(
                [Fact("Expected impacts", sizing.expected_in_words(), f"in {mission}")]
                if sizing.expected_hits is not None
                else []
            ),
            Fact("At 3 sigma of every gap", spoken_percent(three), mission),
        ],
        warnings=list(sizing.warnings),
        sections=[
            Section(
                title="Pair by pair",
                lead=_shared(sizing),
                grids=[
                    Grid.of(f"{heading[0].upper()}{heading[1:]}", places_in_rows(sizing)),
                    Grid.of("Clearances and risk as calculated", pairs_in_words(sizing)),
                ],
                pictures=[
                    shown(
                        lambda: draw_gaps(sizing.scene.impact_pairs, sizing.rests),
                        "Stops as they stand in the scene file, and clearances from the static "
                        "equilibrium.",
                    ),
                    shown(
                        lambda: plot_pairs_clearances(sizing),
                        "Clearances and the rule of three sigma.",
                    ),
                    shown(
                        lambda: plot_pairs_risk(sizing),
                        "Probability of any impact as all clearances change.",
                    ),
                ],
            ),
            excitations_section(sizing.scene),
            *_box_sections(sizing),
            Section(
                title="Other risks",
                lead="The clearance of each pair for other probabilities of any impact, as "
                "calculated.",
                grids=[Grid.of("Clearances", required_in_rows(sizing))],
            ),
            _screening(sizing.screening),
            _tolerances(sizing),
            production_section(sizing.production),
            sensitivity_section(sensitivity),
            Section(
                title="Limits",
                lead="Assumptions of this report.",
                notes=[
                    f"{text[0].upper()}{text[1:].rstrip('.')}."
                    for text in (
                        *sizing.scene.assumptions(),
                        f"the probability comes from {sizing.method}",
                        "clearances are measured from the static equilibrium",
                        *([] if len(sizing.tolerances) > 1 else [NO_TOLERANCES]),
                    )
                ],
            ),
        ],
        origin=origin,
        footer=[f"calculated in {sizing.cost.wall_time:.3g} s on {sizing.cost.threads} threads"],
    )


def _shared(sizing: Sizing) -> str:
    """How the pairs share the risk, in sentences."""
    if sizing.pair is not None:
        return "One pair is sized; the stops of the others stay where the scene has them."
    equally = "share the risk equally: each alone would be hit with the same probability."
    if not sizing.common:
        return f"Pairs {equally}"
    common = f"{', '.join(sizing.common)} have one clearance in common, so that their risks differ."
    rest = "" if set(sizing.common) == set(sizing.clearances) else f" The other pairs {equally}"
    return common + rest


def _screening(linear: Screening) -> Section:
    """The motion without stops, of coordinates, points and gaps."""
    return Section(
        title="Linear screening",
        lead="The rule of three sigma rests on the Gaussian response of the structure without "
        "stops. Impacts are counted as Rice's crossings, as if impacts changed nothing.",
        grids=[
            Grid.of("Coordinates and points", coordinates_in_rows(linear)),
            Grid.of("Gaps and stops of the scene", linear.gaps_to_frame()),
        ],
    )


def _tolerances(sizing: Sizing) -> Section:
    """What changes within the tolerances ask for; empty without tolerances."""
    if len(sizing.tolerances) < 2:
        return Section(title="Tolerances")
    return Section(
        title="Tolerances",
        lead=f"{sizing.allowed.in_words()}.",
        grids=[Grid.of(f"{TOLERANCES[0].upper()}{TOLERANCES[1:]}", tolerances_in_rows(sizing))],
        notes=[f"{line[0].upper()}{line[1:]}." for line in worst_places(sizing)],
    )


def _clearance_cards(sizing: Sizing) -> list[Fact]:
    """The clearance of each pair to make; for many pairs the smallest and the largest."""
    made = sizing.each_made
    purpose = "to make" if sizing.doubtful is None else "for Gaussian noise alone"
    named = list(sizing.clearances)
    if len(named) > MOST_NAMED:
        named = list(dict.fromkeys(sizing.extremes()))
    cards = []
    for name in named:
        each = sizing.clearances[name]
        cards.append(
            Fact(
                f"Clearance of {name} {purpose}",
                str(made[name]),
                f"per side, from the static equilibrium; calculated {LENGTH.text(each.value)}, "
                f"{LENGTH.span(each.lower, each.upper)}, 95 %",
            )
        )
    return cards


def _box_sections(sizing: Sizing) -> list[Section]:
    """The section on a rigid box: its picture, its modes, and the rule of three sigma by axis."""
    if sizing.box is None:
        return []
    return [
        Section(
            title="The box",
            lead="Three sigma of one axis is the clearance that sizing the box as one oscillator "
            "along each axis would give. The probability there is that of an impact on this "
            "snubber alone, by Rice's rate for its gap on the real box.",
            grids=[
                Grid.of("Snubber by snubber, against one oscillator", one_axis_in_rows(sizing)),
                Grid.of("Natural modes without stops", modes_in_rows(sizing.box)),
            ],
            pictures=[
                shown(
                    lambda: plot_box(sizing), "The box, its mounts and its snubbers, by their risk."
                )
            ],
        )
    ]
