"""Pictures of impact rates against the clearance of the stops."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from stochvi.mathematics.shown_units import RATE
from stochvi.views.axes import add_grid, axes_or_new, length_unit
from stochvi.views.colours import COLOURS, owner_colours


def plot_clearance_curve(
    curve: pd.DataFrame, predicted: pd.DataFrame | None = None, ax: Axes | None = None
) -> Axes:
    """Impact rate against clearance: Rice, closure, and Monte Carlo with its 95 % interval.

    `curve` comes from `clearance_curve`; `predicted` from `predicted_curve`. A picture of one pair
    tells the methods apart by colour, one of several pairs the pairs.
    """
    ax = axes_or_new(ax, (6.8, 4.6))
    smooth = curve if predicted is None else predicted
    several = "pair" in curve
    for (name, rows), (_, lines), colours in zip(
        _by_pair(curve), _by_pair(smooth), _colours(curve), strict=True
    ):
        rice, closure, simulated = colours
        sigma = lines["clearance_in_sigma"]
        ax.plot(
            sigma, RATE(lines["rice"]), color=rice, linestyle="--", label=None if several else RICE
        )
        if lines["closure"].notna().any():
            ax.plot(
                sigma, RATE(lines["closure"]), color=closure, linewidth=1.0 if several else None,
                label=None if several else "moment closure",
            )  # fmt: skip
        _error_bars(
            ax, rows, RATE(rows["simulated"]), RATE.shown.si, simulated, name or MONTE_CARLO
        )
    if several:
        ax.plot([], [], color="0.4", linestyle="--", label=RICE)
        ax.plot([], [], color="0.4", linewidth=1.0, label="moment closure")
    ax.set_yscale("log")
    ax.set_xlabel(_sigma_label(curve))
    ax.set_ylabel(f"impacts on the stops{' of a pair' if several else ''} ({RATE})")
    add_grid(ax)
    ax.legend(frameon=False)
    if not several:
        _add_lengths(ax, curve)
    return ax


RICE, MONTE_CARLO = "Rice, no impacts", "Monte Carlo, 95 %"


def _add_lengths(ax: Axes, curve: pd.DataFrame) -> None:
    """The clearances of one pair as lengths, on an upper axis."""
    unit, name = length_unit(float(curve["clearance"].max()))
    per_sigma = float(curve["clearance"].iloc[0] / curve["clearance_in_sigma"].iloc[0]) / unit
    top = ax.secondary_xaxis(
        "top", functions=(lambda s: np.asarray(s) * per_sigma, lambda c: np.asarray(c) / per_sigma)
    )
    top.set_xlabel(f"clearance per side ({name})")


def plot_clearance_ratio(
    curve: pd.DataFrame, predicted: pd.DataFrame | None = None, ax: Axes | None = None
) -> Axes:
    """The same rates divided by Rice's, which shows what the impacts themselves change."""
    ax = axes_or_new(ax)
    smooth = curve if predicted is None else predicted
    ax.axhline(1.0, color=COLOURS["exact"], linestyle="--", linewidth=1.2)
    for (_, rows), (_, lines), (_, closure, simulated) in zip(
        _by_pair(curve), _by_pair(smooth), _colours(curve), strict=True
    ):
        ax.plot(lines["clearance_in_sigma"], lines["closure"] / lines["rice"], color=closure)
        _error_bars(ax, rows, rows["simulated"] / rows["rice"], rows["rice"], simulated, None)
    ax.set_xlabel(_sigma_label(curve))
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
    figure.suptitle(title or "impacts against clearance")
    return above


def _by_pair(table: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    """Name and rows of each pair; the name is empty where there is one."""
    if "pair" not in table:
        return [("", table)]
    return [(str(name), rows) for name, rows in table.groupby("pair", sort=False)]


def _colours(curve: pd.DataFrame) -> list[Sequence[str]]:
    """Colours of Rice's rate, the closure and the simulation, for each pair."""
    if "pair" not in curve:
        return [(COLOURS["exact"], COLOURS["linearise:closure"], COLOURS["simulate"])]
    return [(colour,) * 3 for colour in owner_colours(curve["pair"].nunique())]


def _error_bars(
    ax: Axes, rows: pd.DataFrame, centre: pd.Series, scale: pd.Series | float, colour: str,
    label: str | None,
) -> None:  # fmt: skip
    """Simulated rates over a scale, with their 95 % intervals."""
    ax.errorbar(
        rows["clearance_in_sigma"], centre, color=colour, fmt="o", markersize=4.5, capsize=3,
        yerr=[centre - rows["simulated_low"] / scale, rows["simulated_high"] / scale - centre],
        label=label,
    )  # fmt: skip


def _sigma_label(curve: pd.DataFrame) -> str:
    moved = "of the gap" if "pair" in curve else "displacement"
    return f"clearance per side / rms {moved} without stops"
