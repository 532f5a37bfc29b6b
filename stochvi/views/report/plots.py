"""Pictures of a clearance report. Every function draws on Axes (or new ones) and returns them."""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray
from scipy.signal import welch
from scipy.stats import norm

from stochvi.mathematics.spectra import squared_gain
from stochvi.mathematics.units import STANDARD_GRAVITY, density_from_intensity, power_ratio
from stochvi.results.intervals import GAUSSIAN_95
from stochvi.views.plots import COLOURS, draw_stops, length_unit
from stochvi.views.report.words import count_of

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.scenes.scene import Scene, System

Vector = NDArray[np.float64]

SIZE = (5.2, 3.5)
"""Inches; letters of 10 points then read well at half the width of a page, and on a telephone."""

POINTS = 801
"""Frequencies of a smooth curve."""

FEW_BREAKPOINTS = 60
"""Above, a table is a measured density and its points are not marked."""

WHITE_BAND = (0.05, 20.0)
"""Natural frequencies between which white noise is drawn."""

TOLERANCE_DB = 3.0

PLAIN_NUMBERS = (1e-4, 2e4)
"""A logarithmic axis within these is labelled by numbers, another one by powers of ten."""

FEW_DECADES = 300.0
"""Ratio of the ends of an axis below which 2 and 5 are labelled too."""

LABEL_WIDTH = 30
"""Letters in a line of a label."""

LEGEND_COLUMNS = 2
"""More do not fit above a picture of half a page."""

SYNTHESISED = 0.7
"""Of half the sampling rate: above, a synthesised path carries what was folded from beyond."""

SEGMENT_PERIODS = 60.0
"""Natural periods in a segment of a recorded path: resolves a damping ratio of 2 %."""

GRAVITY_SQUARED = STANDARD_GRAVITY**2
MARKS = {"three_sigma": ("#e0a030", "3 sigma"), "recommended": ("#3a8f5c", "recommended")}
"""Colours and names of the two clearances that every picture may mark."""


def frequencies(system: System) -> Vector:
    """A grid over the input and the resonance, Hz."""
    natural = system.omega / (2.0 * math.pi)
    low = min([float(table.frequency_hz[0]) for table in system.tables], default=0.0)
    high = max([float(table.frequency_hz[-1]) for table in system.tables], default=0.0)
    if system.intensity or not system.tables:
        low, high = WHITE_BAND[0] * natural, max(high, WHITE_BAND[1] * natural)
    near = natural + system.damping_rate / math.pi * np.linspace(-3.0, 3.0, 121)
    edges = [table.frequency_hz for table in system.tables]
    grid = np.concatenate([np.geomspace(low, high, POINTS), near, *edges])
    return np.unique(grid[(grid >= low) & (grid <= high)])


def input_density(system: System, frequency_hz: Vector) -> Vector:
    """One-sided density of the base acceleration, (m/s^2)^2/Hz."""
    total = np.full_like(frequency_hz, density_from_intensity(system.intensity))
    for table in system.tables:
        total = total + table(frequency_hz)
    return total


def plot_input(scene: Scene, ax: Axes | None = None) -> Axes:
    """Input density with its breakpoints and a band of +-3 dB."""
    ax = _axes(ax)
    system = scene.system()
    f = frequencies(system)
    g2 = input_density(system, f) / GRAVITY_SQUARED
    ratio = power_ratio(TOLERANCE_DB)
    ax.fill_between(f, g2 / ratio, g2 * ratio, color=COLOURS["simulate"], alpha=0.18,
                    linewidth=0, label="±3 dB")  # fmt: skip
    ax.loglog(f, g2, color=COLOURS["simulate"], linewidth=1.8, label="base acceleration")
    for table in system.tables:
        if len(system.tables) == 1 and len(table.frequency_hz) <= FEW_BREAKPOINTS:
            ax.plot(table.frequency_hz, table.density / GRAVITY_SQUARED, "o", markersize=5,
                    color=COLOURS["simulate"], label="breakpoints")  # fmt: skip
    _mark_natural(ax, system)
    _finish(ax, "frequency (Hz)", "one-sided density (g²/Hz)")
    return ax


def plot_response(scene: Scene, ax: Axes | None = None) -> Axes:
    """Density of the absolute acceleration without stops, over that of the base."""
    ax = _axes(ax)
    system = scene.system()
    f = frequencies(system)
    g2 = input_density(system, f) / GRAVITY_SQUARED
    ax.loglog(f, g2, color=COLOURS["stop"], linewidth=1.4, label="base")
    ax.loglog(f, g2 * transmissibility(system, f) ** 2, color=COLOURS["simulate"], linewidth=1.8,
              label="mass, no stops")  # fmt: skip
    _mark_natural(ax, system)
    _finish(ax, "frequency (Hz)", "one-sided density (g²/Hz)")
    return ax


def transmissibility(system: System, frequency_hz: Vector) -> Vector:
    """Absolute acceleration over base acceleration, sqrt(omega^4 + b^2 w^2) |H|."""
    w2 = (2.0 * np.pi * frequency_hz) ** 2
    gain = squared_gain(frequency_hz, system.omega, system.damping_rate)
    return np.asarray(np.sqrt((system.omega**4 + system.damping_rate**2 * w2) * gain))


def plot_transmissibility(
    scene: Scene, path: pd.DataFrame | None = None, ax: Axes | None = None
) -> Axes:
    """What the mount passes on: in theory without stops, and apparently in a path with stops.

    Of the path, the density of -(b v + omega^2 x), the part of the acceleration that spring and
    damper cause, over that of the base: with stops it is no property of the mount any more.
    """
    ax = _axes(ax)
    system = scene.system()
    f = frequencies(system)
    if path is not None:
        frequency, density = _path_density(system, path)
        base = input_density(system, frequency)
        seen = (base > 0.0) & (frequency >= f[0])
        ax.loglog(frequency[seen], np.sqrt(density[seen] / base[seen]),
                  color=MARKS["three_sigma"][0], linewidth=1.2,
                  label="apparent, stops at 3 sigma")  # fmt: skip
    ax.loglog(f, transmissibility(system, f), color=COLOURS["exact"], linewidth=1.6,
              label="no stops")  # fmt: skip
    ax.axhline(1.0, color=COLOURS["stop"], linewidth=0.8)
    _mark_natural(ax, system)
    _finish(ax, "frequency (Hz)", "transmissibility (acceleration)")
    return ax


def _path_density(system: System, path: pd.DataFrame) -> tuple[Vector, Vector]:
    step = float(path["time"].iloc[1] - path["time"].iloc[0])
    length = min(round(SEGMENT_PERIODS * 2.0 * math.pi / system.omega / step), len(path))
    rest = system.load / system.omega**2
    acceleration = system.damping_rate * path["velocity"] + system.omega**2 * (
        path["displacement"] - rest
    )
    frequency, density = welch(acceleration.to_numpy(), 1.0 / step, nperseg=length)
    kept = (frequency > 0.0) & (frequency < SYNTHESISED / (2.0 * step))
    return frequency[kept], density[kept]


def plot_cumulative(scene: Scene, ax: Axes | None = None) -> Axes:
    """Share of the mean square below each frequency, without stops."""
    ax = _axes(ax)
    system = scene.system()
    f = frequencies(system)
    base = input_density(system, f)
    displacement = squared_gain(f, system.omega, system.damping_rate) * base
    for name, density, colour in (
        ("relative displacement", displacement, COLOURS["simulate"]),
        ("relative velocity", (2.0 * np.pi * f) ** 2 * displacement, COLOURS["fokker-planck"]),
        ("absolute acceleration", transmissibility(system, f) ** 2 * base, COLOURS["exact"]),
    ):
        areas = np.concatenate([[0.0], np.cumsum(np.diff(f) * (density[1:] + density[:-1]) / 2.0)])
        ax.semilogx(f, 100.0 * areas / areas[-1], color=colour, linewidth=1.6, label=name)
    _mark_natural(ax, system)
    _finish(ax, "frequency (Hz)", "mean square below it (%)")
    return ax


def plot_histogram(
    scene: Scene, path: pd.DataFrame, linear_std: float, ax: Axes | None = None
) -> Axes:
    """Histogram of a path between its stops, logarithmic, over the normal law without stops."""
    ax = _axes(ax)
    system = scene.system()
    rest = system.load / system.omega**2
    unit, name = length_unit(3.0 * linear_std)
    samples = path["displacement"].to_numpy() / unit
    reach = 1.05 * max(abs(samples - rest / unit).max(), 4.5 * linear_std / unit)
    x = rest / unit + np.linspace(-reach, reach, 401)
    ax.hist(samples, bins=120, range=(x[0], x[-1]), density=True, color=COLOURS["simulate"],
            alpha=0.55, label="with stops")  # fmt: skip
    ax.plot(x, norm.pdf(x, rest / unit, linear_std / unit), color=COLOURS["exact"],
            linestyle="--", linewidth=1.3, label="normal law, no stops")  # fmt: skip
    ax.set_yscale("log")
    ax.set_xlim(x[0], x[-1])
    peak = norm.pdf(0.0, 0.0, linear_std / unit)
    ax.set_ylim(2e-6 * peak, 3.0 * peak)
    draw_stops(ax, scene, unit, vertical=True)
    _finish(ax, f"relative displacement ({name})", f"probability density (1/{name})")
    return ax


def plot_hit_rate(
    sizing: Sizing, closure: pd.DataFrame | None = None, ax: Axes | None = None
) -> Axes:
    """Hits per second against clearance: Rice, first hits, closure, Monte Carlo with 95 %."""
    ax = _axes(ax)
    curve, mm = sizing.curve, 1e3
    ax.plot(mm * curve["clearance"], curve["rice_rate"], color=COLOURS["exact"], linestyle="--",
            linewidth=1.3, label="Rice, no impacts")  # fmt: skip
    known = curve[curve["first_hit_rate_low"] > 0.0]
    ax.plot(mm * known["clearance"], known["first_hit_rate"], color=COLOURS["fokker-planck"],
            linewidth=1.6, label="first hits")  # fmt: skip
    ax.fill_between(mm * known["clearance"], known["first_hit_rate_low"],
                    known["first_hit_rate_high"], color=COLOURS["fokker-planck"], alpha=0.25,
                    linewidth=0)  # fmt: skip
    if closure is not None and closure["closure"].notna().any():
        ax.plot(mm * closure["clearance"], closure["closure"], color=COLOURS["linearise:closure"],
                linewidth=1.3, label="moment closure")  # fmt: skip
    seen = sizing.simulated
    if len(seen):
        centre = seen["hit_rate"]
        ax.errorbar(
            mm * seen["clearance"], centre, color=COLOURS["simulate"], fmt="o", markersize=5,
            yerr=[centre - seen["hit_rate_low"], seen["hit_rate_high"] - centre], capsize=3,
            label="with stops, 95 %",
        )  # fmt: skip
    ax.set_yscale("log")
    _mark_clearances(ax, sizing)
    _finish(ax, "clearance per side (mm)", "hits per second")
    return ax


def plot_impact_speeds(
    speeds: Vector, duration: float, rice_rate: float, velocity_std: float, ax: Axes | None = None
) -> Axes:
    """Rate of impacts faster than w, counted, and Rice's with Rayleigh speeds."""
    ax = _axes(ax)
    faster = np.arange(len(speeds), 0, -1) / duration
    w = np.linspace(0.0, 1.15 * max(speeds.max(), 2.5 * velocity_std), 301)
    ax.semilogy(w, rice_rate * np.exp(-0.5 * (w / velocity_std) ** 2), color=COLOURS["exact"],
                linestyle="--", linewidth=1.3, label="Rice, no impacts")  # fmt: skip
    ax.semilogy(np.sort(speeds), faster, color=MARKS["three_sigma"][0], linewidth=1.6,
                drawstyle="steps-post",
                label=f"{count_of(len(speeds))} hits at 3 sigma")  # fmt: skip
    ax.set_ylim(0.5 / duration, 3.0 * max(faster[0], rice_rate))
    _finish(ax, "impact speed w (m/s)", "impacts faster than w, per second")
    return ax


def plot_peaks(table: pd.DataFrame, window: float, ax: Axes | None = None) -> Axes:
    """Largest acceleration against clearance, a line for each stiffness of the stops."""
    ax = _axes(ax)
    own = table["stiffness_ratio"].isna()
    ratios = sorted(table.loc[~own, "stiffness_ratio"].unique())
    for number, ratio in enumerate(ratios):
        rows = table[table["stiffness_ratio"] == ratio]
        colour = plt.get_cmap("viridis")(0.85 - 0.7 * number / max(len(ratios) - 1, 1))
        _error_bars(ax, rows, "o-", colour, f"stops {ratio:g} x the mount")
    _error_bars(ax, table[own], "D", COLOURS["linearise:closure"], "stops of the scene")
    free = (table["largest_acceleration"] / table["peak_amplification"]).mean() / STANDARD_GRAVITY
    ax.axhline(free, color=COLOURS["exact"], linestyle="--", linewidth=1.2, label="no stops")
    ax.set_yscale("log")
    _finish(ax, "clearance per side (mm)", f"largest acceleration in {window:g} s (g)")
    return ax


def _error_bars(ax: Axes, rows: pd.DataFrame, form: str, colour: Any, label: str) -> None:
    ax.errorbar(
        1e3 * rows["clearance"], rows["largest_acceleration"] / STANDARD_GRAVITY,
        yerr=GAUSSIAN_95 * rows["largest_acceleration_error"] / STANDARD_GRAVITY,
            fmt=form, color=colour,
        markersize=4.5, linewidth=1.3, capsize=2, label=label,
    )  # fmt: skip


def plot_sensitivity(table: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Change of the clearance, a bar for each row but the first, which changes nothing."""
    ax = _axes(ax)
    rows = table.iloc[1:][::-1]
    change = 100.0 * rows["clearance_change"]
    colours = [COLOURS["linearise:closure"] if c > 0.0 else COLOURS["simulate"] for c in change]
    names = [textwrap.fill(name, LABEL_WIDTH) for name in rows["change"]]
    ax.barh(names, change, color=colours, height=0.6)
    ax.tick_params(axis="y", labelsize="small")
    for place, value in enumerate(change):
        ax.annotate(f"{value:+.0f} %", (value, place), xytext=(4 if value >= 0.0 else -4, 0),
                    textcoords="offset points", va="center",
                    ha="left" if value >= 0.0 else "right")  # fmt: skip
    ax.axvline(0.0, color=COLOURS["exact"], linewidth=0.8)
    ax.margins(x=0.3)
    ax.set_xlabel("change of the clearance (%)")
    return ax


def _mark_natural(ax: Axes, system: System) -> None:
    natural = system.omega / (2.0 * math.pi)
    ax.axvline(natural, color=COLOURS["linearise:closure"], linestyle=":", linewidth=1.2,
               label=f"mount, {natural:.3g} Hz")  # fmt: skip


def _mark_clearances(ax: Axes, sizing: Sizing) -> None:
    for name, place in (
        ("three_sigma", sizing.three_sigma.clearance),
        ("recommended", sizing.clearance.value),
    ):
        colour, words = MARKS[name]
        ax.axvline(1e3 * place, color=colour, linewidth=1.4, label=f"{words}, {1e3 * place:.3g} mm")


def _finish(ax: Axes, x: str, y: str) -> None:
    for axis in (ax.xaxis, ax.yaxis):
        low, high = sorted(axis.get_view_interval())
        if axis.get_scale() == "log" and low >= PLAIN_NUMBERS[0] and high <= PLAIN_NUMBERS[1]:
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
            if high < FEW_DECADES * low:
                axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    ax.grid(which="major", color="#dddddd", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.legend(frameon=False, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0),
              ncols=LEGEND_COLUMNS)  # fmt: skip


def _axes(ax: Axes | None) -> Axes:
    return new_axes() if ax is None else ax


def new_axes() -> Axes:
    """Axes of a figure of the size of all pictures in a report."""
    axes: Axes = plt.subplots(figsize=SIZE, layout="constrained")[1]
    return axes
