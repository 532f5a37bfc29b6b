"""How every kind of answer is shown, and the pictures that its method `plot` draws."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stochvi.mathematics.units import LENGTH, MILLIRADIANS, SPEED, TIME, shown_as
from stochvi.results.base import ROTATIONS, DataFrame, unit_of
from stochvi.results.errors import StochviError
from stochvi.views.axes import (
    COLOURS,
    GRID_COLOUR,
    OWNERS,
    SCREEN,
    add_grid,
    add_title,
    around_shock,
    axes_or_new,
    in_style,
    legend_above,
    length_unit,
    owner_colours,
    plain_ticks,
    seconds_of,
    thinned,
)
from stochvi.views.pages import Grid, Told, told_of
from stochvi.views.sizing import plot_pairs_risk, plot_risk
from stochvi.views.tables import (
    NEGLIGIBLE,
    QUANTITY_NAMES,
    effects_in_words,
    relative_bias,
    relative_error,
    relative_half_width,
    value_with_error,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.isolators.jolt_response import Jolts
    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.methods.fokker_planck.transients import Transient
    from stochvi.methods.replay.recorded_motion import Replay
    from stochvi.results.base import PairResponse, Response, Result
    from stochvi.statistics.densities import AveragedBins, BandedDensity
    from stochvi.statistics.histories import History
    from stochvi.verification.check import Check, Explanation
    from stochvi.verification.testing.judging import Judgement

ROW_HEIGHT, LEAST_HEIGHT = 0.22, 1.6
"""Heights in inches: of a row in the picture of a list, and of everything around the rows."""

MOST_ROWS = 40
"""Largest number of rows of a list that a picture shows; they are those with the largest values."""

MOST_SCORE = 3.0
"""Scores above this multiple of the one that raises an alarm are drawn at the edge of the
picture."""


def plot(found: Result, ax: Axes | None = None, style: str = "screen") -> Axes:
    """Draw an answer, in `ax` or in a figure of its own; returns the first Axes.

    Where a figure has several panels, `ax` gets the first of them.
    """
    draw = function_of(view_of(found).plot)
    return in_style(style, lambda: draw(found, ax), ax)


def response_told(response: Response) -> Told:
    """Every quantity with its errors, then balances, effects, assumptions and cost."""
    estimates = response.estimates()
    # means are compared to the smallest standard deviation of a coordinate
    spreads = [each.value for (_, name), each in estimates.items() if name == "displacement_std"]
    rows = []
    for (owner, name), estimate in estimates.items():
        quantity = shown_as(unit_of(owner, name))
        mean = name == "displacement_mean"
        scale = quantity(min(spreads)) if mean and spreads else 0.0
        if abs(quantity(estimate).value) < NEGLIGIBLE * scale:  # nothing is relative to 0
            estimate = replace(estimate, value=0.0)
        row = [
            owner, QUANTITY_NAMES.get(name, name),
            value_with_error(quantity(estimate), scale, with_bias=False), str(quantity),
            relative_error(estimate.standard_error, estimate),
            "unknown" if estimate.bias is None else relative_bias(estimate),
            relative_half_width(estimate),
        ]  # fmt: skip
        rows.append(row)
    table = Grid(
        caption=response.method,
        headings=["of", "quantity", "value", "unit", "rel. error", "rel. bias", "95 % within"],
        rows=rows,
        words=("of", "quantity", "unit"),
    )
    balances = ", ".join(
        f"{name} {value_with_error(each) if each.standard_error else f'{each.value:.0e}'}"
        for name, each in response.identities.items()
    )
    notes = [f"{NO_BOUND}{reason}" for reason in _without_bound(response)]
    notes += [f"balances, relative to their largest term: {balances}"] if balances else []
    notes.append(f"simulated effects: {effects_in_words(response.effects)}")
    cost = response.cost
    price = f"cost: {cost.wall_time:.3g} s"
    if cost.steps:
        price += (
            f" on {cost.threads} threads (compilation {cost.compile_time:.2g} s apart), "
            f"{cost.steps:.3g} steps, {cost.impacts:.3g} impacts, {cost.paths} paths"
        )
    if cost.tenfold_wall_time is not None:
        price += f"; a tenth of the errors: about {cost.tenfold_wall_time:.2g} s"
    return told_of(response, [table], notes, verdict="", footer=[price])


NO_BOUND = "no error bound: "
"""Words in `Estimate.how` that precede the reason why an approximation has no error bound."""


def _without_bound(response: Response) -> list[str]:
    """The reasons why numbers that were not sampled have no error bound."""
    unbounded = [
        each.how
        for each in response.estimates().values()
        if each.bias is None and each.standard_error == 0.0 and each.upper_95 is None
    ]
    reasons = [
        how.partition(NO_BOUND)[2] or f"the error of {how.partition(';')[0]} is not known here"
        for how in unbounded
    ]
    return list(dict.fromkeys(reasons))


def plot_response(found: Response, ax: Axes | None = None) -> Axes:
    """The densities of a simulation, or of averaging, between the stops, with their bands.

    Other methods are drawn by the mean and one standard deviation of each coordinate and gap, with
    the rates and mean speeds of impacts.
    """
    with contextlib.suppress(
        StochviError, ValueError
    ):  # without its scene an answer has no densities
        if densities := found.densities():
            return _plot_densities(found, densities, ax)
    rows: list[tuple[str, Any, Any]] = [
        (name, each.displacement_mean, each.displacement_std)
        for name, each in found.coordinates.items()
        if each.displacement_std
    ]
    rows += [
        (f"gap of {name}", pair.relative_displacement_mean, pair.relative_displacement_std)
        for name, pair in found.impact_pairs.items()
        if pair.relative_displacement_std
    ]
    pairs = found.provenance.get("scene", {}).get("impact_pair", [])
    single = len(found.coordinates) == 1
    ax = axes_or_new(ax, (8.0, 1.6 + 0.6 * max(len(rows), 1)))
    size = max((abs(float(mean or 0.0)) + float(std) for _, mean, std in rows), default=1.0)
    turns = any(name in ROTATIONS for name, _, _ in rows)
    unit, length = (LENGTH.shown.si, str(LENGTH)) if turns else length_unit(size)
    for row, (name, mean, std) in enumerate(rows):
        own_unit, own_name = (1e-3, "mrad") if name in ROTATIONS else (unit, length)
        centre, spread = float(mean or 0.0) / own_unit, float(std) / own_unit
        ax.barh(row, 2.0 * spread, left=centre - spread, height=0.3, color=COLOURS["simulate"],
                alpha=0.35)  # fmt: skip
        ax.plot(centre, row, "o", color=COLOURS["simulate"])
        ax.annotate(
            f"{value_with_error(std / own_unit)} {own_name}", (centre, row - 0.2), ha="center",
            va="bottom", fontsize="small",
        )  # fmt: skip
        for pair in pairs:
            own = name in (pair.get("on"), f"gap of {pair.get('name')}")
            if own or (single and not pair.get("between")):
                _draw_stops_of(
                    found.impact_pairs.get(pair.get("name", "stops")), pair, row, unit, ax
                )
    _label_rows(ax, [name for name, _, _ in rows])
    ax.margins(x=0.8 if pairs else 0.1)  # room for the words beside the stops
    rotations = ", rotations in mrad" if turns else ""
    ax.set_xlabel(f"displacement, mean and one standard deviation ({length}{rotations})")
    ax.set_title(found.method, fontsize="medium")
    return ax


def _plot_densities(
    found: Response, densities: Mapping[str, BandedDensity | AveragedBins], ax: Axes | None
) -> Axes:
    """Densities in bins with their bands, the stops of each as dashed lines."""
    ax = axes_or_new(ax)
    size = max(float(np.abs(each.edges).max()) for each in densities.values())
    unit, length = length_unit(size)
    pairs = {
        pair.get("name", "stops"): pair
        for pair in found.provenance.get("scene", {}).get("impact_pair", [])
    }
    colours = owner_colours(len(densities))
    for (name, each), colour in zip(densities.items(), colours, strict=True):
        low, high = each.bands()
        edges = each.edges / unit
        pair = next(iter(pairs)) if len(pairs) == 1 else name
        words = [name, *_of_motion(found, name, pair, unit, length)]
        ax.stairs(high * unit, edges, baseline=low * unit, fill=True, color=colour, alpha=0.3)
        ax.stairs(each.density * unit, edges, color=colour, label=", ".join(words))
        for side in ("lower", "upper"):
            place = pairs.get(pair, {}).get(side)
            if isinstance(place, int | float):
                ax.axvline(place / unit, color=colour, linestyle="--", linewidth=1.0)
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel(f"displacement ({length}), stops dashed")
    bands = "95 % bands" if found.method == "simulate" else "bands of its error"
    ax.set_ylabel(f"probability density (1/{length}), {bands}")
    legend_above(ax, 1, title=found.method)
    return ax


def _of_motion(found: Response, name: str, pair: str, unit: float, length: str) -> list[str]:
    """The standard deviation of a motion, and the impacts of its pair, in words."""
    hits = found.impact_pairs.get(pair)
    std = None if hits is None else hits.relative_displacement_std
    if name in found.coordinates:
        std = found.coordinates[name].displacement_std
    words = [] if std is None else [f"std {float(std) / unit:.4g} {length}"]
    if hits is not None and hits.collision_rate is not None:
        words.append(f"{value_with_error(hits.collision_rate)} impacts/s")
    return words


def _draw_stops_of(
    hits: PairResponse | None, pair: Mapping[str, Any], row: int, unit: float, ax: Axes
) -> None:
    """The stops of a pair in a row of a list, with the rate of their impacts, and the mean
    speed."""
    for side, align in (("lower", "right"), ("upper", "left")):
        place = pair.get(side)
        if place is None:
            continue
        ax.plot([place / unit] * 2, [row - 0.38, row + 0.38], color=COLOURS["stop"], linewidth=5)
        rate = getattr(hits, f"collision_rate_{side}", None)
        speed = hits.impact_speed_mean if hits is not None else None
        words = [] if rate is None else [value_with_error(rate), "impacts/s"]
        words += [] if speed is None or rate is None else [f"mean {float(speed):.2g} m/s"]
        ax.annotate(
            "\n".join(words), (place / unit, row), xytext=(8 if side == "upper" else -8, 0),
            textcoords="offset points", ha=align, va="center", fontsize="x-small",
        )  # fmt: skip


def _stops(provenance: Mapping[str, Any], coordinate: str, coordinates: int) -> list[float]:
    """Positions (m) of the stops of a coordinate in the scene that an answer is of."""
    pairs = provenance.get("scene", {}).get("impact_pair", [])
    own = [
        pair
        for pair in pairs
        if pair.get("on") == coordinate
        or (coordinates == 1 and not pair.get("on") and not pair.get("between"))
    ]
    return [pair[side] for pair in own for side in ("lower", "upper") if pair.get(side) is not None]


def plot_check(found: Check, ax: Axes | None = None) -> Axes:
    """Difference of every comparison that is judged, over that at which an alarm is raised."""
    rows = {
        f"{row.quantity} of {row.of}, {row.method}": row.difference / row.tolerance
        for row in found.comparisons
        if row.tolerance
    }
    return _plot_scores(rows, 1.0, "largest that agrees", ax)


def plot_judgement(found: Judgement, ax: Axes | None = None) -> Axes:
    """Difference over its standard error of every finding, and where an alarm is raised."""
    rows = {
        f"{row.quantity}, {row.scene}": row.score for row in found.findings if row.score is not None
    }
    return _plot_scores(rows, found.z, f"standard error (alarm at {found.z:.2f})", ax)


def _plot_scores(known: Mapping[str, float], z: float, over: str, ax: Axes | None) -> Axes:
    shown = sorted(known, key=lambda name: -abs(known[name]))[:MOST_ROWS]
    ax = _list(ax, len(shown))
    reach = MOST_SCORE * z
    for row, name in enumerate(shown):
        score = float(np.clip(known[name], -reach, reach))
        alarm = abs(known[name]) > z
        ax.plot(
            score,
            row,
            "o" if abs(score) < reach else "<>"[score > 0.0],
            color=COLOURS["linearise:closure" if alarm else "simulate"],
            clip_on=False,
        )
    for side in (-z, z):
        ax.axvline(side, color=COLOURS["linearise:closure"], linestyle="--", linewidth=1.0)
    ax.axvline(0.0, color=COLOURS["stop"], linewidth=0.8)
    ax.set_xlim(-reach, reach)
    _label_rows(ax, shown)
    ax.set_xlabel(f"difference / {over}")
    return ax


def plot_explanation(found: Explanation, ax: Axes | None = None) -> Axes:
    """Predicted time of a simulation against the relative error that is asked for."""
    seconds = {} if found.simulation is None else found.simulation.seconds
    known = {error: time for error, time in seconds.items() if time is not None}
    ax = axes_or_new(ax)
    if known:
        errors = sorted(known)
        ax.loglog(
            [100.0 * error for error in errors],
            [known[error] for error in errors],
            "o-",
            color=COLOURS["simulate"],
        )
    else:
        ax.text(0.5, 0.5, "no simulation was predicted", transform=ax.transAxes, ha="center")
    ax.set_xlabel("relative error asked for (%)")
    ax.set_ylabel("predicted time (s)")
    plain_ticks(ax)
    add_grid(ax)
    return ax


def plot_transient(found: Transient, ax: Axes | None = None) -> Axes:
    """Mean displacement and one standard deviation about it against time."""
    ax = axes_or_new(ax)
    mean, std = found.values.mean, np.sqrt(found.values.variance)
    unit, name = length_unit(float(np.max(np.abs(mean) + std)))
    ax.fill_between(
        TIME(found.times),
        (mean - std) / unit,
        (mean + std) / unit,
        alpha=0.3,
        color=COLOURS["fokker-planck"],
        label="one standard deviation",
    )
    ax.plot(TIME(found.times), mean / unit, "o-", color=COLOURS["fokker-planck"], label="mean")
    ax.set_xlabel(f"time ({TIME})")
    ax.set_ylabel(f"displacement ({name})")
    add_grid(ax)
    ax.legend(frameon=False)
    return ax


def plot_motion(found: History, ax: Axes | None = None) -> Axes:
    """Displacement of each coordinate around the fastest impact, with its stops."""
    ax = axes_or_new(ax, (9.6, 4.2))
    names = list(found.coordinates)
    several = len(names) > 1
    columns = [f"{name}.displacement_m" if several else "displacement_m" for name in names]
    time, hits = found.samples["time_s"].to_numpy(), found.impacts
    shock = None
    if len(hits):
        shock = float(hits["time_s"].iloc[int(hits["speed_m_s"].to_numpy().argmax())])
    part = around_shock(time, found.samples[columns[0]].to_numpy(), shock)
    shown = {
        name: found.samples[column].to_numpy()[part]
        for name, column in zip(names, columns, strict=True)
    }
    moved = [float(np.abs(x).max()) for name, x in shown.items() if name not in ROTATIONS]
    unit, length = length_unit(max(moved, default=1.0))
    for colour, (name, each) in zip(OWNERS, shown.items(), strict=False):
        turns = name in ROTATIONS
        t, x = thinned(TIME(time[part]), MILLIRADIANS(each) if turns else each / unit)
        label = f"{name} ({MILLIRADIANS})" if turns else name
        ax.plot(t, x, color=colour, linewidth=1.1, label=label)
        for number, place in enumerate(_stops(found.provenance, name, len(names))):
            words = f"stops{f' of {name}' * several}" if number == 0 else None
            ax.axhline(place / unit, color=COLOURS["stop"], linewidth=2.0, label=words)
    ax.margins(x=0.0)
    ax.set_xlabel(seconds_of(part, time))
    ax.set_ylabel(f"displacement ({length})")
    add_grid(ax)
    if len(ax.get_legend_handles_labels()[0]) > 1:
        legend_above(ax, 4)
    return ax


def plot_replay(found: Replay, ax: Axes | None = None) -> Axes:
    """x(t) at one clearance, where its samples were kept; else impacts and speeds over
    clearances."""
    single = found.only
    if single is None or single.histories is None:
        return function_of("verification:plot_clearances")(found, ax)  # type: ignore[no-any-return]
    return function_of("verification:plot_history")(single, ax)  # type: ignore[no-any-return]


def plot_jolts(found: Jolts, ax: Axes | None = None) -> Axes:
    """Share of paths that perturbations throw into clatter, with exact 95 % intervals."""
    ax = axes_or_new(ax)
    rows = found.to_frame()
    share = rows["captured"]
    bars = [share - rows["captured_low"], rows["captured_high"] - share]
    ax.errorbar(
        SPEED(rows["jolt"]), share, yerr=bars, fmt="o-", capsize=3, color=COLOURS["simulate"]
    )
    ax.set_ylim(0.0, 1.05)
    ax.set_xlabel(f"perturbation of the velocity ({SPEED})")
    ax.set_ylabel("share captured by clatter")
    add_grid(ax)
    return ax


def plot_sizing(sizing: Sizing, ax: Axes | None = None) -> Axes:
    """Risk against the clearance of one gap, or against those of several."""
    return (plot_pairs_risk if sizing.several else plot_risk)(sizing, ax)


class View(NamedTuple):
    """How an answer of a class is shown, by names of functions of this room as "file:name".

    They are imported when they are needed.
    """

    plot: str
    """The picture that `plot` draws, of the answer and Axes or None."""
    told: str = ""
    """What describes it; empty for an answer of no command."""
    file: str = ""
    """Name of its table and picture in a folder, without their endings; empty for neither."""
    drawn: str | None = ""
    """The picture in a folder, where it is another one; None for no picture."""
    titled: bool = False
    """Whether that picture bears the title of the scene."""
    has_picture: Callable[[Any], bool] = lambda found: True
    """Whether this answer has something to draw."""
    tables: Callable[[Any], dict[str, DataFrame]] = lambda found: {}
    """Other tables by their files."""
    report: str = ""
    """What writes its page, of the answer, a folder, an origin and what stands beside it."""

    def files(self, found: Any) -> dict[str, DataFrame]:
        """All tables of an answer by their files."""
        return ({self.file: found.to_frame()} if self.file else {}) | self.tables(found)

    def tell(self, found: Any, **words: Any) -> Told:
        """The description of an answer; `words` are for it alone."""
        told: Told = function_of(self.told)(found, **words)
        return told

    def draw(self, found: Any, title: str) -> Axes:
        """The picture of an answer in a folder, under the title of its scene."""
        drawn: Axes = function_of(self.drawn or self.plot)(found)
        return add_title(drawn, title) if self.titled else drawn


def view_of(found: Any) -> View:
    """How an answer is shown, by its class or one that it derives from."""
    for kind in type(found).__mro__:
        if kind.__name__ in VIEWS:
            return VIEWS[kind.__name__]
    raise NotImplementedError(f"there is no picture of {type(found).__name__}; use to_frame()")


def function_of(place: str) -> Any:
    """The function of this room that "file:name" names."""
    file, _, name = place.partition(":")
    return getattr(import_module(f"stochvi.views.{file}"), name)


VIEWS = {
    "AbsorberReport": View(
        "absorbers:draw_levels",
        "absorbers:absorber_told",
        "absorber",
        report="absorbers:write_absorber_report",
    ),
    "AbsorberSine": View(
        "absorbers:plot_absorber_sine",
        "absorbers:absorber_sine_told",
        "absorber-sine",
        report="absorbers:write_absorber_report",
    ),
    "Basins": View("sine:plot_basins", "sine:basins_told", "basins"),
    "Bifurcation": View("sine:draw_bifurcation", "sine:bifurcation_told", "bifurcation"),
    "BumperMap": View(
        "statistics:plot_bumper_map",
        "statistics:bumper_map_told",
        "map",
        titled=True,
    ),
    "Check": View("pictures:plot_check", "verification:check_told", "check", None),
    "Checks": View("verification:draw_scores", "verification:checks_told", "check", None),
    "Damage": View(
        "statistics:plot_damage",
        "statistics:damage_told",
        "damage",
        titled=True,
        tables=lambda found: {} if found.test is None else {"profile": found.test.to_frame()},
    ),
    "DamageSizing": View(
        "isolator_tables:plot_damage_sizing",
        "isolator_tables:damage_sizing_told",
        "damage",
        report="report.missions:write_clearance_report",
    ),
    "Design": View(
        "absorbers:draw_design",
        "absorbers:design_told",
        "absorber-design",
        tables=lambda found: {"absorber-design": found.curve},
        report="absorbers:write_absorber_report",
    ),
    "Explanation": View(
        "pictures:plot_explanation", "verification:explanation_told", "methods", None
    ),
    "FirstPassage": View(
        "density:plot_first_passage", "density:first_passage_told", "first_passage", None
    ),
    "HarmonicResponse": View("sine:plot_sine", "sine:sine_told", "sine"),
    "History": View(
        "pictures:plot_motion",
        "density:history_told",
        "history",
        None,
        tables=lambda found: {"impacts": found.impacts},
    ),
    "Identification": View(
        "verification:plot_identification",
        "verification:identification_told",
        "identify",
        tables=lambda found: {"curve": found.curve},
    ),
    "ImpactStatistics": View(
        "statistics:plot_impacts",
        "statistics:impacts_told",
        "impacts",
        titled=True,
        tables=lambda found: {"histograms": found.histograms()},
        has_picture=lambda found: any(pair.speeds is not None for pair in found.pairs.values()),
    ),
    "Jolts": View("pictures:plot_jolts", "isolator_tables:jolts_told", "jolts", None),
    "Judgement": View("pictures:plot_judgement", "verification:judgement_told", "judge", None),
    "LifeTimes": View("sine:plot_lifetimes", "sine:lifetimes_told", "lifetimes"),
    "MissionSizing": View(
        "isolator_tables:plot_mission_sizing",
        "isolator_tables:clearance_told",
        "phases",
        report="report.missions:write_clearance_report",
    ),
    "Production": View("sizing:plot_production", "isolator_tables:production_told"),
    "Reliability": View(
        "statistics:plot_chances",
        "statistics:reliability_told",
        "reliability",
        None,
        report="report.missions:write_reliability_report",
    ),
    "Replay": View(
        "pictures:plot_replay",
        "verification:replay_told",
        "replay",
        "verification:draw_replay",
        titled=True,
        has_picture=lambda found: found.only is None or found.histories is not None,
        tables=lambda found: (
            {"impacts": found.impacts}
            | ({} if found.histories is None else {"histories": found.histories.to_frame()})
        ),
        report="report.missions:write_replay_report",
    ),
    "Response": View("pictures:plot_response", "pictures:response_told", "response", None),
    "ResponseSpectrum": View(
        "statistics:plot_spectrum", "statistics:spectrum_told", "spectrum", titled=True
    ),
    "Screening": View(
        "sizing:plot_screening",
        "isolator_tables:screening_told",
        "screening",
        has_picture=lambda found: bool(found.impact_pairs),
    ),
    "Sizing": View(
        "pictures:plot_sizing", "isolator_tables:sizing_told", report="report.sizing:write_report"
    ),
    "Stability": View("sine:plot_stability", "sine:stability_told", "stability"),
    "Transient": View("pictures:plot_transient"),
    "WorkPrecision": View("verification:plot_cost", "verification:cost_told", "cost", titled=True),
}
"""How each kind of answer is shown, by the name of its class: views do not import answers."""


def _list(ax: Axes | None, rows: int) -> Axes:
    """Axes for a list with this number of rows."""
    return axes_or_new(ax, (SCREEN[0], LEAST_HEIGHT + ROW_HEIGHT * max(rows, 1)))


def _label_rows(ax: Axes, names: Sequence[str]) -> None:
    ax.set_yticks(range(len(names)), names, fontsize="small")
    ax.set_ylim(len(names) - 0.5, -0.5)
    ax.grid(axis="x", color=GRID_COLOUR, linewidth=0.6)
    ax.set_axisbelow(True)
