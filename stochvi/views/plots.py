"""Pictures. Every function draws on the Axes it is given (or on new ones) and returns them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from scipy.stats import norm

from stochvi.methods.closed_form import displacement_density, exact, unmet_conditions
from stochvi.methods.monte_carlo import record_path
from stochvi.results.estimates import Estimate
from stochvi.verification.check import AGREES, DISAGREES
from stochvi.verification.cost import NOISE

if TYPE_CHECKING:
    from stochvi.methods.fokker_planck import FirstPassage
    from stochvi.scenes.scene import Scene
    from stochvi.verification.checks import Checks
    from stochvi.verification.cost import WorkPrecision

COLOURS = {
    "exact": "#1b1b1b",
    "simulate": "#0b6fb8",
    "linearise:closure": "#d1495b",
    "linearise:motion": "#e0a030",
    "linearise:force": "#3a8f5c",
    "fokker-planck": "#7a4fa3",
    "stop": "#8a8f98",
}
"""One colour per method, the same in every picture."""

SIGMA_LABEL = "clearance per side / rms displacement without stops"

DENSITY_PERIODS = 60_000.0
RECORD_PERIODS = 25.0
SEARCHED_PERIODS = 400.0

MOST_PANELS = 9
"""Quantities in a picture of errors against time; more would be too small to read."""

WORK_SECONDS = (1e-4, 1e4)
ERROR_PERCENT = (1e-3, 1e2)
"""What such a picture spans; a method beyond it is drawn on its edge."""

WORK_TITLES = {
    "displacement_mean_square": "mean square displacement",
    "velocity_mean_square": "mean square velocity",
    "collision_rate": "hits",
    "impact_speed_rate": "F1",
    "impact_speed_square_rate": "F2",
}

LENGTH_UNITS = ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"))


def length_unit(size: float) -> tuple[float, str]:
    """Unit in which lengths of this size read well: (metres, name)."""
    return next((unit for unit in LENGTH_UNITS if size >= 0.2 * unit[0]), LENGTH_UNITS[-1])


def draw_stops(ax: Axes, scene: Scene, unit: float, *, vertical: bool) -> None:
    """The stops as grey walls; the view is widened where it does not reach them."""
    limits, span, set_limits = (
        (ax.get_xlim, ax.axvspan, ax.set_xlim)
        if vertical
        else (ax.get_ylim, ax.axhspan, ax.set_ylim)
    )
    stops = [
        (position / unit, side)
        for pair in scene.expanded.impact_pairs
        for position, side in ((pair.lower, -1.0), (pair.upper, 1.0))
        if position is not None
    ]
    low, high = limits()
    margin = 0.08 * (high - low)
    for place, side in stops:
        low = min(low, place - margin) if side < 0.0 else low
        high = max(high, place + margin) if side > 0.0 else high
    for place, side in stops:
        edges = (low, place) if side < 0.0 else (place, high)
        span(*edges, color=COLOURS["stop"], alpha=0.35, linewidth=0)
    set_limits(low, high)


def plot_displacement_density(
    scene: Scene, path: pd.DataFrame, linear_std: float | None = None, ax: Axes | None = None
) -> Axes:
    """Histogram of a recorded path, the exact density where there is one, and the stops.

    Parameters
    ----------
    scene
        The scene that was simulated.
    path
        From `record_path`, long enough for a smooth histogram.
    linear_std
        Standard deviation without stops (m); if given, its normal law is drawn for comparison.
    """
    ax = _axes(ax)
    unit, name = length_unit(float(path["displacement"].abs().max()))
    samples = path["displacement"].to_numpy() / unit
    low, high = samples.min(), samples.max()
    ax.hist(
        samples, bins=60, range=(low, high), density=True, color=COLOURS["simulate"], alpha=0.45,
        label="Monte Carlo",
    )  # fmt: skip
    x = np.linspace(low, high, 801)
    if not unmet_conditions(scene):
        density = displacement_density(scene, x * unit) * unit
        ax.plot(x, density, color=COLOURS["exact"], linewidth=1.8, label="exact")
    if linear_std is not None:
        system = scene.system()
        rest = system.load / system.omega**2
        density = norm.pdf(x, rest / unit, linear_std / unit)
        ax.plot(
            x, density, color=COLOURS["stop"], linestyle="--", linewidth=1.4, label="without stops"
        )
    draw_stops(ax, scene, unit, vertical=True)
    ax.set_xlabel(f"displacement ({name})")
    ax.set_ylabel(f"probability density (1/{name})")
    _legend_above(ax)
    return ax


def plot_velocity_density(scene: Scene, path: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Histogram of the velocity of a recorded path, and the normal law: the exact one or,
    where none is known, that of the same rms."""
    ax = _axes(ax)
    samples = path["velocity"].to_numpy()
    deviation = float(np.sqrt(np.mean(samples**2)))
    limit = 4.2 * deviation
    ax.hist(
        samples, bins=70, range=(-limit, limit), density=True, color=COLOURS["simulate"],
        alpha=0.45, label="Monte Carlo",
    )  # fmt: skip
    v = np.linspace(-limit, limit, 401)
    if unmet_conditions(scene):
        ax.plot(
            v, norm.pdf(v, 0.0, deviation), color=COLOURS["stop"], linestyle="--", linewidth=1.4,
            label="normal law of the same rms",
        )  # fmt: skip
    else:
        known = exact(scene).coordinates["x"]["velocity_std"]
        assert isinstance(known, Estimate)
        density = norm.pdf(v, 0.0, known.value)
        ax.plot(v, density, color=COLOURS["exact"], linewidth=1.8, label="exact")
    ax.set_xlabel("velocity (m/s)")
    ax.set_ylabel("probability density (s/m)")
    _legend_above(ax)
    return ax


def plot_record(scene: Scene, path: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """A short record with its impacts marked on the stops, sized by impact speed."""
    ax = _axes(ax)
    unit, name = length_unit(float(path["displacement"].abs().max()))
    ax.plot(path["time"], path["displacement"] / unit, color=COLOURS["simulate"], linewidth=1.1)
    hits = path[path["impact_speed"] != 0.0]
    if len(hits):
        pair = scene.impact_pairs[0]
        place = np.where(hits["impact_speed"] > 0.0, pair.upper or 0.0, pair.lower or 0.0)
        size = hits["impact_speed"].abs() / hits["impact_speed"].abs().max()
        ax.scatter(
            hits["time"], place / unit, s=12.0 + 60.0 * size, color=COLOURS["linearise:closure"],
            edgecolor="white", linewidth=0.6, zorder=3,
            label=f"{len(hits)} impact{'s' if len(hits) > 1 else ''}, larger = faster",
        )  # fmt: skip
    draw_stops(ax, scene, unit, vertical=False)
    ax.set_xlim(path["time"].iloc[0], path["time"].iloc[-1])
    ax.set_xlabel("time (s)")
    ax.set_ylabel(f"displacement ({name})")
    if len(hits):
        _legend_above(ax)
    return ax


def plot_clearance_curve(
    curve: pd.DataFrame, predicted: pd.DataFrame | None = None, ax: Axes | None = None
) -> Axes:
    """Hit rate against clearance: Rice, closure, and Monte Carlo with its 95 % interval.

    `curve` comes from `clearance_curve`; `predicted` from `predicted_rates` on a finer grid.
    """
    ax = _axes(ax)
    smooth = curve if predicted is None else predicted
    sigma = smooth["clearance_in_sigma"]
    ax.plot(sigma, smooth["rice"], color=COLOURS["exact"], linestyle="--", label="Rice, no impacts")
    ax.plot(sigma, smooth["closure"], color=COLOURS["linearise:closure"], label="moment closure")
    centre = curve["simulated"]
    ax.errorbar(
        curve["clearance_in_sigma"], centre, color=COLOURS["simulate"], fmt="o", markersize=4.5,
        yerr=[centre - curve["simulated_low"], curve["simulated_high"] - centre], capsize=3,
        label="Monte Carlo, 95 %",
    )  # fmt: skip
    ax.set_yscale("log")
    ax.set_xlabel(SIGMA_LABEL)
    ax.set_ylabel("hits on both stops (1/s)")
    ax.grid(which="major", color="#dddddd", linewidth=0.6)
    ax.legend(frameon=False)
    unit, name = length_unit(float(curve["clearance"].max()))
    per_sigma = float(curve["clearance"].iloc[0] / curve["clearance_in_sigma"].iloc[0]) / unit
    top = ax.secondary_xaxis(
        "top", functions=(lambda s: np.asarray(s) * per_sigma, lambda c: np.asarray(c) / per_sigma)
    )
    top.set_xlabel(f"clearance per side ({name})")
    return ax


def plot_clearance_ratio(
    curve: pd.DataFrame, predicted: pd.DataFrame | None = None, ax: Axes | None = None
) -> Axes:
    """The same rates divided by Rice's: what the impacts themselves change."""
    ax = _axes(ax)
    smooth = curve if predicted is None else predicted
    ratio = curve["simulated"] / curve["rice"]
    ax.axhline(1.0, color=COLOURS["exact"], linestyle="--", linewidth=1.2)
    ax.plot(
        smooth["clearance_in_sigma"], smooth["closure"] / smooth["rice"],
        color=COLOURS["linearise:closure"],
    )  # fmt: skip
    ax.errorbar(
        curve["clearance_in_sigma"], ratio, color=COLOURS["simulate"], fmt="o", markersize=4.5,
        yerr=[ratio - curve["simulated_low"] / curve["rice"],
              curve["simulated_high"] / curve["rice"] - ratio], capsize=3,
    )  # fmt: skip
    ax.set_xlabel(SIGMA_LABEL)
    ax.set_ylabel("rate / Rice")
    ax.grid(which="major", color="#dddddd", linewidth=0.6)
    return ax


def plot_first_passage(found: FirstPassage, ax: Axes | None = None) -> Axes:
    """P(first passage before t) against time, beside what constant rates would give.

    Both axes are logarithmic. `found` shows its own times as marks; the line between them is
    drawn where there are many.
    """
    ax = _axes(ax)
    times = np.array(found.times)
    chances = np.array([estimate.value for estimate in found.probability])
    order = np.argsort(times)
    shown = order[(times[order] > 0.0) & (chances[order] > 0.0)]
    if not len(shown):
        raise ValueError("a picture needs a time with a probability above 0")
    last = times[shown[-1]]
    first = times[shown[0]] if len(shown) > 1 else last / PASSAGE_SPAN
    grid = np.geomspace(first, last, 201)
    rates = [("rate in the end, from the first moment", found.decay_rate, "-")]
    if found.rice_rate is not None:
        rates.append(("Rice, no memory", found.rice_rate, "--"))
    for label, rate, style in rates:
        ax.plot(
            grid, -np.expm1(-rate.value * grid), color=COLOURS["stop"], linestyle=style,
            linewidth=1.3, label=label,
        )  # fmt: skip
    ax.plot(
        times[shown], chances[shown], "o-", color=COLOURS["fokker-planck"], linewidth=1.8,
        markersize=3.0 if len(shown) > MANY_TIMES else 5.5, label=f"start: {found.start}",
    )  # fmt: skip
    ax.set_xscale("log")
    ax.set_yscale("log")
    low = min(chances[shown].min(), -np.expm1(-found.decay_rate.value * grid[0]))
    # a chance is never above 1
    ax.set_ylim(max(low / 2.0, FAINTEST * chances[shown].max()), 2.0)
    ax.set_xlabel("time (s)")
    ax.set_ylabel("P(first passage before t)")
    ax.grid(which="major", color="#dddddd", linewidth=0.6)
    ax.legend(frameon=False, loc="lower right")
    return ax


PASSAGE_SPAN = 1000.0
"""What a picture of a single time spans before it."""

MANY_TIMES = 15
"""Times whose marks are drawn small."""

FAINTEST = 1e-8
"""Smallest probability that a picture shows, of its largest."""


def draw_clearance(curve: pd.DataFrame, predicted: pd.DataFrame, title: str) -> Axes:
    """Rates, and their ratio to Rice's below them, in one figure; returns the upper Axes."""
    figure, axes = plt.subplots(
        2, 1, figsize=(6.8, 6.6), height_ratios=(2.0, 1.0), layout="constrained", sharex=True
    )
    above: Axes = axes[0]
    below: Axes = axes[1]
    plot_clearance_curve(curve, predicted, above).set_xlabel("")
    plot_clearance_ratio(curve, predicted, below)
    figure.suptitle(title)
    return above


def draw_work_precision(found: WorkPrecision, title: str = "") -> Axes:
    """Error against CPU time, a panel for each quantity; returns the first Axes.

    A line for each step: the statistical error, which falls with the square root of the time, and
    the bias, on which it levels out. A bias that is not beyond its noise is drawn as its upper
    limit, dotted, and none where it is not known. Crosses are methods that simulate nothing,
    triangles the upper limits of their errors where these are not beyond the noise.
    """
    keys = list(dict.fromkeys((row.of, row.quantity) for row in found.errors))
    keys = [key for key in keys if key[1] != "displacement_mean"][:MOST_PANELS]
    columns = min(3, len(keys))
    rows = -(-len(keys) // columns)
    figure, grid = plt.subplots(
        rows, columns, figsize=(3.4 * columns, 0.9 + 2.8 * rows), layout="constrained",
        sharex=True, sharey=True, squeeze=False,
    )  # fmt: skip
    panels = list(grid.flat)
    for number, (of, quantity) in enumerate(keys):
        _work_precision_panel(found, of, quantity, panels[number])
        if number + columns >= len(keys):
            panels[number].tick_params(labelbottom=True)
            panels[number].set_xlabel("CPU time of one core (s)")
        if number % columns == 0:
            panels[number].set_ylabel("relative error (%)")
    for ax in panels[len(keys) :]:
        ax.axis("off")
    named = [zip(*ax.get_legend_handles_labels(), strict=True) for ax in panels]
    legend = {label: handle for pairs in named for handle, label in pairs}
    figure.legend(
        legend.values(), legend.keys(), loc="outside lower center", ncols=4, frameon=False
    )
    figure.suptitle(title or "what accuracy costs")
    first: Axes = panels[0]
    return first


def _work_precision_panel(found: WorkPrecision, of: str, quantity: str, ax: Axes) -> None:
    rows = [row for row in found.errors if (row.of, row.quantity) == (of, quantity)]
    colours = plt.get_cmap("viridis")(np.linspace(0.85, 0.1, len(rows)))
    seconds = np.geomspace(*WORK_SECONDS, 121)
    for row, colour in zip(rows, colours, strict=True):
        noise = 100.0 * row.error_of_a_second / np.sqrt(seconds)
        limit = row.step_bias_limit
        floor = 0.0 if limit is None else 100.0 * limit
        if limit is not None and row.bias_is_seen and not found.elastic:
            floor = 100.0 * abs(row.step_bias)
        ax.loglog(
            seconds, np.hypot(noise, floor), color=colour, linewidth=1.6,
            label=f"step {row.step:.3g} s",
        )  # fmt: skip
        if floor > 0.0:
            style = "--" if row.bias_is_seen else ":"
            ax.axhline(floor, color=colour, linestyle=style, linewidth=0.9)
    for model in found.models:
        error, doubt = abs(model.model_error), NOISE * model.model_error_error
        limit = 100.0 * (error if error > doubt else error + doubt)
        if (model.of, model.quantity) == (of, quantity) and limit > ERROR_PERCENT[0]:
            ax.plot(
                max(model.cpu_seconds, WORK_SECONDS[0]), min(limit, ERROR_PERCENT[1]),
                "x" if error > doubt else "v", color=COLOURS.get(model.method, COLOURS["stop"]),
                markersize=7, markeredgewidth=2.0, label=model.method, clip_on=False,
            )  # fmt: skip
    if not found.elastic and all(row.step_bias_limit is None for row in rows):
        ax.text(0.96, 0.93, "bias not known", transform=ax.transAxes, ha="right", va="top")
    ax.set_xlim(*WORK_SECONDS)
    ax.set_ylim(*ERROR_PERCENT)
    ax.grid(which="major", color="#dddddd", linewidth=0.6)
    ax.set_title(f"{WORK_TITLES[quantity]}, {of}", fontsize="medium")


def draw_scores(found: Checks) -> Axes:
    """Normal quantile plot of the scores of all comparisons: a line of slope 1 if all agree.

    Scores of one simulation hang together. Against an exact answer there is no bias; the others
    are what stated biases do not cover, and lie within the line where these are generous.
    """
    frame = found.to_frame()
    frame = frame[frame["verdict"].isin([AGREES, DISAGREES]) & frame["score"].notna()]
    exactly = frame["reference"] == "exact"
    ax = _axes(None)
    reach = 1.1 * max(found.z, float(frame["score"].abs().max()) if len(frame) else 0.0)
    ax.plot([-reach, reach], [-reach, reach], color=COLOURS["stop"], label="normal law")
    for side in (-found.z, found.z):
        ax.axhline(side, color=COLOURS["linearise:closure"], linestyle="--")
    ax.text(-reach, found.z, f"  alarm at {found.z:.2f}", va="bottom")
    for chosen, colour, label in (
        (~exactly, COLOURS["linearise:motion"], "others, beyond their stated bias"),
        (exactly, COLOURS["simulate"], "against the exact answer"),
    ):
        scores = np.sort(frame.loc[chosen, "score"].to_numpy())
        expected = norm.ppf((np.arange(len(scores)) + 0.5) / max(len(scores), 1))
        ax.plot(expected, scores, ".", color=colour, label=f"{len(scores)} {label}")
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-1.6 * reach, 1.2 * reach)  # the legend stands below the lower line
    ax.set_xlabel("score expected of a normal variable")
    ax.set_ylabel("difference / standard error")
    ax.legend(frameon=False, loc="lower right")
    return ax


def draw_overview(scene: Scene, title: str) -> Axes:
    """Densities of x and v and a short record in one figure; returns the record's Axes.

    The densities are of one path of `DENSITY_PERIODS` natural periods.
    """
    period = 2.0 * np.pi / scene.system().omega
    long = record_path(scene, duration=DENSITY_PERIODS * period, seed=1)
    without_stops = scene.model_copy(update={"impact_pairs": ()})
    linear = None
    if not unmet_conditions(without_stops):
        linear = exact(without_stops).estimates()["x", "displacement_std"].value
    figure, axes = plt.subplot_mosaic(
        [["x", "v"], ["record", "record"]], figsize=(9.6, 6.8), layout="constrained"
    )
    plot_displacement_density(scene, long, linear, axes["x"])
    plot_velocity_density(scene, long, axes["v"])
    figure.suptitle(title)
    return plot_record(scene, _stretch_with_impacts(scene, period), axes["record"])


def _stretch_with_impacts(scene: Scene, period: float) -> pd.DataFrame:
    """Some periods of a finely stepped record, from shortly before an impact if there is one."""
    record = record_path(scene, duration=SEARCHED_PERIODS * period, seed=2, step=period / 80.0)
    settled = record[record["time"] > 0.1 * SEARCHED_PERIODS * period]
    hits = settled.loc[settled["impact_speed"] != 0.0, "time"]
    last = settled["time"].iloc[-1] - RECORD_PERIODS * period
    start = min(hits.iloc[0] - 2.0 * period if len(hits) else settled["time"].iloc[0], last)
    short = settled[settled["time"].between(start, start + RECORD_PERIODS * period)]
    return short.assign(time=short["time"] - short["time"].iloc[0])


def _axes(ax: Axes | None) -> Axes:
    return plt.subplots(figsize=(6.4, 4.0), layout="constrained")[1] if ax is None else ax


def _legend_above(ax: Axes) -> None:
    ax.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
