"""Tables and pictures of absorbers. Chapters: performance and design; an absorber under a sine."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from stochvi.absorbers.design import tuned_key
from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.units import ACCELERATION, FORCE, LENGTH
from stochvi.views.axes import COLOURS, add_grid, axes_or_new, length_unit, plain_ticks
from stochvi.views.tables import Heading, print_frame, spoken_length, with_error, with_headings

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from rich.console import Console

    from stochvi.absorbers.design import AbsorberSine, Design, ResidualCurve
    from stochvi.absorbers.performance import AbsorberReport, Performance, TunedDamper

SURE = 4.0
"""Number of standard errors by which a ratio must exceed 1 for the verdict that an absorber does
harm."""

SIZE = (7.0, 4.2)
"""Size of a figure, inches."""

RATIO_LABEL = "rms displacement with / without absorber"


def print_absorber(console: Console, found: AbsorberReport) -> None:
    """Print the verdict, a row for each level, and an explanation of the columns."""
    import pandas as pd

    console.print(verdict(found), style="bold", highlight=False)
    rows = [_level_row(each) for each in found.performances]
    print_frame(console, pd.DataFrame(rows), f"motion of {found.carrier!r}, by level")
    rows = [_impact_row(each) for each in found.performances]
    print_frame(console, pd.DataFrame(rows), "impacts, by level")
    if found.tuned_damper is not None:
        console.print(tuned_sentence(found.tuned_damper), highlight=False)
    for line in (
        "ratio: rms displacement with the absorber over that without, which is exact; its 95 % "
        "interval holds the bias of the step",
        "peak factor: largest displacement from the mean in 100 periods, over the rms",
        "0.43774(94) is 0.43774 with a standard error of 0.00094",
        "impacts: on all units together; stop force: mean over time of its magnitude, all stops; "
        "absorbed: share of the supplied power that impacts take",
        "peak force: mean over contacts of the largest force in each; largest: of 100 periods, as "
        "a force and as the acceleration that it gives the structure; rigid stops have neither",
    ):
        console.print(line, style="dim", highlight=False)
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def verdict(found: AbsorberReport) -> str:
    """The effect of the absorber at the level of the scene, in a sentence."""
    central = found.central
    low, high = central.interval()
    surely_worse = central.ratio.value - (central.ratio.bias or 0.0) > (
        1.0 + SURE * central.ratio.standard_error
    )
    units = len(found.masses)
    masses = "a mass" if units == 1 else f"{units} masses"
    mass = f"{masses} of {100.0 * found.mass_ratio:.3g} % of the structure"
    if surely_worse:
        makes = "makes" if units == 1 else "make"
        return f"{mass} {makes} it worse: rms displacement {low:.3f} to {high:.3f} of that without"
    if high >= 1.0:
        return (
            f"{mass} has no clear effect: rms displacement {low:.3f} to {high:.3f} of that without"
        )
    return (
        f"{mass}: rms displacement {central.ratio.value:.3f} of that without "
        f"(95 % interval {low:.3f} to {high:.3f})"
    )


def tuned_sentence(found: TunedDamper) -> str:
    """The effect of the same mass as a tuned damper, with its tuning, in a sentence."""
    return (
        f"The same mass on a tuned spring and dashpot ({found.tuning}: {found.frequency_hz:.4g} "
        f"Hz, damping ratio {found.zeta:.3g}) would leave {found.ratio:.3f} of the rms "
        f"displacement, at every level; it would move {spoken_length(found.stroke_std)} rms "
        "relative to the structure."
    )


def _level_row(each: Performance) -> dict[str, str]:
    low, high = each.interval()
    row = {
        "level (dB)": f"{each.level_db:+g}",
        "ratio": f"{each.ratio.value:.3f}",
        "95 % interval": f"{low:.3f} to {high:.3f}",
        f"rms ({LENGTH})": with_error(LENGTH(each.displacement_std)),
        f"rms without ({LENGTH})": f"{LENGTH(each.displacement_std_without):.4g}",
        "peak factor": with_error(each.peak_factor),
        "peak factor without": with_error(each.peak_factor_without),
    }
    if each.acceleration_std is not None:
        row[f"abs. acc. ({ACCELERATION})"] = with_error(ACCELERATION(each.acceleration_std))
        row[f"abs. acc. without ({ACCELERATION})"] = (
            f"{ACCELERATION(each.acceleration_std_without or 0.0):.3g}"
        )
    return row


def _impact_row(each: Performance) -> dict[str, str]:
    row = {
        "level (dB)": f"{each.level_db:+g}",
        "impacts per period": with_error(each.impacts_per_period),
        f"stop force ({FORCE})": with_error(FORCE(each.wall_force)),
        "impulse (N s)": with_error(each.impulse),
        "absorbed": with_error(each.absorbed_share),
    }
    if each.wall_force_peak and each.wall_force_largest and each.wall_acceleration_largest:
        row[f"peak force ({FORCE})"] = with_error(FORCE(each.wall_force_peak))
        row[f"largest ({FORCE})"] = with_error(FORCE(each.wall_force_largest))
        row[f"largest ({ACCELERATION})"] = with_error(ACCELERATION(each.wall_acceleration_largest))
    return row


def print_design(console: Console, found: Design) -> None:
    """Print the best box, the best box for a range of levels, and the candidates."""
    best, robust = found.best, found.robust
    units = "one unit" if found.units == 1 else f"{found.units} units"
    console.print(
        f"best: {units}, restitution {found.restitution:g}, play {spoken_length(best.play)} "
        f"(95 % interval {LENGTH(best.play_low):.4g} to {LENGTH(best.play_high):.4g}; as good "
        f"within its error: {LENGTH(best.low):.4g} to {LENGTH(best.high):.4g}), rms ratio "
        f"{with_error(best.ratio)}",
        style="bold",
        highlight=False,
    )
    console.print(
        f"for levels from -{found.level_range_db:g} to +{found.level_range_db:g} dB: play "
        f"{spoken_length(robust.play)}, rms ratio at worst {with_error(robust.ratio)}",
        highlight=False,
    )
    if found.tuned_damper is not None:
        console.print(tuned_sentence(found.tuned_damper), highlight=False)
    columns: dict[str, Heading] = {
        "restitution": "restitution",
        "units": "units",
        "play": ("play ()", LENGTH),
        "play_in_sigma": "play/sigma",
        "rms_ratio": "rms ratio",
        "rms_ratio_error": "its error",
    }
    print_frame(console, with_headings(found.candidates, columns), CANDIDATES)
    if rivals := rivals_in_words(found):
        console.print(rivals, highlight=False)
    console.print(
        f"sigma = {spoken_length(found.sigma)}, rms displacement without absorber; total play, "
        "stop to stop",
        style="dim",
        highlight=False,
    )


CANDIDATES = (
    "candidates: the best one after a second, closer search, the others after the first one"
)
"""Heading of the table of candidates."""


def rivals_in_words(found: Design) -> str:
    """The candidates about as good as the best one; empty without any."""
    best = found.best.ratio
    near = [
        f"restitution {each['restitution']:g} with {each['units']:g} unit(s)"
        for each in found.candidates.iloc[1:].to_dict("records")
        if each["rms_ratio"] - best.value
        < SIGNIFICANT * math.hypot(each["rms_ratio_error"], best.standard_error)
    ]
    return f"as good within their errors: {', '.join(near)}" if near else ""


SIGNIFICANT = 2.0
"""Number of standard errors of a difference above which two candidates differ clearly."""


def draw_levels(found: AbsorberReport, ax: Axes | None = None) -> Axes:
    """rms ratio against level, with 95 % intervals."""
    ax = axes_or_new(ax, SIZE)
    levels = [each.level_db for each in found.performances]
    ratios = np.array([each.ratio.value for each in found.performances])
    low, high = np.array([each.interval() for each in found.performances]).T
    ax.errorbar(
        levels, ratios, yerr=[ratios - low, high - ratios], fmt="o-", capsize=3,
        color=COLOURS["simulate"],
    )  # fmt: skip
    ax.axhline(1.0, color=COLOURS["stop"], linestyle="--", linewidth=1.0)
    ax.text(levels[0], 1.0, "no absorber", va="bottom", color=COLOURS["stop"])
    ax.set_xlabel("level of the excitation (dB)")
    ax.set_ylabel(RATIO_LABEL)
    ax.set_ylim(0.0, max(1.1, 1.05 * float(high.max())))
    _draw_tuned(ax, found.tuned_damper)
    ax.set_title(f"absorber of {100.0 * found.mass_ratio:.3g} % of the mass")
    return ax


def draw_plays(found: AbsorberReport, ax: Axes | None = None) -> Axes:
    """rms ratio against the total play of the box, with 95 % intervals; the scene's own play and
    the tuned damper of the same mass are marked."""
    ax = axes_or_new(ax, SIZE)
    curve = found.play_curve
    known = [each.play for each in curve if each.play is not None]
    unit, name = length_unit(max(known)) if known else (1.0, "")
    plays = np.array(known) / unit if known else np.array([each.play_factor for each in curve])
    own = float(np.interp(1.0, [each.play_factor for each in curve], plays))
    ratios = np.array([each.ratio.value for each in curve])
    low, high = np.array([(each.low, each.high) for each in curve]).T
    ax.errorbar(
        plays, ratios, yerr=[ratios - low, high - ratios], fmt="o-", capsize=3,
        color=COLOURS["simulate"],
    )  # fmt: skip
    ax.axvline(own, color=COLOURS["stop"], linestyle=":", linewidth=1.0)
    ax.text(own, 0.02, " this box", color=COLOURS["stop"])
    ax.axhline(1.0, color=COLOURS["stop"], linestyle="--", linewidth=1.0)
    ax.text(plays[0], 1.0, "no absorber", va="bottom", color=COLOURS["stop"])
    ax.set_xlabel(f"total play of the box ({name})" if known else "play over that of the scene")
    ax.set_ylabel(RATIO_LABEL)
    ax.set_ylim(0.0, max(1.1, 1.05 * float(high.max())))
    _draw_tuned(ax, found.tuned_damper)
    ax.set_title(f"absorber of {100.0 * found.mass_ratio:.3g} % of the mass")
    return ax


def _draw_tuned(ax: Axes, found: TunedDamper | None) -> None:
    """Draw the ratio of the tuned damper of the same mass as a horizontal line."""
    if found is not None:
        ax.axhline(found.ratio, color=COLOURS["exact"], linestyle="-.", linewidth=1.0)
        ax.annotate(
            "tuned damper of the same mass", (1.0, found.ratio), (-4.0, -3.0),
            xycoords=("axes fraction", "data"), textcoords="offset points", ha="right", va="top",
            color=COLOURS["exact"],
        )  # fmt: skip


def draw_design(found: Design, ax: Axes | None = None) -> Axes:
    """rms ratio against play for every candidate, and the best box with its interval."""
    from matplotlib import colormaps

    ax = axes_or_new(ax, SIZE)
    unit, name = length_unit(found.best.play)
    shades = colormaps["viridis"]
    laws, splits = (sorted(found.curve[name].unique()) for name in ("restitution", "units"))
    for (restitution, units), rows in found.curve.groupby(["restitution", "units"]):
        points = rows.sort_values("play")
        shade = 0.85 * laws.index(restitution) / max(len(laws) - 1, 1)
        ax.errorbar(
            points["play"] / unit, points["rms_ratio"], yerr=2.0 * points["rms_ratio_error"],
            marker="o", linestyle=("-", "--", ":", "-.")[splits.index(units) % 4],
            markersize=3.5, linewidth=1.2, capsize=2, color=shades(shade),
            label=f"R = {restitution:g}" + ("" if units == 1 else f", {units} units"),
        )  # fmt: skip
    best = found.best
    ax.axvspan(
        best.low / unit, best.high / unit, color=COLOURS["stop"], alpha=0.25, linewidth=0,
        label="as good as the best",
    )  # fmt: skip
    ax.set_xscale("log")
    ticks = [t for t in (0.5, 1, 2, 5, 10, 20, 50, 100) if ax.get_xlim()[0] < t < ax.get_xlim()[1]]
    ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.minorticks_off()
    ax.set_xlabel(f"total play of the box ({name})")
    ax.set_ylabel(RATIO_LABEL)
    ax.set_ylim(0.0, 1.05)
    _draw_tuned(ax, found.tuned_damper)
    ax.legend(frameon=False)
    return ax


# ------------------------------------------------------------------------------
# Tables and pictures of an absorber under a sine.
# ------------------------------------------------------------------------------


PANEL = (7.0, 3.2)
"""Width of a figure and height of each of its panels, inches."""

LABEL = "largest displacement\nwith / without absorber"

LOWEST = 1e-3
"""Smallest ratio that a picture shows."""


def print_absorber_sine(console: Console, found: AbsorberSine) -> None:
    """Print the vibration that is left over frequency, the best tuning, and the meanings of the
    columns."""
    console.print(found.summary(), style="bold", highlight=False)
    print_frame(console, ranges(found.frequency), f"motion of {found.carrier!r} over frequency")
    if found.tuning:
        print_frame(console, tunings(found), "best tuning at the frequency of the scene")
    for line in (
        "ratio: largest displacement with the absorber over that without; the least and the "
        "largest of the motions that may last",
        "regime: one with impacts is stable; idle: loose masses may rest in their boxes, and do "
        "nothing; clusters: no regime is reached, impacts come and go",
    ):
        console.print(line, style="dim", highlight=False)
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def ranges(curve: ResidualCurve) -> pd.DataFrame:
    """Ranges of values over which the same motions may last, with the ratios in each."""
    import pandas as pd

    kinds = [_lasting(curve, number) for number in range(len(curve.value))]
    starts = [0, *(n for n in range(1, len(kinds)) if kinds[n] != kinds[n - 1]), len(kinds)]
    rows = []
    for first, end in pairwise(starts):
        part = slice(first, end)
        rows.append(
            {
                "from (Hz)": curve.value[first],
                "to (Hz)": curve.value[end - 1],
                "what may last": kinds[first],
                f"without ({LENGTH})": LENGTH(np.max(curve.without[part])),
                "least ratio": np.min(curve.best[part]),
                "largest ratio": np.max(curve.worst[part]),
            }
        )
    return pd.DataFrame(rows)


def tunings(found: AbsorberSine) -> pd.DataFrame:
    """A row for each number that is tuned: its best value and the ratio there."""
    import pandas as pd

    rows = []
    for curve in found.tuning:
        at = curve.tuned
        rows.append(
            {
                "what": _name(curve),
                "best": _shown(curve)[at],
                "ratio": curve.worst[at],
                "first harmonics": curve.first_harmonic[at],
                "what may last": _lasting(curve, at),
            }
        )
    return pd.DataFrame(rows)


def _lasting(curve: ResidualCurve, number: int) -> str:
    seen = {
        "regime": curve.stable[number],
        "bursts": not curve.periodic[number],
        "idle": curve.idle[number],
    }
    return ", ".join(name for name, there in seen.items() if there) or "no impacts"


def _name(curve: ResidualCurve) -> str:
    """The name of the varied number, with its unit where that is known."""
    if curve.key == "frequency_hz":
        return "frequency (Hz)"
    name, quantity = tuned_key(curve.key)
    return quantity.heading(name)


def _shown(curve: ResidualCurve) -> Vector:
    """The varied numbers in the unit that is shown."""
    known = curve.key == "frequency_hz"
    shown: Vector = curve.value if known else tuned_key(curve.key)[1](curve.value)
    return shown


def draw_absorber_sine(found: AbsorberSine) -> Axes:
    """Draw the ratio that the absorber leaves over frequency, and over each number that is
    tuned."""
    import matplotlib.pyplot as plt

    curves = (found.frequency, *found.tuning)
    size = PANEL[0], PANEL[1] * len(curves)
    _, axes = plt.subplots(len(curves), 1, figsize=size, squeeze=False, layout="constrained")
    for ax, curve in zip(axes[:, 0], curves, strict=True):
        plot_residual(curve, ax)
    first: Axes = axes[0, 0]
    first.set_title(f"absorber of {100.0 * found.mass_ratio:.3g} % of the mass, {found.carrier}")
    return first


def plot_absorber_sine(found: AbsorberSine, ax: Axes | None = None) -> Axes:
    """The picture of an answer; in given axes, the panel over frequency alone."""
    return draw_absorber_sine(found) if ax is None else plot_residual(found.frequency, ax)


def plot_residual(curve: ResidualCurve, ax: Axes) -> Axes:
    """Least and largest ratio of the motions that may last, and that of the first harmonics."""
    x, best, worst = _shown(curve), curve.best, curve.worst
    marker = "o" if len(x) < 3 else ""
    ax.fill_between(x, best, worst, color=COLOURS["simulate"], alpha=0.25, linewidth=0)
    ax.semilogy(x, worst, f"-{marker}", color=COLOURS["simulate"], label="largest that may last")
    ax.semilogy(x, best, f"--{marker}", color=COLOURS["simulate"], label="least that may last")
    ax.semilogy(
        x, curve.first_harmonic, f":{marker}", color=COLOURS["exact"],
        label="first harmonics, stable regime",
    )  # fmt: skip
    bursts = ~curve.periodic
    ax.semilogy(
        x[bursts], worst[bursts], ".", color=COLOURS["linearise:closure"], label="bursts"
    )  # fmt: skip
    ax.axhline(1.0, color=COLOURS["stop"], linestyle="--", linewidth=1.0)
    if len(x) > 1 and x[0] > 0.0 and x[-1] / x[0] > 5.0:
        ax.set_xscale("log")
    ax.set_xlabel(_name(curve))
    ax.set_ylabel(LABEL)
    ax.set_ylim(bottom=max(LOWEST, ax.get_ylim()[0]))
    plain_ticks(ax)
    ax.legend(fontsize="small", frameon=False)
    add_grid(ax)
    return ax
