"""Views of the verification. Chapters: error against CPU time, and scores; verdicts, costs and
explanations; the law of a stop from a test; replays; the shocks in a record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.mathematics.units import (
    DENSITY,
    FORCE,
    LENGTH,
    MILLIRADIANS,
    MILLISECONDS,
    PERCENT,
    SPEED,
    TIME,
    readable,
    shown_as,
)
from stochvi.results.base import ROTATIONS, DataFrame, of_angle, quantities_of, rows_of
from stochvi.results.estimates import NO_VALUE, Estimate, capital, plus_minus
from stochvi.verification.check import (
    APPROXIMATE,
    BALANCE,
    BALANCES_ONLY,
    DETERMINISTIC_ERROR,
    DISAGREES,
    OTHER_THRESHOLD,
    STOPPED_EARLY,
    Check,
    Comparison,
)
from stochvi.verification.cost import (
    NOISE,
    TARGETS,
    ModelError,
    StepError,
    WorkPrecision,
    spoken_time,
)
from stochvi.views.axes import (
    COLOURS,
    FREQUENCY,
    OWNERS,
    Chart,
    Scale,
    legend_above,
    length_of,
    panels,
    thinned,
)
from stochvi.views.density import draw_motion, excerpt
from stochvi.views.pages import Grid, Section, Told, told_of
from stochvi.views.tables import (
    QUANTITY_NAMES,
    UNKNOWN,
    effects_in_words,
    modes_in_rows,
    spoken_length,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.identification import Identification, LawFit
    from stochvi.identification.shocks import FoundShocks
    from stochvi.isolators.record_verdict import RecordVerdict
    from stochvi.methods.monte_carlo import Prospect
    from stochvi.methods.replay import Replay, ReplayAt
    from stochvi.verification.check import Checks, Explanation
    from stochvi.verification.testing.judging import Judgement

MOST_PANELS = 9
"""Largest number of quantities in a picture of errors against time: more would be too small."""

WORK_SECONDS = (1e-4, 1e4)
LARGEST_ERRORS = (1e-5, 1.0)
"""Ends of both axes of the picture of errors, CPU seconds and relative errors; a method beyond them
is drawn at the edge."""

WORK_TITLES = {
    "displacement_mean_square": "mean square displacement",
    "velocity_mean_square": "mean square velocity",
    "collision_rate": "hits",
    "impact_speed_rate": "F1",
    "impact_speed_square_rate": "F2",
}
"""Titles of the panels by quantity."""


def plot_cost(found: WorkPrecision, ax: Axes | None = None) -> Axes:
    """Error against CPU time, a panel for each quantity; given Axes get the first one.

    A line for each step: the statistical error, which falls with the square root of the time, and
    the bias, on which it levels out. A bias that is not beyond its noise is drawn as its upper
    limit, dotted, and none where it is not known. Crosses are methods that simulate nothing,
    triangles the upper limits of their errors where these are not beyond the noise.
    """
    keys = list(dict.fromkeys((row.of, row.quantity) for row in found.errors))
    keys = [key for key in keys if key[1] != "displacement_mean"][:MOST_PANELS]
    columns = min(3, len(keys))
    size = 3.4 * columns, 0.9 + 2.8 * -(-len(keys) // columns)
    draw = [partial(_draw_work, found, *key) for key in keys]
    first = panels(ax, draw, size, "what accuracy costs", columns, sharex=True, sharey=True)
    figure: Any = first.figure
    shown = figure.axes if ax is None else [first]
    named = [zip(*each.get_legend_handles_labels(), strict=True) for each in shown]
    legend = {label: handle for pairs in named for handle, label in pairs}
    handles: dict[str, Any] = {"handles": [*legend.values()], "labels": [*legend]}
    if ax is None:
        figure.legend(
            **handles, loc="outside lower center", ncols=min(4, columns + 1), frameon=False
        )
    else:
        legend_above(ax, **handles)
    return first


def _draw_work(found: WorkPrecision, of: str, quantity: str, ax: Axes) -> None:
    """The panel of one quantity."""
    from matplotlib import colormaps

    rows = [row for row in found.errors if (row.of, row.quantity) == (of, quantity)]
    chart = Chart(
        ax, Scale("CPU time of one core (s)", log=True), Scale("relative error", PERCENT, log=True)
    )
    seconds = np.geomspace(*WORK_SECONDS, 121)
    for row, colour in zip(
        rows, colormaps["viridis"](np.linspace(0.85, 0.1, len(rows))), strict=True
    ):
        floor = row.step_bias_limit or 0.0
        if row.step_bias_limit is not None and row.bias_is_seen and not found.elastic:
            floor = abs(row.step_bias)
        error = np.hypot(row.error_of_a_second / np.sqrt(seconds), floor)
        chart.curve(seconds, error, f"step {row.step:.3g} s", tuple(colour), linewidth=1.6)
        if floor > 0.0:
            chart.level(floor, None, tuple(colour), "--" if row.bias_is_seen else ":")
    for model in found.models:
        off, doubt = abs(model.model_error), NOISE * model.model_error_error
        limit = off if off > doubt else off + doubt
        if (model.of, model.quantity) == (of, quantity) and limit > LARGEST_ERRORS[0]:
            chart.points(
                max(model.cpu_seconds, WORK_SECONDS[0]), min(limit, LARGEST_ERRORS[1]),
                model.method, COLOURS.get(model.method, COLOURS["stop"]),
                "x" if off > doubt else "v", markersize=7, markeredgewidth=2.0, clip_on=False,
            )  # fmt: skip
    if not found.elastic and all(row.step_bias_limit is None for row in rows):
        ax.text(0.96, 0.93, "bias not known", transform=ax.transAxes, ha="right", va="top")
    chart.finish(0)  # one legend names the lines of all panels
    ax.set(xlim=WORK_SECONDS, ylim=PERCENT(LARGEST_ERRORS))
    ax.minorticks_off()  # those of eight decades on six panels take most of the time of the picture
    ax.set_title(f"{WORK_TITLES[quantity]}, {of}", fontsize="medium")


# ------------------------------------------------------------------------------
# Verdicts, costs and explanations on a terminal.
# ------------------------------------------------------------------------------


NOT_JUDGED = (APPROXIMATE, OTHER_THRESHOLD)
"""Verdicts on approximations."""


def check_told(verdict: Check) -> Told:
    """The comparisons, the errors of linearisation, and the verdict in a sentence."""
    judged = [row for row in verdict.comparisons if row.verdict not in NOT_JUDGED]
    methods = dict.fromkeys(row.method for row in judged)
    grids = [_judged([row for row in judged if row.method == method]) for method in methods]
    notes = [
        reason if reason.startswith(STOPPED_EARLY) else f"left out: {reason}"
        for reason in verdict.left_out
        if reason != verdict.summary()
    ]
    return told_of(
        verdict,
        [*chain(*grids), *_approximations(verdict)],
        notes,
        alarm=not verdict.passed,
        warnings=[each for response in verdict.responses[:1] for each in response.warnings],
    )


def checks_told(verdict: Checks) -> Told:
    """A line for each scene, every alarm, and the verdict in a sentence."""
    overview = verdict.overview()
    alarms = np.flatnonzero(~overview["verdict"].isin(["passed", BALANCES_ONLY])).tolist()
    table = Grid.of(
        "scenes, under one alarm rate",
        overview,
        [(name, name, "1 .2f") for name in map(str, overview)],
        ("scene", "methods", "verdict"),
        alarms,
    )
    notes = [
        f"alarm: {name}: {row.quantity} of {row.of}: {row.method} {row.value:.6g}, "
        f"{row.reference} {row.reference_value:.6g}, allowed {row.tolerance:.1e}"
        for name, row in verdict.alarms
    ]
    return told_of(verdict, table, notes, alarm=not verdict.passed)


def problems_told(sentences: Mapping[str, str]) -> Told:
    """A line for each problem: its name, and a sentence that describes it."""
    rows = [{"problem": name, "what it is": words} for name, words in sentences.items()]
    return Told(sections=[Section(grids=Grid.of("problems", rows, words=2))])


def judgement_told(verdict: Judgement) -> Told:
    """Every quantity with its true value, likely causes of disagreements, and the verdict."""
    table = Grid.of(
        "judged against the known answer",
        verdict.findings,
        "quantity; truth; found = value; off by (%) = off; visible (%) = visible_percent "
        "{.2g}; verdict",
        ("quantity", "verdict"),
        [k for k, row in enumerate(verdict.findings) if row in verdict.failures],
        truth=lambda row: f"{row.truth:.6g} {row.unit}",
        value=lambda row: _scattered(row.value, row.standard_error) or "not finite",
        off=lambda row: _scattered(row.bias_percent, row.bias_error_percent),
    )
    notes = [f"left out: {reason}" for reason in verdict.left_out]
    notes += [f"looks like: {hint}" for hint in verdict.hints]
    return told_of(
        verdict,
        table,
        notes,
        alarm=not verdict.passed,
        statements=[verdict.read_as] if verdict.read_as else [],
    )


def _scattered(value: float | None, error: float | None) -> Estimate | None:
    """A number with its standard error, where both are known."""
    if value is None or error is None:
        return None
    return Estimate(value=value, standard_error=error)


def _judged(judged: Sequence[Comparison]) -> list[Grid]:
    """The comparisons and balances of one method that claims to be right."""
    against = [row.reference for row in judged if row.of != BALANCE]
    title = f"judged: {judged[0].method}"
    title += f" against {against[0]}, and its balances" if against else ", its balances"
    return Grid.of(
        title,
        judged,
        "quantity = words_of; reference; value = found; difference {+.1e}; allowed = tolerance "
        "{.1e}; verdict",
        ("quantity", "verdict"),
        [k for k, row in enumerate(judged) if row.verdict == DISAGREES],
        words_of=lambda row: (
            f"{row.quantity} balance" if row.of == BALANCE else QUANTITY_NAMES[row.quantity]
        ),
        reference=lambda row: None if row.of == BALANCE else f"{row.reference_value:.6g}",
        found=lambda row: f"{row.value:{'.2e' if row.of == BALANCE else '.6g'}}",
    )


def _approximations(verdict: Check) -> list[Grid]:
    """Relative errors of the approximate methods against the reference, not judged."""
    shown = [row for row in verdict.comparisons if row.verdict in NOT_JUDGED]
    if not shown:
        return []
    return Grid.across(
        f"errors of approximations against {shown[0].reference} (%), not judged",
        "quantity",
        {
            (
                QUANTITY_NAMES[row.quantity], row.method.removeprefix("linearise:")
            ): _error_in_words(row)
            for row in shown
            if row.quantity != "displacement_mean"
        },
    )  # fmt: skip


def _error_in_words(row: Comparison) -> str:
    """The relative error in per cent; "never seen" where the reference value is 0, and no number
    where the two count impacts above different speeds."""
    if row.verdict == OTHER_THRESHOLD:
        return "other threshold"
    if row.reference_value == 0.0 != row.value:
        return "never seen"
    return f"{100.0 * row.relative:+.2f}"


def explanation_told(explanation: Explanation) -> Told:
    """Which effects would be simulated, by which method, and the expected cost."""
    words = ("simulated:", "not simulated:")
    if not explanation.simulated:
        words = ("in the scene:", "not in the scene:")
    width = max(map(len, words)) + 1
    effects = zip(words, (explanation.effects, explanation.absent), strict=True)
    return Told(
        statements=[f"{word:{width}}{effects_in_words(each) or '-'}" for word, each in effects],
        sections=[
            Section(grids=_modes(explanation), notes=_rest(explanation)),
            Section(
                notes=[
                    *(f"{method}: {verdict}" for method, verdict in explanation.methods.items()),
                    *_plan(explanation.simulation),
                ]
            ),
        ],
        footer=[f"assumed: {assumption}" for assumption in explanation.assumptions],
        warnings=explanation.notes,
    )


def phases_told(phases: Mapping[str, Explanation]) -> list[Told]:
    """The explanation of each phase of a mission."""
    told = [
        replace(explanation_told(each), verdict=f"phase {name}") for name, each in phases.items()
    ]
    return [*told, Told(footer=["all phases together: size, reliability and damage"])]


def _plan(plan: Prospect | None) -> list[str]:
    """How a simulation would go, and what it would cost."""
    if plan is None:
        return []
    lines = [
        f"{plan.method}: {plan.states} states, step {plan.step:.3g} s, {plan.steps_per_path} "
        f"steps a path ({plan.burn_in:.3g} s of burn-in, {plan.duration:.3g} s counted), "
        f"{plan.nanoseconds_per_step:.2g} ns a step here"
    ]
    if plan.start_seconds:
        lines.append(f"to start: about {plan.start_seconds:.1g} s, in every run")
    for target, seconds in plan.seconds.items():
        cost = "unknown"
        if seconds is not None:
            least, most = (
                f"{each:{'.1g' if each < 10.0 else '.0f'}}"
                for each in plan.seconds_between.get(target, (seconds, seconds))
            )
            cost = f"about {least if least == most else f'{least} to {most}'} s"
        lines.append(f"relative error {target:g}: {cost} ({plan.governed_by})")
    return lines


def _modes(explanation: Explanation) -> list[Grid]:
    """The modes of a structure of several coordinates."""
    modes = explanation.modes
    if len(modes) < 2:
        return []
    caption = "natural modes without stops, and the mass that each moves with the base"
    return Grid.of(caption, modes_in_rows(modes), words=0)


def _rest(explanation: Explanation) -> list[str]:
    """Where a structure rests under loads."""
    lines = []
    if explanation.rest:
        listed = ", ".join(
            f"{name} {(MILLIRADIANS if name in ROTATIONS else LENGTH).text(value, '.3g')}"
            for name, value in explanation.rest.items()
        )
        lines.append(f"at rest under constant loads: {listed}")
    for name, gap in explanation.rest_of_gaps.items():
        left = [
            f"{LENGTH.text(distance, '.3g')} from the {side} stop"
            for side, distance in (("lower", gap.to_lower), ("upper", gap.to_upper))
            if distance is not None
        ]
        place = LENGTH.text(gap.position, ".3g")
        lines.append(f"{name}: at rest the gap is at {place}, {' and '.join(left)}")
    return lines


def cost_told(found: WorkPrecision) -> Told:
    """Bias and statistical error at each step, the CPU times that follow, and errors of models."""
    bias, noise = {}, {}
    for row in found.errors:
        place = _whose(found, row.of, row.quantity), f"{row.step:.3g} s"
        bias[place] = _step_bias(found, row)
        noise[place] = f"{100.0 * row.error_of_a_second:.2g}"
    against = f"biases are measured against: {found.reference}"
    if found.reference == "fokker-planck":
        against += " (itself against the simulation)"
    if found.elastic:
        against += "; with elastic stops there is none at any step, in theory"
    footer = [
        against,
        f"{found.method}, {found.cost.paths} paths at every step, {found.cost.wall_time:.3g} s on "
        f"{found.cost.threads} threads; errors of a mean are relative to the standard "
        "deviation of the displacement",
    ]
    if not found.elastic:
        footer.append(
            "these are true errors; the interval that simulate states is wider, as it holds what "
            "simulate knows of its own bias"
        )
    tables = [
        *Grid.across("bias of the step (%)", "quantity", bias),
        *Grid.across("standard error of one CPU second (%)", "quantity", noise),
    ]
    return told_of(
        found,
        tables,
        (),
        _prices(found),
        _models(found),
        footer=footer,
        warnings=found.left_out,
    )


def _whose(found: WorkPrecision, owner: str, quantity: str) -> str:
    """A quantity in words, with its owner where the scene has several coordinates or pairs."""
    hits = [row.of for row in found.errors if row.quantity == "impact_speed_rate"]
    moments = [row.of for row in found.errors if row.quantity == "velocity_mean_square"]
    alone = len(set(hits)) < 2 and len(set(moments)) < 2
    return QUANTITY_NAMES[quantity] if alone else f"{owner}: {QUANTITY_NAMES[quantity]}"


def _step_bias(found: WorkPrecision, row: StepError) -> str:
    """The bias of a step in per cent with its standard error; an upper limit where it may be
    nothing but noise."""
    if row.step_bias_limit is None:
        return "unknown"
    if row.bias_is_seen:
        return plus_minus(_scattered(row.step_bias, row.step_bias_error), PERCENT)
    if row.step_bias_error == 0.0:
        return "reference"
    return f"< {100.0 * (row.largest_bias if found.elastic else row.step_bias_limit):.2g}"


def _prices(found: WorkPrecision) -> Section:
    """The CPU seconds that bring statistical error and bias below each target, by step."""
    cells = {}
    for step in found.steps:
        name = f"{step:.3g} s{' *' if step == found.default_step else ''}"
        for kind, rates in (("", False), ("impacts ", True)):
            rows = found.of_step(step, rates=rates)
            for target in TARGETS if rows else ():
                prices = [row.seconds(target) for row in rows]
                known = [price for price in prices if price is not None]
                price = spoken_time(max(known)) if len(known) == len(prices) else NO_VALUE
                cells[name, f"{kind}{100.0 * target:g} %"] = price
    usual = "* the step that simulate takes"
    return Section(
        grids=Grid.across("CPU time until both are below (-: the bias never is)", "step", cells),
        notes=[usual if found.elastic else f"{usual}, and twice it: half as much time on top"],
    )


def _models(found: WorkPrecision) -> Section:
    """The errors of models, which more time does not make smaller."""
    short = {"fokker-planck": "Fokker-P.", "average:finite jumps": "average"}
    table = Grid.across(
        "error of methods without random numbers (%) [bound that the method states]",
        "quantity",
        {
            (
                _whose(found, row.of, row.quantity),
                short.get(row.method, row.method.removeprefix("linearise:")),
            ): _model_error(row)
            for row in found.models
        },
    )
    told = f"{NO_VALUE}: not known, or of impacts above another speed than simulated"
    return Section(grids=table, notes=[told] if table else [])


def _model_error(row: ModelError) -> str:
    bound = f" [{100.0 * row.stated_bias:.2g}]" if row.stated_bias else ""
    if abs(row.model_error) < DETERMINISTIC_ERROR:
        return f"0{bound}"
    return f"{plus_minus(_scattered(row.model_error, row.model_error_error), PERCENT)}{bound}"


# ------------------------------------------------------------------------------
# Table and picture of the law of a stop that a test shows.
# ------------------------------------------------------------------------------


PLACES = {
    "restitution": ("speed of approach", SPEED),
    "force": ("deflection", LENGTH),
    "acceleration": ("time", MILLISECONDS),
}
"""The abscissa by what was observed."""

STYLES = ("-", "--", "-.", ":")
"""Styles of the lines of laws, in their order."""

MOST_LINES = 4
"""Largest number of laws that a picture shows: those of the smallest criteria."""


def identification_told(found: Identification) -> Told:
    """The law to take, the line to copy, and all laws that were fitted."""

    def numbers(_: str, fit: LawFit) -> str:
        known = [(name, each, fit.units[name]) for name, each in fit.numbers.items()]
        return ", ".join(f"{n} {plus_minus(each)} {u}".rstrip() for n, each, u in known)

    table = Grid.of(
        "laws; rejected below 0.05: the probability of so bad a fit if the law were true",
        found.fits.items(),
        "law = name; numbers = in_words; residual; AICc = criterion; rejected {.2g}",
        2,
        in_words=numbers,
    )
    of_test = []
    for name, each in found.of_test.items():
        quantity = shown_as(found.test.start[name][1])
        of_test.append(f"{name}: {plus_minus(each, quantity)} {quantity}")
    return told_of(found, table, of_test, statements=[found.line])


def plot_identification(found: Identification, ax: Axes | None = None) -> Axes:
    """What was observed with the laws that fit best, and below it the residuals of the law to take.

    The record of a drop also has its force over the deflection. Given axes get the first panel."""
    draw = [partial(each, found) for each in (_draw_laws, _draw_residuals)]
    draw += [] if found.loop is None else [partial(_draw_loop, found.loop)]
    return panels(ax, draw, (6.4, 2.4 * len(draw) + 0.4), sharex=False)


def _draw_laws(found: Identification, ax: Axes) -> None:
    words, place = PLACES[found.test.word]
    over = Scale(words, place, log=found.test.word == "restitution")
    chart = Chart(ax, over, Scale(found.test.word, shown_as(found.test.unit)))
    table = found.curve.sort_values("place")
    chart.column(table, "place", "observed", "measured", "exact", "o", markersize=3)
    names = sorted(found.fits, key=lambda name: found.fits[name].criterion)[:MOST_LINES]
    if found.chosen not in names:
        names[-1] = found.chosen
    for name, colour, style in zip(names, OWNERS, STYLES, strict=False):
        words = f"{name} (to take)" if name == found.chosen else name
        chart.curve(table["place"], table[name], words, colour, style)
    chart.finish()


def _draw_residuals(found: Identification, ax: Axes) -> None:
    words, place = PLACES[found.test.word]
    over = Scale(words, place, log=found.test.word == "restitution")
    chart = Chart(ax, over, Scale("measured - law", shown_as(found.test.unit)))
    left = found.curve["observed"] - found.curve[found.chosen]
    chart.points(found.curve["place"], left, markersize=3)
    chart.level(0.0)
    chart.finish()


def _draw_loop(loop: DataFrame, ax: Axes) -> None:
    chart = Chart(ax, Scale("deflection", LENGTH), Scale("force", FORCE))
    chart.column(loop, "deflection", "force", "record, integrated", "exact", "o", markersize=3)
    chart.curve(loop["deflection"], loop["law"], "law on that motion")
    chart.finish()


# ------------------------------------------------------------------------------
# Replays on a terminal and as pictures: x(t) with stops and impacts, impacts against clearance.
# ------------------------------------------------------------------------------


MOST_ON_LINEAR_AXIS = 50
"""Number of impacts up to which single ones can be read off a linear axis."""

HEADROOM = 1.15
"""Top of an axis over its largest value, so that no marker or number is cut."""

MOST_SPEEDS, MOST_MOTIONS = 6, 3
"""Largest number of impact speeds in a picture, and of clearances whose x(t) is drawn."""

DECADES = 1e6
"""Largest over smallest density that a waterfall tells apart."""

LEAST_DENSITY = 1e-200
"""Density that stands for 0 on a logarithmic scale."""


def replay_told(found: Replay, record: RecordVerdict | None) -> Told:
    """The clearance that the record itself needs, where it is known, and the motion and impacts."""
    needed = [] if record is None else [record.needs()]
    verdict, *others = [f"{capital(each)}." for each in [*needed, found.summary()]]
    return told_of(
        found,
        verdict=verdict,
        statements=others,
        brief=True,
        alarm=any(
            float(pair.hits) > 0.0
            for each in found.clearances
            for pair in each.impact_pairs.values()
        ),
        sections=[
            Section(
                title="Motion and impacts",
                lead="One record, one answer: nothing is sampled, every impact is located in time.",
                grids=[_replay_grid(found)],
            )
        ],
        assumptions=[
            f"{text[:1].lower()}{text[1:].removesuffix('.')}" for text in found.assumptions
        ],
        footer=[f"cost: {found.cost.wall_time:.3g} s"],
    )


def _replay_grid(found: Replay) -> Grid:
    """A row per quantity, a column per clearance; the biases of a single one stand beside it."""
    single = found.only
    biased = single is not None and any(own.bias for *_, own in single.estimates())
    rows = []
    for group in ("coordinates", "impact_pairs"):
        for owner, quantities in getattr(found.clearances[0], group).items():
            if single is not None and owner in single.still:
                continue  # as its sentence says
            for name, known in quantities_of(quantities.__class__).items():
                values = [getattr(each, group)[owner][name] for each in found.clearances]
                if all(value is None for value in values):
                    continue  # the speed of no impact, the force of a rigid stop
                quantity = of_angle(owner, readable(known.unit))
                row = ["none" if v is None else f"{quantity(float(v)):.4g}" for v in values]
                if biased:
                    bias = values[0].bias
                    row.append(UNKNOWN if bias is None else f"{quantity(bias):.2g}")
                rows.append([f"{owner}: {quantity.heading(known.words)}", *row])
    headings = [
        "as in the scene" if each.clearance is None else f"at {spoken_length(each.clearance)}"
        for each in found.clearances
    ]
    headings += ["bias"] if biased else []
    return Grid(caption="the record itself", headings=["", *headings], rows=rows)


def plot_history(each: ReplayAt, ax: Axes | None = None, *, whole: bool = False) -> Axes:
    """x(t) between its stops with the impacts, of all coordinates where there are several: around
    the shock, that is the fastest impact, or the whole record."""
    kept = each.histories
    assert kept is not None
    curves = kept.displacement
    part = slice(None) if whole else excerpt(kept.time, curves[_first_moving(each)], each.impacts)
    stops = each.stops if len(curves) == 1 else {}
    size = (9.6, 4.2)
    return draw_motion(ax, kept.time, curves, stops, each.impacts, part, size=size).finish(4)


def plot_waterfall(each: ReplayAt, ax: Axes | None = None) -> Axes:
    """Short-time spectra of the absolute acceleration of the first coordinate that moves, over the
    whole record, with the impacts as marks above them."""
    from matplotlib.colors import LogNorm

    kept = each.histories
    assert kept is not None
    chart, owner = Chart.on(ax, Scale("time", TIME), FREQUENCY, (9.6, 4.2)), _first_moving(each)
    spectra = kept.short_time_spectra(owner)
    unit = shown_as("(rad/s^2)^2/Hz") if owner in ROTATIONS else DENSITY
    density = unit(np.maximum(spectra.density, LEAST_DENSITY))
    norm = LogNorm(density.max() / DECADES, density.max(), clip=True)
    mesh = chart.ax.pcolormesh(
        TIME(spectra.time), spectra.frequency_hz, density, norm=norm, cmap="viridis",
        shading="nearest", rasterized=True,
    )  # fmt: skip
    chart.ax.figure.colorbar(mesh, ax=chart.ax, label=f"acceleration of {owner} ({unit})")
    if len(each.impacts):
        times = TIME(np.asarray(each.impacts["time"]))
        chart.ax.plot(
            times, np.full(len(times), 1.02), "v", markersize=4.5, clip_on=False, label="impacts",
            color=COLOURS["linearise:closure"], transform=chart.ax.get_xaxis_transform(),
        )  # fmt: skip
    chart.finish(borderaxespad=1.0)
    chart.ax.set_ylim(*spectra.frequency_hz[[0, -1]])
    return chart.ax


def _first_moving(each: ReplayAt) -> str:
    """The first coordinate that moves; the first one where none does."""
    return min(each.coordinates, key=each.still.__contains__)


def plot_clearances(found: Replay, ax: Axes | None = None) -> Axes:
    """Impacts against clearance; the largest impact speed stands at each point."""
    from matplotlib.ticker import MaxNLocator

    places = np.array([each.clearance for each in found.clearances], dtype=float)
    order = np.argsort(places)
    pairs = [next(iter(each.impact_pairs.values())) for each in found.clearances]
    hits = np.array([float(pair.hits) for pair in pairs])
    clearance = Scale("clearance", length_of(float(places.max())))
    chart = Chart.on(ax, clearance, Scale("impacts in the record"))
    chart.curve(places[order], hits[order], marker="o")
    if hits.max() > MOST_ON_LINEAR_AXIS:
        chart.ax.set_yscale("symlog", linthresh=1.0)
        chart.ax.set_ylim(0.0, 4.0 * hits.max())
    else:
        chart.ax.yaxis.set_major_locator(MaxNLocator(integer=True))
        chart.ax.set_ylim(0.0, HEADROOM * max(hits.max(), 1.0))
    for number in order[:: -(-len(order) // MOST_SPEEDS)]:
        if (speed := pairs[number].impact_speed_max) is not None:
            chart.note(SPEED.text(float(speed), ".2g"), places[number], hits[number])
    chart.ax.margins(x=0.12)
    return chart.finish()


def draw_replay(found: Replay) -> Axes:
    """x(t) around the shock with the stops, above the whole record; over several clearances x(t)
    around the shock at some of them, then impacts over clearances."""
    single, title = found.only, "replay of the record"
    if single is not None:
        if single.histories is None:
            raise ValueError("there is no picture of x(t): its samples were not kept")
        draw = [partial(plot_history, single, whole=whole) for whole in (False, True)]
        return panels(None, draw, (9.6, 6.4), title, sharex=False, height_ratios=(2, 1))
    shown = [each for each in found.clearances if each.histories is not None]
    shown = sorted(shown, key=lambda each: each.clearance or 0.0)[:MOST_MOTIONS]
    draws: list[Any] = [partial(_draw_at, each) for each in shown]
    draws.append(partial(plot_clearances, found))
    return panels(None, draws, (9.6, 2.4 * len(shown) + 3.2), title, sharex=False)


def _draw_at(each: ReplayAt, ax: Axes) -> None:
    """x(t) under the clearance of its stops."""
    plot_history(each, ax).set_title(
        f"stops {spoken_length(each.clearance or 0.0)} away", loc="left", fontsize="small"
    )


# ------------------------------------------------------------------------------
# The shocks in a record.
# ------------------------------------------------------------------------------


def shocks_told(found: FoundShocks) -> Told:
    """The number and the rate of shocks, their heights, and what else might have been found."""
    quantity = found.quantity

    def spoken(row: Mapping[str, float]) -> str:
        length, height = row["length"], row["height"]
        return f"from {quantity.text(height, '.3g')} on at {MILLISECONDS.text(length, '.3g')}"

    heights = [abs(each.height) for each in found.shocks]
    lengths = rows_of(found.smallest)
    statements = [f"Heights: {quantity.span(min(heights), max(heights), '.3g')}"] if heights else []
    statements += [
        f"False ones to expect in such a record: at most {found.false_alarms:.2g}",
        f"Nine of ten half sines are found {spoken(lengths[0])}, {spoken(lengths[-1])}",
    ]
    columns = "at = start {s}; length = duration {ms}; height = height {%s}; over_threshold {.3g}"
    grids = Grid.of("shocks", found.shocks, columns % found.unit, 0)
    columns = "length of a half sine = length {ms}; found from = height {%s .3g}"
    grids += Grid.of("nine of ten are found", found.smallest, columns % found.unit, 0)
    note = (
        f"between the shocks: {quantity.text(found.noise, '.3g')} rms, {found.peaks} peaks beyond "
        f"3.5 local levels where Gaussian noise has {found.peaks_expected:.3g}"
    )
    return told_of(
        found, statements=statements, sections=[Section(grids=grids, notes=[note])], brief=True,
        footer=[f"cost: {found.cost.wall_time:.3g} s"],
    )  # fmt: skip


def plot_shocks(found: FoundShocks, ax: Axes | None = None) -> Axes:
    """The record, the threshold about it, and its shocks."""
    words = "force" if found.unit == "N" else "acceleration"
    chart = Chart.on(ax, Scale("time", TIME), Scale(words, found.quantity), (9.6, 4.2))
    when, values, mean, threshold = found.samples.to_numpy()[:, :4].astype(float).T
    chart.curve(*thinned(when, values), "record", linewidth=0.6)
    for edge in (mean - threshold, mean + threshold):
        chart.curve(*thinned(when, edge), "threshold", "stop", "--", linewidth=0.8)
    for each in found.shocks:
        ends = chart.x.quantity([each.start, each.start + each.duration])
        chart.ax.axvspan(*ends, color=OWNERS[3], alpha=0.4, linewidth=0.8, label="shock")
    return chart.finish(3)
