"""Pictures of isolators. Chapters: screening; impact rates against clearance; a sizing and its
review; several
pairs and productions."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.mathematics.impact_rates import normal_density
from stochvi.mathematics.units import (
    ACCELERATION,
    DENSITY,
    LENGTH,
    RATE,
    SPEED,
    ShownQuantity,
    power_ratio,
    spoken_mission,
)
from stochvi.results.base import DataFrame, is_speed
from stochvi.results.estimates import GAUSSIAN_95, count_of, spoken_percent
from stochvi.views.axes import (
    CLEARANCES,
    COLOURS,
    OWNERS,
    PAGE,
    add_grid,
    add_title,
    axes_or_new,
    draw_stops,
    label_for_page,
    legend_above,
    length_unit,
    owner_colours,
)
from stochvi.views.tables import name_of_answer

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from stochvi.isolators.production_risk import Production
    from stochvi.isolators.screening import Environment, Screening
    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.isolators.sizing.review import MotionBetweenStops, Review


# ------------------------------------------------------------------------------
# Pictures of a linear screening.
# ------------------------------------------------------------------------------


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


# ------------------------------------------------------------------------------
# Pictures of impact rates against the clearance of the stops.
# ------------------------------------------------------------------------------


def plot_clearance_curve(
    curve: DataFrame, predicted: DataFrame | None = None, ax: Axes | None = None
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


def _add_lengths(ax: Axes, curve: DataFrame) -> None:
    """The clearances of one pair as lengths, on an upper axis."""
    unit, name = length_unit(float(curve["clearance"].max()))
    per_sigma = float(curve["clearance"].iloc[0] / curve["clearance_in_sigma"].iloc[0]) / unit
    top = ax.secondary_xaxis(
        "top", functions=(lambda s: np.asarray(s) * per_sigma, lambda c: np.asarray(c) / per_sigma)
    )
    top.set_xlabel(f"clearance per side ({name})")


def plot_clearance_ratio(
    curve: DataFrame, predicted: DataFrame | None = None, ax: Axes | None = None
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


def draw_clearance(curve: DataFrame, predicted: DataFrame, title: str) -> Axes:
    """Rates, and their ratio to Rice's below them, in one figure; returns the upper Axes."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(
        2, 1, figsize=(6.8, 6.6), height_ratios=(2.0, 1.0), layout="constrained", sharex=True
    )
    above: Axes = axes[0]
    below: Axes = axes[1]
    plot_clearance_curve(curve, predicted, above).set_xlabel("")
    plot_clearance_ratio(curve, predicted, below)
    figure.suptitle(title or "impacts against clearance")
    return above


def _by_pair(table: DataFrame) -> list[tuple[str, DataFrame]]:
    """Name and rows of each pair; the name is empty where there is one."""
    if "pair" not in table:
        return [("", table)]
    return [(str(name), rows) for name, rows in table.groupby("pair", sort=False)]


def _colours(curve: DataFrame) -> list[Sequence[str]]:
    """Colours of Rice's rate, the closure and the simulation, for each pair."""
    if "pair" not in curve:
        return [(COLOURS["exact"], COLOURS["linearise:closure"], COLOURS["simulate"])]
    return [(colour,) * 3 for colour in owner_colours(curve["pair"].nunique())]


def _error_bars(
    ax: Axes, rows: DataFrame, centre: pd.Series, scale: pd.Series | float, colour: str,
    label: str | None,
) -> None:  # fmt: skip
    """Simulated rates over a scale, with their 95 % intervals."""
    ax.errorbar(
        rows["clearance_in_sigma"], centre, color=colour, fmt="o", markersize=4.5, capsize=3,
        yerr=[centre - rows["simulated_low"] / scale, rows["simulated_high"] / scale - centre],
        label=label,
    )  # fmt: skip


def _sigma_label(curve: DataFrame) -> str:
    moved = "of the gap" if "pair" in curve else "displacement"
    return f"clearance per side / rms {moved} without stops"


# ------------------------------------------------------------------------------
# Pictures of a sizing and of its review: risk, impact rate, peaks, spectra, sensitivity.
#
# Pictures of the page of a report are drawn at half its width (`axes.PAGE`).
# ------------------------------------------------------------------------------


LEAST_PROBABILITY = 1e-5
"""Lower end of the picture of the risk, unless the target lies lower."""

FEW_BREAKPOINTS = 60
"""Number of points above which a table is taken for a measured density, and its points are not
marked."""

TOLERANCE_DB = 3.0
"""Half width of the band around the input density, dB: a usual tolerance of vibration tests."""

LABEL_WIDTH = 30
"""Largest number of letters in a line of a label."""


def _marks(sizing: Sizing) -> list[tuple[str, str, float]]:
    """Colour, name and place (m) of the clearances that a picture marks: 3 sigma and the answer,
    and what a record itself needs where it contradicts the noise of the answer."""
    found = [(CLEARANCES["three_sigma"], "3 sigma", sizing.three_sigma.clearance)]
    if sizing.doubtful is None:
        return [*found, (CLEARANCES["recommended"], name_of_answer(sizing), sizing.clearance.value)]
    return [
        *found,
        (COLOURS["stop"], name_of_answer(sizing), sizing.clearance.value),
        (CLEARANCES["record"], "the record itself", sizing.doubtful.clearance),
    ]


def plot_risk(sizing: Sizing, ax: Axes | None = None) -> Axes:
    """Probability in the mission that the target limits against clearance, 3 sigma and the
    calculated clearance marked: that of any impact or, of a target with a limit, that an impact
    exceeds it.

    The dashed line takes Rice's crossings for independent impacts. Bands and bars are the 95 %
    intervals.
    """
    ax = axes_or_new(ax, (6.8, 4.6))
    unit, name = length_unit(sizing.clearance.value)
    curve, sigma = sizing.curve, sizing.sigma
    own, wanted = COLOURS["linearise:force" if sizing.doubtful is None else "stop"], sizing.target
    places = {
        "3 sigma": sizing.three_sigma.clearance,
        name_of_answer(sizing): sizing.clearance.value,
    }
    if wanted.exceedance is None:
        lowest = _plot_any_hit(ax, sizing, unit)
        end = float(curve["clearance"][curve["probability"] > lowest].iloc[-1]) / unit
    else:
        lowest = _plot_limit(ax, sizing, unit)
        end = 1.25 * max(places.values()) / unit
    shown = {"3 sigma": COLOURS["linearise:closure"], name_of_answer(sizing): own}
    for words, place in places.items():
        label = f"{words}: {place / unit:.4g} {name}"
        ax.axvline(place / unit, color=shown[words], linewidth=1.0, alpha=0.8, label=label)
    if sizing.doubtful is not None:
        place = sizing.doubtful.clearance / unit
        end = max(end, 1.05 * place)
        ax.axvline(
            place,
            color=CLEARANCES["record"],
            linewidth=1.6,
            label=f"the record itself: {sizing.doubtful.needed}",
        )
    ax.set_xlim(min(float(curve["clearance"].iloc[0]), 0.8 * sizing.clearance.value) / unit, end)
    ax.set_ylim(lowest, 1.3)
    ax.set_yscale("log")
    ax.set_xlabel(f"clearance per side ({name})")
    what = "an impact" if wanted.name == "rate" else wanted.event
    ax.set_ylabel(f"probability of {what} in {spoken_mission(sizing.mission)}")
    add_grid(ax)
    # above the label of the upper axis, whose distance is one of letters
    legend_above(ax, 2, borderaxespad=5.0)
    top = ax.secondary_xaxis(
        "top",
        functions=(lambda c: np.asarray(c) * unit / sigma, lambda s: np.asarray(s) * sigma / unit),
    )
    top.set_xlabel("clearance per side / rms displacement without stops")
    return ax


def _plot_any_hit(ax: Axes, sizing: Sizing, unit: float) -> float:
    """Draw the probability of any impact; returns the smallest probability that is shown."""
    curve = sizing.curve
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
    three, answer = sizing.three_sigma, sizing.clearance.value
    ax.plot(
        three.clearance / unit, three.probability.value, "o", color=COLOURS["linearise:closure"],
        clip_on=False, zorder=3,
    )  # fmt: skip
    there = float(np.exp(np.interp(answer, curve["clearance"], np.log(curve["probability"]))))
    own = COLOURS["linearise:force" if sizing.doubtful is None else "stop"]
    ax.plot(answer / unit, there, "D", color=own, clip_on=False, zorder=3)
    return min(LEAST_PROBABILITY, 0.1 * there)


def _plot_limit(ax: Axes, sizing: Sizing, unit: float) -> float:
    """Draw the probability that the limit of the target is exceeded at the clearances that were
    tried, with that of any impact for comparison; returns the smallest probability that is
    shown."""
    accepted, table = sizing.target.exceedance, sizing.exceeding
    assert accepted is not None
    lowest = 0.1 * accepted
    curve = sizing.curve
    ax.plot(
        curve["clearance"] / unit, curve["probability"], color="0.6", linewidth=1.0,
        label="any impact, however soft",
    )  # fmt: skip
    ax.axhline(accepted, color="0.3", linestyle=":", label=f"accepted: {spoken_percent(accepted)}")
    if table is None or not len(table):
        return lowest
    colour, known = COLOURS["simulate"], table[table["probability"].notna()]
    known = known[known["probability"] > 0.0]
    if len(known):
        value = known["probability"]
        ax.errorbar(
            known["clearance"] / unit, value,
            yerr=[value - known["probability_low"], known["probability_high"] - value],
            color=colour, marker="o", capsize=3.0, label="an impact beyond the limit, simulated",
        )  # fmt: skip
        lowest = min(lowest, 0.3 * float(value.min()))
    unseen = table[table["probability"].isna()]
    if len(unseen):
        ax.plot(
            unseen["clearance"] / unit, unseen["probability_high"], "v", color=colour,
            label="95 % limit, hardly any seen",
        )  # fmt: skip
        lowest = min(lowest, 0.3 * float(unseen["probability_high"].min()))
    return lowest


def draw_sizing(sizing: Sizing, title: str = "") -> Axes:
    """The risk against clearance as a figure with a title."""
    return add_title(plot_risk(sizing), title or "clearance and risk")


def plot_input(review: Review, ax: Axes | None = None) -> Axes:
    """Input density with its breakpoints and a band of +-3 dB."""
    ax = axes_or_new(ax, PAGE)
    spectra, breakpoints = _spectra(review.environment), review.environment.breakpoints
    f, density = spectra["frequency_hz"], DENSITY(spectra["base_density"])
    ratio = power_ratio(TOLERANCE_DB)
    ax.fill_between(f, density / ratio, density * ratio, color=COLOURS["simulate"], alpha=0.18,
                    linewidth=0, label="±3 dB")  # fmt: skip
    ax.loglog(f, density, color=COLOURS["simulate"], linewidth=1.8, label="base acceleration")
    if breakpoints is not None and len(breakpoints) <= FEW_BREAKPOINTS:
        ax.plot(breakpoints["frequency_hz"], DENSITY(breakpoints["base_density"]), "o",
                markersize=5, color=COLOURS["simulate"], label="breakpoints")  # fmt: skip
    _mark_natural(ax, review)
    label_for_page(ax, "frequency (Hz)", f"one-sided density ({DENSITY})")
    return ax


def plot_response(review: Review, ax: Axes | None = None) -> Axes:
    """Density of the absolute acceleration without stops, over that of the base."""
    ax = axes_or_new(ax, PAGE)
    spectra = _spectra(review.environment)
    f, density = spectra["frequency_hz"], DENSITY(spectra["base_density"])
    ax.loglog(f, density, color=COLOURS["stop"], linewidth=1.4, label="base")
    ax.loglog(f, density * spectra["transmissibility"] ** 2, color=COLOURS["simulate"],
              linewidth=1.8, label="mass, no stops")  # fmt: skip
    _mark_natural(ax, review)
    label_for_page(ax, "frequency (Hz)", f"one-sided density ({DENSITY})")
    return ax


def plot_transmissibility(review: Review, ax: Axes | None = None) -> Axes:
    """Transmissibility of the mount: by theory without stops, and apparent in a path with stops.

    For the path it is the density of -(b v + omega^2 x) over that of the base. This is the part of
    the acceleration that spring and damper cause. With stops it is no longer a property of the
    mount."""
    ax = axes_or_new(ax, PAGE)
    spectra = _spectra(review.environment)
    apparent = None if review.motion is None else review.motion.transmissibility
    if apparent is not None:
        ax.loglog(apparent["frequency_hz"], apparent["transmissibility"],
                  color=CLEARANCES["three_sigma"], linewidth=1.2,
                  label="apparent, stops at 3 sigma")  # fmt: skip
    ax.loglog(spectra["frequency_hz"], spectra["transmissibility"], color=COLOURS["exact"],
              linewidth=1.6, label="no stops")  # fmt: skip
    ax.axhline(1.0, color=COLOURS["stop"], linewidth=0.8)
    _mark_natural(ax, review)
    label_for_page(ax, "frequency (Hz)", "transmissibility (acceleration)")
    return ax


def plot_cumulative(review: Review, ax: Axes | None = None) -> Axes:
    """Share of the mean square below each frequency, without stops."""
    ax = axes_or_new(ax, PAGE)
    spectra = _spectra(review.environment)
    for quantity, name, colour in (
        ("displacement", "relative displacement", COLOURS["simulate"]),
        ("velocity", "relative velocity", COLOURS["fokker-planck"]),
        ("acceleration", "absolute acceleration", COLOURS["exact"]),
    ):
        ax.semilogx(spectra["frequency_hz"], 100.0 * spectra[f"{quantity}_share"], color=colour,
                    linewidth=1.6, label=name)  # fmt: skip
    _mark_natural(ax, review)
    label_for_page(ax, "frequency (Hz)", "mean square below it (%)")
    return ax


def plot_histogram(review: Review, ax: Axes | None = None) -> Axes:
    """Histogram of a path between its stops, logarithmic, over the normal distribution without
    stops."""
    ax = axes_or_new(ax, PAGE)
    sizing, motion = review.sizing, _motion(review)
    unit, name = length_unit(3.0 * sizing.sigma)
    rest, deviation = motion.mean_position / unit, sizing.sigma / unit
    edges = motion.displacement.edges / unit
    ax.stairs(motion.displacement.density * unit, edges, fill=True, color=COLOURS["simulate"],
              alpha=0.55, label="with stops")  # fmt: skip
    x = np.linspace(edges[0], edges[-1], 401)
    ax.plot(x, normal_density(x, rest, deviation), color=COLOURS["exact"], linestyle="--",
            linewidth=1.3, label="normal distribution, no stops")  # fmt: skip
    ax.set_yscale("log")
    ax.set_xlim(edges[0], edges[-1])
    peak = float(normal_density(0.0, 0.0, deviation))
    ax.set_ylim(2e-6 * peak, 3.0 * peak)
    draw_stops(ax, motion.scene, unit, vertical=True)
    label_for_page(ax, f"relative displacement ({name})", f"probability density (1/{name})")
    return ax


def plot_hit_rate(review: Review, ax: Axes | None = None) -> Axes:
    """Impacts per second against clearance: Rice, first impacts, closure, Monte Carlo with 95 %."""
    ax = axes_or_new(ax, PAGE)
    sizing, closure = review.sizing, review.closure
    curve = sizing.curve
    ax.plot(LENGTH(curve["clearance"]), RATE(curve["rice_rate"]), color=COLOURS["exact"],
            linestyle="--", linewidth=1.3, label="Rice, no impacts")  # fmt: skip
    known = curve[curve["first_hit_rate_low"] > 0.0]
    ax.plot(LENGTH(known["clearance"]), RATE(known["first_hit_rate"]),
            color=COLOURS["fokker-planck"], linewidth=1.6, label="first impacts")  # fmt: skip
    ax.fill_between(LENGTH(known["clearance"]), RATE(known["first_hit_rate_low"]),
                    RATE(known["first_hit_rate_high"]), color=COLOURS["fokker-planck"], alpha=0.25,
                    linewidth=0)  # fmt: skip
    if closure is not None and closure["closure"].notna().any():
        ax.plot(
            LENGTH(closure["clearance"]), RATE(closure["closure"]), linewidth=1.3,
            color=COLOURS["linearise:closure"], label="moment closure",
        )  # fmt: skip
    seen = sizing.simulated
    if len(seen):
        low, centre, high = (RATE(seen[f"hit_rate{end}"]) for end in ("_low", "", "_high"))
        ax.errorbar(
            LENGTH(seen["clearance"]), centre, color=COLOURS["simulate"], fmt="o", markersize=5,
            yerr=[centre - low, high - centre], capsize=3,
            label="with stops, 95 %",
        )  # fmt: skip
    ax.set_yscale("log")
    _mark_clearances(ax, sizing)
    label_for_page(ax, f"clearance per side ({LENGTH})", f"impacts per {RATE.time}")
    return ax


def plot_impact_speeds(review: Review, ax: Axes | None = None) -> Axes:
    """Rate of impacts faster than w, counted, and Rice's with Rayleigh speeds."""
    ax = axes_or_new(ax, PAGE)
    sizing, motion = review.sizing, _motion(review)
    assert motion.faster_hits is not None
    speeds, faster = motion.faster_hits["impact_speed"], motion.faster_hits["rate"]
    deviation = sizing.screening.velocity_std
    rice = sizing.three_sigma.rice_hits / sizing.mission
    w = np.linspace(0.0, 1.15 * max(speeds.max(), 2.5 * deviation), 301)
    ax.semilogy(SPEED(w), RATE(rice) * np.exp(-0.5 * (w / deviation) ** 2), color=COLOURS["exact"],
                linestyle="--", linewidth=1.3, label="Rice, no impacts")  # fmt: skip
    ax.semilogy(SPEED(speeds), RATE(faster), color=CLEARANCES["three_sigma"], linewidth=1.6,
                drawstyle="steps-post",
                label=f"{count_of(motion.hits)} impacts at 3 sigma")  # fmt: skip
    ax.set_ylim(RATE(0.5 / motion.duration), RATE(3.0 * max(faster.max(), rice)))
    label_for_page(ax, f"impact speed w ({SPEED})", f"impacts faster than w, per {RATE.time}")
    return ax


def plot_exceedances(review: Review, ax: Axes | None = None) -> Axes:
    """Probability that the hardest impact of the mission exceeds a limit against the limit, for the
    smallest, the recommended and the largest clearance; each line bears its clearance."""
    ax = axes_or_new(ax, PAGE)
    table, words, quantity = _hard_hits(review)
    known = sorted(set(table["clearance"]))
    nominal = min(known, key=lambda c: abs(c - review.sizing.clearance.value))
    for colour, clearance in zip(OWNERS, sorted({known[0], nominal, known[-1]}), strict=False):
        rows = table[table["clearance"] == clearance].sort_values("limit")
        x = quantity(rows["limit"].to_numpy())
        _chance_line(ax, x, rows, colour, LENGTH.text(clearance, ".3g"))
    _limit_mark(ax, review)
    ax.set_ylim(*_chance_limits(table))
    ax.set_yscale("log")
    label_for_page(ax, quantity.heading(words), _chance_label(review), legend=False)
    return ax


def plot_exceedances_over_clearance(review: Review, ax: Axes | None = None) -> Axes:
    """The probability of exceeding a limit against clearance; each line bears its limit."""
    ax = axes_or_new(ax, PAGE)
    table, _, quantity = _hard_hits(review)
    marked = table[table["mark"]]
    for colour, limit in zip(OWNERS, sorted(set(marked["limit"])), strict=False):
        rows = marked[marked["limit"] == limit].sort_values("clearance")
        x = LENGTH(rows["clearance"].to_numpy())
        _chance_line(ax, x, rows, colour, f"> {quantity.text(limit, '.3g')}", marker="o")
    ax.set_ylim(*_chance_limits(table))
    ax.set_yscale("log")
    for colour, name, place in _marks(review.sizing):
        ax.axvline(LENGTH(place), color=colour, linewidth=1.0)
        ax.text(LENGTH(place), 1.0, f" {name}", color=colour, fontsize="small",
                va="bottom", ha="left", transform=ax.get_xaxis_transform())  # fmt: skip
    label_for_page(ax, f"clearance per side ({LENGTH})", _chance_label(review), legend=False)
    return ax


def _hard_hits(review: Review) -> tuple[DataFrame, str, ShownQuantity]:
    """The table of probabilities of hard impacts, and their limit in words."""
    table = review.exceedances
    assert table is not None
    if is_speed(table["event"].iloc[0]):
        return table, "largest impact speed", SPEED
    return table, "largest peak acceleration", ACCELERATION


def _chance_label(review: Review) -> str:
    return f"probability in {spoken_mission(review.sizing.mission)}"


def _chance_limits(table: DataFrame) -> tuple[float, float]:
    return max(0.3 * float(table["probability"].min()), LEAST_CHANCE), 1.5


LEAST_CHANCE = 1e-9
"""Lower end of a picture of probabilities of hard impacts."""


def _chance_line(
    ax: Axes, x: Any, rows: DataFrame, colour: str, label: str, marker: str = ""
) -> None:
    """Draw probabilities with their 95 % band, and the label at the end of the line."""
    y = rows["probability"].to_numpy()
    ax.plot(x, y, color=colour, linewidth=1.6, marker=marker, markersize=4)
    ax.fill_between(x, np.maximum(rows["probability_low"], LEAST_CHANCE), rows["probability_high"],
                    color=colour, alpha=0.2, linewidth=0)  # fmt: skip
    ax.annotate(label, (x[-1], y[-1]), xytext=(3, 3), textcoords="offset points", color=colour,
                fontsize="small", annotation_clip=False)  # fmt: skip
    ax.margins(x=0.12)


def _limit_mark(ax: Axes, review: Review) -> None:
    """Draw the limit of the target, if it has one."""
    target = review.sizing.target
    if target.exceedance is None:
        return
    place = (SPEED if is_speed(target.name) else ACCELERATION)(target.value)
    ax.axvline(place, color=COLOURS["stop"], linewidth=1.0)
    ax.axhline(target.exceedance, color=COLOURS["stop"], linewidth=1.0)
    ax.text(place, 1.0, f"limit {target.limit}", fontsize="small", color=COLOURS["stop"],
            va="bottom", ha="center", transform=ax.get_xaxis_transform())  # fmt: skip


def plot_peaks(review: Review, ax: Axes | None = None) -> Axes:
    """Largest acceleration against clearance, a line for each stiffness of the stops."""
    from matplotlib import colormaps

    ax = axes_or_new(ax, PAGE)
    table = review.peaks
    assert table is not None
    own = table["stiffness_ratio"].isna()
    ratios = sorted(table.loc[~own, "stiffness_ratio"].unique())
    for number, ratio in enumerate(ratios):
        rows = table[table["stiffness_ratio"] == ratio]
        colour = colormaps["viridis"](0.85 - 0.7 * number / max(len(ratios) - 1, 1))
        _sizing_error_bars(ax, rows, "o-", colour, f"stops {ratio:g} x the mount")
    _sizing_error_bars(ax, table[own], "D", COLOURS["linearise:closure"], "stops of the scene")
    free = ACCELERATION((table["largest_acceleration"] / table["peak_amplification"]).mean())
    ax.axhline(free, color=COLOURS["exact"], linestyle="--", linewidth=1.2, label="no stops")
    ax.set_yscale("log")
    label_for_page(
        ax,
        f"clearance per side ({LENGTH})",
        f"largest in {review.peak_window:g} s, mean ({ACCELERATION})",
    )
    return ax


def _sizing_error_bars(ax: Axes, rows: DataFrame, form: str, colour: Any, label: str) -> None:
    half = GAUSSIAN_95 * ACCELERATION(rows["largest_acceleration_error"])
    ax.errorbar(
        LENGTH(rows["clearance"]), ACCELERATION(rows["largest_acceleration"]), yerr=half,
        fmt=form, color=colour, markersize=4.5, linewidth=1.3, capsize=2, label=label,
    )  # fmt: skip


def plot_sensitivity(table: DataFrame, ax: Axes | None = None) -> Axes:
    """Change of the clearance, a bar for each row but the first, which changes nothing."""
    ax = axes_or_new(ax, PAGE)
    rows = table.iloc[1:][::-1]
    change = 100.0 * rows["clearance_change"]
    colours = [COLOURS["linearise:closure"] if c > 0.0 else COLOURS["simulate"] for c in change]
    names = [textwrap.fill(name, LABEL_WIDTH) for name in rows["change"]]
    ax.barh(names, change, color=colours, height=0.6)
    ax.tick_params(axis="y", labelsize="small")
    for place, value in enumerate(change):
        ax.annotate(f"{value:+.0f} %", (value, place), xytext=(4 if value >= 0.0 else -4, 0),
                    textcoords="offset points", va="center",
                    ha="left" if value >= 0.0 else "right")  # fmt: skip
    ax.axvline(0.0, color=COLOURS["exact"], linewidth=0.8)
    ax.margins(x=0.3)
    ax.set_xlabel("change of the clearance (%)")
    return ax


def _spectra(environment: Environment) -> DataFrame:
    assert environment.spectra is not None
    return environment.spectra


def _motion(review: Review) -> MotionBetweenStops:
    assert review.motion is not None
    return review.motion


def _mark_natural(ax: Axes, review: Review) -> None:
    natural = review.mount.natural_frequency_hz
    ax.axvline(natural, color=COLOURS["linearise:closure"], linestyle=":", linewidth=1.2,
               label=f"mount, {natural:.3g} Hz")  # fmt: skip


def _mark_clearances(ax: Axes, sizing: Sizing) -> None:
    for colour, words, place in _marks(sizing):
        ax.axvline(
            LENGTH(place),
            color=colour,
            linewidth=1.4,
            label=f"{words}, {LENGTH.text(place, '.3g')}",
        )


# ------------------------------------------------------------------------------
# Pictures of a sizing of several pairs, and of a production.
# ------------------------------------------------------------------------------


def plot_pairs_risk(sizing: Sizing, ax: Axes | None = None) -> Axes:
    """Probability of any impact against the clearance of each pair, all of which change together.

    The dashed line takes the pairs for independent of each other.
    """
    ax = axes_or_new(ax, (6.8, 4.6))
    curve = sizing.curve
    unit, name = length_unit(max(each.value for each in sizing.clearances.values()))
    groups, any_hit = _alike(sizing), sizing.any_hit or math.nan
    for names, colour in zip(groups, owner_colours(len(groups)), strict=True):
        found, x = sizing.clearances[names[0]], curve[names[0]] / unit
        ax.fill_between(
            x, curve["probability_low"], curve["probability_high"], color=colour, alpha=0.2,
            linewidth=0,
        )  # fmt: skip
        ax.plot(
            x,
            curve["probability"],
            color=colour,
            label=f"{_joined(names)}: {found.value / unit:.4g} {name}",
        )
        ax.plot(x, curve["independent"], color=colour, linestyle="--", linewidth=0.9)
        ax.plot(found.value / unit, any_hit, "o", color=colour, zorder=3)
    ax.plot([], [], color="0.4", linestyle="--", linewidth=0.9, label="pairs taken for independent")
    ax.axhline(any_hit, color="0.5", linewidth=0.8)
    ax.set_yscale("log")
    ax.set_xlabel(f"clearance per side ({name})")
    ax.set_ylabel(f"probability of any impact in {spoken_mission(sizing.mission)}")
    add_grid(ax)
    legend_above(ax, 2)
    return ax


SAME_CURVE = 5e-3
"""Relative distance of two curves below which a picture shows them as one line."""

MOST_JOINED = 3
"""Largest number of names of pairs in one entry of a legend."""


def _alike(sizing: Sizing) -> list[list[str]]:
    """Names of the sized pairs, grouped where a picture cannot tell their curves apart."""
    groups: list[list[str]] = []
    for name in sizing.clearances:
        own = sizing.curve[name]
        for group in groups:
            if np.allclose(own, sizing.curve[group[0]], rtol=SAME_CURVE, atol=0.0):
                group.append(name)
                break
        else:
            groups.append([name])
    return groups


def _joined(names: list[str]) -> str:
    """Names in one entry of a legend, the last of many only counted."""
    if len(names) <= MOST_JOINED:
        return ", ".join(names)
    return f"{', '.join(names[: MOST_JOINED - 1])} and {len(names) - MOST_JOINED + 1} more"


def draw_pairs_risk(sizing: Sizing, title: str = "") -> Axes:
    """The risk against the clearances as a figure with a title."""
    return add_title(plot_pairs_risk(sizing), title or "clearances and risk")


def plot_pairs_clearances(sizing: Sizing, ax: Axes | None = None) -> Axes:
    """The clearance of each pair, the largest within the tolerances, and three sigma of its
    gap."""
    ax = axes_or_new(ax, (6.8, 0.9 + 0.42 * max(len(sizing.clearances), 3)))
    names = list(sizing.clearances)
    values = np.array([sizing.clearances[name].value for name in names])
    unit, unit_name = length_unit(float(values.max()))
    sigma = sizing.pairs.set_index("pair")["sigma"]
    rows = np.arange(len(names))
    worst = sizing.tolerances.iloc[-1]
    ax.barh(
        rows, values / unit, color=COLOURS["linearise:force"], height=0.5, label="as calculated"
    )
    if len(sizing.tolerances) > 1:
        more = [max(float(worst[n]) - v, 0.0) / unit for n, v in zip(names, values, strict=True)]
        ax.barh(
            rows, more, left=values / unit, color=COLOURS["linearise:force"], alpha=0.3,
            height=0.5, label="largest within the tolerances",
        )  # fmt: skip
    ax.plot(
        [3.0 * float(sigma[name]) / unit for name in names], rows, "o",
        color=COLOURS["linearise:closure"], label="3 sigma",
    )  # fmt: skip
    ax.set_yticks(rows, names)
    ax.invert_yaxis()
    ax.set_xlim(left=0.0)
    ax.set_xlabel(f"clearance per side ({unit_name})")
    legend_above(ax)
    return ax


LABEL_WIDTH = 26
"""Largest number of letters in a line of a label."""

LEAST_PROBABILITY = 1e-9
"""Smallest probability that the picture shows."""


def plot_production(found: Production, ax: Axes | None = None) -> Axes:
    """The units by their risk; beside them, in a figure of its own, what each tolerance costs."""
    if ax is None:
        import matplotlib.pyplot as plt

        ax, beside = plt.subplots(
            1, 2, width_ratios=[1.3, 1.0], figsize=(9.6, 4.0), layout="constrained"
        )[1]
        plot_costs(found, beside)
    return plot_units(found, ax)


def plot_units(found: Production, ax: Axes | None = None) -> Axes:
    """The share of the units below each probability of an impact, with the mean over the production
    and a unit as stated."""
    ax = axes_or_new(ax, PAGE)
    table = found.units[found.units["probability"] > LEAST_PROBABILITY]
    ax.plot(
        table["probability"], 100.0 * table["share_of_units"], "o-", markersize=4,
        color=COLOURS["simulate"],
    )  # fmt: skip
    marks = [
        ("mean over the production", found.probability.value, COLOURS["linearise:closure"], "-"),
        ("a unit as stated", found.probability_as_stated, CLEARANCES["recommended"], "--"),
    ]
    for words, chance, colour, style in marks:
        ax.axvline(
            chance, color=colour, linestyle=style, linewidth=1.4,
            label=f"{words}: {spoken_percent(chance)}",
        )  # fmt: skip
    ax.set_xscale("log")
    ax.set_ylim(0.0, 103.0)
    ax.set_xlabel(f"probability of any impact of a unit in {spoken_mission(found.mission)}")
    ax.set_ylabel("units with at most this probability (%)")
    ax.legend(
        facecolor="white", edgecolor="none", framealpha=1.0, fontsize="small", loc="upper left"
    )
    ax.grid(alpha=0.4)
    return ax


def plot_costs(found: Production, ax: Axes | None = None) -> Axes:
    """The clearance that each tolerance costs."""
    ax = axes_or_new(ax, PAGE)
    rows = found.tolerances[::-1]
    unit, name = length_unit(float(np.max(np.abs(rows["clearance_cost"]))))
    ax.barh(
        # a number stays with its sign and unit
        [textwrap.fill(each.replace("± ", "±"), LABEL_WIDTH) for each in rows["tolerance"]],
        rows["clearance_cost"] / unit, height=0.55, color=COLOURS["linearise:force"],
    )  # fmt: skip
    ax.tick_params(axis="y", labelsize="small")
    ax.set_xlabel(f"clearance that it costs ({name})")
    ax.margins(x=0.12)
    return ax
