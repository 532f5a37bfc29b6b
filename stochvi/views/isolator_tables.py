"""Screening, clearances and sizing of isolators on a terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from stochvi.isolators.sizing.answer import (
    HITS_PER_FIRST_HIT,
    Probability,
    spoken_mission,
    spoken_percent,
)
from stochvi.mathematics.shown_units import LENGTH, RATE, SPEED
from stochvi.views.pairs import (
    TOLERANCES,
    coordinates_in_rows,
    interval_in_words,
    pairs_in_words,
    places_heading,
    places_in_rows,
    required_in_rows,
    tolerances_in_rows,
    worst_places,
)
from stochvi.views.production import print_production
from stochvi.views.tables import (
    LAST_DIGITS,
    Heading,
    new_table,
    print_frame,
    print_line,
    print_table,
    value_with_error,
    with_headings,
)
from stochvi.views.words import (
    WITHOUT_TOLERANCES,
    clearances_of_changes,
    places_of_stops,
    way_in_words,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd
    from rich.console import Console

    from stochvi.isolators.jolt_response import Jolts
    from stochvi.isolators.record_verdict import RecordVerdict
    from stochvi.isolators.screening import Screening
    from stochvi.isolators.sizing.answer import Sizing


def print_screening(console: Console, linear: Screening) -> None:
    """Print the verdict on a record, then the linear screening of coordinates and gaps with its
    notes."""
    print_record(console, linear.record)
    table = linear.to_frame() if len(linear.coordinates) == 1 else coordinates_in_rows(linear)
    print_frame(console, table, "linear screening, stops left out")
    if linear.impact_pairs:
        print_frame(console, linear.gaps_to_frame(), "gaps, and impacts by Rice")
    for note in linear.notes:
        console.print(f"note: {note}", style="yellow", highlight=False)


CONTRADICTED = "bold red"
"""Style of a verdict on a record that is not like Gaussian noise, or too short to tell."""


def print_record(console: Console, record: RecordVerdict | None, where: str = "") -> None:
    """Print whether a record moves the mount as Gaussian noise would; nothing without a record.

    `where` stands before it, such as the phase of the record.
    """
    if record is None:
        return
    style = None if record.agrees else CONTRADICTED
    console.print(f"{where}{record.sentence()}", style=style, highlight=False)


CLEARANCE_COLUMNS: dict[str, Heading] = {
    "pair": "pair",
    "clearance_in_sigma": "gap/sigma",
    "clearance": ("gap ()", LENGTH),
    "rice": ("Rice ()", RATE),
    "closure": ("closure", RATE),
    "simulated": ("Monte Carlo", RATE),
    "interval": "95 % interval",
    "impact_speed_mean": ("speed ()", SPEED),
}


def print_clearance(console: Console, curve: pd.DataFrame, notes: Sequence[str] = ()) -> None:
    """Print the impact rate against clearance, as `clearance_curve` returns it, and the notes on
    it."""
    limits = zip(curve["simulated_low"], curve["simulated_high"], strict=True)
    shown = curve.assign(interval=[f"{RATE(a):.3g} to {RATE(b):.3g}" for a, b in limits])
    print_frame(
        console,
        with_headings(shown, CLEARANCE_COLUMNS),
        f"impacts per {RATE.time} on both stops, and mean impact speed",
        {"gap/sigma": ".2f"},
    )
    for note in notes:
        console.print(f"note: {note}", style="yellow", highlight=False)


def print_sizing(console: Console, sizing: Sizing, sensitivity: pd.DataFrame | None = None) -> None:
    """Print the clearances to make first, then the numbers behind them, then what they rest on."""
    style = "bold" if sizing.doubtful is None else CONTRADICTED
    console.print(sizing.verdict(), style=style, highlight=False)
    if sizing.doubtful is None:
        print_record(console, sizing.record)
    if sizing.several:
        _print_pairs(console, sizing)
    else:
        _print_one(console, sizing)
    if sizing.production is not None:
        print_production(console, sizing.production)
    if sensitivity is not None:
        _print_changes(console, sensitivity, "one thing changed at a time")
    print_line(console, f"method: {sizing.method}")
    print_line(console, f"cost: {sizing.cost.wall_time:.3g} s on {sizing.cost.threads} threads")
    for warning in sizing.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def _print_one(console: Console, sizing: Sizing) -> None:
    """Print where the stops go and the risk at three sigma, then the numbers behind both."""
    for line in places_of_stops(sizing).splitlines():
        print_line(console, line)
    print_line(console, sizing.calculated())
    _print_tolerances(console, sizing)
    if sizing.worst_case is not None:
        _print_changes(console, sizing.worst_case, "within the tolerances, each row sized anew")
    three, mission = sizing.three_sigma, spoken_mission(sizing.mission)
    table = new_table(
        f"at 3 sigma = {LENGTH.text(three.clearance)}, in {mission}", ["quantity", "value"]
    )
    table.add_row("probability of any impact", spoken_percent(three.probability.value))
    table.add_row("impacts by Rice", f"{three.rice_hits:.4g}")
    table.add_row("first impacts (clusters)", value_with_error(three.first_hits))
    if three.hits is not None:
        table.add_row("impacts, simulated", value_with_error(three.hits))
    if three.impact_speed_mean is not None:
        table.add_row(
            f"mean impact speed ({SPEED})", value_with_error(SPEED(three.impact_speed_mean))
        )
    print_table(console, table)
    print_line(console, LAST_DIGITS)
    limits = zip(sizing.required["clearance_low"], sizing.required["clearance_high"], strict=True)
    print_frame(
        console,
        with_headings(
            sizing.required.assign(
                probability=[spoken_percent(chance) for chance in sizing.required["probability"]],
                interval=[f"{LENGTH(low):.4g} to {LENGTH(high):.4g}" for low, high in limits],
            ),
            REQUIRED_COLUMNS,
        ),
        f"probability of any impact in {mission}",
    )
    _print_hits(console, sizing)


def _print_tolerances(console: Console, sizing: Sizing) -> None:
    """Say that nothing is taken to differ from the scene, where that is so."""
    if not sizing.varies:
        print_line(console, WITHOUT_TOLERANCES)


def _print_changes(console: Console, table: pd.DataFrame, title: str) -> None:
    """Print changed scenes with the clearance that each needs for the same target."""
    columns: dict[str, Heading] = {
        "change": "change",
        **clearances_of_changes(table),
        **CHANGE_COLUMNS,
    }
    shown = table.assign(
        clearance_change=[
            "not found" if math.isnan(c) else f"{100.0 * c:+.1f} %"
            for c in table["clearance_change"]
        ],
        probability=[
            "" if math.isnan(chance) else spoken_percent(chance) for chance in table["probability"]
        ],
    )
    print_frame(
        console,
        with_headings(shown, columns),
        f"{title}: clearance for the same target; probability with the clearance as stated",
    )
    for change, note in zip(table["change"], table["note"], strict=True):
        if note:
            print_line(console, f"{change}: {note}")


def _print_pairs(console: Console, sizing: Sizing) -> None:
    """Print where the stops of several pairs go, then the numbers behind them."""
    mission = spoken_mission(sizing.mission)
    print_frame(console, places_in_rows(sizing), places_heading(sizing))
    print_line(console, sizing.calculated())
    _print_tolerances(console, sizing)
    print_frame(console, pairs_in_words(sizing), f"pair by pair, as calculated, in {mission}")
    table = new_table(
        f"probability that any pair is hit in {mission}", ["stops", "probability", "95 % interval"]
    )
    known = {
        "as sized": sizing.probability,
        "3 sigma of every gap": Probability.of(sizing.three_sigma.probability),
        "of the scene": sizing.as_given,
    }
    for place, chance in known.items():
        if chance is not None:
            table.add_row(place, spoken_percent(chance.value), interval_in_words(chance))
    print_table(console, table)
    print_frame(
        console,
        required_in_rows(sizing),
        f"clearances for other probabilities of any impact in {mission}",
    )
    if len(sizing.tolerances) > 1:
        print_frame(console, tolerances_in_rows(sizing), TOLERANCES)
        for line in worst_places(sizing):
            print_line(console, line)


def _print_hits(console: Console, sizing: Sizing) -> None:
    """Print the impacts at 3 sigma and at the answer; other clearances were steps of the search."""
    if len(sizing.simulated):
        places = [sizing.three_sigma.clearance, sizing.clearance.value]
        table = sizing.simulated[sizing.simulated["clearance"].isin(places)]
        print_frame(
            console,
            with_headings(table.assign(by=table["by"].map(way_in_words)), HIT_COLUMNS),
            "impacts on all stops, with the stop law",
        )
        print_line(console, HITS_PER_FIRST_HIT)


REQUIRED_COLUMNS: dict[str, Heading] = {
    "probability": "probability",
    "clearance": ("clearance ()", LENGTH),
    "interval": "95 % interval",
    "clearance_in_sigma": "in sigma",
}


CHANGE_COLUMNS: dict[str, Heading] = {
    "clearance_change": "by",
    "probability": "probability of any impact",
}


HIT_COLUMNS: dict[str, Heading] = {
    "clearance": ("clearance ()", LENGTH),
    "clearance_in_sigma": "in sigma",
    "hit_rate": ("impacts ()", RATE),
    "hits_per_first_hit": "impacts per cluster",
    "impact_speed_mean": ("mean speed ()", SPEED),
    "by": "by",
}


JOLT_COLUMNS: dict[str, Heading] = {
    "jolt": ("jolt ()", SPEED),
    "captured": "captured",
    "captured_low": "95 % from",
    "captured_high": "to",
    "on_both_stops": "on both stops",
    "left_later": "left later",
}


def print_jolts(console: Console, found: Jolts) -> None:
    """Print whether jolts lead to clatter, and the shares of paths."""
    console.print(found.summary(), style="bold", highlight=False)
    title = f"shares of {found.paths} paths, watched for {found.duration:.3g} s"
    print_frame(console, with_headings(found.to_frame(), JOLT_COLUMNS), title)
