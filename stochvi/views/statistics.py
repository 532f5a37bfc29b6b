"""Views of statistics. Chapters: response spectra; impacts; damage of equipment; the bumper map;
tables of spectra and impacts; the risk of a mission."""

from __future__ import annotations

import re
import textwrap
from dataclasses import replace
from functools import partial
from itertools import chain, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from stochvi.mathematics.numerics import Matrix
from stochvi.mathematics.units import (
    ACCELERATION,
    DENSITY,
    ENERGY,
    FORCE,
    HOURLY,
    LENGTH,
    NUMBER,
    SPEED,
    STIFFNESS,
    TIME,
    ShownQuantity,
    Size,
    spoken_mission,
)
from stochvi.results.base import (
    ROTATIONS,
    estimate_of,
    in_chosen_units,
    rows_of,
)
from stochvi.results.estimates import (
    Estimate,
    capital,
    chance_of,
    plus_minus,
    spoken_percent,
)
from stochvi.statistics.hardness import hardness_of
from stochvi.views.axes import (
    CLEARANCES,
    COLOURS,
    FREQUENCY,
    MOST_OF_SPECTRA,
    OWNERS,
    TRANSFERS,
    Chart,
    Scale,
    density_of,
    limit_decades,
    listed,
    owner_colours,
    panels,
    plain_ticks,
)
from stochvi.views.pages import (
    Grid,
    Picture,
    Section,
    Told,
    told_of,
)
from stochvi.views.tables import chance_in_words, no_tolerances

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes

    from stochvi.isolators.bumpers import BumperMap
    from stochvi.statistics.damage import Damage, SpectrumValues, TailoredTest
    from stochvi.statistics.impacts import Histogram, ImpactStatistics
    from stochvi.statistics.reliability import Reliability
    from stochvi.statistics.spectra import Curve, ResponseSpectrum


# ------------------------------------------------------------------------------
# Pictures of response spectra with their 95 % bands.
# ------------------------------------------------------------------------------


DENSITIES = {
    "displacement": (
        "displacement\nrelative to the base", ShownQuantity("length", Size("m²/Hz", 1.0), 2, "/Hz")
    ),
    "velocity": (
        "velocity\nrelative to the base", ShownQuantity("speed", Size("(m/s)²/Hz", 1.0), 2, "/Hz")
    ),
    "acceleration": (
        "acceleration\n{}", ShownQuantity("acceleration density", Size("(m/s²)²/Hz", 1.0))
    ),
}  # fmt: skip
"""Labels of the panels of densities, by quantity; the label of an acceleration is completed by the
kind of acceleration."""

TRANSFER_NAMES = {
    "transmissibility_h1": "H1, the linear part",
    "transmissibility_ratio": "root of the ratio of densities",
}
"""Names of the transmissibilities in the panel that compares with the excitation."""

TITLE = "spectra, one-sided per hertz, with 95 % bands"

MODAL = re.compile(r"mode \d+")
"""Names of modal coordinates, which are not drawn beside points."""


def plot_curve(chart: Chart, curve: Curve, label: str | None, colour: str) -> None:
    """A spectrum with its 95 % band; values that reach zero leave the view."""
    low = np.maximum(curve.lower, 1e-300)
    chart.curve(
        curve.frequency_hz, curve.value, label, colour, low=low, high=curve.upper, linewidth=0.9
    )


def plot_spectrum(found: ResponseSpectrum, ax: Axes | None = None) -> Axes:
    """All spectra, one panel for each quantity; the last panel compares with the excitation. Given
    Axes get the first quantity."""
    points = {owner: c for owner, c in found.curves.items() if not MODAL.fullmatch(owner)}
    shown = points or dict(found.curves)
    present = [name for name in DENSITIES if any(name in c for c in shown.values())]
    transfer = next((c for c in found.curves.values() if "coherence" in c), None)
    draw = [partial(_draw_densities, found, shown, name) for name in present]
    draw += [] if transfer is None else [partial(_draw_transfer, transfer)]
    return panels(ax, draw, (7.2, 2.3 * len(draw) + 0.6), TITLE)


def _draw_densities(
    found: ResponseSpectrum, shown: Mapping[str, Mapping[str, Curve]], name: str, ax: Axes
) -> None:
    """The densities of one quantity, radians in the place of metres of what turns."""
    kind, quantity = DENSITIES[name]
    which, _, more = found.meanings.get(name, "").partition(", between impacts")
    label = kind.format("absolute, between impacts" if more else which)
    chart = Chart.on(ax, FREQUENCY, Scale(f"{label}\n", quantity, log=True))
    for colour, (owner, curves) in zip(OWNERS, shown.items(), strict=False):
        if name in curves:
            turns = owner in ROTATIONS
            own = chart._replace(y=Scale("")) if turns else chart
            words = f"{owner}{' (rad for m)' * turns}" if len(shown) > 1 else None
            plot_curve(own, curves[name], words, colour)
    limit_decades(ax, MOST_OF_SPECTRA)
    chart.finish(3)


def _draw_transfer(transfer: Mapping[str, Curve], ax: Axes) -> None:
    """Transmissibilities, and the coherence on a linear axis at the right."""
    chart = Chart.on(ax, FREQUENCY, Scale("transmissibility", log=True))
    for name, label in TRANSFER_NAMES.items():
        plot_curve(chart, transfer[name], label, TRANSFERS[name])
    values = np.concatenate([transfer[name].value for name in TRANSFER_NAMES])
    ax.set_ylim(0.5 * max(values.min(), 1e-3 * values.max()), 1.5 * values.max())
    right, colour = ax.twinx(), TRANSFERS["coherence"]
    coherence = Chart(right, FREQUENCY, Scale("coherence"))
    plot_curve(coherence, transfer["coherence"], "coherence, right axis", colour)
    right.set(ylim=(0.0, 1.05), yticks=np.linspace(0.0, 1.0, 6))
    right.set_ylabel("coherence", color=colour)
    right.tick_params(axis="y", colors=colour)
    lines = [*ax.get_lines(), *right.get_lines()]
    chart.finish(3, handles=lines, labels=[str(each.get_label()) for each in lines])


# ------------------------------------------------------------------------------
# Pictures of impact statistics: densities of impact speeds and of times between impacts.
# ------------------------------------------------------------------------------


SLOW = 0.3
"""Share of the rms speed below which the power law of slow impacts is drawn."""


def plot_histogram(chart: Chart, found: Histogram, label: str, colour: str) -> None:
    """A density on logarithmic bins, with its standard errors; empty bins are left out."""
    seen = found.density > 0.0
    density, error = found.density[seen], found.standard_error[seen]
    chart.points(
        found.middles[seen], density, label, colour, low=density - error, high=density + error,
        capsize=0.0, markersize=3.0,
    )  # fmt: skip


def plot_impacts(found: ImpactStatistics, ax: Axes | None = None) -> Axes:
    """Densities of impact speeds, with Rayleigh's of the same rms speed and the power law of slow
    impacts, and of the times between impacts. Given Axes get the speeds alone."""
    draw = [partial(each, found) for each in (_draw_speeds, _draw_intervals)]
    return panels(ax, draw, (9.6, 4.2), "impacts", columns=2)


def _draw_speeds(found: ImpactStatistics, ax: Axes) -> None:
    chart = Chart(ax, Scale("impact speed", SPEED, log=True), density_of(SPEED, log=True))
    colours = owner_colours(len(found.pairs))
    for colour, (name, pair) in zip(colours, found.pairs.items(), strict=True):
        if pair.speeds is None:
            continue
        w, density = pair.speeds.middles, pair.speeds.density
        plot_histogram(chart, pair.speeds, name, colour)
        chart.curve(w, pair.rayleigh(w), "Rayleigh", colour, "--", linewidth=1.0)
        for side, exponent in pair.exponents.items():
            if exponent.theory is None:
                continue
            seen = np.flatnonzero(density > 0.0)[:8]
            slow = w[w < SLOW * pair.speed_rms.value] if pair.speed_rms else w[:0]
            power = density[seen].mean() * (slow / w[seen].mean()) ** exponent.theory
            label = f"w^{exponent.theory:.2g}" + (f", {side}" if side != "both" else "")
            chart.curve(slow, power, label, colour, ":", linewidth=1.6)
    _finish_histograms(chart)


def _draw_intervals(found: ImpactStatistics, ax: Axes) -> None:
    chart = Chart(ax, Scale("time between impacts", TIME, log=True), density_of(TIME, log=True))
    colours = owner_colours(len(found.pairs))
    for colour, (name, pair) in zip(colours, found.pairs.items(), strict=True):
        if pair.intervals is not None:
            plot_histogram(chart, pair.intervals, name, colour)
            t, rate = pair.intervals.middles, pair.rates["both"].estimate.value
            with np.errstate(under="ignore"):
                poisson = rate * np.exp(-rate * t)
            chart.curve(t, poisson, "Poisson", colour, "--", linewidth=1.0)
    _finish_histograms(chart)


def _finish_histograms(chart: Chart) -> None:
    """Show what the bins reach, whatever the laws beside them do."""
    heights = [float(y) for each in chart.ax.containers for y in each[0].get_ydata()]
    chart.ax.set_ylim(0.3 * min(heights, default=1e-3), 3.0 * max(heights, default=1.0))
    chart.finish()
    if not heights:
        chart.ax.text(0.5, 0.5, "too few impacts", transform=chart.ax.transAxes, ha="center")


# ------------------------------------------------------------------------------
# Damage of equipment: the table on a terminal, and the pictures of its spectra.
# ------------------------------------------------------------------------------


ROWS = 12
"""Largest number of frequencies of the table on a terminal; the file has all of them."""

WITH, WITHOUT, SHOCK = COLOURS["simulate"], COLOURS["exact"], COLOURS["stop"]
"""Colours of the scene as it is, without its stops, and of its impacts."""


def damage_told(found: Damage) -> Told:
    """The spectra at some frequencies, the impacts, and the test of the same damage."""
    spectra, without, shocks = found.with_stops, found.without_stops, found.shocks
    shown = {
        f"rms ({ACCELERATION})": (spectra.response_rms, ACCELERATION),
        f"largest ({ACCELERATION})": (spectra.extreme_response, ACCELERATION),
        "damage": (spectra.fatigue_damage, NUMBER),
    }
    if (
        without is not None
        and found.damage_ratio is not None
        and found.impacts_per_hour is not None
        and not found.unseen
    ):
        shown |= {
            f"rms, no stops ({ACCELERATION})": (without.response_rms, ACCELERATION),
            f"largest, no stops ({ACCELERATION})": (without.extreme_response, ACCELERATION),
            "times the damage": (found.damage_ratio, NUMBER),
        }
    shown[f"equivalent ({DENSITY})"] = (found.equivalent_density, DENSITY)
    of_impacts = {} if shocks is None else {
        f"typical impact ({ACCELERATION})": ACCELERATION(shocks.typical),
        f"worst of 100 ({ACCELERATION})": ACCELERATION(shocks.worst),
    }  # fmt: skip
    title = (
        f"equipment at {found.at}, Q = {found.quality:g}, b = {found.exponent:g}, in a mission of "
        f"{spoken_mission(found.mission)}"
    )
    rows = [
        {"Hz": found.equipment_frequency_hz[k]}
        | {words: plus_minus(values.at(k), of) for words, (values, of) in shown.items()}
        | {words: f"{values[k]:.3g}" for words, values in of_impacts.items()}
        for k in _spread(len(found.equipment_frequency_hz), ROWS)
    ]
    lines, test = hits_in_words(found), []
    if found.test is not None:
        test = [_test_section(found, found.test)]
        duration = spoken_mission(found.test.duration)
        lines.append(f"random test of {duration}: {found.test.summary()}")
    return told_of(
        found, Grid.of(title, rows, words=0), (), *test,
        verdict=capital(found.summary()), statements=[*map(capital, lines)], brief=True,
    )  # fmt: skip


def _spread(count: int, most: int) -> list[int]:
    """At most so many of the numbers below a count, evenly spread."""
    return [int(k) for k in np.unique(np.linspace(0, count - 1, min(count, most)).round())]


def _test_section(found: Damage, test: TailoredTest) -> Section:
    """The profile of a test."""
    title = (
        f"random test of {spoken_mission(test.duration)} with the damage of "
        f"{spoken_mission(found.mission)}, at {test.exaggeration:.3g} times the rms"
    )
    points = {"Hz": test.frequency_hz, "density": test.density}
    return Section(grids=Grid.of(title, rows_of(points), "Hz; density {(m/s^2)^2/Hz .3g}", 0))


def hits_in_words(found: Damage) -> list[str]:
    """Sentences on the impacts, their energy and accelerations."""
    several = len(found.provenance.get("scene", {}).get("phase", ())) > 1
    impacts = "impacts, mean over the mission:" if several else "impacts:"
    energy = f" {ENERGY}/kg" if found.scene_without_mass else f" {ENERGY}"
    lines = [
        f"{words} {_hourly(quantity(estimate))}{unit} per {HOURLY.time}"
        for words, estimate, quantity, unit in (
            (impacts, found.impacts_per_hour, NUMBER, ""),
            ("impacts bring", found.impact_work_per_hour, ENERGY, energy),
            ("impacts lose", found.impact_loss_per_hour, ENERGY, energy),
        )
        if estimate is not None and not (found.unseen and quantity is ENERGY)
    ]
    lines += [
        f"contacts above {ACCELERATION.text(float(level))}: {_hourly(estimate)} per {HOURLY.time}"
        for level, estimate in found.contacts_above.items()
    ]
    return lines


def _hourly(per_hour: Estimate) -> str:
    """A rate, per hour, in the unit of rates that is shown."""
    return plus_minus(per_hour / 3600.0, HOURLY)


EQUIPMENT = FREQUENCY._replace(words="natural frequency of the equipment")


def plot_damage(found: Damage, ax: Axes | None = None) -> Axes:
    """Extreme response and shocks, fatigue damage, and the density that does the same damage. Given
    Axes get the first alone."""
    mission = spoken_mission(found.mission)
    title = f"equipment at {found.at}, Q = {found.quality:g}, in a mission of {mission}"
    draw = [partial(each, found) for each in (_draw_extremes, _draw_fatigue, _draw_equivalent)]
    return panels(ax, draw, (7.2, 8.4), title)


def _draw_extremes(found: Damage, ax: Axes) -> None:
    """Expected largest acceleration of the equipment with the range of 95 % of missions, rms, and
    shock spectra of impacts."""
    f, spectra, without = found.equipment_frequency_hz, found.with_stops, found.without_stops
    chart = Chart(ax, EQUIPMENT, Scale("acceleration of\nthe equipment", ACCELERATION, log=True))
    largest, low, high = "largest of the record", None, None
    if found.way != "record":  # one record has no scatter
        largest = "expected largest, and that of 95 % of missions"
        low, high = spectra.extreme_lower, spectra.extreme_upper
    chart.curve(f, spectra.extreme_response.value, largest, WITH, low=low, high=high)
    if without is not None and without is not spectra:
        chart.curve(f, without.extreme_response.value, "without stops", WITHOUT)
    if found.shocks is not None:
        chart.curve(f, found.shocks.worst, "worst of 100 impacts", SHOCK, "--")
        chart.curve(f, found.shocks.typical, "typical impact", SHOCK, ":")
    chart.curve(f, spectra.response_rms.value, "rms", WITH, "-.")
    chart.finish(3)


def _draw_fatigue(found: Damage, ax: Axes) -> None:
    """Fatigue damage spectrum with its 95 % intervals, with stops and without."""
    damage = Scale(f"fatigue damage\n(m/s)^{found.exponent:g}", log=True)
    chart = Chart(ax, EQUIPMENT, damage)
    _draw_values(chart, found, found.with_stops.fatigue_damage, "with stops", WITH)
    if found.without_stops is not None and found.without_stops is not found.with_stops:
        _draw_values(chart, found, found.without_stops.fatigue_damage, "without stops", WITHOUT)
    chart.finish(3)


def _draw_equivalent(found: Damage, ax: Axes) -> None:
    """The density that does the same damage without stops, and the test that was asked for."""
    chart = Chart(ax, EQUIPMENT, Scale("equivalent one-sided\ndensity", DENSITY, log=True))
    _draw_values(chart, found, found.equivalent_density, "same damage without stops", WITH)
    if (test := found.test) is not None:
        words = f"test of {spoken_mission(test.duration)}"
        chart.curve(test.frequency_hz, test.density, words, SHOCK, marker="o", markersize=3)
    chart.finish(3)


def _draw_values(
    chart: Chart, found: Damage, values: SpectrumValues, label: str, colour: str
) -> None:
    """A spectrum with its 95 % intervals."""
    half = values.half_width_95()
    low = np.maximum(values.value - half, 1e-3 * values.value)
    f = found.equipment_frequency_hz
    chart.curve(f, values.value, label, colour, low=low, high=values.value + half)


# ------------------------------------------------------------------------------
# The bumper map on a terminal, and its picture.
# ------------------------------------------------------------------------------


SIZE = (10.0, 7.6)
"""Size of the picture, inches."""

LINES = 7
"""Number of lines of equal values in a panel."""

CORNERS = 4
"""Number of clearances, and of stiffnesses, of the table on a terminal; the file has all."""


class Panel(NamedTuple):
    """A quantity of the map in words, and what stands behind its unit."""

    name: str
    words: str
    quantity: ShownQuantity
    more: str = ""


def panels_of(found: BumperMap) -> list[Panel]:
    """The four panels of the picture."""
    per = "/kg" if found.scene_without_mass else ""
    return [
        Panel("peak_acceleration", "peak acceleration", ACCELERATION),
        Panel("pad_force", "largest force on a stop", FORCE, per),
        Panel("rattle_space", "travel per side", LENGTH),
        Panel("energy_per_hit", "mean energy of an impact", ENERGY, per),
    ]


def bumper_map_told(found: BumperMap) -> Told:
    """The quantities at some points, and the best one."""
    times = f"stiffness ({STIFFNESS})" if _in_units(found) else "stiffness, times"
    rows, columns = found.feasible.shape
    shown = [
        {
            f"clearance ({LENGTH})": f"{LENGTH(found.clearance[at[0]]):.3g}",
            times: f"{_stiffness(found)[at[1]]:.3g}",
            **{each.quantity.heading(each.words, each.more): _one_point(found, each, at)
               for each in panels_of(found)},
            **({"limits": _verdict(found, at)} if found.limits else {}),
        }
        for at in product(_spread(rows, CORNERS), _spread(columns, CORNERS))
    ]  # fmt: skip
    left = rows * columns - len(shown)
    more = f"; {left} more points in map.csv of --out" if left else ""
    cost = f"cost: {found.cost.wall_time:.3g} s on {found.cost.threads} threads"
    told = told_of(
        found,
        Grid.of(f"exceeded in {_risk(found)}{more}", shown, words=0),
        footer=[cost],
        brief=True,
    )
    return replace(told, statements=[*told.statements, no_tolerances(found.left_out)])


def _verdict(found: BumperMap, at: tuple[int, int]) -> str:
    """Whether a point keeps the limits, as far as its errors tell."""
    if found.feasible[at]:
        return "kept"
    return "exceeded" if found.exceeded[at] else "not shown"


def _risk(found: BumperMap) -> str:
    return f"{spoken_percent(found.exceedance)} of missions of {spoken_mission(found.mission)}"


def _in_units(found: BumperMap) -> bool:
    return found.stiffness is not None


def _stiffness(found: BumperMap) -> Matrix:
    return found.stiffness_factor if found.stiffness is None else STIFFNESS(found.stiffness)


def _one_point(found: BumperMap, panel: Panel, at: tuple[int, int]) -> str:
    """A value with its errors."""
    values = getattr(found, panel.name)
    value = float(values.value[at])
    if not np.isfinite(value):
        return "not known"
    if not found.impact_speed.value[at] > 0.0:
        untouched = "no contact" if panel.name == "pad_force" else f"{panel.quantity(value):.3g}"
        return untouched if panel.name != "energy_per_hit" or value else "no contact"
    return plus_minus(values.at(at), panel.quantity)


def plot_bumper_map(found: BumperMap, ax: Axes | None = None) -> Axes:
    """Peak acceleration, force, rattle space and energy over clearance and stiffness, each with
    what the limits leave. Given Axes get the peak acceleration alone."""
    draw = [partial(_draw_panel, found, panel) for panel in panels_of(found)]
    title = f"exceeded in {_risk(found)}; mean energy"
    return panels(ax, draw, SIZE, title, columns=2, sharex=True, sharey=True)


def _draw_panel(found: BumperMap, panel: Panel, ax: Axes) -> None:
    """One quantity in colours, with lines of equal values; what exceeds a limit is hatched,
    and dotted where that is not known."""
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

    values = panel.quantity(getattr(found, panel.name).value.T)
    x, y = LENGTH(found.clearance), _stiffness(found)
    stiffness = "stiffness of a stop"
    stiffness = STIFFNESS.heading(stiffness) if _in_units(found) else f"{stiffness}, times its own"
    ax.set(xlabel=f"clearance per side ({LENGTH})", ylabel=stiffness)
    known = np.ma.masked_invalid(np.where(values > 0.0, values, np.nan))
    low, high = float(known.min()), float(known.max())
    wide = high > 3.0 * low
    norm = LogNorm(low, high) if wide else Normalize(low, high)
    mesh = ax.pcolormesh(x, y, known, norm=norm, cmap="viridis", shading="nearest", rasterized=True)
    levels = (np.geomspace if wide else np.linspace)(low, high, LINES + 2)[1:-1]
    levels = np.unique([float(f"{level:.2g}") for level in levels])
    if min(values.shape) > 1:
        lines = ax.contour(x, y, known, levels=levels, colors="white", linewidths=0.7)
        ax.clabel(lines, fmt="%g", fontsize=7)
        if found.limits:
            outside = (~found.feasible.T).astype(float)
            beyond = np.where(found.exceeded.T, outside, 0.0)
            for area, hatch in ((beyond, "////"), (outside - beyond, "..")):
                ax.contourf(x, y, area, levels=[0.5, 1.5], colors="none", hatches=[hatch])
            ax.contour(x, y, outside, levels=[0.5], colors="black", linewidths=1.4)
    if (best := found.best) is not None:
        ax.plot(
            LENGTH(best.clearance), y[best.column], "*", markersize=13, markeredgecolor="black",
            color=CLEARANCES["three_sigma"], label="least travel",
        )  # fmt: skip
        if panel.quantity is ACCELERATION:  # the first panel tells it for all
            ax.legend(fontsize="small", markerscale=0.7)
    ax.set_yscale("log")
    plain_ticks(ax)
    limit = found.limits.get(panel.name)
    most = "" if limit is None else f", at most {panel.quantity(limit):.4g}"
    ax.set_title(panel.quantity.heading(panel.words, panel.more + most), fontsize="medium")
    bar = ax.figure.colorbar(mesh, ax=ax)
    bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)) if wide else MaxNLocator(6))
    bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.ax.yaxis.set_minor_formatter(NullFormatter())


# ------------------------------------------------------------------------------
# Spectra and statistics of impacts on a terminal.
# ------------------------------------------------------------------------------


def spectrum_told(found: ResponseSpectrum) -> Told:
    """The peak of each spectrum and the meanings of the spectra."""
    title = "at the peak of each spectrum, one-sided per hertz"
    return told_of(
        found,
        Grid.of(title, found.peaks(), words=("of", "quantity", "unit")),
        [f"{name}: {meaning}" for name, meaning in found.meanings.items()],
    )


SPAN = "{lower:.4g} to {upper:.4g}"
"""The interval of a rate in words."""


def impacts_told(found: ImpactStatistics, mission: float | None = None) -> Told:
    """The rates of impacts with their intervals, and the impacts in a mission, s."""
    title = "impacts, with 95 % intervals of the rates"
    return told_of(
        found,
        Grid.of(
            title,
            in_chosen_units(found.to_frame()),
            "of; quantity; value = number; 95 % interval = interval; by; unit",
            ("of", "quantity", "by", "unit"),
            number=lambda row: plus_minus(estimate_of(row)),
            interval=lambda row: (
                f"{row['lower']:.4g} to {row['upper']:.4g}"
                if row["lower"] == row["lower"]
                else None
            ),
        ),
        [] if mission is None else [_in_mission(found, mission)],
    )


def _in_mission(found: ImpactStatistics, mission: float) -> str:
    """The mean number of impacts of each pair in a mission, s, with its 95 % interval: the rate
    times the time, of a motion that is stationary from the start."""
    sentences = []
    for name, pair in found.pairs.items():
        rate = pair.rates["both"]
        low, high = rate.lower * mission, rate.upper * mission
        mean = f"{rate.estimate.value * mission:.4g} ({low:.4g} to {high:.4g})"
        number = f"at most {high:.4g}" if rate.estimate.value == 0.0 else mean
        sentences.append(f"{name}: {number} impacts in {spoken_mission(mission)}")
    return "; ".join(sentences)


# ------------------------------------------------------------------------------
# The risk of a mission, and its picture.
# ------------------------------------------------------------------------------


STARTS = {"rest": "rest", "stationary": "the stationary motion"}
"""The starts of a mission in words."""

SMALLEST_DRAWN = 1e-9
"""Share of the largest probability below which the probability of a phase is left out of the
picture."""


def reliability_told(found: Reliability) -> Told:
    """The probabilities with their intervals, how each was found, and the expected impacts."""
    mission, chances = spoken_mission(found.mission), list(found.chances.values())
    hits = f"expected impacts in {mission}: {found.hits_in_words()}"
    lines = [] if found.hits is None else [hits]
    which = "{0.words}: {0.why}" if len(chances) > 1 else "{0.why}"
    lines += [which.format(each) for each in chances if each.way in ("phases", "levels")]
    if found.gaps:
        name, most = next(iter(found.gaps.items()))
        likely = chance_in_words(most.probability)
        lines.append(f"most likely of {len(found.gaps)} gaps: {name}, alone {likely}")
    if len(found.pairs) > 1:
        share = max((each.share_of_first_hits, name) for name, each in found.pairs.items())
        lines.append(f"first impacts: {spoken_percent(share[0])} of them on {share[1]}")
    placed = [each.words for each in chances if each.limit and hardness_of(each.event).has_place]

    def of_phase(name: str, phase: Reliability) -> dict[str, object]:
        known = {each.words: each.likely for each in phase.chances.values()}
        hits = None if phase.hits is None else phase.hits.value
        return {"phase": name, "mission": phase.mission, **known, "expected_impacts": hits}

    events = [each.words for each in chances]
    tables = [
        Grid.of(
            "How each probability was found",
            chances,
            "event = words; way {way}; probability = likely; interval; "
            "bias of the step = bias {likely}; missions, records or repetitions = trials {count}; "
            "CPU s = seconds {.2g}; as whole missions = crude_seconds {.2g}",
            2,
            bias=lambda chance: chance.estimate.bias,
        ),
        Grid.of(
            "Phase by phase",
            [of_phase(*each) for each in found.phases.items()],
            ["phase", "duration = mission {mission}", *((words, words, "1") for words in events),
             "expected_impacts {count}"],
        ),
        Grid.of(
            "Pair by pair: the probability of an impact if this pair alone had stops, and its "
            "share of the first impacts of a mission; its expected impacts there and their mean "
            "speed, with all stops where they are",
            found.pairs.items(),
            "pair = name; probability alone = alone; of first impacts = share_of_first_hits "
            "{percent}; expected impacts = expected_hits; mean speed = impact_speed_mean",
            alone=lambda _, risk: chance_of(risk.probability),
        ),
        Grid.of(
            f"Where {placed[-1] if placed else 'nothing'} occurs while a stop is touched",
            found.outputs.items(),
            "coordinate or point = name; probability = risk",
            risk=lambda _, risk: chance_of(risk),
        ),
    ]  # fmt: skip
    picture = Picture(lambda: plot_chances(found), f"Probabilities in {mission}, with intervals.")
    probabilities = Section(
        title="Probabilities",
        lead=f"Intervals at {100.0 * found.confidence:g} % hold the statistical errors alone; a "
        "probability that was never seen has an upper limit.",
        grids=[*chain(*tables)],
        pictures=[picture] if chances else [],
        notes=[f"{each.words}: {each.why}" for each in chances],
    )
    return told_of(
        found,
        verdict=found.verdict(),
        alarm=bool(found.missing),
        statements=[*map(capital, lines)],
        sections=[probabilities, *_gaps_told(found)],
        footer=[f"cost: {found.cost.wall_time:.3g} s on {found.cost.threads} threads"],
        brief=True,
    )


FIRST_GAPS = 10
"""Number of gaps that a terminal and a page list; a file holds all."""


def _gaps_told(found: Reliability) -> list[Section]:
    """The first of many gaps, each as if it alone could close."""
    mission, count = spoken_mission(found.mission), len(found.gaps)
    if not count:
        return []
    more = f", {FIRST_GAPS} of {count}" if count > FIRST_GAPS else ""
    rows = Grid.of(
        f"Gaps by the probability that they close in {mission}, each alone{more}",
        [*found.gaps.items()][:FIRST_GAPS],
        "gap = name; stop = side; distance = clearance; displacement_std; "
        "left at 3 sigma = left {length}; crossings {count}; probability {likely}; "
        "at_least {likely}; at_most {likely}",
        2,
        left=lambda _, gap: gap.clearance - 3.0 * gap.displacement_std,
    )
    picture = Picture(lambda: plot_gaps(found), f"The first gaps, with bounds, in {mission}.")
    return [Section(title="Gaps", grids=rows, pictures=[picture], asked=True)]


def plot_gaps(found: Reliability, ax: Axes | None = None) -> Axes:
    """The probabilities of the first gaps with their bounds on a logarithmic axis."""
    shown = [*found.gaps.items()][: 2 * FIRST_GAPS]
    words = (
        f"probability of a contact in {spoken_mission(found.mission)}, each gap alone, with bounds"
    )
    chart = listed(ax, [name for name, _ in shown], Scale(words, log=True))
    for row, (_, gap) in enumerate(shown):
        chart.across(
            row, gap.probability, max(gap.at_least, SMALLEST_DRAWN * gap.at_most), gap.at_most
        )
    return chart.finish()


def plot_chances(found: Reliability, ax: Axes | None = None) -> Axes:
    """Each probability with its interval on a logarithmic axis; an upper limit as an arrow. Those
    of phases stand below those of the whole mission."""
    drawn = [(chance.words, chance) for chance in found.chances.values()]
    least = SMALLEST_DRAWN * max((chance.upper for _, chance in drawn), default=0.0)
    drawn += [
        (f"{name}, {chance.words}", chance)
        for name, phase in found.phases.items()
        for chance in phase.chances.values()
        if chance.upper > least
    ]
    names = [textwrap.fill(f"{words}: {chance.likely}", LABEL_WIDTH) for words, chance in drawn]
    mission = spoken_mission(found.mission)
    chart = listed(ax, names, Scale(f"probability in {mission}", log=True), 0.45)
    for row, (_, chance) in enumerate(drawn):
        chart.across(row, chance.estimate.value or None, chance.lower, chance.upper)
    chart.ax.margins(x=0.2)
    return chart.finish()


LABEL_WIDTH = 28
"""Largest number of letters in a line of the name of an event."""
