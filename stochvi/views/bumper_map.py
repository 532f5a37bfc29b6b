"""The bumper map on a terminal, and its picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from stochvi.isolators.sizing.answer import spoken_mission, spoken_percent
from stochvi.mathematics.arrays import Matrix
from stochvi.mathematics.shown_units import (
    ACCELERATION,
    ENERGY,
    FORCE,
    LENGTH,
    STIFFNESS,
    ShownQuantity,
)
from stochvi.results.estimates import Estimate
from stochvi.views.axes import axes_or_new, plain_ticks
from stochvi.views.colours import CLEARANCES
from stochvi.views.tables import (
    new_table,
    print_assumptions,
    print_line,
    print_table,
    value_with_error,
)

if TYPE_CHECKING:
    from rich.console import Console

    from stochvi.isolators.bumpers import BumperMap

SIZE = (10.0, 7.6)
"""Size of the picture, inches."""

LINES = 7
"""Number of lines of equal values in a panel."""

CORNERS = 4
"""Number of clearances, and of stiffnesses, of the table on a terminal; the file has all."""


class Panel(NamedTuple):
    """A quantity of the map in words, and what stands behind its unit."""

    name: str
    words: str
    quantity: ShownQuantity
    more: str = ""


def panels(found: BumperMap) -> list[Panel]:
    """The four panels of the picture."""
    per = "/kg" if found.scene_without_mass else ""
    return [
        Panel("peak_acceleration", "peak acceleration", ACCELERATION),
        Panel("pad_force", "largest force on a stop", FORCE, per),
        Panel("rattle_space", "travel per side", LENGTH),
        Panel("energy_per_hit", "mean energy of an impact", ENERGY, per),
    ]


def print_bumper_map(console: Console, found: BumperMap) -> None:
    """Print the quantities at some points, and the best one."""
    console.print(found.summary(), style="bold", highlight=False)
    headings = [
        f"clearance ({LENGTH})",
        f"stiffness ({STIFFNESS})" if _in_units(found) else "stiffness, times",
    ]
    shown = panels(found)
    headings += [panel.quantity.heading(panel.words, panel.more) for panel in shown]
    headings += ["limits"] if found.limits else []
    rows, columns = found.feasible.shape
    at = [np.unique(np.linspace(0, n - 1, CORNERS).round().astype(int)) for n in (rows, columns)]
    left = rows * columns - len(at[0]) * len(at[1])
    more = f"; {left} more points in the file of the map" if left else ""
    table = new_table(f"exceeded in {_risk(found)}{more}", headings)
    for row in at[0]:
        for column in at[1]:
            cells = [f"{LENGTH(found.clearance[row]):.3g}", f"{_stiffness(found)[column]:.3g}"]
            for panel in shown:
                cells.append(_one(found, panel, row, column))
            if found.limits:
                cells.append(_verdict(found, row, column))
            table.add_row(*cells)
    print_table(console, table)
    print_assumptions(console, found.assumptions)
    print_line(console, f"cost: {found.cost.wall_time:.3g} s on {found.cost.threads} threads")
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def _verdict(found: BumperMap, row: int, column: int) -> str:
    """Whether a point keeps the limits, as far as its errors tell."""
    if found.feasible[row, column]:
        return "kept"
    return "exceeded" if found.exceeded[row, column] else "not shown"


def _risk(found: BumperMap) -> str:
    return f"{spoken_percent(found.exceedance)} of missions of {spoken_mission(found.mission)}"


def _in_units(found: BumperMap) -> bool:
    return found.stiffness is not None


def _stiffness(found: BumperMap) -> Matrix:
    return found.stiffness_factor if found.stiffness is None else STIFFNESS(found.stiffness)


def _one(found: BumperMap, panel: Panel, row: int, column: int) -> str:
    """A value with its errors."""
    values = getattr(found, panel.name)
    value, error, bias = (
        float(each[row, column]) for each in (values.value, values.standard_error, values.bias)
    )
    if not np.isfinite(value):
        return "not known"
    if not found.impact_speed.value[row, column] > 0.0:
        untouched = "no contact" if panel.name == "pad_force" else f"{panel.quantity(value):.3g}"
        return untouched if panel.name != "energy_per_hit" or value else "no contact"
    estimate = Estimate(value=value, standard_error=error, bias=bias)
    return value_with_error(panel.quantity(estimate), with_bias=False)


def draw_bumper_map(found: BumperMap, title: str = "") -> Axes:
    """Peak acceleration, force, rattle space and energy over clearance and stiffness, each with
    what the limits leave."""
    figure, axes = plt.subplots(2, 2, figsize=SIZE, sharex=True, sharey=True, layout="constrained")
    for ax, panel in zip(axes.ravel(), panels(found), strict=True):
        _draw_panel(found, panel, ax)
    for ax in axes[1]:
        ax.set_xlabel(f"clearance per side ({LENGTH})")
    for ax in axes[:, 0]:
        ax.set_ylabel(_stiffness_label(found))
    words = f"exceeded in {_risk(found)}; mean energy"
    figure.suptitle(f"{title}\n{words}" if title else words, fontsize="medium")
    first: Axes = axes[0, 0]
    return first


def plot_bumper_map(found: BumperMap, ax: Axes | None = None) -> Axes:
    """All panels, or the peak acceleration alone in given Axes."""
    if ax is None:
        return draw_bumper_map(found)
    ax = axes_or_new(ax)
    _draw_panel(found, panels(found)[0], ax)
    ax.set_xlabel(f"clearance per side ({LENGTH})")
    ax.set_ylabel(_stiffness_label(found))
    return ax


def _stiffness_label(found: BumperMap) -> str:
    return (
        f"stiffness of a stop ({STIFFNESS})"
        if _in_units(found)
        else "stiffness of a stop, times its own"
    )


def _draw_panel(found: BumperMap, panel: Panel, ax: Axes) -> None:
    """One quantity in colours, with lines of equal values; what exceeds a limit is hatched,
    and dotted where that is not known."""
    values = panel.quantity(getattr(found, panel.name).value.T)
    x, y = LENGTH(found.clearance), _stiffness(found)
    known = np.ma.masked_invalid(np.where(values > 0.0, values, np.nan))
    low, high = float(known.min()), float(known.max())
    wide = high > 3.0 * low
    norm = LogNorm(low, high) if wide else Normalize(low, high)
    mesh = ax.pcolormesh(x, y, known, norm=norm, cmap="viridis", shading="nearest", rasterized=True)
    levels = (np.geomspace if wide else np.linspace)(low, high, LINES + 2)[1:-1]
    levels = np.unique([float(f"{level:.2g}") for level in levels])
    if min(values.shape) > 1:
        lines = ax.contour(x, y, known, levels=levels, colors="white", linewidths=0.7)
        ax.clabel(lines, fmt="%g", fontsize=7)
        if found.limits:
            outside = (~found.feasible.T).astype(float)
            beyond = np.where(found.exceeded.T, outside, 0.0)
            for area, hatch in ((beyond, "////"), (outside - beyond, "..")):
                ax.contourf(x, y, area, levels=[0.5, 1.5], colors="none", hatches=[hatch])
            ax.contour(x, y, outside, levels=[0.5], colors="black", linewidths=1.4)
    if (best := found.best) is not None:
        ax.plot(
            LENGTH(best.clearance), y[best.column], "*", markersize=13, markeredgecolor="black",
            color=CLEARANCES["three_sigma"],
        )  # fmt: skip
    ax.set_yscale("log")
    plain_ticks(ax)
    limit = found.limits.get(panel.name)
    most = "" if limit is None else f", at most {panel.quantity(limit):.4g}"
    ax.set_title(panel.quantity.heading(panel.words, panel.more + most), fontsize="medium")
    bar = ax.figure.colorbar(mesh, ax=ax)
    bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)) if wide else MaxNLocator(6))
    bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.ax.yaxis.set_minor_formatter(NullFormatter())
