"""How every kind of answer is shown, and the pictures that its method `plot` draws."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stochvi.mathematics.units import (
    LENGTH,
    MILLIRADIANS,
    PERCENT,
    SPEED,
    TIME,
    ShownQuantity,
    shown_as,
)
from stochvi.results.base import ROTATIONS, DataFrame, plain, unit_of
from stochvi.results.errors import StochviError
from stochvi.results.estimates import plus_minus
from stochvi.results.files import origin_of
from stochvi.views.axes import (
    BAND_ALPHA,
    COLOURS,
    Chart,
    Scale,
    add_title,
    density_of,
    in_style,
    length_of,
    listed,
    owner_colours,
)
from stochvi.views.files import to_json, write_report_page, write_text
from stochvi.views.pages import Grid, Told, told_of
from stochvi.views.tables import (
    NEGLIGIBLE,
    QUANTITY_NAMES,
    effects_in_words,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.isolators.jolt_response import Jolts
    from stochvi.methods.fokker_planck.transients import Transient
    from stochvi.methods.replay.recorded_motion import Replay
    from stochvi.results.base import PairResponse, Response, Result
    from stochvi.results.files import Origin
    from stochvi.statistics.densities import AveragedBins, BandedDensity
    from stochvi.statistics.histories import History
    from stochvi.verification.check import Check, Checks, Explanation
    from stochvi.verification.testing.judging import Judgement

MOST_ROWS = 40
"""Largest number of rows of a list that a picture shows; they are those with the largest values."""

MOST_SCORE = 3.0
"""Scores above this multiple of the one that raises an alarm are drawn at the edge of the
picture."""


def plot(found: Result, ax: Axes | None = None, style: str = "screen") -> Axes:
    """Draw an answer, in `ax` or in a figure of its own; returns the first Axes.

    Where a figure has several panels, `ax` gets the first of them.
    """
    return in_style(style, lambda: view_of(found).plots(found, ax), ax)


def response_told(response: Response) -> Told:
    """Every quantity with its errors, then balances, effects, assumptions and cost."""
    estimates = response.estimates()
    # means are compared to the smallest standard deviation of a coordinate
    spreads = [each.value for (_, name), each in estimates.items() if name == "displacement_std"]
    least = NEGLIGIBLE * min(spreads, default=0.0)
    rows = []
    for (owner, name), estimate in estimates.items():
        quantity = shown_as(unit_of(owner, name))
        vanishes = name == "displacement_mean" and abs(estimate.value) < least
        words = "0" if vanishes else plus_minus(estimate, quantity, 7)
        row = {"of": owner, "quantity": QUANTITY_NAMES.get(name, name), "value": words}
        # that of a number that was not sampled is its interval
        sampled = estimate.standard_error > 0.0 or estimate.bias is None
        bias = quantity(estimate).bias_in_words.removeprefix(", bias ") * sampled
        rows.append(row | {"unit": str(quantity), "bias": None if vanishes else bias or None})
    table = Grid.of(response.method, rows, words=("of", "quantity", "unit", "bias"))
    balances = ", ".join(
        f"{name} {plus_minus(each) if each.standard_error else f'{each.value:.0e}'}"
        for name, each in response.identities.items()
    )
    notes = _without_bound(response)
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
    return told_of(response, table, notes, verdict="", footer=[price])


NO_BOUND = "no error bound: "
"""Words in `Estimate.how` that precede the reason why an approximation has no error bound."""


def _without_bound(response: Response) -> list[str]:
    """Why numbers that were not sampled have no error bound, where others have one or none does."""
    of_theory = [
        each
        for each in response.estimates().values()
        if each.standard_error == 0.0 and each.upper_95 is None
    ]
    unbounded = [each.how for each in of_theory if each.bias is None]
    where = NO_BOUND
    if len(unbounded) < len(of_theory):
        where = NO_BOUND.replace(":", " where the bias is not known:")
    reasons = [
        how.partition(NO_BOUND)[2] or f"the error of {how.partition(';')[0]} is not known here"
        for how in unbounded
    ]
    return [f"{where}{reason}" for reason in dict.fromkeys(reasons)]


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
    sizes = [abs(float(mean or 0.0)) + float(std) for _, mean, std in rows]
    turns = any(name in ROTATIONS for name, _, _ in rows)
    length = LENGTH if turns else length_of(max(sizes, default=1.0))
    words = f"displacement{', rotations in mrad' * turns}"
    chart = listed(ax, [name for name, _, _ in rows], Scale(words, length), 0.6)
    for row, (name, mean, std) in enumerate(rows):
        own = chart._replace(x=Scale(name, MILLIRADIANS)) if name in ROTATIONS else chart
        centre, unit = float(mean or 0.0), own.x.quantity
        ends = centre - float(std), centre + float(std)
        own.bar(row, *ends, "mean and one standard deviation", height=0.3, alpha=0.35)
        own.across(row, centre, None, None)
        spread = f"{plus_minus(std, unit)} {unit}"
        own.note(spread, centre, row - 0.16, (0.0, 1.0), ha="center", va="bottom")
        for pair in _pairs_on(found, name):
            _draw_stops_of(chart, row, pair, found.impact_pairs.get(pair.get("name", "stops")))
    # room for the words beside the stops
    chart.ax.margins(x=0.8 if any(_pairs_on(found, name) for name, *_ in rows) else 0.1)
    return chart.finish(title=found.method)


def _plot_densities(
    found: Response, densities: Mapping[str, BandedDensity | AveragedBins], ax: Axes | None
) -> Axes:
    """Densities in bins with their bands, the stops of each as dashed lines."""
    length = length_of(max(float(np.abs(each.edges).max()) for each in densities.values()))
    pairs = {pair.get("name", "stops"): pair for pair in _pairs(found)}
    height = density_of(length)
    bands = "95 % bands" if found.method == "simulate" else "bands of its error"
    height = height._replace(words=f"{height.words}, {bands}")
    chart = Chart.on(ax, Scale("displacement, stops dashed", length), height)
    colours = owner_colours(len(densities))
    for (name, each), colour in zip(densities.items(), colours, strict=True):
        low, high = each.bands()
        pair = next(iter(pairs)) if len(pairs) == 1 else name
        words = ", ".join([name, *_of_motion(found, name, pair, length)])
        chart.stairs(each.edges, high, None, colour, low=low, fill=True, alpha=BAND_ALPHA)
        chart.stairs(each.edges, each.density, words, colour)
        for side in ("lower", "upper"):
            place = pairs.get(pair, {}).get(side)
            if isinstance(place, int | float):
                chart.at(place, None, colour, "--", linewidth=1.0)
    chart.ax.set_ylim(bottom=0.0)
    return chart.finish(1, title=found.method)


def _of_motion(found: Response, name: str, pair: str, length: ShownQuantity) -> list[str]:
    """The standard deviation of a motion, and the impacts of its pair, in words."""
    hits = found.impact_pairs.get(pair)
    std = None if hits is None else hits.relative_displacement_std
    if name in found.coordinates:
        std = found.coordinates[name].displacement_std
    words = [] if std is None else [f"std {length.text(float(std))}"]
    if hits is not None and hits.collision_rate is not None:
        words.append(f"{plus_minus(hits.collision_rate)} impacts/s")
    return words


def _draw_stops_of(
    chart: Chart, row: int, pair: Mapping[str, Any], hits: PairResponse | None
) -> None:
    """The stops of a pair in a row of a list, with the rate of their impacts, and the mean
    speed."""
    for side, align, shift in (("lower", "right", -8.0), ("upper", "left", 8.0)):
        if pair.get(side) is None:
            continue
        chart.stop(row, pair[side])
        rate = getattr(hits, f"collision_rate_{side}", None)
        speed = hits.impact_speed_mean if hits is not None else None
        words = [] if rate is None else [plus_minus(rate), "impacts/s"]
        words += [] if speed is None or rate is None else [f"mean {float(speed):.2g} m/s"]
        chart.note(
            "\n".join(words), pair[side], row, (shift, 0.0), ha=align, va="center",
            fontsize="x-small",
        )  # fmt: skip


def _pairs(found: Any) -> list[dict[str, Any]]:
    """The impact pairs of the scene that an answer is of, as its file states them."""
    pairs: list[dict[str, Any]] = found.provenance.get("scene", {}).get("impact_pair", [])
    return pairs


def _pairs_on(found: Any, name: str) -> list[dict[str, Any]]:
    """The pairs whose stops stand beside a coordinate, or a gap."""
    alone = len(found.coordinates) == 1
    return [
        pair
        for pair in _pairs(found)
        if name in (pair.get("on"), f"gap of {pair.get('name')}")
        or (alone and not pair.get("between"))
    ]


def plot_check(found: Check, ax: Axes | None = None) -> Axes:
    """Difference of every comparison that is judged, over that at which an alarm is raised."""
    rows = {
        f"{row.quantity} of {row.of}, {row.method}": row.difference / row.tolerance
        for row in found.comparisons
        if row.tolerance
    }
    return _plot_scores(rows, 1.0, "largest that agrees", ax)


def plot_checks(found: Checks, ax: Axes | None = None) -> Axes:
    """Difference over its standard error of the comparisons of all scenes that differ most."""
    from stochvi.verification.check import AGREES, DISAGREES

    table = found.to_frame()
    table = table[table["verdict"].isin([AGREES, DISAGREES]) & table["score"].notna()]
    rows = {
        f"{row['quantity']} of {row['of']}, {row['method']}, {row['scene']}": row["score"]
        for row in table.to_dict("records")
    }
    return _plot_scores(rows, found.z, f"standard error (alarm at {found.z:.2f})", ax)


def plot_judgement(found: Judgement, ax: Axes | None = None) -> Axes:
    """Difference over its standard error of every finding, and where an alarm is raised."""
    rows = {
        f"{row.quantity}, {row.scene}": row.score for row in found.findings if row.score is not None
    }
    return _plot_scores(rows, found.z, f"standard error (alarm at {found.z:.2f})", ax)


def _plot_scores(known: Mapping[str, float], z: float, over: str, ax: Axes | None) -> Axes:
    shown = sorted(known, key=lambda name: -abs(known[name]))[:MOST_ROWS]
    chart, reach = listed(ax, shown, Scale(f"difference / {over}"), 0.22), MOST_SCORE * z
    for row, name in enumerate(shown):
        score = float(np.clip(known[name], -reach, reach))
        form = "o" if abs(score) < reach else "<>"[score > 0.0]
        colour = COLOURS["linearise:closure" if abs(known[name]) > z else "simulate"]
        chart.ax.plot(score, row, form, color=colour, clip_on=False)
    for side in (-z, z):
        chart.at(side, None, "linearise:closure", "--")
    chart.at(0.0, linewidth=0.8)
    chart.ax.set_xlim(-reach, reach)
    return chart.finish()


def plot_explanation(found: Explanation, ax: Axes | None = None) -> Axes:
    """Predicted time of a simulation against the relative error that is asked for."""
    seconds = {} if found.simulation is None else found.simulation.seconds
    known = {error: time for error, time in sorted(seconds.items()) if time is not None}
    error = Scale("relative error asked for", PERCENT, log=True)
    chart = Chart.on(ax, error, Scale("predicted time", TIME, log=True))
    chart.curve(list(known), list(known.values()), marker="o")
    if not known:
        words = "no simulation was predicted"
        chart.ax.text(0.5, 0.5, words, transform=chart.ax.transAxes, ha="center")
    return chart.finish()


def plot_transient(found: Transient, ax: Axes | None = None) -> Axes:
    """Mean displacement and one standard deviation about it against time."""
    mean, std = found.values.mean, np.sqrt(found.values.variance)
    length = length_of(float(np.max(np.abs(mean) + std)))
    chart = Chart.on(ax, Scale("time", TIME), Scale("displacement", length))
    chart.curve(
        found.times, mean, "mean, and one standard deviation", "fokker-planck", marker="o",
        low=mean - std, high=mean + std,
    )  # fmt: skip
    return chart.finish()


def plot_motion(found: History, ax: Axes | None = None) -> Axes:
    """Displacement of each coordinate around the fastest impact, with its stops."""
    from stochvi.views.density import draw_motion, excerpt, hits_of

    names, samples = list(found.coordinates), found.samples
    columns = [f"{name}.displacement_m" if len(names) > 1 else "displacement_m" for name in names]
    curves = {name: samples[column].to_numpy() for name, column in zip(names, columns, strict=True)}
    stops = {
        f"{pair.get('name', 'stops')} {side}": pair[side]
        for name in names
        for pair in _pairs_on(found, name)
        for side in ("lower", "upper")
        if pair.get(side) is not None
    }
    time, hits = samples["time_s"].to_numpy(), hits_of(found)
    part = excerpt(time, curves[names[0]], hits)
    return draw_motion(ax, time, curves, stops, hits, part, size=(9.6, 4.2)).finish(4)


def plot_replay(found: Replay, ax: Axes | None = None) -> Axes:
    """x(t) at one clearance, where its samples were kept; else impacts and speeds over
    clearances."""
    single = found.only
    if single is None or single.histories is None:
        return function_of("verification", "plot_clearances")(found, ax)  # type: ignore[no-any-return]
    return function_of("verification", "plot_history")(single, ax)  # type: ignore[no-any-return]


def plot_jolts(found: Jolts, ax: Axes | None = None) -> Axes:
    """Share of paths that perturbations throw into clatter, with exact 95 % intervals."""
    jolt, share = Scale("perturbation of the velocity", SPEED), Scale("share captured by clatter")
    chart = Chart.on(ax, jolt, share)
    chart.column(found.to_frame(), "jolt", "captured", form="o-")
    chart.ax.set_ylim(0.0, 1.05)
    return chart.finish()


class View(NamedTuple):
    """How an answer of a class is shown: by `NAME_told` and `plot_NAME` of a file of this room, or
    of this file. They are imported when they are needed.
    """

    room: str
    name: str
    file: str = ""
    """Name of its table and picture in a folder, without their endings; empty for neither."""
    drawn: str | None = ""
    """The picture in a folder, where it is another one; None for no picture."""
    titled: bool = False
    """Whether that picture bears the title of the scene."""
    page: str = ""
    """What makes its page, of the answer, an origin and what stands beside it."""
    numbers: str = ""
    """Name of the JSON document beside the page."""
    beside: str = ""
    """What writes other files of its page, of the answer, a folder and what stands beside it."""
    plot: str = ""
    """The picture that `plot` draws of the answer and Axes or None, where it has another name."""
    has_picture: Callable[[Any], bool] = lambda found: True
    """Whether this answer has something to draw."""
    tables: Callable[[Any], dict[str, DataFrame]] = lambda found: {}
    """Other tables by their files."""
    pictures: Callable[[Any], dict[str, Callable[[], Axes]]] = lambda found: {}
    """Other pictures by their files."""

    def files(self, found: Any) -> dict[str, DataFrame]:
        """All tables of an answer by their files."""
        return ({self.file: found.to_frame()} if self.file else {}) | self.tables(found)

    def tell(self, found: Any, **words: Any) -> Told:
        """The description of an answer; `words` are for it alone."""
        told: Told = function_of(self.room, f"{self.name}_told")(found, **words)
        return told

    @property
    def plots(self) -> Callable[..., Axes]:
        """What draws an answer, in Axes or None."""
        drawn: Callable[..., Axes] = function_of(self.room, self.plot or f"plot_{self.name}")
        return drawn

    def draw(self, found: Any, title: str) -> Axes:
        """The picture of an answer in a folder, under the title of its scene."""
        drawn: Axes = (function_of(self.room, self.drawn) if self.drawn else self.plots)(found)
        return add_title(drawn, title) if self.titled else drawn


def view_of(found: Any) -> View:
    """How an answer is shown, by its class or one that it derives from."""
    for kind in type(found).__mro__:
        if kind.__name__ in VIEWS:
            return VIEWS[kind.__name__]
    raise NotImplementedError(f"there is no picture of {type(found).__name__}; use to_frame()")


def function_of(room: str, name: str) -> Any:
    """The function of this name in a file of the views, which the name may state, or in this."""
    file, _, name = name.rpartition(":")
    found = getattr(import_module(f"stochvi.views.{file or room}"), name, None)
    return globals()[name] if found is None else found


DOCUMENTED = ("record", "production", "sensitivity")
"""What stands beside an answer on its page, and in the document of the page, too."""


def write_report(
    found: Result, folder: str | Path, origin: Origin | None = None, **beside: Any
) -> Path:
    """Write `report.html`, its numbers in a JSON document, and other files of its page; returns the
    path of the page.

    The page needs no other file: pictures and style are embedded, and nothing is fetched.

    Parameters
    ----------
    found
        An answer that has a page.
    folder
        Folder for the files; it is made if it is missing.
    origin
        When, how and from what the page was made; by default a call from Python.
    **beside
        What stands beside the answer: the `review` of one mass, `sensitivity`, `production`,
        `record`, the `scene` and where it hangs (`hung`).
    """
    view, folder = view_of(found), Path(folder)
    if view.beside:
        function_of(view.room, view.beside)(found, folder, **beside)
    page = function_of(view.room, view.page)(
        found, origin=origin or origin_of(found.provenance), **beside
    )
    document = (beside.get("review") or found).to_dict()
    document |= {n: plain(beside[n]) for n in DOCUMENTED if beside.get(n) is not None}
    document["report"] = plain(page.origin)
    write_text(to_json(document) + "\n", folder / f"{view.numbers}.json")
    write_report_page(page.html(), folder / "report.html")
    return folder / "report.html"


VIEWS = {
    "AbsorberReport": View(
        "absorbers", "absorber", "absorber", page="performance_page", numbers="absorber",
        pictures=lambda found: (
            {"absorber-play": lambda: function_of("absorbers", "draw_plays")(found)}
            if found.play_curve
            else {}
        ),
    ),
    "AbsorberSine": View(
        "absorbers", "absorber_sine", "absorber-sine", page="sine_page", numbers="absorber"
    ),
    "Basins": View("sine", "basins", "basins"),
    "Bifurcation": View("sine", "bifurcation", "bifurcation"),
    "BumperMap": View("statistics", "bumper_map", "map", titled=True),
    "Check": View("verification", "check", "check", None),
    "Checks": View(
        "verification", "checks", "check", None, pictures=lambda found: {"scores": found.plot}
    ),
    "Damage": View(
        "statistics", "damage", "damage", titled=True,
        tables=lambda found: {} if found.test is None else {"profile": found.test.to_frame()},
    ),
    "DamageSizing": View(
        "isolator_tables", "damage_sizing", "damage", page="report.missions:damage_page",
        numbers="size", plot="sizing:plot_damage_sizing",
    ),
    "Design": View(
        "absorbers", "design", "absorber-design", page="design_page", numbers="absorber",
        tables=lambda found: {"absorber-design": found.curve},
    ),
    "Explanation": View("verification", "explanation", "methods", None),
    "FirstPassage": View("density", "first_passage", "first_passage", titled=True),
    "FoundShocks": View(
        "verification", "shocks", "shocks",
        tables=lambda found: (
            {f"shock-{number}": each for number, each in enumerate(found.cuts, 1)}
            | ({"quiet": found.quiet} if found.shocks else {})
        ),
    ),
    "HarmonicResponse": View("sine", "sine", "sine"),
    "History": View(
        "density", "history", "history", None, plot="plot_motion",
        tables=lambda found: {"impacts": found.impacts},
    ),
    "Identification": View(
        "verification", "identification", "identify", tables=lambda found: {"curve": found.curve}
    ),
    "ImpactStatistics": View(
        "statistics", "impacts", "impacts", titled=True,
        tables=lambda found: {"histograms": found.histograms()},
        has_picture=lambda found: any(pair.speeds is not None for pair in found.pairs.values()),
    ),
    "Jolts": View("isolator_tables", "jolts", "jolts", None),
    "Judgement": View("verification", "judgement", "judge", None),
    "LifeTimes": View("sine", "lifetimes", "lifetimes"),
    "Production": View("isolator_tables", "production", plot="sizing:plot_production"),
    "Reliability": View(
        "statistics", "reliability", "reliability", None, plot="plot_chances",
        page="report.missions:reliability_page", numbers="reliability",
        tables=lambda found: {"gaps": found.gap_table()} if found.gaps else {},
        pictures=lambda found: (
            {"gaps": lambda: function_of("statistics", "plot_gaps")(found)} if found.gaps else {}
        ),
    ),
    "Replay": View(
        "verification", "replay", "replay", "draw_replay", titled=True,
        page="report.missions:replay_page", numbers="replay",
        has_picture=lambda found: found.only is None or found.histories is not None,
        tables=lambda found: (
            {"impacts": found.impacts}
            | ({} if found.histories is None else {"histories": found.histories.to_frame()})
        ),
    ),
    "Response": View("pictures", "response", "response", None),
    "ResponseSpectrum": View("statistics", "spectrum", "spectrum", titled=True),
    "Screening": View(
        "isolator_tables", "screening", "screening", plot="sizing:plot_screening",
        has_picture=lambda found: bool(found.impact_pairs),
    ),
    "Sizing": View(
        "isolator_tables", "sizing", page="report.sizing:sizing_page", numbers="size",
        plot="sizing:plot_sizing",
        beside="report.sizing:write_sizing_files",
        tables=lambda found: {"phases": found.phases} if found.scene.phases else {},
        pictures=lambda found: (
            ({"phases": found.plot} if found.scene.phases else {})
            | ({} if found.production is None else {"production": found.production.plot})
        ),
    ),
    "Stability": View("sine", "stability", "stability"),
    "Transient": View("pictures", "transient"),
    "WorkPrecision": View("verification", "cost", "cost", titled=True),
}  # fmt: skip
"""How each kind of answer is shown, by the name of its class: views do not import answers."""
