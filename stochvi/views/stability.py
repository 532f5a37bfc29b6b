"""Table and picture of the stability of a modulated structure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.axes import Axes

from stochvi.mathematics.shown_units import RATE
from stochvi.results.column_units import in_chosen_units
from stochvi.views.axes import add_grid, axes_or_new
from stochvi.views.colours import COLOURS
from stochvi.views.tables import print_frame

if TYPE_CHECKING:
    from rich.console import Console

    from stochvi.statistics.stability import Stability

NAMES = {
    "lyapunov_exponent": "almost every motion",
    "mean_growth": "mean",
    "mean_square_growth": "mean squares",
}
"""Whose rate of growth each quantity is."""

COLUMNS = {
    "quantity": "growth of", "value": "rate", "unit": "unit", "standard_error": "error",
    "bias": "bias", "how": "from",
}  # fmt: skip
"""Headings of the columns as the terminal shows them."""


def print_stability(console: Console, found: Stability) -> None:
    """Print how fast what grows."""
    console.print(found.summary(), style="bold", highlight=False)
    table = in_chosen_units(found.to_frame()).replace({"quantity": NAMES}).rename(columns=COLUMNS)
    print_frame(console, table, "growth without stops; below 0 it decays")
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def plot_stability(found: Stability, ax: Axes | None = None) -> Axes:
    """Rates of growth with their 95 % intervals; what lies right of 0 grows."""
    ax = axes_or_new(ax, (6.4, 2.4))
    for row, each in enumerate(found.rates.values()):
        low, high = each.interval()
        bars = [[RATE(each.value - low)], [RATE(high - each.value)]]
        ax.errorbar(RATE(each.value), row, xerr=bars, fmt="o", capsize=3, color=COLOURS["simulate"])
    ax.axvline(0.0, color="black", linewidth=0.8)
    ax.set_yticks(range(len(found.rates)), [NAMES[name] for name in found.rates])
    ax.set_ylim(len(found.rates) - 0.5, -0.5)
    ax.set_xlabel(f"rate of growth ({RATE}); below 0 it decays")
    add_grid(ax)
    return ax
