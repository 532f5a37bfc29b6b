"""Views of motions under a sine. Chapters: periodic motions; basins, bifurcations and life times;
stability of a modulated structure."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.mathematics.units import LENGTH, RATE, SI_ACCELERATION, SPEED, TIME
from stochvi.results.base import quantities_of
from stochvi.views.axes import (
    BASINS,
    BEYOND,
    CHAOTIC,
    COLOURS,
    UNDECIDED,
    add_grid,
    axes_or_new,
    legend_above,
    length_unit,
    plain_ticks,
)
from stochvi.views.pages import Grid, Told, records, told_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

    from stochvi.methods.periodic.attracted import Basins, Bifurcation
    from stochvi.methods.periodic.sine_response import Branch, HarmonicResponse
    from stochvi.statistics.lifetimes import LifeTimes
    from stochvi.statistics.stability import Stability

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


def sine_told(found: HarmonicResponse) -> Told:
    """What was found, the branches, the jumps and the special points."""
    name = _name(found)
    # a branch that nowhere keeps to its stops is shown as a whole
    branches = [
        (number, each, each.admissible | (not each.admissible.any()))
        for number, each in enumerate(found.branches)
    ]
    regimes = {
        "branch": lambda number, *_: number,
        "form": lambda _, branch, at: branch.form,
        "impacts": lambda _, branch, at: _struck(branch),
        "periods": lambda _, branch, at: branch.periods,
        "from": lambda _, branch, at: branch.value[at].min(),
        "to": lambda _, branch, at: branch.value[at].max(),
        "stable": lambda _, branch, at: _range(branch.value[at & branch.stable]),
        f"displacement ({LENGTH})": lambda _, branch, at: LENGTH(branch.displacement_max[at].max()),
        f"impact speed ({SPEED})": lambda _, branch, at: SPEED(
            branch.impact_speed[at].max(initial=0.0)
        ),
        f"acceleration ({SI_ACCELERATION})": lambda _, branch, at: SI_ACCELERATION(
            branch.acceleration_max[at].max()
        ),
    }
    jumps = {
        "sweep": lambda jump: "up" if jump.upwards else "down",
        name: lambda jump: jump.value,
        f"displacement before ({LENGTH})": lambda jump: LENGTH(jump.displacement_max[0]),
        f"after ({LENGTH})": lambda jump: LENGTH(jump.displacement_max[1]),
        f"impact speed before ({SPEED})": lambda jump: SPEED(jump.impact_speed[0]),
        f"after ({SPEED})": lambda jump: SPEED(jump.impact_speed[1]),
    }
    points = {
        "what": lambda point: point.name,
        name: lambda point: f"{point.value:.7g}",
        "branch": lambda point: point.branch,
    }
    return told_of(
        found,
        [
            *Grid.by(f"regimes over {name}", regimes, branches, ("form", "impacts", "stable")),
            *Grid.by("jumps of a slow sweep", jumps, [(each,) for each in found.jumps]),
            *Grid.by("special points", points, [(each,) for each in found.special_points]),
        ],
        [
            "stable: largest and smallest value at which small perturbations die away",
            "peak acceleration: absolute, with the forces of compliant stops; with rigid stops it "
            "is that between impacts",
        ],
    )


def _name(found: HarmonicResponse) -> str:
    return "frequency (Hz)" if found.key == "frequency_hz" else found.key


def _impacts(stops: Sequence[str]) -> str:
    """The stops that are hit in their order, those in a row counted: "2 x tool upper"."""
    runs = [(name, len(list(hits))) for name, hits in itertools.groupby(stops)]
    words = [name if count == 1 else f"{count} x {name}" for name, count in runs]
    return ", ".join(words) or "none"


def _range(values: np.ndarray) -> str:
    if not len(values):
        return "nowhere"
    return f"{values.min():.4g} to {values.max():.4g}"


def plot_sine(found: HarmonicResponse, ax: Axes | None = None) -> Axes:
    """Displacement, impact speed and acceleration of the branches: stable ones full, unstable ones
    dashed, simulated motions as dots. A ValueError says that there is none to draw. Given Axes get
    the impact speed alone."""
    import matplotlib.pyplot as plt

    if ax is not None:
        legend_above(plot_branches(found, ax, "impact_speed_max"), 2)
        return ax
    figure, axes = plt.subplots(3, 1, figsize=SIZE, sharex=True, layout="constrained")
    for panel, column in zip(axes, PANELS, strict=True):
        plot_branches(found, panel, column)
    if not any(panel.has_data() for panel in axes):
        raise ValueError("no motion was found")
    for panel in axes[:2]:
        panel.set_xlabel("")
    if found.branches:
        lines = axes[0].get_legend_handles_labels()
        figure.legend(*lines, fontsize="x-small", ncols=2, loc="outside lower center")
    jumps = "; dotted: a slow sweep jumps" if found.jumps else ""
    axes[0].set_title(
        f"{found.coordinate}: full where stable, dashed where unstable{jumps}", fontsize="medium"
    )
    return axes[0]  # type: ignore[no-any-return]


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


# ------------------------------------------------------------------------------
# Tables and pictures of basins, bifurcations and life times.
# ------------------------------------------------------------------------------


MAP_SIZE, DIAGRAM_SIZE = (7.0, 5.2), (7.0, 6.0)
"""Sizes of a map of basins and of a diagram of two panels, inches."""

MOST_PRINTED = 40
"""Largest number of values of a bifurcation diagram that the terminal shows."""


def basins_told(found: Basins) -> Told:
    """Which motions are reached, and by what share of the starts."""
    regimes = [(each,) for each in found.regimes]
    return told_of(found, Grid.stated("motions that starts end in", regimes, 2))


def bifurcation_told(found: Bifurcation) -> Told:
    """The motion at some of the values."""
    table = found.table()
    chosen = np.unique(np.linspace(0, len(table) - 1, min(MOST_PRINTED, len(table))).astype(int))
    columns = {
        "sweep": lambda row: row["sweep"],
        found.key: lambda row: row["value"],
        "periods (0: none)": lambda row: row["periods"],
        "impacts per period": lambda row: row["impacts per period"],
        f"impact speed ({SPEED})": lambda row: SPEED(row["impact_speed_max"]),
        f"Lyapunov exponent ({RATE})": lambda row: RATE(row["lyapunov"]),
        "standard error": lambda row: RATE(row["lyapunov_error"]),
    }
    return told_of(found, Grid.by("motions of a slow sweep", columns, records(table.iloc[chosen])))


def lifetimes_told(found: LifeTimes) -> Told:
    """How long each regime lasts, and where paths go."""
    words = ("regime", "they go to")
    return told_of(found, Grid.stated("regimes in noise", found.departures, words))


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
    plain_ticks(ax)
    add_grid(ax)
    return ax


def plot_basins(found: Basins, ax: Axes | None = None) -> Axes:
    """The map of starts, each coloured by the motion that it ends in, and the regimes in it."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

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
    marks = _mark(found, ax, units)
    ax.set_xlim(edges[0][0], edges[0][-1])
    ax.set_ylim(edges[1][0], edges[1][-1])
    ax.set_xlabel(labels[0])
    ax.set_ylabel(labels[1])
    legend_above(ax, 2, handles=[*handles, *marks[:1]])
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


def _mark(found: Basins, ax: Axes, units: tuple[float, ...]) -> list[Line2D]:
    """Mark the states of the periodic regimes at the phase of the starts; only with one coordinate
    do they lie in the plane of the map."""
    marks: list[Line2D] = []
    if found.regimes and len(found.regimes[0].displacement) > 1:
        return marks
    for regime in found.regimes:
        if regime.kind == "periodic":
            known = {"displacement": regime.displacement[0], "velocity": regime.velocity[0]}
            x, y = (known[name.partition(".")[0]] for name in found.plane)
            where = x / units[0], y / units[1]
            marks += ax.plot(*where, "ok", markersize=4.0, label="the motion itself")
    return marks


def draw_bifurcation(found: Bifurcation, ax: Axes | None = None) -> Axes:
    """Draw impact speeds over the varied number, and the Lyapunov exponent below them."""
    import matplotlib.pyplot as plt

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
    axes[1].set_xlabel(_basin_name(found))
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
    ax.set_xlabel(_basin_name(found))
    ax.legend(fontsize="small", markerscale=2.0)
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


def _basin_name(found: Bifurcation) -> str:
    return "frequency (Hz)" if found.key == "frequency_hz" else found.key


# ------------------------------------------------------------------------------
# Table and picture of the stability of a modulated structure.
# ------------------------------------------------------------------------------


def stability_told(found: Stability) -> Told:
    """How fast what grows."""
    columns = {
        "growth of": lambda name, _: words_of_rate(found, name),
        f"rate ({RATE})": lambda _, each: RATE(each.value),
        "error": lambda _, each: RATE(each.standard_error),
        "bias": lambda _, each: RATE(each.bias),
        "from": lambda _, each: each.how,
    }
    caption, words = "growth without stops; below 0 it decays", ("growth of", "from")
    return told_of(found, Grid.by(caption, columns, found.rates.items(), words))


def words_of_rate(found: Stability, name: str) -> str:
    """Whose rate of growth a quantity is."""
    kind: Any = type(found)
    return quantities_of(kind)[name].words


def plot_stability(found: Stability, ax: Axes | None = None) -> Axes:
    """Rates of growth with their 95 % intervals; what lies right of 0 grows."""
    ax = axes_or_new(ax, (6.4, 2.4))
    for row, each in enumerate(found.rates.values()):
        low, high = each.interval()
        bars = [[RATE(each.value - low)], [RATE(high - each.value)]]
        ax.errorbar(RATE(each.value), row, xerr=bars, fmt="o", capsize=3, color=COLOURS["simulate"])
    ax.axvline(0.0, color="black", linewidth=0.8)
    ax.set_yticks(range(len(found.rates)), [words_of_rate(found, name) for name in found.rates])
    ax.set_ylim(len(found.rates) - 0.5, -0.5)
    ax.set_xlabel(f"rate of growth ({RATE}); below 0 it decays")
    add_grid(ax)
    return ax
