"""The picture of a first passage: its probability against time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from stochvi.mathematics.shown_units import TIME
from stochvi.views.axes import add_grid, axes_or_new
from stochvi.views.colours import COLOURS

if TYPE_CHECKING:
    from stochvi.methods.fokker_planck import FirstPassage

SINGLE_TIME_SPAN = 1000.0
"""Ratio of the ends of the time axis where the answer has a single time."""

MANY_TIMES = 15
"""Number of times above which their marks are drawn small."""

FAINTEST = 1e-8
"""Smallest probability that a picture shows, relative to its largest."""


def plot_first_passage(found: FirstPassage, ax: Axes | None = None) -> Axes:
    """P(first passage before t) against time, with the curve of constant rates.

    Both axes are logarithmic. `found` shows its own times as marks; the line between them is
    drawn where there are many.
    """
    ax = axes_or_new(ax)
    times = np.array(found.times)
    chances = np.array([estimate.value for estimate in found.probability])
    order = np.argsort(times)
    shown = order[(times[order] > 0.0) & (chances[order] > 0.0)]
    if not len(shown):
        raise ValueError("a picture needs a time with a probability above 0")
    last = times[shown[-1]]
    first = times[shown[0]] if len(shown) > 1 else last / SINGLE_TIME_SPAN
    grid = np.geomspace(first, last, 201)
    rates = [("rate in the end, from the first moment", found.decay_rate, "-")]
    if found.rice_rate is not None:
        rates.append(("Rice, no memory", found.rice_rate, "--"))
    for label, rate, style in rates:
        ax.plot(
            TIME(grid), -np.expm1(-rate.value * grid), color=COLOURS["stop"], linestyle=style,
            linewidth=1.3, label=label,
        )  # fmt: skip
    ax.plot(
        TIME(times[shown]), chances[shown], "o-", color=COLOURS["fokker-planck"], linewidth=1.8,
        markersize=3.0 if len(shown) > MANY_TIMES else 5.5, label=f"start: {found.start}",
    )  # fmt: skip
    ax.set_xscale("log")
    ax.set_yscale("log")
    low = min(chances[shown].min(), -np.expm1(-found.decay_rate.value * grid[0]))
    # a probability is never above 1
    ax.set_ylim(max(low / 2.0, FAINTEST * chances[shown].max()), 2.0)
    ax.set_xlabel(f"time ({TIME})")
    ax.set_ylabel("P(first passage before t)")
    add_grid(ax)
    ax.legend(frameon=False, loc="lower right")
    return ax
