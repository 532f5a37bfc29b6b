"""Spectra, statistics of impacts and reliability on a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stochvi.isolators.sizing.answer import NEAR_ONE, over_percent, spoken_mission
from stochvi.mathematics.shown_units import SPEED, shown_as
from stochvi.results.estimates import format_with_error
from stochvi.results.hardness import is_speed, unit_of_limit
from stochvi.views.tables import (
    new_table,
    print_assumptions,
    print_frame,
    print_line,
    print_table,
    value_with_error,
)
from stochvi.views.words import way_in_words

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from stochvi.results.estimates import Estimate
    from stochvi.statistics.impacts import ImpactStatistics
    from stochvi.statistics.reliability import Reliability
    from stochvi.statistics.spectra import ResponseSpectrum

STARTS = {"rest": "rest", "stationary": "the stationary motion"}
"""The starts of a mission in words."""

SURELY = 0.9
"""Lower end of an interval that reaches to 1, from which on "over" and that end are printed; where
it is lower the probability is hardly known, and the interval is printed."""


def print_spectrum(console: Console, found: ResponseSpectrum) -> None:
    """Print the peak of each spectrum and the meanings of the spectra."""
    print_frame(console, found.peaks(), "at the peak of each spectrum, one-sided per hertz")
    for name, meaning in found.meanings.items():
        console.print(f"{name}: {meaning}", style="dim", highlight=False)
    console.print(found.summary(), highlight=False)
    _print_limits(console, found.assumptions, found.warnings)


def print_impacts(console: Console, found: ImpactStatistics, mission: float | None = None) -> None:
    """Print the rates of impacts with their intervals, and the impacts in a mission, s."""
    print_frame(
        console,
        found.to_table(),
        "impacts, with 95 % intervals of the rates",
    )
    console.print(found.summary(), highlight=False)
    if mission is not None:
        console.print(_in_mission(found, mission), highlight=False)
    _print_limits(console, found.assumptions, found.warnings)


def _in_mission(found: ImpactStatistics, mission: float) -> str:
    """The mean number of impacts of each pair in a mission, s, with its 95 % interval: the rate
    times the time, of a motion that is stationary from the start."""
    sentences = []
    for name, pair in found.pairs.items():
        rate = pair.rates["both"]
        low, high = rate.lower * mission, rate.upper * mission
        mean = f"{rate.estimate.value * mission:.4g} ({low:.4g} to {high:.4g})"
        number = f"at most {high:.4g}" if rate.estimate.value == 0.0 else mean
        sentences.append(f"{name}: {number} impacts in {spoken_mission(mission)}")
    return "; ".join(sentences)


def _print_limits(console: Console, assumptions: Sequence[str], warnings: Sequence[str]) -> None:
    console.print(f"assumptions: {'; '.join(assumptions)}", style="dim", highlight=False)
    for warning in warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def chance_in_words(value: float, error: float, lower: float) -> str:
    """A probability with its error; near 1, the number that it exceeds, or its interval where that
    reaches far below 1."""
    if value < NEAR_ONE:
        return format_with_error(value, error)
    if lower < SURELY:
        return f"{max(lower, 0.0):.2g} to 1"
    return over_percent(lower)


def _print_pairs(console: Console, found: Reliability) -> None:
    """Print the risk of each of several pairs, and the probabilities for single coordinates and
    points."""
    table = new_table(
        "pair by pair",
        [
            "pair",
            "hit, if it alone had stops",
            "of first impacts",
            "expected impacts",
            f"mean speed ({SPEED})",
        ],
    )
    for name, risk in found.pairs.items():
        table.add_row(
            name,
            _chance(risk.probability),
            f"{100.0 * risk.share_of_first_hits:.3g} %",
            _number(risk.expected_hits),
            _number(SPEED(risk.impact_speed_mean)),
        )
    print_table(console, table)
    if found.outputs:
        limit = found.chances["peak_acceleration"].limit
        table = new_table(
            f"acceleration above {shown_as('m/s^2').text(limit or 0.0, 'g')}",
            ["coordinate or point", "probability"],
        )
        for name, chance in found.outputs.items():
            table.add_row(name, _chance(chance))
        print_table(console, table)


def _number(estimate: Estimate | None) -> str:
    """A number with its errors; empty where it is not known."""
    if estimate is None:
        return ""
    if estimate.upper_95 is not None:
        return f"at most {estimate.upper_95:.3g}"
    return value_with_error(estimate)


def _chance(chance: Estimate) -> str:
    """A probability with its standard error, or its upper limit."""
    if chance.upper_95 is not None:
        return f"at most {chance.upper_95:.3g}" if chance.upper_95 < NEAR_ONE else "unknown"
    return chance_in_words(
        chance.value, chance.standard_error, chance.value - chance.half_width_95()
    )


def _print_phases(console: Console, found: Reliability) -> None:
    """Print the probabilities and the expected impacts of each phase of a mission."""
    from stochvi.isolators.sizing.answer import spoken_mission

    events = [event.replace("_", " ") for event in found.chances]
    table = new_table("phase by phase", ["phase", "duration", *events, "expected impacts"])
    for name, phase in found.phases.items():
        table.add_row(
            name,
            spoken_mission(phase.mission),
            *(
                f"at most {chance.upper:.3g}"
                if chance.estimate.value == 0.0
                else chance_in_words(
                    chance.estimate.value, chance.estimate.standard_error, chance.lower
                )
                for chance in (phase.chances[event] for event in found.chances)
            ),
            _number(phase.hits),
        )
    print_table(console, table)


def print_reliability(console: Console, found: Reliability, limit_in_g: str | None = None) -> None:
    """Print the probabilities with their intervals, how each was found, and the price.

    `limit_in_g` is the limit of the acceleration as the user gave it, where that was in g.
    """
    from stochvi.isolators.sizing.answer import spoken_mission

    title = f"in a mission of {spoken_mission(found.mission)} from {STARTS[found.start]}"
    percent = f"{100.0 * found.confidence:g} % interval"
    headings = ["event", "probability", percent, "rel. bias", "way", "CPU s"]
    compared = any(chance.crude_seconds is not None for chance in found.chances.values())
    table = new_table(title, [*headings, *["crude"] * compared])
    for name, chance in found.chances.items():
        estimate = chance.estimate
        limit = ""
        if chance.limit is not None:
            quantity = shown_as(unit_of_limit(name))
            limit = f" > {quantity.text(chance.limit, 'g')}"
            if not is_speed(name) and limit_in_g and quantity.chosen is None:
                limit = f" > {limit_in_g.removesuffix('g').strip()} g"
        unseen = estimate.value == 0.0
        known = estimate.bias is not None and not unseen
        crude = chance.crude_seconds
        table.add_row(
            f"{name.replace('_', ' ')}{limit}",
            f"at most {chance.upper:.3g} ({100.0 * chance.confidence:g} %)"
            if unseen
            else chance_in_words(estimate.value, estimate.standard_error, chance.lower),
            f"{chance.lower:.3g} to {chance.upper:.3g}",
            f"{(estimate.bias or 0.0) / estimate.value:.1g}" if known else "unknown",
            way_in_words(chance.way),
            f"{chance.seconds:.2g}",
            *["" if crude is None else f"{crude:.2g}"] * compared,
        )
    for name in found.missing:
        if name != "expected_hits" and name not in found.chances:
            table.add_row(name.replace("_", " "), "not found")
    print_table(console, table)
    if found.phases:
        _print_phases(console, found)
    if found.pairs:
        _print_pairs(console, found)
    if "expected_hits" in found.missing and found.hits is None:
        console.print("expected impacts not found", highlight=False)
    if found.hits is not None and found.hits_interval is not None:
        lower, upper = found.hits_interval
        ends = "" if found.hits.upper_95 is not None else f", {lower:.4g} to {upper:.4g}"
        console.print(f"expected impacts {_number(found.hits)}{ends}", highlight=False)
    for chance in found.chances.values():
        print_line(console, f"{chance.event.replace('_', ' ')}: {chance.why}")
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)
    print_assumptions(console, found.assumptions)
    meaning = "; crude: CPU seconds of whole missions for the same error" if compared else ""
    print_line(console, f"cost: {found.cost.wall_time:.3g} s{meaning}")
