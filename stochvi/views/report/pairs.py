"""Sections of a clearance report on several pairs: clearance by clearance, and the box."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stochvi.isolators.sizing.answer import (
    MOST_NAMED,
    places_in_words,
    spoken_mission,
    spoken_percent,
)
from stochvi.mathematics.shown_units import LENGTH
from stochvi.views.box import modes_in_rows, one_axis_in_rows, plot_box
from stochvi.views.pairs import (
    TOLERANCES,
    coordinates_in_rows,
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
from stochvi.views.report.pages import Fact, Grid, Section, capital, shown
from stochvi.views.report.records import record_cards
from stochvi.views.schematic import draw_gaps
from stochvi.views.words import UNKNOWN

if TYPE_CHECKING:
    from stochvi.isolators.screening import Screening
    from stochvi.isolators.sizing.answer import Sizing


def pairs_cards(sizing: Sizing) -> list[Fact]:
    """The clearances to make, and the risk with them and at 3 sigma of every gap."""
    mission, own, gaussian = (
        spoken_mission(sizing.mission), record_cards(sizing.record), _clearance_cards(sizing),
    )  # fmt: skip
    three, any_hit = sizing.three_sigma.probability.value, sizing.probability
    assert any_hit is not None
    return [
        *(own + gaussian if sizing.doubtful else gaussian + own),
        Fact(
            "Probability of any impact",
            spoken_percent(any_hit.value),
            f"{interval_in_words(any_hit)}, 95 %; as calculated"
            + ("" if sizing.doubtful is None else ", for Gaussian noise alone"),
        ),
        *(
            [Fact("Expected impacts", sizing.expected_in_words(), f"in {mission}")]
            if sizing.expected_hits is not None
            else []
        ),
        Fact("At 3 sigma of every gap", spoken_percent(three), mission),
    ]


def pairs_section(sizing: Sizing) -> Section:
    """Where the stops of each pair go, its risk, and the clearances for other risks."""
    return Section(
        title="Pair by pair",
        lead=_shared(sizing),
        grids=[
            Grid.of(capital(places_heading(sizing)), places_in_rows(sizing)),
            Grid.of("Clearances and risk as calculated", pairs_in_words(sizing)),
            Grid.of(
                "Clearances for other probabilities of any impact, as calculated",
                required_in_rows(sizing),
            ),
        ],
        pictures=[
            shown(
                lambda: draw_gaps(sizing.as_made().impact_pairs, sizing.rests),
                f"Stops {_where(sizing)}, from the unloaded mounts.",
            ),
            shown(lambda: plot_pairs_clearances(sizing), "Clearances and the rule of three sigma."),
            shown(
                lambda: plot_pairs_risk(sizing),
                "Probability of any impact as all clearances change.",
            ),
        ],
    )


def _where(sizing: Sizing) -> str:
    """Where the stops of the drawing stand."""
    if not sizing.each_made:
        return "as the scene file states them"
    return "at the clearances to make, as a scene file has them"


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


def gaps_screening_section(linear: Screening) -> Section:
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


def pairs_tolerances_section(sizing: Sizing) -> Section:
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
    made = sizing.rounded
    purpose = "to make" if sizing.doubtful is None else "for Gaussian noise alone"
    tried = "" if sizing.shown_to_keep else " were tried, and not shown to keep the target"
    if not made or tried:
        text = f"{places_in_words(made)}{tried}" if made else "none was found within the tolerances"
        return [Fact(f"Clearances {purpose}", UNKNOWN, f"{text}; raise the budget")]
    named = list(sizing.clearances)
    if len(named) > MOST_NAMED:
        by_size = sorted(made, key=lambda name: made[name].value)
        named = [by_size[0], by_size[-1]]
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


def box_sections(sizing: Sizing) -> list[Section]:
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
                    lambda: plot_box(sizing),
                    "The box, its mounts and its snubbers, by their risk with the stops of the "
                    "scene.",
                )
            ],
        )
    ]
