"""Pictures of a sizing: the risk against clearance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from stochvi.isolators.sizing.answer import spoken_mission, spoken_percent
from stochvi.views.plots import COLOURS, length_unit

if TYPE_CHECKING:
    from stochvi.isolators.sizing.answer import Sizing

LEAST_PROBABILITY = 1e-5
"""Lower end of the picture, unless the target lies lower."""


def plot_risk(sizing: Sizing, ax: Axes | None = None) -> Axes:
    """Chance of any hit in the mission against clearance, 3 sigma and the recommendation marked.

    The dashed line takes Rice's crossings for independent hits. The band is the 95 % interval.
    """
    if ax is None:
        ax = plt.subplots(figsize=(6.8, 4.6), layout="constrained")[1]
    unit, name = length_unit(sizing.clearance.value)
    curve, sigma = sizing.curve, sizing.sigma
    x = curve["clearance"] / unit
    expected = curve["rice_rate"] * sizing.mission
    ax.plot(
        x, -np.expm1(-expected), color=COLOURS["exact"], linestyle="--", linewidth=1.2,
        label="Rice, crossings independent",
    )  # fmt: skip
    ax.plot(x, curve["probability"], color=COLOURS["simulate"], label="first crossings")
    ax.fill_between(
        x, curve["probability_low"], curve["probability_high"], color=COLOURS["simulate"],
        alpha=0.25, linewidth=0,
    )  # fmt: skip
    three = sizing.three_sigma
    ax.plot(
        three.clearance / unit, three.probability.value, "o", color=COLOURS["linearise:closure"],
        label=f"3 sigma: {spoken_percent(three.probability.value)}", clip_on=False, zorder=3,
    )  # fmt: skip
    answer = sizing.clearance
    there = float(np.interp(answer.value, curve["clearance"], np.log(curve["probability"])))
    ax.plot(
        answer.value / unit, np.exp(there), "D", color=COLOURS["linearise:force"],
        label=f"recommended: {answer.value / unit:.4g} {name}", clip_on=False, zorder=3,
    )  # fmt: skip
    for place, colour in (
        (three.clearance, COLOURS["linearise:closure"]),
        (answer.value, COLOURS["linearise:force"]),
    ):
        ax.axvline(place / unit, color=colour, linewidth=0.8, alpha=0.6)
    lowest = min(LEAST_PROBABILITY, 0.1 * float(np.exp(there)))
    shown = curve["probability"] > lowest
    ax.set_xlim(float(x.iloc[0]), float(x[shown].iloc[-1]))
    ax.set_ylim(lowest, 1.3)
    ax.set_yscale("log")
    ax.set_xlabel(f"clearance per side ({name})")
    ax.set_ylabel(f"chance of any hit in {spoken_mission(sizing.mission)}")
    ax.grid(which="major", color="#dddddd", linewidth=0.6)
    ax.legend(frameon=False, loc="lower left")
    top = ax.secondary_xaxis(
        "top",
        functions=(lambda c: np.asarray(c) * unit / sigma, lambda s: np.asarray(s) * sigma / unit),
    )
    top.set_xlabel("clearance per side / rms displacement without stops")
    return ax


def draw_sizing(sizing: Sizing, title: str = "") -> Axes:
    """The same as a figure with a title."""
    ax = plot_risk(sizing)
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.suptitle(title or "clearance and risk")
    return ax
