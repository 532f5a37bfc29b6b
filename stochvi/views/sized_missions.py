"""Clearances of missions with phases, and of a ratio of damage: tables and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from stochvi.isolators.sizing.answer import spoken_mission, spoken_percent
from stochvi.mathematics.shown_units import LENGTH
from stochvi.results.intervals import GAUSSIAN_95
from stochvi.views.axes import add_grid, axes_or_new, plain_ticks
from stochvi.views.colours import BAND_ALPHA, CLEARANCES, COLOURS
from stochvi.views.damage import print_damage
from stochvi.views.isolator_tables import CONTRADICTED
from stochvi.views.tables import (
    Heading,
    print_assumptions,
    print_frame,
    print_line,
    with_headings,
)
from stochvi.views.words import WITHOUT_TOLERANCES, chance_in_words, line_to_copy

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

    from stochvi.isolators.sizing.answer import ClearanceAnswer
    from stochvi.isolators.sizing.damage_answer import DamageSizing
    from stochvi.isolators.sizing.missions_answer import MissionSizing


def _print_clearance(console: Console, found: ClearanceAnswer) -> None:
    """Print the clearance to make, the line to copy, and the clearance that was calculated."""
    style = CONTRADICTED if found.doubtful else "bold"
    console.print(found.verdict(), style=style, highlight=False)
    if stops := found.stops_to_copy():
        print_line(console, line_to_copy(stops))
    print_line(console, found.calculated())
    print_line(console, WITHOUT_TOLERANCES)


def _mark(ax: Axes, found: ClearanceAnswer, label: str) -> None:
    """Mark the calculated clearance and, where a record does not agree with the noise for which it
    holds, what the record itself needs."""
    place, record = LENGTH(found.clearance.value), found.record
    if not found.doubtful or record is None:
        ax.axvline(place, color=CLEARANCES["recommended"], label=label)
        return
    ax.axvline(place, color=COLOURS["stop"], label=f"for Gaussian noise: {label}")
    largest = max(record.gaps, key=lambda each: each.clearance)
    ax.axvline(
        LENGTH(largest.clearance), color=CLEARANCES["record"],
        label=f"the record itself: {largest.needed}",
    )  # fmt: skip


def phases_table(found: MissionSizing) -> pd.DataFrame:
    """The phases in words."""
    table = found.phases.assign(
        duration=[spoken_mission(each) for each in found.phases["duration"]],
        probability=[chance_in_words(each) for each in found.phases["probability"]],
        share=[chance_in_words(each) for each in found.phases["share"]],
    )
    still = not found.phases["shift"].any()
    return with_headings(
        table, {k: v for k, v in PHASE_COLUMNS.items() if not (still and k == "shift")}
    )


PHASE_COLUMNS: dict[str, Heading] = {
    "phase": "phase", "duration": "duration", "displacement_std": ("rms ()", LENGTH),
    "shift": ("shift of rest ()", LENGTH), "probability": "probability there",
    "share": "part of the risk", "clearance": ("clearance alone ()", LENGTH),
}  # fmt: skip
TRIED_COLUMNS: dict[str, Heading] = {
    "clearance": ("clearance ()", LENGTH), "damage_ratio": "times the damage",
    "standard_error": "standard error", "frequency_hz": "at (Hz)", "by": "by",
}  # fmt: skip


def print_mission_sizing(console: Console, found: MissionSizing) -> None:
    """Print the clearance to make, the share of each phase in its risk, and what records say."""
    _print_clearance(console, found)
    print_frame(console, phases_table(found), "phases")
    for name, record in found.records.items():
        if record.agrees:
            print_line(console, f"phase {name}: {record.sentence()}")
    print_assumptions(console, found.assumptions)
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def plot_mission_sizing(found: MissionSizing, ax: Axes | None = None) -> Axes:
    """Probability of any impact in the mission against the clearance."""
    ax = axes_or_new(ax)
    curve = found.curve
    x = LENGTH(curve["clearance"])
    ax.fill_between(
        x, curve["probability_low"], curve["probability_high"], color=COLOURS["simulate"],
        alpha=BAND_ALPHA, linewidth=0,
    )  # fmt: skip
    ax.plot(
        x,
        curve["probability"],
        color=COLOURS["simulate"],
        label="all phases" if len(found.phases) > 1 else None,
    )
    _mark(
        ax, found,
        f"{LENGTH.text(found.clearance.value)} keeps {spoken_percent(found.target.value)}",
    )  # fmt: skip
    ax.set_yscale("log")
    ax.set_ylim(top=1.5)
    ax.set_xlabel(f"clearance per side{found.of_widest} ({LENGTH})")
    ax.set_ylabel(f"probability of an impact in {spoken_mission(found.mission)}")
    add_grid(ax)
    ax.legend(frameon=False)
    return ax


def damage_table(found: DamageSizing) -> pd.DataFrame:
    """The clearances that were tried."""
    return with_headings(found.tried, TRIED_COLUMNS)


def print_damage_sizing(console: Console, found: DamageSizing) -> None:
    """Print the clearance to make, the clearances that were tried, and the damage there."""
    _print_clearance(console, found)
    print_frame(console, damage_table(found), "clearances that were tried")
    print_damage(console, found.damage)


def plot_damage_sizing(found: DamageSizing, ax: Axes | None = None) -> Axes:
    """Largest ratio of damage, less 1, against the clearance."""
    ax = axes_or_new(ax)
    tried = found.tried
    added, half = tried["damage_ratio"] - 1.0, GAUSSIAN_95 * tried["standard_error"]
    low = np.minimum(half, 0.99 * added)
    ax.errorbar(
        LENGTH(tried["clearance"]), added, yerr=[low, half], fmt="o", capsize=3,
        color=COLOURS["simulate"], label="damage that stops add, 95 %",
    )  # fmt: skip
    ax.axhline(found.ratio - 1.0, color=COLOURS["stop"], linestyle="--", label="accepted")
    _mark(ax, found, LENGTH.text(found.clearance.value))
    ax.set_yscale("log")
    plain_ticks(ax)
    ax.set_xlabel(f"clearance per side{found.of_widest} ({LENGTH})")
    ax.set_ylabel("largest damage with stops over that without, less 1")
    add_grid(ax)
    ax.legend(frameon=False, fontsize="small")
    return ax
