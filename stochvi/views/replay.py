"""Replays on a terminal and as pictures: x(t) with stops and impacts, impacts against clearance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stochvi.mathematics.shown_units import (
    ACCELERATION,
    DENSITY,
    FORCE,
    LENGTH,
    MILLIRADIANS,
    NUMBER,
    SPEED,
    TIME,
    shown_as,
)
from stochvi.results.quantity_units import ROTATIONS, of_angle
from stochvi.views.axes import (
    add_grid,
    around_shock,
    axes_or_new,
    length_unit,
    seconds_of,
    thinned,
)
from stochvi.views.colours import COLOURS, OWNERS, owner_colours
from stochvi.views.tables import new_table, print_frame, print_line, print_table
from stochvi.views.words import UNKNOWN, four_digits, spoken_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.console import Console

    from stochvi.isolators.record_verdict import RecordVerdict
    from stochvi.methods.replay import Replay, ReplayAt

MOST_ON_LINEAR_AXIS = 50
"""Number of impacts up to which single ones can be read off a linear axis."""

HEADROOM = 1.15
"""Top of an axis over its largest value, so that no marker or number is cut."""

MOST_SPEEDS, MOST_MOTIONS = 6, 3
"""Largest number of impact speeds in a picture, and of clearances whose x(t) is drawn."""

DECADES = 1e6
"""Largest over smallest density that a waterfall tells apart."""

ROWS = {
    "displacement_max": ("largest displacement", LENGTH),
    "displacement_min": ("smallest displacement", LENGTH),
    "displacement_std": ("standard deviation of displacement", LENGTH),
    "displacement_kurtosis": ("kurtosis of the displacement", NUMBER),
    "acceleration_max": ("largest absolute acceleration", ACCELERATION),
    "hits": ("impacts", NUMBER),
    "impact_speed_max": ("largest impact speed", SPEED),
    "peak_force": ("largest force of a stop", FORCE),
    "contact_time": ("time in contact", TIME),
    "rests": ("times at rest on a stop", NUMBER),
}
"""Quantities that a terminal shows, in words."""


def headline(found: Replay, record: RecordVerdict | None) -> str:
    """The clearance that the record itself needs, where it is known, and the summary of the
    replay."""
    return "; ".join([*([] if record is None else [record.needs()]), found.summary()])


def print_replay(console: Console, found: Replay, record: RecordVerdict | None) -> None:
    """Print the clearance that the record needs, then its effect at one clearance, or a row per
    clearance."""
    console.print(headline(found, record), style="bold", highlight=False)
    if found.only is not None:
        _print_one(console, found.only)
    else:
        _print_many(console, found)
    for line in found.assumptions:
        print_line(console, line)
    print_line(console, f"cost: {found.cost.wall_time:.3g} s")
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def _print_one(console: Console, each: ReplayAt) -> None:
    biased = any(own.bias for *_, own in each.estimates())
    columns = ["of", "quantity", "value", *(["bias"] if biased else [])]
    table = new_table("the record itself", columns, ["of", "quantity"])
    for group in (each.coordinates, each.impact_pairs):
        for owner, quantities in group.items():
            for name, value in quantities.items():
                if name in ROWS and value is not None:
                    words, quantity = ROWS[name][0], of_angle(owner, ROWS[name][1])
                    own = [owner, quantity.heading(words), f"{quantity(float(value)):.5g}"]
                    if biased:
                        own.append(UNKNOWN if value.bias is None else f"{quantity(value.bias):.2g}")
                    table.add_row(*own)
    print_table(console, table)


def _print_many(console: Console, found: Replay) -> None:
    import pandas as pd

    rows = []
    pairs = [next(iter(each.impact_pairs.values())) for each in found.clearances]
    # rigid stops give no acceleration at an impact
    where = "" if any(pair.peak_force is not None for pair in pairs) else " between impacts"
    for each in found.clearances:
        assert each.clearance is not None
        (pair,) = each.impact_pairs.values()
        motion = next(iter(each.coordinates.values()))
        speed, force = pair.impact_speed_max, pair.peak_force
        peak = float(motion.acceleration_max)
        rows.append(
            {
                f"clearance ({LENGTH})": four_digits(LENGTH(each.clearance)),
                "impacts": f"{float(pair.hits):.0f}",
                f"max speed ({SPEED})": UNKNOWN if speed is None else f"{SPEED(float(speed)):.4g}",
                f"max force ({FORCE})": UNKNOWN if force is None else f"{FORCE(float(force)):.4g}",
                f"peak acc.{where} ({ACCELERATION})": f"{ACCELERATION(peak):.4g}",
                f"from ({LENGTH})": four_digits(LENGTH(float(motion.displacement_min))),
                f"to ({LENGTH})": four_digits(LENGTH(float(motion.displacement_max))),
            }
        )
    frame = pd.DataFrame(rows).replace(UNKNOWN, "-")
    print_frame(console, frame, f"the record itself, {found.duration:.4g} s, at each clearance")


def plot_history(each: ReplayAt, ax: Axes | None = None) -> Axes:
    """x(t) around the shock between its stops, with the impacts; all coordinates where there are
    several."""
    return _plot_shock(each, axes_or_new(ax, (9.6, 4.2)))


def _plot_shock(each: ReplayAt, ax: Axes, *, whole: bool = False, legend: bool = True) -> Axes:
    """x(t) with stops and impacts: around the shock, that is the fastest impact, or `whole`."""
    kept = each.histories
    assert kept is not None
    first = next(iter(kept.displacement.values()))
    part = slice(0, len(first)) if whole else around_shock(kept.time, first, _shock(each))
    moving = [x for owner, x in kept.displacement.items() if owner not in ROTATIONS]
    size = max((float(np.max(np.abs(x[part]))) for x in moving), default=0.0)
    unit, name = length_unit(size)
    width, angles = 0.5 if whole else 1.1, None
    colours = owner_colours(len(kept.displacement))
    for colour, (owner, x) in zip(colours, kept.displacement.items(), strict=True):
        t, y = thinned(TIME(kept.time[part]), x[part])
        if owner not in ROTATIONS:
            ax.plot(t, y / unit, color=colour, linewidth=width, label=owner)
            continue
        if angles is None:
            angles = ax.twinx()
            angles.set_ylabel(f"rotation ({MILLIRADIANS}), dashed")
        angles.plot(t, MILLIRADIANS(y), "--", color=colour, linewidth=width)
        ax.plot([], [], "--", color=colour, label=owner)
    if len(kept.displacement) == 1:
        begin, end = kept.time[part][0], kept.time[part][-1]
        for number, (stop, place) in enumerate(each.stops.items()):
            label = f"{stop.rpartition(' ')[0]}" if number == 0 else None
            ax.axhline(place / unit, color=COLOURS["stop"], linewidth=2.0, label=label)
            hit = each.impacts[
                (each.impacts["side"] == stop.rpartition(" ")[2])
                & each.impacts["time"].between(begin, end)
            ]
            if not len(hit):
                continue  # markers that are not clipped take the whole figure where there are none
            named = "impacts" in ax.get_legend_handles_labels()[1]
            ax.plot(TIME(hit["time"]), np.full(len(hit), place / unit), "v", markersize=4.5,
                    color=COLOURS["linearise:closure"], clip_on=False, zorder=3,
                    label=None if named else "impacts")  # fmt: skip
    ax.margins(x=0.0)
    ax.set_xlabel(seconds_of(part, kept.time))
    ax.set_ylabel(f"displacement ({name})")
    add_grid(ax)
    if legend:
        ax.legend(frameon=False, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0),
                  ncols=4)  # fmt: skip
    return ax


def plot_waterfall(each: ReplayAt, ax: Axes | None = None) -> Axes:
    """Short-time spectra of the absolute acceleration of the first coordinate, over the whole
    record, with the impacts as marks above them."""
    from matplotlib.colors import LogNorm

    kept = each.histories
    assert kept is not None
    ax = axes_or_new(ax, (9.6, 4.2))
    spectra = kept.short_time_spectra()
    owner = next(iter(kept.acceleration))
    unit = shown_as("(rad/s^2)^2/Hz") if owner in ROTATIONS else DENSITY
    density = unit(np.maximum(spectra.density, np.finfo(float).tiny))
    norm = LogNorm(density.max() / DECADES, density.max(), clip=True)
    mesh = ax.pcolormesh(
        TIME(spectra.time), spectra.frequency_hz, density, norm=norm, cmap="viridis",
        shading="nearest", rasterized=True,
    )  # fmt: skip
    ax.figure.colorbar(mesh, ax=ax, label=f"acceleration of {owner} ({unit})")
    if len(each.impacts):
        times = TIME(np.asarray(each.impacts["time"]))
        ax.plot(times, np.full(len(times), 1.02), "v", markersize=4.5, clip_on=False,
                color=COLOURS["linearise:closure"], transform=ax.get_xaxis_transform(),
                label="impacts")  # fmt: skip
        ax.legend(frameon=False, fontsize="small", loc="lower right", bbox_to_anchor=(1.0, 1.03))
    ax.set(yscale="log", ylim=spectra.frequency_hz[[0, -1]], xlabel=f"time ({TIME})",
           ylabel="frequency (Hz)")  # fmt: skip
    return ax


def _shock(each: ReplayAt) -> float | None:
    """Time of the fastest impact, s; None without impacts."""
    if not len(each.impacts):
        return None
    return float(each.impacts["time"].iloc[int(each.impacts["speed"].to_numpy().argmax())])


def plot_clearances(found: Replay, ax: Axes | None = None) -> Axes:
    """Impacts against clearance; the largest impact speed stands at each point."""
    ax = axes_or_new(ax)
    places = np.array([each.clearance for each in found.clearances], dtype=float)
    order = np.argsort(places)
    unit, name = length_unit(float(places.max()))
    pairs = [next(iter(each.impact_pairs.values())) for each in found.clearances]
    hits = np.array([float(pair.hits) for pair in pairs])
    ax.plot(places[order] / unit, hits[order], "o-", color=OWNERS[0])
    if hits.max() > MOST_ON_LINEAR_AXIS:
        ax.set_yscale("symlog", linthresh=1.0)
        ax.set_ylim(0.0, 4.0 * hits.max())
    else:
        from matplotlib.ticker import MaxNLocator

        ax.yaxis.set_major_locator(MaxNLocator(integer=True))
        ax.set_ylim(0.0, HEADROOM * max(hits.max(), 1.0))
    for number in order[:: -(-len(order) // MOST_SPEEDS)]:
        if (speed := pairs[number].impact_speed_max) is not None:
            ax.annotate(
                SPEED.text(float(speed), ".2g"), (places[number] / unit, hits[number]),
                xytext=(5, 5), textcoords="offset points", fontsize="small",
            )  # fmt: skip
    ax.margins(x=0.12)
    ax.set_xlabel(f"clearance ({name})")
    ax.set_ylabel("impacts in the record")
    add_grid(ax)
    return ax


def draw_replay(found: Replay, title: str = "") -> Axes:
    """x(t) around the shock with the stops, above the whole record; over several clearances x(t)
    around the shock at some of them, then impacts over clearances."""
    import matplotlib.pyplot as plt

    single = found.only
    if single is not None:
        if single.histories is None:
            raise ValueError("there is no picture of x(t): its samples were not kept")
        above, below = plt.subplots(
            2, 1, figsize=(9.6, 6.4), height_ratios=[2, 1], layout="constrained"
        )[1]
        _plot_shock(single, above)
        _plot_shock(single, below, whole=True, legend=False)
        return _titled(above, title)
    shown = [each for each in found.clearances if each.histories is not None]
    shown = sorted(shown, key=lambda each: each.clearance or 0.0)[:MOST_MOTIONS]
    axes = plt.subplots(
        len(shown) + 1, 1, figsize=(9.6, 2.2 * len(shown) + 3.2), squeeze=False,
        layout="constrained",
    )[1][:, 0]  # fmt: skip
    for each, ax in zip(shown, axes, strict=False):
        _plot_shock(each, ax, legend=False)
        ax.set_title(f"stops {spoken_length(each.clearance or 0.0)} away", fontsize="small")
    plot_clearances(found, axes[-1])
    return _titled(axes[0], title)


def _titled(ax: Axes, title: str) -> Axes:
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.suptitle(title or "replay of the record", fontsize="medium")
    return ax
