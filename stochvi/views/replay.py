"""Replays on a terminal and as pictures: x(t) with stops and hits, hits against clearance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stochvi.views.axes import add_grid, axes_or_new, length_unit, thinned
from stochvi.views.colours import COLOURS, OWNERS
from stochvi.views.tables import new_table, print_frame, print_line, print_table
from stochvi.views.words import MM, UNKNOWN, G, four_digits

Vector = NDArray[np.float64]

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.console import Console

    from stochvi.isolators.record_verdict import RecordVerdict
    from stochvi.methods.replay import Replay, ReplayAt

MOST_ON_LINEAR_AXIS = 50
"""Number of hits up to which single ones can be read off a linear axis."""

HEADROOM = 1.08
"""Top of an axis over its largest value, so that no marker is cut."""

ROWS = {
    "displacement_max": ("largest displacement (mm)", MM),
    "displacement_min": ("smallest displacement (mm)", MM),
    "displacement_std": ("standard deviation of displacement (mm)", MM),
    "displacement_kurtosis": ("kurtosis of the displacement", 1.0),
    "acceleration_max": ("largest absolute acceleration (g)", G),
    "hits": ("hits", 1.0),
    "impact_speed_max": ("largest impact speed (m/s)", 1.0),
    "peak_force": ("largest force of a stop (N)", 1.0),
    "contact_time": ("time in contact (s)", 1.0),
    "rests": ("times at rest on a stop", 1.0),
}
"""Quantities that a terminal shows, with their names and factors to the units there."""


def headline(found: Replay, record: RecordVerdict | None) -> str:
    """The clearance that the record itself needs, where it is known, and the summary of the
    replay."""
    return "; ".join([*([] if record is None else [record.needs()]), found.summary()])


def print_replay(console: Console, found: Replay, record: RecordVerdict | None) -> None:
    """Print the clearance that the record needs, then its effect at one clearance, or a row per
    clearance."""
    console.print(headline(found, record), style="bold", highlight=False)
    if found.single is not None:
        _print_one(console, found.single)
    else:
        _print_many(console, found)
    for line in found.assumptions:
        print_line(console, line)
    print_line(console, f"cost: {found.cost.wall_time:.3g} s")
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def _print_one(console: Console, each: ReplayAt) -> None:
    table = new_table("the record itself", ["of", "quantity", "value"], ["of", "quantity"])
    for group in (each.coordinates, each.impact_pairs):
        for owner, quantities in group.items():
            for name, value in quantities.items():
                if name in ROWS and value is not None:
                    words, factor = ROWS[name]
                    table.add_row(owner, words, f"{factor * float(value):.5g}")
    print_table(console, table)


def _print_many(console: Console, found: Replay) -> None:
    import pandas as pd

    rows = []
    for each in found.clearances:
        assert each.clearance is not None
        (pair,) = each.impact_pairs.values()
        motion = next(iter(each.coordinates.values()))
        speed, force = pair.impact_speed_max, pair.peak_force
        rows.append(
            {
                "gap (mm)": four_digits(MM * each.clearance),
                "hits": f"{float(pair.hits):.0f}",
                "max speed (m/s)": UNKNOWN if speed is None else f"{float(speed):.4g}",
                "max force (N)": UNKNOWN if force is None else f"{float(force):.4g}",
                "max |acc.| (g)": f"{G * float(motion.acceleration_max):.4g}",
                "from (mm)": four_digits(MM * float(motion.displacement_min)),
                "to (mm)": four_digits(MM * float(motion.displacement_max)),
            }
        )
    frame = pd.DataFrame(rows).replace(UNKNOWN, "-")
    print_frame(console, frame, f"the record itself, {found.duration:.4g} s, at each clearance")


def plot_history(each: ReplayAt, ax: Axes | None = None) -> Axes:
    """x(t) between its stops, with the impacts; all coordinates where there are several."""
    ax = axes_or_new(ax, (9.6, 4.2))
    kept = each.histories
    assert kept is not None
    size = max(float(np.max(np.abs(x))) for x in kept.displacement.values())
    unit, name = length_unit(size)
    for colour, (owner, x) in zip(OWNERS, kept.displacement.items(), strict=False):
        t, y = thinned(kept.time, x)
        ax.plot(t, y / unit, color=colour, linewidth=0.7, label=owner)
    if len(kept.displacement) == 1:
        for number, (stop, place) in enumerate(each.stops.items()):
            label = f"{stop.rpartition(' ')[0]}" if number == 0 else None
            ax.axhline(place / unit, color=COLOURS["stop"], linewidth=2.0, label=label)
            hit = each.impacts[each.impacts["side"] == stop.rpartition(" ")[2]]
            ax.plot(hit["time"], np.full(len(hit), place / unit), "v", markersize=4.5,
                    color=COLOURS["linearise:closure"], clip_on=False, zorder=3,
                    label="hits" if number == 0 else None)  # fmt: skip
    ax.margins(x=0.0)
    ax.set_xlabel("time (s)")
    ax.set_ylabel(f"displacement ({name})")
    add_grid(ax)
    ax.legend(frameon=False, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0),
              ncols=4)  # fmt: skip
    return ax


def plot_clearances(found: Replay, ax: Axes | None = None) -> Axes:
    """Hits and the largest impact speed against clearance."""
    ax = axes_or_new(ax)
    places = np.array([each.clearance for each in found.clearances], dtype=float)
    order = np.argsort(places)
    unit, name = length_unit(float(places.max()))
    pairs = [next(iter(each.impact_pairs.values())) for each in found.clearances]
    hits = np.array([float(pair.hits) for pair in pairs])
    speeds = np.array(
        [np.nan if p.impact_speed_max is None else float(p.impact_speed_max) for p in pairs]
    )
    (left,) = ax.plot(places[order] / unit, hits[order], "o-", color=OWNERS[0], label="hits")
    if hits.max() > MOST_ON_LINEAR_AXIS:
        ax.set_yscale("symlog", linthresh=1.0)
        ax.set_ylim(0.0, 2.0 * hits.max())
    else:
        from matplotlib.ticker import MaxNLocator

        ax.yaxis.set_major_locator(MaxNLocator(integer=True))
        ax.set_ylim(0.0, HEADROOM * max(hits.max(), 1.0))
    ax.set_xlabel(f"clearance ({name})")
    ax.set_ylabel("hits in the record")
    add_grid(ax)
    other = ax.twinx()
    (right,) = other.plot(
        places[order] / unit, speeds[order], "s--", color=OWNERS[1], label="largest impact speed"
    )
    fastest = np.nan_to_num(speeds).max()
    other.set_ylim(0.0, HEADROOM * fastest if fastest > 0.0 else 1.0)
    other.set_ylabel("largest impact speed (m/s)")
    ax.legend(handles=[left, right], frameon=False, fontsize="small", loc="lower center",
              bbox_to_anchor=(0.5, 1.0), ncols=2)  # fmt: skip
    return ax


def draw_replay(found: Replay, title: str = "") -> Axes:
    """x(t) at one clearance, else hits and speeds over clearances, with a title."""
    if found.single is None:
        return _titled(plot_clearances(found), title)
    if found.histories is None:
        raise ValueError("there is no picture of x(t): its samples were not kept")
    return _titled(plot_history(found.single), title)


def _titled(ax: Axes, title: str) -> Axes:
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.suptitle(title or "replay of the record", fontsize="medium")
    return ax
