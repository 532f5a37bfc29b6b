"""Tables and pictures of basins, bifurcations and life times."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from stochvi.mathematics.shown_units import RATE, SPEED, TIME
from stochvi.views.axes import add_grid, axes_or_new, length_unit
from stochvi.views.colours import BASINS, BEYOND, CHAOTIC, COLOURS, UNDECIDED
from stochvi.views.tables import Heading, print_frame, with_headings

if TYPE_CHECKING:
    from rich.console import Console

    from stochvi.methods.periodic.basins import Basins
    from stochvi.methods.periodic.bifurcation import Bifurcation
    from stochvi.statistics.lifetimes import LifeTimes

MAP_SIZE, DIAGRAM_SIZE = (7.0, 5.2), (7.0, 6.0)
"""Sizes of a map of basins and of a diagram of two panels, inches."""

REGIME_COLUMNS: dict[str, Heading] = {
    "regime": "regime",
    "kind": "kind",
    "share": "share of starts",
    "impact_speed_max": ("impact speed ()", SPEED),
    "multiplier": "largest multiplier",
    "lyapunov": ("Lyapunov exponent ()", RATE),
    "lyapunov_error": ("standard error", RATE),
}
"""Headings of the columns of regimes as the terminal shows them."""

LIFE_COLUMNS: dict[str, Heading] = {
    "regime": "regime",
    "life_time": ("life time ()", TIME),
    "life_time_low": ("95 % from", TIME),
    "life_time_high": ("to", TIME),
    "left": "paths left",
    "paths": "of",
    "to": "they go to",
    "share": "share",
    "share_low": "95 % from ",
    "share_high": "to ",
}
"""Headings of the columns of life times as the terminal shows them."""

MOST_PRINTED = 40
"""Largest number of values of a bifurcation diagram that the terminal shows."""


def print_basins(console: Console, found: Basins) -> None:
    """Print which motions are reached, and by what share of the starts."""
    console.print(found.summary(), style="bold", highlight=False)
    print_frame(console, with_headings(found.table(), REGIME_COLUMNS), "motions that starts end in")
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def print_bifurcation(console: Console, found: Bifurcation) -> None:
    """Print the motion at some of the values."""
    console.print(found.summary(), style="bold", highlight=False)
    table = found.table()
    chosen = np.unique(np.linspace(0, len(table) - 1, min(MOST_PRINTED, len(table))).astype(int))
    columns: dict[str, Heading] = {
        "sweep": "sweep", "value": found.key, "periods": "periods (0: none)",
        "impacts per period": "impacts per period", **REGIME_COLUMNS,
    }  # fmt: skip
    print_frame(console, with_headings(table.iloc[chosen], columns), "motions of a slow sweep")
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def print_lifetimes(console: Console, found: LifeTimes) -> None:
    """Print how long each regime lasts, and where paths go."""
    console.print(found.summary(), style="bold", highlight=False)
    print_frame(console, with_headings(found.to_frame(), LIFE_COLUMNS), "regimes in noise")
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def plot_lifetimes(found: LifeTimes, ax: Axes | None = None) -> Axes:
    """Mean life times with their 95 % intervals, and where paths go; arrows are lower limits."""
    rows = len(found.regimes)
    ax = axes_or_new(ax, (MAP_SIZE[0], 1.4 + 0.6 * rows))
    longest = max((each.life_time or each.life_time_low for each in found.regimes), default=1.0)
    for row, each in enumerate(found.regimes):
        colour = COLOURS["simulate"]
        if each.life_time is None or each.life_time_high is None:
            ax.plot(TIME(each.life_time_low or longest), row, ">", color=colour)
        else:
            ends = (each.life_time_low, each.life_time, each.life_time_high)
            low, middle, high = map(TIME, ends)
            bars = [[middle - low], [high - middle]]
            ax.errorbar(middle, row, xerr=bars, fmt="o", capsize=3, color=colour)
        there = ", ".join(f"{100.0 * to.share:.0f} % to {to.regime}" for to in each.destinations)
        place = TIME(each.life_time or each.life_time_low or longest)
        ax.annotate(
            there or "longer than this (95 %): no path left it", (place, row), (0.0, 9.0),
            textcoords="offset points", ha="center", fontsize="small",
        )  # fmt: skip
    ax.set_xscale("log")
    ax.margins(x=0.45)
    ax.set_yticks(range(rows), [each.regime for each in found.regimes])
    ax.set_ylim(rows - 0.5, -0.7)
    ax.set_xlabel(f"mean life time ({TIME})")
    add_grid(ax)
    return ax


def plot_basins(found: Basins, ax: Axes | None = None) -> Axes:
    """The map of starts, each coloured by the motion that it ends in, and the regimes in it."""
    ax = axes_or_new(ax, MAP_SIZE)
    shades, handles, number = list[str](), list[Patch](), 0
    for regime in found.regimes:
        if regime.kind == "chaotic":
            shade = CHAOTIC
        else:
            shade, number = BASINS[number % len(BASINS)], number + 1
        shades.append(shade)
        label = f"{regime.name}: {100.0 * regime.share:.3g} %"
        handles.append(Patch(color=shade, label=label))
    if found.undecided:
        label = f"undecided: {100.0 * found.undecided:.3g} %"
        handles.append(Patch(color=UNDECIDED, label=label))
    units, labels = zip(*(_unit(*each) for each in _sides(found)), strict=True)
    edges = [
        _edges(side / unit) for side, unit in zip((found.across, found.up), units, strict=True)
    ]
    colours = ListedColormap([BEYOND, UNDECIDED, *shades])
    ax.pcolormesh(
        *edges, found.ends + 2, cmap=colours, vmin=-0.5, vmax=len(shades) + 1.5, rasterized=True
    )
    _mark(found, ax, units)
    ax.set_xlim(edges[0][0], edges[0][-1])
    ax.set_ylim(edges[1][0], edges[1][-1])
    ax.set_xlabel(labels[0])
    ax.set_ylabel(labels[1])
    ax.legend(
        handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize="small",
        frameon=False,
    )  # fmt: skip
    return ax


def _sides(found: Basins) -> list[tuple[str, np.ndarray]]:
    return list(zip(found.plane, (found.across, found.up), strict=True))


def _unit(name: str, values: np.ndarray) -> tuple[float, str]:
    """The unit of an axis and its label."""
    what, _, coordinate = name.partition(".")
    if what == "velocity":
        return SPEED.shown.si, f"velocity of {coordinate} at the start ({SPEED})"
    unit, word = length_unit(float(np.abs(values).max()) or 1.0)
    return unit, f"displacement of {coordinate} at the start ({word})"


def _edges(values: np.ndarray) -> np.ndarray:
    """Edges of the cells around values."""
    if len(values) == 1:
        half = abs(values[0]) or 1.0
        return np.array([values[0] - half, values[0] + half])
    middles = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[1.5 * values[0] - 0.5 * values[1]], middles,
                           [1.5 * values[-1] - 0.5 * values[-2]]])  # fmt: skip


def _mark(found: Basins, ax: Axes, units: tuple[float, ...]) -> None:
    """Mark the states of the periodic regimes at the phase of the starts; only with one coordinate
    do they lie in the plane of the map."""
    if found.regimes and len(found.regimes[0].displacement) > 1:
        return
    for regime in found.regimes:
        if regime.kind == "periodic":
            known = {"displacement": regime.displacement[0], "velocity": regime.velocity[0]}
            x, y = (known[name.partition(".")[0]] for name in found.plane)
            ax.plot(x / units[0], y / units[1], "o", color="black", markersize=4.0)


def draw_bifurcation(found: Bifurcation, ax: Axes | None = None) -> Axes:
    """Draw impact speeds over the varied number, and the Lyapunov exponent below them."""
    if ax is not None:
        return _plot_speeds(found, ax)
    _, axes = plt.subplots(
        2, 1, figsize=DIAGRAM_SIZE, sharex=True, layout="constrained", height_ratios=(2, 1)
    )
    first: Axes = _plot_speeds(found, axes[0])
    first.set_xlabel("")
    for sweep in found.sweeps:
        axes[1].plot(sweep.value, RATE(sweep.lyapunov), **_style(upwards=sweep.upwards))
    axes[1].axhline(0.0, color=COLOURS["stop"], linewidth=1.0)
    axes[1].set_ylabel(f"Lyapunov exponent ({RATE})")
    axes[1].set_xlabel(_name(found))
    add_grid(axes[1])
    return first


def _plot_speeds(found: Bifurcation, ax: Axes) -> Axes:
    for sweep in found.sweeps:
        pairs = zip(sweep.value, sweep.impact_speed, strict=True)
        # a motion that repeats itself strikes at the same speeds again and again
        rows = [(value, speed) for value, speeds in pairs for speed in _distinct(speeds)]
        values, speeds = np.array(rows).reshape(-1, 2).T
        word = "up" if sweep.upwards else "down"
        ax.plot(values, SPEED(speeds), label=f"sweep {word}", **_style(upwards=sweep.upwards))
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel(f"impact speed ({SPEED})")
    ax.set_xlabel(_name(found))
    ax.legend(fontsize="small", markerscale=5.0)
    add_grid(ax)
    return ax


def _distinct(speeds: np.ndarray) -> np.ndarray:
    if not len(speeds):
        return np.zeros(1)
    digits = max(0, 5 - int(np.floor(np.log10(max(float(speeds.max()), 1e-300)))))
    return np.unique(speeds.round(digits))


def _style(*, upwards: bool) -> dict[str, Any]:
    """Style of the dots of a sweep; dots of a downward sweep are smaller, so that both are seen
    where they agree."""
    colour = COLOURS["simulate"] if upwards else COLOURS["linearise:closure"]
    size = 2.4 if upwards else 0.8
    return {"linestyle": "none", "marker": "o", "markersize": size, "color": colour}


def _name(found: Bifurcation) -> str:
    return "frequency (Hz)" if found.key == "frequency_hz" else found.key
