"""The shocks in a record, on a terminal and as a picture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from stochvi.mathematics.units import MILLISECONDS, TIME
from stochvi.results.base import rows_of
from stochvi.views.axes import OWNERS, Chart, Scale, thinned
from stochvi.views.pages import Grid, Section, Told, told_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.identification.shocks import FoundShocks


def shocks_told(found: FoundShocks) -> Told:
    """The number and the rate of shocks, their heights, and what else might have been found."""
    quantity = found.quantity

    def spoken(row: Mapping[str, float]) -> str:
        length, height = row["length"], row["height"]
        return f"{MILLISECONDS.text(length, '.3g')} from {quantity.text(height, '.3g')} on"

    heights = [abs(each.height) for each in found.shocks]
    lengths = rows_of(found.smallest)
    statements = [f"Heights: {quantity.span(min(heights), max(heights), '.3g')}"] if heights else []
    statements += [
        f"False ones to expect in such a record: at most {found.false_alarms:.2g}",
        f"Found in nine of ten: half sines of {spoken(lengths[0])}, of {spoken(lengths[-1])}",
    ]
    columns = "at = start {s}; length = duration {ms}; height = height {%s}; over_threshold {.3g}"
    grids = Grid.of("shocks", found.shocks, columns % found.unit, 0)
    columns = "length of a half sine = length {ms}; found from = height {%s .3g}"
    grids += Grid.of("nine of ten are found", found.smallest, columns % found.unit, 0)
    note = (
        f"between the shocks: {quantity.text(found.noise, '.3g')} rms, {found.peaks} peaks beyond "
        f"3.5 local levels where Gaussian noise has {found.peaks_expected:.3g}"
    )
    return told_of(
        found, statements=statements, sections=[Section(grids=grids, notes=[note])], brief=True,
        footer=[f"cost: {found.cost.wall_time:.3g} s"],
    )  # fmt: skip


def plot_shocks(found: FoundShocks, ax: Axes | None = None) -> Axes:
    """The record, the threshold about it, and its shocks."""
    words = "force" if found.unit == "N" else "acceleration"
    chart = Chart.on(ax, Scale("time", TIME), Scale(words, found.quantity), (9.6, 4.2))
    when, values, mean, threshold = found.samples.to_numpy()[:, :4].astype(float).T
    chart.curve(*thinned(when, values), "record", linewidth=0.6)
    for edge in (mean - threshold, mean + threshold):
        chart.curve(*thinned(when, edge), "threshold", "stop", "--", linewidth=0.8)
    for each in found.shocks:
        ends = chart.x.quantity([each.start, each.start + each.duration])
        chart.ax.axvspan(*ends, color=OWNERS[3], alpha=0.4, linewidth=0.8, label="shock")
    return chart.finish(3)
