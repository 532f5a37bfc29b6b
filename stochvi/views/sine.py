"""Tables and pictures of periodic regimes."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from stochvi.mathematics.shown_units import LENGTH, SI_ACCELERATION, SPEED
from stochvi.views.axes import add_grid, length_unit
from stochvi.views.colours import COLOURS
from stochvi.views.tables import print_frame

if TYPE_CHECKING:
    from rich.console import Console

    from stochvi.methods.periodic.answer import Branch, HarmonicResponse

SIZE = (7.0, 8.0)
"""Size of the figure of three panels, inches."""

WIDE = 10.0
"""Ratio of the ends of an axis from which on it is logarithmic: on a linear one the branches of
small motions would lie on the axis."""

MOST_COLOURS = 6
"""Number of branches with a colour and a line in the legend; the others, which come after them by
the size of their stable range, are grey."""

PANELS = {
    "displacement_max": ("largest displacement", LENGTH),
    "impact_speed_max": ("impact speed", SPEED),
    "acceleration_max": ("peak acceleration", SI_ACCELERATION),
}
"""Columns of the table of an answer that are drawn, in words."""


def print_sine(console: Console, found: HarmonicResponse) -> None:
    """Print what was found, the branches, the jumps and the special points."""
    console.print(found.summary(), style="bold", highlight=False)
    rows = [_row(number, branch) for number, branch in enumerate(found.branches)]
    if rows:
        print_frame(console, pd.DataFrame(rows), f"regimes over {_name(found)}")
    jumps = [
        {
            "sweep": "up" if jump.upwards else "down",
            _name(found): jump.value,
            f"displacement before ({LENGTH})": LENGTH(jump.displacement_max[0]),
            f"after ({LENGTH})": LENGTH(jump.displacement_max[1]),
            f"impact speed before ({SPEED})": SPEED(jump.impact_speed[0]),
            f"after ({SPEED})": SPEED(jump.impact_speed[1]),
        }
        for jump in found.jumps
    ]
    if jumps:
        print_frame(console, pd.DataFrame(jumps), "jumps of a slow sweep")
    points = [
        {"what": point.name, _name(found): point.value, "branch": point.branch}
        for point in found.special_points
    ]
    if points:
        print_frame(console, pd.DataFrame(points), "special points", {_name(found): ".7g"})
    for line in (
        "stable: largest and smallest value at which small perturbations die away",
        "peak acceleration: absolute, with the forces of compliant stops; with rigid stops it is "
        "that between impacts",
    ):
        console.print(line, style="dim", highlight=False)
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def _name(found: HarmonicResponse) -> str:
    return "frequency (Hz)" if found.key == "frequency_hz" else found.key


def _row(number: int, branch: Branch) -> dict[str, object]:
    shown = branch.admissible if branch.admissible.any() else np.ones_like(branch.admissible)
    stable = shown & branch.stable
    return {
        "branch": number,
        "form": branch.form,
        "impacts": _struck(branch),
        "periods": branch.periods,
        "from": float(branch.value[shown].min()),
        "to": float(branch.value[shown].max()),
        "stable": _range(branch.value[stable]),
        f"displacement ({LENGTH})": LENGTH(float(branch.displacement_max[shown].max())),
        f"impact speed ({SPEED})": SPEED(float(branch.impact_speed[shown].max(initial=0.0))),
        f"acceleration ({SI_ACCELERATION})": SI_ACCELERATION(
            float(branch.acceleration_max[shown].max())
        ),
    }


def _impacts(stops: Sequence[str]) -> str:
    """The stops that are hit in their order, those in a row counted: "2 x tool upper"."""
    runs = [(name, len(list(hits))) for name, hits in itertools.groupby(stops)]
    words = [name if count == 1 else f"{count} x {name}" for name, count in runs]
    return ", ".join(words) or "none"


def _range(values: np.ndarray) -> str:
    if not len(values):
        return "nowhere"
    return f"{values.min():.4g} to {values.max():.4g}"


def draw_sine(found: HarmonicResponse) -> Axes:
    """Displacement, impact speed and acceleration of the branches: stable ones full, unstable ones
    dashed, simulated motions as dots. A ValueError says that there is none to draw."""
    figure, axes = plt.subplots(3, 1, figsize=SIZE, sharex=True, layout="constrained")
    for ax, column in zip(axes, PANELS, strict=True):
        plot_branches(found, ax, column)
    if not any(ax.has_data() for ax in axes):
        raise ValueError("no motion was found")
    for ax in axes[:2]:
        ax.set_xlabel("")
    if found.branches:
        lines = axes[0].get_legend_handles_labels()
        figure.legend(*lines, fontsize="x-small", ncols=2, loc="outside lower center")
    jumps = "; dotted: a slow sweep jumps" if found.jumps else ""
    axes[0].set_title(
        f"{found.coordinate}: full where stable, dashed where unstable{jumps}", fontsize="medium"
    )
    first: Axes = axes[0]
    return first


def plot_sine(found: HarmonicResponse, ax: Axes | None = None) -> Axes:
    """The picture of an answer; in given axes, its impact speeds."""
    return draw_sine(found) if ax is None else plot_branches(found, ax, "impact_speed_max")


def plot_branches(found: HarmonicResponse, ax: Axes, column: str) -> Axes:
    """One quantity of all branches over the varied number."""
    words, quantity = PANELS[column]
    name, unit = quantity.shown
    tables = [(branch, _columns(branch)) for branch in found.branches]
    if column == "displacement_max" and tables:
        largest = max(float(np.nanmax(table[column])) for _, table in tables)
        unit, name = length_unit(largest)
    coloured = sorted(
        range(len(tables)), key=lambda number: _extent(tables[number][0]), reverse=True
    )
    colours = {number: f"C{place}" for place, number in enumerate(coloured[:MOST_COLOURS])}
    for number, (branch, table) in enumerate(tables):
        colour = colours.get(number, COLOURS["stop"])
        for stable, style in ((True, "-"), (False, "--")):
            chosen = branch.admissible & (branch.stable == stable)
            # a line goes on to the first point of the other style
            reached = chosen | np.append(chosen[1:], False) | np.insert(chosen[:-1], 0, False)
            values = np.where(reached & branch.admissible, table[column] / unit, np.nan)
            label = f"{number}: {_label(branch)}" if stable and number in colours else None
            width = 1.3 if number in colours else 0.7
            # one value alone makes no line
            dot = "o" if len(branch.value) == 1 else ""
            ax.plot(
                branch.value, values, style, marker=dot, ms=4.0, color=colour, linewidth=width,
                label=label,
            )  # fmt: skip
        special = np.array([bool(each) for each in branch.names]) & branch.admissible
        if number in colours:
            ax.plot(branch.value[special], table[column][special] / unit, "o", color=colour, ms=3.0)
    for swept in found.simulated:
        marker = "^" if swept.upwards else "v"
        values = swept.displacement_max if column == "displacement_max" else swept.impact_speed_max
        if column != "acceleration_max":
            ax.plot(
                swept.value, values / unit, marker, ms=2.5, color=COLOURS["simulate"], alpha=0.6,
                label=f"simulated, {'up' if swept.upwards else 'down'}",
            )  # fmt: skip
    for jump in found.jumps:
        ax.axvline(jump.value, color=COLOURS["stop"], linestyle=":", linewidth=1.0)
    ax.set_xlabel(_name(found))
    ax.set_ylabel(f"{words} ({name})")
    ax.set_ylim(bottom=0.0)
    # impact speeds begin with 0
    if column != "impact_speed_max" and _wide(
        [table[column][branch.admissible] for branch, table in tables]
    ):
        ax.set_yscale("log")
        ax.autoscale(axis="y")
    ends = [float(value) for branch in found.branches for value in branch.value[[0, -1]]]
    if ends and max(ends) > WIDE * min(ends) > 0.0:
        ax.set_xscale("log")
    add_grid(ax)
    return ax


def _extent(branch: Branch) -> tuple[float, float]:
    """Ranges over which a branch is stable, and over which it is at all."""
    shown = branch.admissible
    stable, whole = (
        float(np.ptp(each)) if len(each) else -1.0
        for each in (branch.value[shown & branch.stable], branch.value[shown])
    )
    return stable, whole


def _struck(branch: Branch) -> str:
    """The stops that are hit in their order, and those that are rested on."""
    rests = f"; rests on {', '.join(branch.sticking)}" if branch.sticking else ""
    return _impacts(branch.stops) + rests


def _label(branch: Branch) -> str:
    """Impacts and periods of a branch, in a few words."""
    words = _struck(branch) if branch.stops or branch.sticking else "no impacts"
    return words + (f", in {branch.periods} periods" if branch.periods > 1 else "")


def _wide(drawn: Sequence[np.ndarray]) -> bool:
    """Whether numbers span decades: a tenth of them lies far below another tenth."""
    values = np.concatenate([np.empty(0), *drawn])
    values = values[np.isfinite(values)]
    if not len(values) or values.min() <= 0.0:
        return False
    return bool(np.quantile(values, 0.9) > WIDE * np.quantile(values, 0.1))


def _columns(branch: Branch) -> dict[str, np.ndarray]:
    return {
        "displacement_max": branch.displacement_max,
        "acceleration_max": branch.acceleration_max,
        "impact_speed_max": branch.impact_speed.max(axis=1, initial=0.0),
    }
