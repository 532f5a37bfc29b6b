"""Damage of equipment: the table on a terminal, and the pictures of its spectra."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from stochvi.isolators.sizing.answer import spoken_mission
from stochvi.mathematics.shown_units import (
    ACCELERATION,
    DENSITY,
    ENERGY,
    HOURLY,
    NUMBER,
    ShownQuantity,
)
from stochvi.results.estimates import Estimate
from stochvi.views.axes import add_grid, axes_or_new, legend_above, plain_ticks
from stochvi.views.colours import BAND_ALPHA, COLOURS
from stochvi.views.tables import (
    new_table,
    print_assumptions,
    print_line,
    print_table,
    value_with_error,
)

if TYPE_CHECKING:
    from rich.console import Console

    from stochvi.statistics.damage import Damage, SpectrumValues, TailoredTest

ROWS = 12
"""Largest number of frequencies of the table on a terminal; the file has all of them."""

WITH, WITHOUT, SHOCK = COLOURS["simulate"], COLOURS["exact"], COLOURS["stop"]
"""Colours of the scene as it is, without its stops, and of its impacts."""


def print_damage(console: Console, found: Damage) -> None:
    """Print the spectra at some frequencies, and the impacts."""
    headings = ["Hz", f"rms ({ACCELERATION})", f"largest ({ACCELERATION})", "damage"]
    without = found.without_stops
    compared = (
        without is not None
        and found.damage_ratio is not None
        and found.impacts_per_hour is not None
        and not found.unseen
    )
    if compared:
        headings += [
            f"rms, no stops ({ACCELERATION})", f"largest, no stops ({ACCELERATION})",
            "times the damage",
        ]  # fmt: skip
    headings.append(f"equivalent ({DENSITY})")
    if found.shocks is not None:
        headings += [f"typical impact ({ACCELERATION})", f"worst of 100 ({ACCELERATION})"]
    title = (
        f"equipment at {found.at}, Q = {found.quality:g}, b = {found.exponent:g}, in a mission of "
        f"{spoken_mission(found.mission)}"
    )
    table = new_table(title, headings)
    count = len(found.equipment_frequency_hz)
    for k in np.unique(np.linspace(0, count - 1, min(count, ROWS)).round().astype(int)):
        spectra = found.with_stops
        row = [
            f"{found.equipment_frequency_hz[k]:.4g}", _one(spectra.response_rms, k, ACCELERATION),
            _one(spectra.extreme_response, k, ACCELERATION), _one(spectra.fatigue_damage, k),
        ]  # fmt: skip
        if compared and without is not None and found.damage_ratio is not None:
            row += [
                _one(without.response_rms, k, ACCELERATION),
                _one(without.extreme_response, k, ACCELERATION), _one(found.damage_ratio, k),
            ]  # fmt: skip
        row.append(_one(found.equivalent_density, k, DENSITY))
        if found.shocks is not None:
            shocks = (found.shocks.typical, found.shocks.worst)
            row += [f"{ACCELERATION(shock[k]):.3g}" for shock in shocks]
        table.add_row(*row)
    print_table(console, table)
    for line in hits_in_words(found):
        print_line(console, line)
    console.print(found.summary(), highlight=False)
    if found.test is not None:
        _print_test(console, found, found.test)
    print_assumptions(console, found.assumptions)
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def _print_test(console: Console, found: Damage, test: TailoredTest) -> None:
    """Print the profile of a test."""
    print_line(
        console,
        f"random test of {spoken_mission(test.duration)} with the damage of "
        f"{spoken_mission(found.mission)}, at {test.exaggeration:.3g} times the rms:",
    )
    table = new_table("", ["Hz", str(DENSITY)])
    for frequency, density in zip(test.frequency_hz, test.density, strict=True):
        table.add_row(f"{frequency:.4g}", f"{DENSITY(density):.3g}")
    print_table(console, table)
    console.print(test.summary(), highlight=False)


def hits_in_words(found: Damage) -> list[str]:
    """Sentences on the impacts, their energy and accelerations."""
    energy = f" {ENERGY}/kg" if found.scene_without_mass else f" {ENERGY}"
    lines = [
        f"{words} {_hourly(quantity(estimate))}{unit} per {HOURLY.time}"
        for words, estimate, quantity, unit in (
            ("impacts", found.impacts_per_hour, NUMBER, ""),
            ("impacts bring", found.impact_work_per_hour, ENERGY, energy),
            ("and lose", found.impact_loss_per_hour, ENERGY, energy),
        )
        if estimate is not None and not (found.unseen and quantity is ENERGY)
    ]
    lines += [
        f"contacts above {ACCELERATION.text(float(level))}: {_hourly(estimate)} per {HOURLY.time}"
        for level, estimate in found.contacts_above.items()
    ]
    return lines


def _hourly(per_hour: Estimate) -> str:
    """A rate, per hour, in the unit of rates that is shown."""
    estimate = HOURLY(per_hour / 3600.0)
    if estimate.upper_95 is not None:
        return f"at most {estimate.upper_95:.3g}"
    return value_with_error(estimate)


def _one(values: SpectrumValues, k: int, quantity: ShownQuantity = NUMBER) -> str:
    """A value with its errors, in the unit that is shown."""
    estimate = Estimate(
        value=float(values.value[k]), standard_error=float(values.standard_error[k]),
        bias=float(values.bias[k]),
    )  # fmt: skip
    return value_with_error(quantity(estimate))


def draw_damage(found: Damage, title: str = "") -> Axes:
    """Extreme response and shocks, fatigue damage, and the density that does the same damage."""
    figure, axes = plt.subplots(3, 1, figsize=(7.2, 8.4), sharex=True, layout="constrained")
    plot_extremes(found, axes[0])
    plot_fatigue(found, axes[1])
    _curve(axes[2], found, found.equivalent_density, WITH, "same damage without stops", DENSITY)
    if found.test is not None:
        words = f"test of {spoken_mission(found.test.duration)}"
        points = found.test.frequency_hz, DENSITY(found.test.density)
        axes[2].plot(*points, "o-", color=SHOCK, markersize=3, label=words)
        axes[2].legend(frameon=False, fontsize="small")
    axes[2].set_ylabel(f"equivalent density\n({DENSITY}, one-sided)")
    axes[2].set_yscale("log")
    plain_ticks(axes[2])
    add_grid(axes[2])
    axes[2].set_xlabel("natural frequency of the equipment (Hz)")
    words = (
        f"equipment at {found.at}, Q = {found.quality:g}, in a mission of "
        f"{spoken_mission(found.mission)}"
    )
    figure.suptitle(f"{title}\n{words}" if title else words, fontsize="medium")
    first: Axes = axes[0]
    return first


def plot_damage(found: Damage, ax: Axes | None = None) -> Axes:
    """All spectra, or the fatigue damage alone in given Axes."""
    if ax is None:
        return draw_damage(found)
    plot_fatigue(found, ax)
    ax.set_xlabel("natural frequency of the equipment (Hz)")
    return ax


def plot_extremes(found: Damage, ax: Axes | None = None) -> Axes:
    """Expected largest acceleration of the equipment with the range of 95 % of missions, rms, and
    shock spectra of impacts."""
    ax = axes_or_new(ax)
    f, shown = found.equipment_frequency_hz, ACCELERATION
    spectra, without = found.with_stops, found.without_stops
    largest = "largest of the record"
    if found.way != "record":  # one record has no scatter
        largest = "expected largest"
        ax.fill_between(
            f, shown(spectra.extreme_lower), shown(spectra.extreme_upper), color=WITH,
            alpha=BAND_ALPHA, linewidth=0, label="largest of 95 % of missions",
        )  # fmt: skip
    ax.plot(f, shown(spectra.extreme_response.value), color=WITH, label=largest)
    if without is not None and without is not spectra:
        ax.plot(f, shown(without.extreme_response.value), color=WITHOUT, label="without stops")
    if found.shocks is not None:
        ax.plot(f, shown(found.shocks.worst), "--", color=SHOCK, label="worst of 100 impacts")
        ax.plot(f, shown(found.shocks.typical), ":", color=SHOCK, label="typical impact")
    ax.plot(f, shown(spectra.response_rms.value), color=WITH, linewidth=0.8, label="rms")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_ylabel(f"acceleration of the\nequipment ({ACCELERATION})")
    _show_one(ax, found)
    plain_ticks(ax)
    add_grid(ax)
    legend_above(ax)
    return ax


def plot_fatigue(found: Damage, ax: Axes | None = None) -> Axes:
    """Fatigue damage spectrum with its 95 % intervals, with stops and without."""
    ax = axes_or_new(ax)
    _curve(ax, found, found.with_stops.fatigue_damage, WITH, "with stops")
    if found.without_stops is not None and found.without_stops is not found.with_stops:
        _curve(ax, found, found.without_stops.fatigue_damage, WITHOUT, "without stops")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_ylabel(f"fatigue damage\n(m/s)^{found.exponent:g}")
    plain_ticks(ax)
    add_grid(ax)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(frameon=False, fontsize="small")
    return ax


def _curve(
    ax: Axes,
    found: Damage,
    values: SpectrumValues,
    colour: str,
    label: str,
    quantity: ShownQuantity = NUMBER,
) -> None:
    """A curve with its 95 % intervals."""
    f, half = found.equipment_frequency_hz, values.half_width_95()
    low, high = np.maximum(values.value - half, 1e-3 * values.value), values.value + half
    ax.fill_between(f, quantity(low), quantity(high), color=colour, alpha=BAND_ALPHA, linewidth=0)
    ax.plot(f, quantity(values.value), color=colour, label=label)
    _show_one(ax, found)


def _show_one(ax: Axes, found: Damage) -> None:
    """Mark the values of equipment of a single frequency, which no line would show."""
    if len(found.equipment_frequency_hz) == 1:
        for line in ax.lines:
            line.set_marker("o")
