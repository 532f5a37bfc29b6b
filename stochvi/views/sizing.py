"""Pictures of a sizing and of its review: risk, impact rate, peaks, spectra, sensitivity.

Pictures of the page of a report are drawn at half its width (`axes.PAGE`).
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.isolators.sizing.answer import spoken_mission, spoken_percent
from stochvi.mathematics.shown_units import (
    ACCELERATION,
    DENSITY,
    LENGTH,
    RATE,
    SPEED,
    ShownQuantity,
)
from stochvi.mathematics.truncated_normal import normal_density
from stochvi.mathematics.units import power_ratio
from stochvi.results.hardness import is_speed
from stochvi.results.intervals import GAUSSIAN_95
from stochvi.views.axes import (
    PAGE,
    add_grid,
    add_title,
    axes_or_new,
    draw_stops,
    label_for_page,
    length_unit,
)
from stochvi.views.colours import CLEARANCES, COLOURS, OWNERS
from stochvi.views.words import count_of, name_of_answer, with_article

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from stochvi.isolators.environment import Environment
    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.isolators.sizing.motion import MotionBetweenStops
    from stochvi.isolators.sizing.review import Review

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
        what = "probability of any impact"
    else:
        lowest = _plot_limit(ax, sizing, unit)
        end = 1.25 * max(places.values()) / unit
        what = f"probability of {with_article(wanted.name.replace('_', ' '))}\nabove {wanted.limit}"
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
    ax.set_ylabel(f"{what} in {spoken_mission(sizing.mission)}")
    add_grid(ax)
    # above the label of the upper axis, whose distance is one of letters
    ax.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2,
              borderaxespad=5.0, fontsize="small")  # fmt: skip
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


def _hard_hits(review: Review) -> tuple[pd.DataFrame, str, ShownQuantity]:
    """The table of probabilities of hard impacts, and their limit in words."""
    table = review.exceedances
    assert table is not None
    if is_speed(table["event"].iloc[0]):
        return table, "largest impact speed", SPEED
    return table, "largest peak acceleration", ACCELERATION


def _chance_label(review: Review) -> str:
    return f"probability in {spoken_mission(review.sizing.mission)}"


def _chance_limits(table: pd.DataFrame) -> tuple[float, float]:
    return max(0.3 * float(table["probability"].min()), LEAST_CHANCE), 1.5


LEAST_CHANCE = 1e-9
"""Lower end of a picture of probabilities of hard impacts."""


def _chance_line(
    ax: Axes, x: Any, rows: pd.DataFrame, colour: str, label: str, marker: str = ""
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
    peak = not is_speed(target.name)
    place = (ACCELERATION if peak else SPEED)(target.value)
    ax.axvline(place, color=COLOURS["stop"], linewidth=1.0)
    ax.axhline(target.exceedance, color=COLOURS["stop"], linewidth=1.0)
    limit = f"limit {target.in_g if peak else target.limit}"
    ax.text(place, 1.0, limit, fontsize="small", color=COLOURS["stop"], va="bottom", ha="center",
            transform=ax.get_xaxis_transform())  # fmt: skip


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
        _error_bars(ax, rows, "o-", colour, f"stops {ratio:g} x the mount")
    _error_bars(ax, table[own], "D", COLOURS["linearise:closure"], "stops of the scene")
    free = ACCELERATION((table["largest_acceleration"] / table["peak_amplification"]).mean())
    ax.axhline(free, color=COLOURS["exact"], linestyle="--", linewidth=1.2, label="no stops")
    ax.set_yscale("log")
    label_for_page(
        ax,
        f"clearance per side ({LENGTH})",
        f"largest in {review.peak_window:g} s, mean ({ACCELERATION})",
    )
    return ax


def _error_bars(ax: Axes, rows: pd.DataFrame, form: str, colour: Any, label: str) -> None:
    half = GAUSSIAN_95 * ACCELERATION(rows["largest_acceleration_error"])
    ax.errorbar(
        LENGTH(rows["clearance"]), ACCELERATION(rows["largest_acceleration"]), yerr=half,
        fmt=form, color=colour, markersize=4.5, linewidth=1.3, capsize=2, label=label,
    )  # fmt: skip


def plot_sensitivity(table: pd.DataFrame, ax: Axes | None = None) -> Axes:
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


def _spectra(environment: Environment) -> pd.DataFrame:
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
