"""Pictures of a linear screening."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stochvi.mathematics.shown_units import RATE
from stochvi.views.axes import add_grid, axes_or_new, legend_above, length_unit
from stochvi.views.colours import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.isolators.screening import Screening

SIGMAS = np.linspace(1.0, 6.0, 101)
"""Clearances of the picture of one mass, in rms displacements."""


def plot_screening(found: Screening, ax: Axes | None = None) -> Axes:
    """Three sigma of every gap beside its stops; for one mass, impacts by Rice's formula against
    clearance."""
    one = len(found.coordinates) == 1 and len(found.impact_pairs) < 2
    return _plot_rice(found, ax) if one else _plot_gaps(found, ax)


def _plot_rice(found: Screening, ax: Axes | None) -> Axes:
    """Impacts by Rice's formula against the clearance of one mass, three sigma marked."""
    ax = axes_or_new(ax)
    sigma = found.displacement_std
    unit, name = length_unit(3.0 * sigma)
    places = SIGMAS * sigma
    ax.semilogy(
        places / unit,
        [RATE(found.rice_rate(place)) for place in places],
        color=COLOURS["exact"],
        linestyle="--",
        label="Rice, impacts change nothing",
    )
    ax.plot(
        3.0 * sigma / unit,
        RATE(found.rice_rate(3.0 * sigma)),
        "o",
        color=COLOURS["linearise:closure"],
        label="3 sigma",
    )
    ax.set_xlabel(f"clearance per side ({name})")
    ax.set_ylabel(f"impacts per {RATE.time}")
    add_grid(ax)
    ax.legend(frameon=False)
    return ax


def _plot_gaps(found: Screening, ax: Axes | None) -> Axes:
    """Three sigma of every gap about its mean, and the stops where they are."""
    gaps = found.impact_pairs
    ax = axes_or_new(ax, (6.8, 0.9 + 0.42 * max(len(gaps), 3)))
    places = [max(gap.three_sigma, *gap.stops.values()) for gap in gaps.values()]
    unit, unit_name = length_unit(max(places, default=1.0))
    for row, gap in enumerate(gaps.values()):
        half = gap.three_sigma / unit
        ax.barh(row, 2.0 * half, left=-half, color=COLOURS["simulate"], alpha=0.5, height=0.5)
        for side, distance in gap.stops.items():
            at = (distance if side == "upper" else -distance) / unit
            ax.plot([at, at], [row - 0.4, row + 0.4], color=COLOURS["stop"], linewidth=4)
    ax.plot([], [], color=COLOURS["stop"], linewidth=4, label="stop")
    ax.barh([0], [0], color=COLOURS["simulate"], alpha=0.5, label="3 sigma, nothing hit")
    ax.set_yticks(range(len(gaps)), list(gaps))
    ax.invert_yaxis()
    ax.set_xlabel(f"gap, from its mean ({unit_name})")
    legend_above(ax)
    return ax
