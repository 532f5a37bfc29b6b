"""The picture of the study: impacts at three sigma, and the clearance for 1 % an hour."""

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from stochvi.views.axes import BAND_ALPHA, COLOURS, GRID_COLOUR, OWNERS

TRUCK = {
    "mil-std-810h-truck-vertical-5hz": ("o-", "810H truck, vertical"),
    "mil-std-810h-truck-transverse-5hz": ("s--", "810H truck, transverse"),
    "mil-std-810h-truck-longitudinal-5hz": ("^:", "810H truck, longitudinal"),
}
"""Tables from 5 Hz. All other profiles start at 20 Hz, and differ little from each other."""


def band(ax: plt.Axes, rows: pd.DataFrame, column: str, colour: str, label: str) -> None:
    """Least to largest of a quantity over profiles, against the natural frequency."""
    ends = rows.groupby("frequency_hz")[column].agg(["min", "max"])
    ax.fill_between(ends.index, ends["min"], ends["max"], color=colour, alpha=BAND_ALPHA)
    ax.plot(ends["max"], "D-", color=colour, markersize=4, label=label)
    ax.plot(ends["min"], "D-", color=colour, markersize=4)


def figure_of(table: pd.DataFrame) -> Figure:
    """Both panels: profiles that nearly coincide are one band, beside what Rice says of them."""
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(7.2, 7.6), sharex=True, layout="constrained", height_ratios=(3, 2)
    )
    others = table[~table["profile"].isin(list(TRUCK))]
    shade = OWNERS[-2]
    name = f"profiles from 20 Hz ({others['profile'].nunique()})"
    band(above, others, "hits_per_hour", shade, f"{name}, least and largest")
    band(below, others, "clearance_in_sigma", shade, name)
    rice = others.groupby("frequency_hz")["hits_by_rice_per_hour"].median()
    above.plot(rice, "-.", color=shade, label="the same by Rice's formula, median")
    for (profile, (style, label)), colour in zip(TRUCK.items(), OWNERS, strict=False):
        rows = table[table["profile"] == profile].set_index("frequency_hz")
        above.plot(rows["hits_per_hour"], style, color=colour, markersize=5, label=label)
        below.plot(rows["clearance_in_sigma"], style, color=colour, markersize=5)
    above.set(yscale="log", ylabel="impacts per hour")
    above.set_title("stops at three sigma: impacts per hour")
    above.legend(frameon=False)
    below.axhline(3.0, color=COLOURS["stop"], linestyle="--")
    below.annotate("three sigma", (60.0, 3.05), ha="right", va="bottom", color="0.3")
    below.set(ylabel="clearance / sigma", ylim=(2.8, 6.5))
    below.set_title("clearance for a probability of 1 % of any impact in an hour")
    below.set_xlabel("natural frequency (Hz), zeta = 0.1, R = 0.5")
    for ax in (above, below):
        ax.grid(color=GRID_COLOUR)
    return figure
