"""Views of motions under a sine. Chapters: periodic motions; basins, bifurcations and life times;
stability of a modulated structure."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.mathematics.units import LENGTH, RATE, SI_ACCELERATION, SPEED, TIME
from stochvi.results.base import quantities_of
from stochvi.views.axes import (
    BASINS,
    BEYOND,
    CHAOTIC,
    UNDECIDED,
    Chart,
    Scale,
    legend_above,
    length_of,
    listed,
    panels,
)
from stochvi.views.pages import Grid, Told, told_of

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
    regimes = [
        {
            "branch": number, "form": branch.form, "impacts": _struck(branch),
            "periods": branch.periods, "from": branch.value[at].min(),
            "to": branch.value[at].max(), "stable": _range(branch.value[at & branch.stable]),
            "displacement": branch.displacement_max[at].max(),
            "impact_speed": branch.impact_speed[at].max(initial=0.0),
            f"acceleration ({SI_ACCELERATION})": SI_ACCELERATION(branch.acceleration_max[at].max()),
        }
        for number, branch, at in branches
    ]  # fmt: skip
    jumps = [
        {"sweep": "up" if jump.upwards else "down", name: jump.value}
        | dict(zip(("before", "after"), jump.displacement_max, strict=True))
        | dict(zip(("speed_before", "speed_after"), jump.impact_speed, strict=True))
        for jump in found.jumps
    ]
    after = (
        ("displacement before", "before", "m"), ("after", "after", "m"),
        ("impact speed before", "speed_before", "m/s"), ("after", "speed_after", "m/s"),
    )  # fmt: skip
    return told_of(
        found,
        [
            *Grid.of(f"regimes over {name}", regimes, words=("form", "impacts", "stable")),
            *Grid.of("jumps of a slow sweep", jumps, ["sweep", (name, name, "1"), *after]),
            *Grid.of(
                "special points",
                found.special_points,
                ["what = name", (name, "value", "1 .7g"), "branch"],
            ),
        ],
        [
            "stable: largest and smallest value at which small perturbations die away",
            "peak acceleration: absolute, with the forces of compliant stops; with rigid stops it "
            "is that between impacts",
        ],
    )


def _name(found: HarmonicResponse | Bifurcation) -> str:
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
    the displacement alone."""
    draw = [partial(plot_branches, found, column=column) for column in PANELS]
    first = panels(ax, draw, SIZE)
    figure: Any = first.figure
    if not any(panel.has_data() for panel in figure.axes):
        raise ValueError("no motion was found")
    if ax is not None:
        legend_above(ax, 2)
        return ax
    if found.branches:
        lines = first.get_legend_handles_labels()
        figure.legend(*lines, fontsize="x-small", ncols=2, loc="outside lower center")
    jumps = "; dotted: a slow sweep jumps" if found.jumps else ""
    words = f"{found.coordinate}: full where stable, dashed where unstable{jumps}"
    first.set_title(words, fontsize="medium")
    return first


def plot_branches(found: HarmonicResponse, ax: Axes, column: str) -> Axes:
    """One quantity of all branches over the varied number."""
    words, quantity = PANELS[column]
    tables = [(branch, _columns(branch)[column]) for branch in found.branches]
    if column == "displacement_max" and tables:
        quantity = length_of(max(float(np.nanmax(values)) for _, values in tables))
    # impact speeds begin with 0
    log = column != "impact_speed_max" and _wide([v[b.admissible] for b, v in tables])
    ends = [float(value) for branch in found.branches for value in branch.value[[0, -1]]]
    over = bool(ends) and max(ends) > WIDE * min(ends) > 0.0
    chart = Chart(ax, Scale(_name(found), log=over), Scale(words, quantity, log))
    coloured = sorted(range(len(tables)), key=lambda n: _extent(tables[n][0]), reverse=True)
    colours = {number: f"C{place}" for place, number in enumerate(coloured[:MOST_COLOURS])}
    for number, (branch, height) in enumerate(tables):
        colour, named = colours.get(number, "stop"), number in colours
        for stable, style in ((True, "-"), (False, "--")):
            chosen = branch.admissible & (branch.stable == stable)
            # a line goes on to the first point of the other style
            reached = chosen | np.append(chosen[1:], False) | np.insert(chosen[:-1], 0, False)
            values = np.where(reached & branch.admissible, height, np.nan)
            label = f"{number}: {_label(branch)}" if stable and named else None
            chart.curve(branch.value, values, label, colour, style, linewidth=1.3 if named else 0.7)
        if named:
            special = np.array([bool(each) for each in branch.names]) & branch.admissible
            chart.points(branch.value[special], height[special], None, colour, markersize=3.0)
    for swept in found.simulated:
        if column != "acceleration_max":
            way, form = ("up", "^") if swept.upwards else ("down", "v")
            chart.points(
                swept.value, getattr(swept, column), f"simulated, {way}", form=form,
                markersize=2.5, alpha=0.6,
            )  # fmt: skip
    for jump in found.jumps:
        chart.at(jump.value, None, style=":", linewidth=1.0)
    if not log:
        ax.set_ylim(bottom=0.0)
    return chart.finish(0)


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
    return told_of(found, Grid.of("motions that starts end in", found.regimes, words=2))


def bifurcation_told(found: Bifurcation) -> Told:
    """The motion at some of the values."""
    table = found.table()
    chosen = np.unique(np.linspace(0, len(table) - 1, min(MOST_PRINTED, len(table))).astype(int))
    columns = (
        "sweep", (found.key, "value", "1"), "periods (0: none) = periods",
        ("impacts per period", "impacts per period", "1"), "impact speed = impact_speed_max",
        "Lyapunov exponent = lyapunov",
    )  # fmt: skip
    return told_of(found, Grid.of("motions of a slow sweep", table.iloc[chosen], columns))


def lifetimes_told(found: LifeTimes) -> Told:
    """How long each regime lasts, and where paths go."""
    words = ("regime", "they go to")
    return told_of(found, Grid.of("regimes in noise", found.departures, words=words))


def plot_lifetimes(found: LifeTimes, ax: Axes | None = None) -> Axes:
    """Mean life times with their 95 % intervals, and where paths go; arrows are lower limits."""
    names = [each.regime for each in found.regimes]
    chart = listed(ax, names, Scale("mean life time", TIME, log=True), 0.6)
    longest = max((each.life_time or each.life_time_low for each in found.regimes), default=1.0)
    for row, each in enumerate(found.regimes):
        known = None if each.life_time_high is None else each.life_time
        low = each.life_time_low or longest
        chart.across(row, known, low, None if known is None else each.life_time_high)
        there = ", ".join(f"{100.0 * to.share:.0f} % to {to.regime}" for to in each.destinations)
        there = there or "longer than this (95 %): no path left it"
        chart.note(there, each.life_time or low, row, (0.0, 9.0), ha="center")
    chart.ax.margins(x=0.45)
    return chart.finish()


def plot_basins(found: Basins, ax: Axes | None = None) -> Axes:
    """The map of starts, each coloured by the motion that it ends in, and the regimes in it."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    light = itertools.cycle(BASINS)
    shades = [CHAOTIC if each.kind == "chaotic" else next(light) for each in found.regimes]
    named = [
        (each.name, each.share, shade) for each, shade in zip(found.regimes, shades, strict=True)
    ]
    named += [("undecided", found.undecided, UNDECIDED)] if found.undecided else []
    handles: list[Any] = [
        Patch(color=shade, label=f"{name}: {100.0 * share:.3g} %") for name, share, shade in named
    ]
    sides = [_scale(*each) for each in _sides(found)]
    chart = Chart.on(ax, sides[0], sides[1], MAP_SIZE)
    across, up = _edges(chart.x.quantity(found.across)), _edges(chart.y.quantity(found.up))
    chart.ax.pcolormesh(
        across, up, found.ends + 2, cmap=ListedColormap([BEYOND, UNDECIDED, *shades]), vmin=-0.5,
        vmax=len(shades) + 1.5, rasterized=True,
    )  # fmt: skip
    handles += _mark(found, chart)[:1]
    chart.ax.set(xlim=across[[0, -1]], ylim=up[[0, -1]])
    return chart.finish(2, handles=handles, labels=[each.get_label() for each in handles])


def _sides(found: Basins) -> list[tuple[str, np.ndarray]]:
    return list(zip(found.plane, (found.across, found.up), strict=True))


def _scale(name: str, values: np.ndarray) -> Scale:
    """The scale of an axis."""
    what, _, coordinate = name.partition(".")
    length = length_of(float(np.abs(values).max()) or 1.0)
    return Scale(f"{what} of {coordinate} at the start", SPEED if what == "velocity" else length)


def _edges(values: np.ndarray) -> np.ndarray:
    """Edges of the cells around values."""
    if len(values) == 1:
        half = abs(values[0]) or 1.0
        return np.array([values[0] - half, values[0] + half])
    middles = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[1.5 * values[0] - 0.5 * values[1]], middles,
                           [1.5 * values[-1] - 0.5 * values[-2]]])  # fmt: skip


def _mark(found: Basins, chart: Chart) -> list[Line2D]:
    """Mark the states of the periodic regimes at the phase of the starts; only with one coordinate
    do they lie in the plane of the map."""
    marks: list[Line2D] = []
    if found.regimes and len(found.regimes[0].displacement) > 1:
        return marks
    for regime in found.regimes:
        if regime.kind == "periodic":
            known = {"displacement": regime.displacement[0], "velocity": regime.velocity[0]}
            x, y = (known[name.partition(".")[0]] for name in found.plane)
            where = chart.x.quantity(x), chart.y.quantity(y)
            marks += chart.ax.plot(*where, "ok", markersize=4.0, label="the motion itself")
    return marks


def plot_bifurcation(found: Bifurcation, ax: Axes | None = None) -> Axes:
    """Draw impact speeds over the varied number, and the Lyapunov exponent below them."""
    draw = [partial(each, found) for each in (_draw_speeds, _draw_exponents)]
    return panels(ax, draw, DIAGRAM_SIZE, height_ratios=(2, 1))


def _draw_speeds(found: Bifurcation, ax: Axes) -> None:
    chart = Chart(ax, Scale(_name(found)), Scale("impact speed", SPEED))
    for sweep in found.sweeps:
        pairs = zip(sweep.value, sweep.impact_speed, strict=True)
        # a motion that repeats itself strikes at the same speeds again and again
        rows = [(value, speed) for value, speeds in pairs for speed in _distinct(speeds)]
        values, speeds = np.array(rows).reshape(-1, 2).T
        _dots(chart, values, speeds, upwards=sweep.upwards)
    ax.set_ylim(bottom=0.0)
    chart.finish(markerscale=2.0)


def _draw_exponents(found: Bifurcation, ax: Axes) -> None:
    chart = Chart(ax, Scale(_name(found)), Scale("Lyapunov exponent", RATE))
    for sweep in found.sweeps:
        _dots(chart, sweep.value, sweep.lyapunov, upwards=sweep.upwards)
    chart.level(0.0)
    chart.finish(0)


def _dots(chart: Chart, x: np.ndarray, y: np.ndarray, *, upwards: bool) -> None:
    """Dots of a sweep; those of a downward sweep are smaller, so that both are seen where they
    agree."""
    way, colour, size = ("up", "simulate", 2.4) if upwards else ("down", "linearise:closure", 0.8)
    chart.points(x, y, f"sweep {way}", colour, markersize=size)


def _distinct(speeds: np.ndarray) -> np.ndarray:
    if not len(speeds):
        return np.zeros(1)
    digits = max(0, 5 - int(np.floor(np.log10(max(float(speeds.max()), 1e-300)))))
    return np.unique(speeds.round(digits))


# ------------------------------------------------------------------------------
# Table and picture of the stability of a modulated structure.
# ------------------------------------------------------------------------------


def stability_told(found: Stability) -> Told:
    """How fast what grows."""
    table = Grid.of(
        "growth without stops; below 0 it decays",
        found.rates.items(),
        "growth of = words_of; rate = value {1/s}; error = standard_error {1/s}; bias {1/s}; "
        "from = how",
        ("growth of", "from"),
        words_of=lambda name, _: words_of_rate(found, name),
    )
    return told_of(found, table)


def words_of_rate(found: Stability, name: str) -> str:
    """Whose rate of growth a quantity is."""
    kind: Any = type(found)
    return quantities_of(kind)[name].words


def plot_stability(found: Stability, ax: Axes | None = None) -> Axes:
    """Rates of growth with their 95 % intervals; what lies right of 0 grows."""
    names = [words_of_rate(found, name) for name in found.rates]
    chart = listed(ax, names, Scale("rate of growth, below 0 it decays", RATE))
    for row, each in enumerate(found.rates.values()):
        chart.across(row, each.value, *each.interval())
    chart.at(0.0, None, "black", linewidth=0.8)
    return chart.finish()
