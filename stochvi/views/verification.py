"""Pictures of the verification: error against CPU time, and scores of many comparisons."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from scipy.special import ndtri

from stochvi.verification.check import AGREES, DISAGREES
from stochvi.verification.cost import NOISE
from stochvi.views.axes import add_grid, axes_or_new
from stochvi.views.colours import COLOURS

if TYPE_CHECKING:
    from stochvi.verification.check_of_many import Checks
    from stochvi.verification.cost import WorkPrecision

MOST_PANELS = 9
"""Largest number of quantities in a picture of errors against time: more would be too small."""

WORK_SECONDS = (1e-4, 1e4)
ERROR_PERCENT = (1e-3, 1e2)
"""Ends of both axes of the picture of errors, CPU seconds and per cent; a method beyond them is
drawn at the edge."""

WORK_TITLES = {
    "displacement_mean_square": "mean square displacement",
    "velocity_mean_square": "mean square velocity",
    "collision_rate": "hits",
    "impact_speed_rate": "F1",
    "impact_speed_square_rate": "F2",
}
"""Titles of the panels by quantity."""


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
        plot_work_precision(found, of, quantity, panels[number])
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


def plot_work_precision(found: WorkPrecision, of: str, quantity: str, ax: Axes) -> None:
    """The panel of one quantity."""
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
    ax.minorticks_off()  # those of eight decades on six panels take most of the time of the picture
    add_grid(ax)
    ax.set_title(f"{WORK_TITLES[quantity]}, {of}", fontsize="medium")


def draw_scores(found: Checks, ax: Axes | None = None) -> Axes:
    """Normal quantile plot of the scores of all comparisons: a line of slope 1 if all agree.

    Scores of one simulation are correlated. Against an exact answer there is no bias. The other
    scores measure the part of a difference that the stated biases do not cover. They lie within the
    line where these biases are larger than needed."""
    frame = found.to_frame()
    frame = frame[frame["verdict"].isin([AGREES, DISAGREES]) & frame["score"].notna()]
    exactly = frame["reference"] == "exact"
    ax = axes_or_new(ax)
    reach = 1.1 * max(found.z, float(frame["score"].abs().max()) if len(frame) else 0.0)
    ax.plot([-reach, reach], [-reach, reach], color=COLOURS["stop"], label="normal distribution")
    for side in (-found.z, found.z):
        ax.axhline(side, color=COLOURS["linearise:closure"], linestyle="--")
    ax.text(-reach, found.z, f"  alarm at {found.z:.2f}", va="bottom")
    for chosen, colour, label in (
        (~exactly, COLOURS["linearise:motion"], "others, beyond their stated bias"),
        (exactly, COLOURS["simulate"], "against the exact answer"),
    ):
        scores = np.sort(frame.loc[chosen, "score"].to_numpy())
        expected = ndtri((np.arange(len(scores)) + 0.5) / max(len(scores), 1))
        ax.plot(expected, scores, ".", color=colour, label=f"{len(scores)} {label}")
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-1.6 * reach, 1.2 * reach)  # the legend stands below the lower line
    ax.set_xlabel("score expected of a normal variable")
    ax.set_ylabel("difference / standard error")
    ax.legend(frameon=False, loc="lower right")
    return ax
