"""Pictures of the hit rate of an isolator against the clearance of its stops."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from stochvi.views.axes import add_grid, add_title, axes_or_new, length_unit
from stochvi.views.colours import COLOURS, owner_colours

SIGMA_LABEL = "clearance per side / rms displacement without stops"


def plot_clearance_curve(
    curve: pd.DataFrame, predicted: pd.DataFrame | None = None, ax: Axes | None = None
) -> Axes:
    """Hit rate against clearance: Rice, closure, and Monte Carlo with its 95 % interval.

    `curve` comes from `clearance_curve`; `predicted` from `predicted_rates` on a finer grid.
    """
    ax = axes_or_new(ax)
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
    add_grid(ax)
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
    """The same rates divided by Rice's, which shows what the impacts themselves change."""
    ax = axes_or_new(ax)
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
    add_grid(ax)
    return ax


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


def draw_pairs_clearance(curve: pd.DataFrame, title: str, ax: Axes | None = None) -> Axes:
    """Hit rate of each pair against the clearance of all, in rms of its gap: Monte Carlo with its
    95 % interval over Rice."""
    ax = axes_or_new(ax, (6.8, 4.6))
    groups = curve.groupby("pair", sort=False)
    for colour, (name, rows) in zip(owner_colours(len(groups)), groups, strict=True):
        centre = rows["simulated"]
        ax.plot(rows["clearance_in_sigma"], rows["rice"], color=colour, linestyle="--", linewidth=1)
        ax.errorbar(
            rows["clearance_in_sigma"], centre, color=colour, fmt="o", markersize=4.5, capsize=3,
            yerr=[centre - rows["simulated_low"], rows["simulated_high"] - centre], label=name,
        )  # fmt: skip
    ax.plot([], [], color="0.4", linestyle="--", linewidth=1, label="Rice, no impacts")
    ax.set_yscale("log")
    ax.set_xlabel("clearance per side / rms of the gap without stops")
    ax.set_ylabel("hits on the stops of the pair (1/s)")
    add_grid(ax)
    ax.legend(frameon=False)
    return add_title(ax, title or "hits against clearance")
