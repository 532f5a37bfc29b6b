"""Pictures of an overview: densities of displacement and velocity, and a short record."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from stochvi.mathematics.shown_units import SPEED, TIME
from stochvi.mathematics.truncated_normal import normal_density
from stochvi.views.axes import axes_or_new, draw_stops, length_unit
from stochvi.views.colours import COLOURS

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.scenes.scene import Scene
    from stochvi.statistics.overview import Overview

CURVE_POINTS = 801
"""Number of points of the curve of a normal distribution."""


def plot_displacement_density(found: Overview, ax: Axes | None = None) -> Axes:
    """The histogram, the exact density where one is known, the law without stops, the stops."""
    ax = axes_or_new(ax)
    edges = found.displacement.edges
    unit, name = length_unit(float(np.abs(edges[[0, -1]]).max()))
    ax.stairs(
        found.displacement.density * unit, edges / unit, fill=True, color=COLOURS["simulate"],
        alpha=0.45, label="Monte Carlo",
    )  # fmt: skip
    if found.exact_displacement is not None:
        known = found.exact_displacement
        ax.plot(
            known["displacement"] / unit, known["density"] * unit, color=COLOURS["exact"],
            linewidth=1.8, label="exact",
        )  # fmt: skip
    if found.std_without_stops is not None:
        x = np.linspace(edges[0], edges[-1], CURVE_POINTS)
        density = normal_density(x, found.mean_without_stops, found.std_without_stops)
        ax.plot(
            x / unit, density * unit, color=COLOURS["stop"], linestyle="--", linewidth=1.4,
            label="without stops",
        )  # fmt: skip
    ax.set_ylim(bottom=0.0)
    draw_stops(ax, found.scene, unit, vertical=True)
    ax.set_xlabel(f"displacement ({name})")
    ax.set_ylabel(f"probability density (1/{name})")
    _legend_above(ax)
    return ax


def plot_velocity_density(found: Overview, ax: Axes | None = None) -> Axes:
    """The histogram and a normal distribution: the exact one or, where none is known, that of its
    rms."""
    ax = axes_or_new(ax)
    edges, unit = found.velocity.edges, SPEED.shown.si
    ax.stairs(
        found.velocity.density * unit, edges / unit, fill=True, color=COLOURS["simulate"],
        alpha=0.45, label="Monte Carlo",
    )  # fmt: skip
    v = np.linspace(edges[0], edges[-1], CURVE_POINTS)
    if found.exact_velocity_std is None:
        ax.plot(
            v / unit, normal_density(v, 0.0, found.velocity_rms) * unit, color=COLOURS["stop"],
            linestyle="--", linewidth=1.4, label="normal distribution, same rms",
        )  # fmt: skip
    else:
        density = normal_density(v, 0.0, found.exact_velocity_std)
        ax.plot(v / unit, density * unit, color=COLOURS["exact"], linewidth=1.8, label="exact")
    ax.set_xlabel(f"velocity ({SPEED})")
    ax.set_ylabel(f"probability density ({SPEED.inverse})")
    _legend_above(ax)
    return ax


def plot_record(scene: Scene, path: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """A short record with its impacts marked on the stops, sized by impact speed."""
    ax = axes_or_new(ax)
    unit, name = length_unit(float(path["displacement"].abs().max()))
    ax.plot(
        TIME(path["time"]), path["displacement"] / unit, color=COLOURS["simulate"], linewidth=1.1
    )
    hits = path[path["impact_speed"] != 0.0]
    if len(hits):
        pair = scene.impact_pairs[0]
        place = np.where(hits["impact_speed"] > 0.0, pair.upper or 0.0, pair.lower or 0.0)
        size = hits["impact_speed"].abs() / hits["impact_speed"].abs().max()
        ax.scatter(
            TIME(hits["time"]), place / unit, s=12.0 + 60.0 * size,
            color=COLOURS["linearise:closure"], edgecolor="white", linewidth=0.6, zorder=3,
            label=f"{len(hits)} impact{'s' if len(hits) > 1 else ''}, larger = faster",
        )  # fmt: skip
    draw_stops(ax, scene, unit, vertical=False)
    ax.set_xlim(TIME(path["time"].iloc[0]), TIME(path["time"].iloc[-1]))
    ax.set_xlabel(f"time ({TIME})")
    ax.set_ylabel(f"displacement ({name})")
    if len(hits):
        _legend_above(ax)
    return ax


def draw_overview(found: Overview, title: str) -> Axes:
    """Densities of x and v and a short record in one figure; returns the record's Axes."""
    figure, axes = plt.subplot_mosaic(
        [["x", "v"], ["record", "record"]], figsize=(9.6, 6.8), layout="constrained"
    )
    plot_displacement_density(found, axes["x"])
    plot_velocity_density(found, axes["v"])
    figure.suptitle(title)
    return plot_record(found.scene, found.record, axes["record"])


def _legend_above(ax: Axes) -> None:
    ax.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
