"""Pictures of isolators. Chapters: screening; impact rates against clearance; a sizing and its
review; missions, pairs and productions."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from stochvi.mathematics.impact_rates import normal_density
from stochvi.mathematics.units import (
    ACCELERATION,
    DENSITY,
    LENGTH,
    PERCENT,
    RATE,
    SPEED,
    power_ratio,
    spoken_mission,
)
from stochvi.results.base import DataFrame
from stochvi.results.estimates import GAUSSIAN_95, count_of, spoken_percent
from stochvi.statistics.hardness import hardness_of
from stochvi.views.axes import (
    CLEARANCES,
    COLOURS,
    FREQUENCY,
    OWNERS,
    PAGE,
    Chart,
    Scale,
    bounds_of,
    density_of,
    length_of,
    listed,
    owner_colours,
    panels,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.isolators.production_risk import Production
    from stochvi.isolators.screening import Screening
    from stochvi.isolators.sizing.answer import (
        ClearanceAnswer,
        DamageSizing,
        Sizing,
    )
    from stochvi.isolators.sizing.review import MotionBetweenStops, Review

PER_SIDE = "clearance per side"
IMPACTS = Scale("impacts", RATE, log=True)
RICE, CLOSURE, MONTE_CARLO = "Rice, no impacts", "moment closure", "Monte Carlo, 95 %"
WIDE = (6.8, 4.6)
"""What several pictures of clearances share: words of scales and curves, and a size, inches."""


# ------------------------------------------------------------------------------
# Pictures of a linear screening.
# ------------------------------------------------------------------------------


SIGMAS = np.linspace(1.0, 6.0, 101)
"""Clearances of the picture of one mass, in rms displacements."""


def plot_screening(found: Screening, ax: Axes | None = None) -> Axes:
    """Three sigma of every gap beside its stops; for one mass, impacts by Rice's formula against
    clearance."""
    if len(found.coordinates) > 1 or len(found.impact_pairs) > 1:
        return _plot_gaps(found, ax)
    sigma = found.displacement_std
    chart = Chart.on(ax, Scale(PER_SIDE, length_of(3.0 * sigma)), IMPACTS)
    rates = [found.rice_rate(place) for place in SIGMAS * sigma]
    chart.curve(SIGMAS * sigma, rates, "Rice, impacts change nothing", "exact", "--")
    chart.points(3.0 * sigma, found.rice_rate(3.0 * sigma), "3 sigma", "linearise:closure")
    return chart.finish()


def _plot_gaps(found: Screening, ax: Axes | None) -> Axes:
    """Three sigma of every gap about its mean, and the stops where they are."""
    gaps = found.impact_pairs
    reach = [max(gap.three_sigma, *gap.stops.values()) for gap in gaps.values()]
    words = Scale("gap, from its mean", length_of(max(reach, default=1.0)))
    chart = listed(ax, list(gaps), words)
    for row, gap in enumerate(gaps.values()):
        chart.bar(row, -gap.three_sigma, gap.three_sigma, "3 sigma, nothing hit", alpha=0.5)
        for side, distance in gap.stops.items():
            chart.stop(row, distance if side == "upper" else -distance)
    return chart.finish()


# ------------------------------------------------------------------------------
# Pictures of impact rates against the clearance of the stops.
# ------------------------------------------------------------------------------


IN_SIGMA = "clearance_in_sigma"
"""Column of the clearances over the rms displacement without stops."""


def plot_clearance_curve(
    curve: DataFrame, predicted: DataFrame | None = None, ax: Axes | None = None
) -> Axes:
    """Impact rate against clearance: Rice, closure, and Monte Carlo with its 95 % interval.

    `curve` comes from `clearance_curve`; `predicted` from `predicted_curve`. A picture of one pair
    tells the methods apart by colour, one of several pairs the pairs.
    """
    several = "pair" in curve
    words = f"impacts on the stops{' of a pair' if several else ''}"
    chart = Chart.on(ax, _in_sigma(curve), Scale(words, RATE, log=True), WIDE)
    told = (None, None) if several else (RICE, CLOSURE)
    for (name, rows), (_, lines), (rice, closure, simulated) in zip(
        _by_pair(curve), _by_pair(curve if predicted is None else predicted), _colours(curve),
        strict=True,
    ):  # fmt: skip
        chart.column(lines, IN_SIGMA, "rice", told[0], rice, "--")
        if lines["closure"].notna().any():
            chart.column(lines, IN_SIGMA, "closure", told[1], closure)
        chart.column(rows, IN_SIGMA, "simulated", name or MONTE_CARLO, simulated, "o")
    if several:
        chart.curve([], [], RICE, "0.4", "--")
        chart.curve([], [], CLOSURE, "0.4")
    else:
        longest = float(curve["clearance"].max())
        per_sigma = longest / float(curve[IN_SIGMA].max())
        chart.above(Scale(PER_SIDE, length_of(longest)), per_sigma)
    return chart.finish()


def plot_clearance_ratio(
    curve: DataFrame, predicted: DataFrame | None = None, ax: Axes | None = None
) -> Axes:
    """The same rates divided by Rice's, which shows what the impacts themselves change."""
    chart = Chart.on(ax, _in_sigma(curve), Scale("rate / Rice"))
    chart.level(1.0, None, "exact", "--")
    for (_, rows), (_, lines), (_, closure, simulated) in zip(
        _by_pair(curve), _by_pair(curve if predicted is None else predicted), _colours(curve),
        strict=True,
    ):  # fmt: skip
        chart.curve(lines[IN_SIGMA], lines["closure"] / lines["rice"], None, closure)
        bounds = {end: each / rows["rice"] for end, each in bounds_of(rows, "simulated").items()}
        chart.points(rows[IN_SIGMA], rows["simulated"] / rows["rice"], None, simulated, **bounds)
    return chart.finish()


def draw_clearance(curve: DataFrame, predicted: DataFrame, title: str) -> Axes:
    """Rates, and their ratio to Rice's below them, in one figure; returns the upper Axes."""
    both, title = (plot_clearance_curve, plot_clearance_ratio), title or "impacts against clearance"
    draw = [partial(each, curve, predicted) for each in both]
    return panels(None, draw, (6.8, 6.6), title, height_ratios=(2.0, 1.0))


def _by_pair(table: DataFrame) -> list[tuple[str, DataFrame]]:
    """Name and rows of each pair; the name is empty where there is one."""
    if "pair" not in table:
        return [("", table)]
    return [(str(name), rows) for name, rows in table.groupby("pair", sort=False)]


def _colours(curve: DataFrame) -> list[Sequence[str]]:
    """Colours of Rice's rate, the closure and the simulation, for each pair."""
    if "pair" not in curve:
        return [("exact", "linearise:closure", "simulate")]
    return [(colour,) * 3 for colour in owner_colours(curve["pair"].nunique())]


def _in_sigma(curve: DataFrame) -> Scale:
    moved = "of the gap" if "pair" in curve else "displacement"
    return Scale(f"{PER_SIDE} / rms {moved} without stops")


# ------------------------------------------------------------------------------
# Pictures of a sizing and of its review: risk, impact rate, peaks, spectra.
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

NOTABLE = 0.02
"""Relative distance of the clearance to make from the calculated one from which on both are
marked: below it the first is the second, rounded up."""


def _marks(found: ClearanceAnswer) -> list[tuple[str, str, float]]:
    """Colour, words and place (m) of the clearances that a picture marks, the one to sign last: the
    calculated one and the one to make, or what a record itself needs where it contradicts the noise
    of the answer."""
    place, made, record = found.clearance.value, found.widest, found.record
    calculated = f"calculated: {LENGTH.text(place)}"
    if found.doubtful and record is not None:
        largest = max(record.gaps, key=lambda gap: gap.clearance)
        return [
            (COLOURS["stop"], f"for Gaussian noise: {LENGTH.text(place)}", place),
            (CLEARANCES["record"], f"the record itself: {largest.needed}", largest.clearance),
        ]
    if not found.each_made or made is None:
        return [(COLOURS["stop"], calculated, place)]
    if made.value < (1.0 + NOTABLE) * place:
        return [(CLEARANCES["recommended"], f"make {made} ({calculated})", made.value)]
    return [
        (COLOURS["stop"], calculated, place),
        (CLEARANCES["recommended"], f"make {made}", made.value),
    ]


def _three_sigma(sizing: Sizing) -> tuple[str, str, float]:
    place = sizing.three_sigma.clearance
    return CLEARANCES["three_sigma"], f"3 sigma: {LENGTH.text(place)}", place


def _draw_marks(chart: Chart, marks: Sequence[tuple[str, str, float]]) -> None:
    """Lines at clearances, the last and thickest at the one to sign."""
    for colour, words, place in marks:
        chart.at(place, words, colour, linewidth=1.8 if words is marks[-1][1] else 1.0)


def plot_sizing(sizing: Sizing, ax: Axes | None = None) -> Axes:
    """Risk against the clearance of one gap, against those of several, or that of a mission."""
    if sizing.scene.phases:
        return plot_mission(sizing, ax)
    return (plot_pairs_risk if sizing.several else plot_risk)(sizing, ax)


def plot_risk(sizing: Sizing, ax: Axes | None = None) -> Axes:
    """Probability in the mission that the target limits against clearance, 3 sigma and the
    calculated clearance marked: that of any impact or, of a target with a limit, that an impact
    exceeds it.

    The dashed line takes Rice's crossings for independent impacts. Bands and bars are the 95 %
    intervals.
    """
    curve, wanted, answer = sizing.curve, sizing.target, sizing.clearance.value
    marks = [_three_sigma(sizing), *_marks(sizing)]
    places = [place for *_, place in marks]
    words = "an impact" if wanted.name == "rate" else wanted.event
    risk = Scale(f"probability of {words} in {spoken_mission(sizing.mission)}", log=True)
    chart = Chart.on(ax, Scale(PER_SIDE, length_of(answer)), risk, WIDE)
    if wanted.exceedance is None:
        lowest = _draw_any_hit(chart, sizing)
        end = float(curve["clearance"][curve["probability"] > lowest].iloc[-1])
    else:
        lowest, end = _draw_limit(chart, sizing), 1.2 * max(places)
    _draw_marks(chart, marks)
    ends = min(float(curve["clearance"].iloc[0]), 0.8 * answer), max(end, 1.05 * max(places))
    chart.ax.set(xlim=chart.x.quantity(ends), ylim=(lowest, 1.3))
    chart.above(Scale("clearance / rms displacement, no stops"), 1.0 / sizing.sigma)
    return chart.finish()


def _draw_any_hit(chart: Chart, sizing: Sizing) -> float:
    """Draw the probability of any impact; returns the smallest probability that is shown."""
    curve, three, answer = sizing.curve, sizing.three_sigma, sizing.clearance.value
    by_rice = -np.expm1(-curve["rice_rate"] * sizing.mission)
    chart.curve(curve["clearance"], by_rice, "Rice, crossings independent", "exact", "--")
    chart.column(curve, "clearance", "probability", "first crossings")
    there = float(np.exp(np.interp(answer, curve["clearance"], np.log(curve["probability"]))))
    own = _marks(sizing)[0][0]
    for place, chance, colour, form in (
        (three.clearance, three.probability.value, CLEARANCES["three_sigma"], "o"),
        (answer, there, own, "D"),
    ):
        chart.points(place, chance, None, colour, form, clip_on=False, zorder=3, markersize=6.0)
    return min(LEAST_PROBABILITY, 0.1 * there)


def _draw_limit(chart: Chart, sizing: Sizing) -> float:
    """Draw the probability that the limit of the target is exceeded at the clearances that were
    tried, with that of any impact for comparison; returns the smallest probability that is
    shown."""
    accepted, table, curve = sizing.target.exceedance, sizing.exceeding, sizing.curve
    assert accepted is not None
    any_hit = "any impact, however soft"
    chart.curve(curve["clearance"], curve["probability"], any_hit, "0.6")
    chart.level(accepted, f"accepted: {spoken_percent(accepted)}", "0.3", ":")
    if table is None or not len(table):
        return 0.1 * accepted
    known, unseen = table[table["probability"] > 0.0], table[table["probability"].isna()]
    words = "an impact beyond the limit, simulated"
    if len(known):
        chart.column(known, "clearance", "probability", words, form="o-")
    if len(unseen):
        words, highest = "95 % limit, hardly any seen", unseen["probability_high"]
        chart.points(unseen["clearance"], highest, words, form="v")
    drawn = [*known["probability"], *unseen["probability_high"]]
    return min(0.1 * accepted, 0.3 * min(drawn, default=1.0))


def _spectra(review: Review, ax: Axes | None, y: Scale) -> tuple[Chart, DataFrame]:
    """A chart over frequency with the natural frequency of the mount, and the table to draw."""
    table = review.environment.spectra
    assert table is not None
    chart, natural = Chart.on(ax, FREQUENCY, y, PAGE), review.mount.natural_frequency_hz
    chart.at(natural, f"mount, {natural:.3g} Hz", "linearise:closure", ":")
    return chart, table


def plot_input(review: Review, ax: Axes | None = None) -> Axes:
    """Input density with its breakpoints and a band of +-3 dB, and the density of the absolute
    acceleration of the mass without stops."""
    chart, table = _spectra(review, ax, Scale("one-sided density", DENSITY, log=True))
    f, density, points = (
        table["frequency_hz"],
        table["base_density"],
        review.environment.breakpoints,
    )
    ratio = power_ratio(TOLERANCE_DB)
    chart.band(f, density / ratio, density * ratio, "exact", f"± {TOLERANCE_DB:g} dB")
    chart.curve(f, density, "base", "exact")
    if points is not None and len(points) <= FEW_BREAKPOINTS:
        chart.column(points, "frequency_hz", "base_density", "breakpoints", "exact", "o")
    chart.curve(f, density * table["transmissibility"] ** 2, "mass, no stops", linewidth=1.8)
    return chart.finish()


def plot_transmissibility(review: Review, ax: Axes | None = None) -> Axes:
    """Transmissibility of the mount: by theory without stops, and apparent in a path with stops.

    For the path it is the density of -(b v + omega^2 x) over that of the base. This is the part of
    the acceleration that spring and damper cause. With stops it is no longer a property of the
    mount."""
    of, name = Scale("transmissibility (acceleration)", log=True), "transmissibility"
    chart, table = _spectra(review, ax, of)
    apparent = None if review.motion is None else review.motion.transmissibility
    if apparent is not None:
        words = "apparent, stops at 3 sigma"
        chart.column(apparent, "frequency_hz", name, words, CLEARANCES["three_sigma"])
    chart.column(table, "frequency_hz", name, "no stops", "exact")
    chart.level(1.0)
    return chart.finish()


def plot_histogram(review: Review, ax: Axes | None = None) -> Axes:
    """Histogram of a path between its stops, logarithmic, over the normal distribution without
    stops."""
    sizing, motion = review.sizing, _motion(review)
    length = length_of(3.0 * sizing.sigma)
    heights = density_of(length, log=True)
    chart = Chart.on(ax, Scale("relative displacement", length), heights, PAGE)
    edges = motion.displacement.edges
    chart.stairs(edges, motion.displacement.density, "with stops", fill=True, alpha=0.55)
    x = np.linspace(edges[0], edges[-1], 401)
    normal = normal_density(x, motion.mean_position, sizing.sigma)
    chart.curve(x, normal, "normal distribution, no stops", "exact", "--")
    peak = heights.quantity(float(normal_density(0.0, 0.0, sizing.sigma)))
    chart.ax.set(xlim=length(edges[[0, -1]]), ylim=(2e-6 * peak, 3.0 * peak))
    chart.walls(motion.scene)
    return chart.finish()


def plot_hit_rate(review: Review, ax: Axes | None = None) -> Axes:
    """Impacts per second against clearance: Rice, first impacts, closure, Monte Carlo with 95 %."""
    sizing, closure = review.sizing, review.closure
    chart = Chart.on(ax, Scale(PER_SIDE, LENGTH), IMPACTS, PAGE)
    chart.column(sizing.curve, "clearance", "rice_rate", RICE, "exact", "--")
    known = sizing.curve[sizing.curve["first_hit_rate_low"] > 0.0]
    chart.column(known, "clearance", "first_hit_rate", "first impacts", "fokker-planck")
    if closure is not None and closure["closure"].notna().any():
        chart.column(closure, "clearance", "closure", CLOSURE, "linearise:closure")
    if len(sizing.simulated):
        chart.column(sizing.simulated, "clearance", "hit_rate", "with stops, 95 %", form="o")
    _draw_marks(chart, [_three_sigma(sizing), *_marks(sizing)])
    return chart.finish()


def plot_impact_speeds(review: Review, ax: Axes | None = None) -> Axes:
    """Rate of impacts faster than w, counted, and Rice's with Rayleigh speeds."""
    sizing, motion = review.sizing, _motion(review)
    assert motion.faster_hits is not None
    speeds, faster = motion.faster_hits["impact_speed"], motion.faster_hits["rate"]
    deviation = sizing.screening.velocity_std
    rice = sizing.three_sigma.rice_hits / sizing.mission
    w = np.linspace(0.0, 1.15 * max(speeds.max(), 2.5 * deviation), 301)
    rates = Scale("impacts faster than w", RATE, log=True)
    chart = Chart.on(ax, Scale("impact speed w", SPEED), rates, PAGE)
    chart.curve(w, rice * np.exp(-0.5 * (w / deviation) ** 2), RICE, "exact", "--")
    words, colour = f"{count_of(motion.hits)} impacts at 3 sigma", CLEARANCES["three_sigma"]
    chart.curve(speeds, faster, words, colour, drawstyle="steps-post")
    chart.ax.set_ylim(RATE(0.5 / motion.duration), RATE(3.0 * max(faster.max(), rice)))
    return chart.finish()


def plot_exceedances(review: Review, ax: Axes | None = None) -> Axes:
    """The probability that the hardest impact of the mission exceeds a limit against clearance;
    each line bears its limit."""
    table = review.exceedances
    assert table is not None
    quantity = hardness_of(table["event"].iloc[0]).quantity
    risk = Scale(f"probability in {spoken_mission(review.sizing.mission)}", log=True)
    chart = Chart.on(ax, Scale(PER_SIDE, LENGTH), risk, PAGE)
    marked = table[table["mark"]].sort_values("clearance")
    for colour, (limit, line) in zip(OWNERS, marked.groupby("limit"), strict=False):
        words = f"above {quantity.text(float(str(limit)), '.3g')}"
        chart.column(line, "clearance", "probability", words, colour, marker="o", markersize=4)
    least = max(0.3 * float(table["probability"].min()), LEAST_CHANCE)
    _draw_marks(chart, _marks(review.sizing))
    chart.ax.set_ylim(least, 1.5)
    return chart.finish()


LEAST_CHANCE = 1e-9
"""Lower end of pictures of probabilities of hard impacts, and of the units of a production."""


def plot_peaks(review: Review, ax: Axes | None = None) -> Axes:
    """Largest acceleration against clearance, a line for each stiffness of the stops."""
    from matplotlib import colormaps

    table, name = review.peaks, "largest_acceleration"
    assert table is not None
    words = f"largest in {review.peak_window:g} s, mean"
    peaks = Scale(words, ACCELERATION, log=True)
    chart = Chart.on(ax, Scale(PER_SIDE, LENGTH), peaks, PAGE)
    own = table["stiffness_ratio"].isna()
    groups = list(table[~own].groupby("stiffness_ratio"))
    shades = colormaps["viridis"](np.linspace(0.85, 0.15, max(len(groups), 1)))
    for shade, (ratio, rows) in zip(shades, groups, strict=False):
        chart.column(rows, "clearance", name, f"stops {ratio:g} x the mount", tuple(shade), "o-")
    chart.column(table[own], "clearance", name, "stops of the scene", "linearise:closure", "D")
    free = (table[name] / table["peak_amplification"]).mean()
    chart.level(free, "no stops", "exact", "--")
    return chart.finish()


def _motion(review: Review) -> MotionBetweenStops:
    assert review.motion is not None
    return review.motion


# ------------------------------------------------------------------------------
# Pictures of missions, of ratios of damage, of several pairs, and of productions.
# ------------------------------------------------------------------------------


def plot_mission(found: Sizing, ax: Axes | None = None) -> Axes:
    """Probability of any impact in the mission against the clearance."""
    risk = Scale(f"probability of an impact in {spoken_mission(found.mission)}", log=True)
    chart = Chart.on(ax, Scale(f"{PER_SIDE}{found.of_widest}", LENGTH), risk)
    words = "all phases" if len(found.phases) > 1 else None
    chart.column(found.curve, "clearance", "probability", words)
    chart.level(found.target.value, f"accepted: {spoken_percent(found.target.value)}", "0.3", ":")
    _draw_marks(chart, _marks(found))
    chart.ax.set_ylim(top=1.5)
    return chart.finish()


def plot_damage_sizing(found: DamageSizing, ax: Axes | None = None) -> Axes:
    """Largest ratio of damage, less 1, against the clearance."""
    added = Scale("damage that stops add / damage without", log=True)
    chart = Chart.on(ax, Scale(f"{PER_SIDE}{found.of_widest}", LENGTH), added)
    tried = found.tried
    more, half = tried["damage_ratio"] - 1.0, GAUSSIAN_95 * tried["standard_error"]
    low, words = np.maximum(more - half, 0.01 * more), "damage that stops add, 95 %"
    chart.points(tried["clearance"], more, words, low=low, high=more + half)
    chart.level(found.ratio - 1.0, "accepted", style="--")
    _draw_marks(chart, _marks(found))
    return chart.finish()


def plot_pairs_risk(sizing: Sizing, ax: Axes | None = None) -> Axes:
    """Probability of any impact against the clearance of each pair, all of which change together.

    The dashed line takes the pairs for independent of each other.
    """
    curve, values = sizing.curve, {name: each.value for name, each in sizing.clearances.items()}
    risk = Scale(f"probability of any impact in {spoken_mission(sizing.mission)}", log=True)
    chart = Chart.on(ax, Scale(PER_SIDE, length_of(max(values.values()))), risk, WIDE)
    groups, any_hit = _alike(sizing), sizing.any_hit or math.nan
    for (name, *others), colour in zip(groups, owner_colours(len(groups)), strict=True):
        made = sizing.each_made.get(name)
        signed = f"make {made}" if made else chart.x.quantity.text(values[name])
        words = f"{_joined([name, *others])}: {signed}"
        chart.column(curve, name, "probability", words, colour)
        chart.column(curve, name, "independent", None, colour, "--", linewidth=0.9)
        chart.points(values[name], any_hit, None, colour, zorder=3)
    chart.curve([], [], "pairs taken for independent", "0.4", "--", linewidth=0.9)
    chart.level(any_hit, None, "0.5")
    return chart.finish()


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


LABEL_WIDTH = 26
"""Largest number of letters in a line of a label."""


def plot_production(found: Production, ax: Axes | None = None) -> Axes:
    """The units by their risk; beside them, in a figure of its own, what each tolerance costs."""
    draw = [partial(each, found) for each in (plot_units, plot_costs)]
    return panels(ax, draw, (9.6, 4.0), columns=2, width_ratios=(1.3, 1.0))


def plot_units(found: Production, ax: Axes | None = None) -> Axes:
    """The share of the units below each probability of an impact, with the mean over the production
    and a unit as stated."""
    risk = f"probability of any impact of a unit in {spoken_mission(found.mission)}"
    units = Scale("units with at most this probability", PERCENT)
    chart = Chart.on(ax, Scale(risk, log=True), units, PAGE)
    table = found.units[found.units["probability"] > LEAST_CHANCE]
    chart.column(table, "probability", "share_of_units", marker="o", markersize=4)
    mean, stated = found.probability.value, found.probability_as_stated
    words = f"mean over the production: {spoken_percent(mean)}"
    chart.at(mean, words, "linearise:closure")
    chart.at(stated, f"a unit as stated: {spoken_percent(stated)}", "linearise:force", "--")
    chart.ax.set_ylim(0.0, 103.0)
    return chart.finish(1)


def plot_costs(found: Production, ax: Axes | None = None) -> Axes:
    """The clearance that each tolerance costs."""
    costs = found.tolerances["clearance_cost"]
    # a number stays with its sign and unit
    names = [each.replace("± ", "±") for each in found.tolerances["tolerance"]]
    words = Scale("clearance that it costs", length_of(float(np.nanmax(np.abs(costs)))))
    chart = listed(ax, [textwrap.fill(each, LABEL_WIDTH) for each in names], words, 0.4)
    for row, cost in enumerate(costs):
        chart.bar(row, 0.0, cost, None, "linearise:force")
    return chart.finish()
