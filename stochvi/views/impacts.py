"""Pictures of impact statistics: densities of impact speeds and of times between impacts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from stochvi.mathematics.shown_units import SPEED, TIME, ShownQuantity
from stochvi.views.colours import OWNERS, owner_colours

if TYPE_CHECKING:
    from stochvi.statistics.impacts import ImpactStatistics
    from stochvi.statistics.impacts.tallies import Histogram


def plot_histogram(
    found: Histogram, ax: Axes, quantity: ShownQuantity, *, colour: str = OWNERS[0], label: str = ""
) -> Axes:
    """A density on logarithmic bins, with its standard errors; empty bins are left out."""
    seen, unit = found.density > 0.0, quantity.shown.si
    ax.errorbar(
        found.middles[seen] / unit, found.density[seen] * unit, found.standard_error[seen] * unit,
        fmt="o", markersize=3, color=colour, linewidth=0.9, label=label,
    )  # fmt: skip
    ax.set_xscale("log")
    ax.set_yscale("log")
    return ax


def draw_impacts(found: ImpactStatistics, title: str = "") -> Axes:
    """Densities of impact speeds, with Rayleigh's of the same rms speed and the power law of slow
    impacts, and of the times between impacts."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    colours, speed, time = owner_colours(len(found.pairs)), SPEED.shown.si, TIME.shown.si
    for colour, (name, pair) in zip(colours, found.pairs.items(), strict=True):
        if pair.speeds is None:
            continue
        plot_histogram(pair.speeds, left, SPEED, colour=colour, label=name)
        w = pair.speeds.middles
        left.plot(w / speed, pair.rayleigh(w) * speed, "--", color=colour, linewidth=1.0)
        for side, exponent in pair.exponents.items():
            if exponent.theory is None:
                continue
            seen = np.flatnonzero(pair.speeds.density > 0.0)
            slow = w < 0.3 * pair.speed_rms.value if pair.speed_rms else w < 0.0
            start = pair.speeds.density[seen][:8].mean(), w[seen][:8].mean()
            power = start[0] * (w[slow] / start[1]) ** exponent.theory
            label = f"w^{exponent.theory:.2g}" + (f", {side}" if side != "both" else "")
            left.plot(w[slow] / speed, power * speed, ":", color=colour, linewidth=1.6, label=label)
        if pair.intervals is not None:
            plot_histogram(pair.intervals, right, TIME, colour=colour, label=name)
            t, rate = pair.intervals.middles, pair.rates["both"].estimate.value
            with np.errstate(under="ignore"):
                poisson = rate * np.exp(-rate * t)
            right.plot(t / time, poisson * time, "--", color=colour, linewidth=1.0)
    for ax, law, labels in (
        (left, "Rayleigh", (f"impact speed ({SPEED})", f"density ({SPEED.inverse})")),
        (right, "Poisson", (f"time between impacts ({TIME})", f"density ({TIME.inverse})")),
    ):
        if ax.lines:
            ax.plot([], [], "--", color="0.4", linewidth=1.0, label=law)
        heights = [float(y) for each in ax.containers for y in each[0].get_ydata()]
        ax.set_ylim(0.3 * min(heights, default=1e-3), 3.0 * max(heights, default=1.0))
        ax.set_xlabel(labels[0])
        ax.set_ylabel(labels[1])
        ax.grid(alpha=0.25)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(frameon=False, fontsize="small")
    figure.suptitle(title or "impacts")
    first: Axes = left
    return first
