"""Views of the verification. Chapters: error against CPU time, and scores; verdicts, costs and
explanations; the law of a stop from a test; replays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtri

from stochvi.mathematics.units import (
    DENSITY,
    FORCE,
    LENGTH,
    MILLIRADIANS,
    MILLISECONDS,
    SPEED,
    TIME,
    readable,
    shown_as,
)
from stochvi.results.base import ROTATIONS, of_angle, quantities_of
from stochvi.results.estimates import NO_VALUE, capital, format_with_error
from stochvi.verification.check import (
    AGREES,
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
    OWNERS,
    add_grid,
    add_title,
    around_shock,
    axes_or_new,
    legend_above,
    length_unit,
    owner_colours,
    plain_ticks,
    seconds_of,
    thinned,
)
from stochvi.views.pages import Grid, Section, Told, told_of
from stochvi.views.tables import (
    QUANTITY_NAMES,
    UNKNOWN,
    effects_in_words,
    spoken_length,
    value_with_error,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.identification import Identification
    from stochvi.isolators.record_verdict import RecordVerdict
    from stochvi.methods.monte_carlo import Prospect
    from stochvi.methods.replay import Replay, ReplayAt
    from stochvi.verification.check import Checks, Explanation
    from stochvi.verification.testing.judging import Finding, Judgement

MOST_PANELS = 9
"""Largest number of quantities in a picture of errors against time: more would be too small."""

WORK_SECONDS = (1e-4, 1e4)
ERROR_PERCENT = (1e-3, 1e2)
"""Ends of both axes of the picture of errors, CPU seconds and per cent; a method beyond them is
drawn at the edge."""

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
    import matplotlib.pyplot as plt

    keys = list(dict.fromkeys((row.of, row.quantity) for row in found.errors))
    keys = [key for key in keys if key[1] != "displacement_mean"][:MOST_PANELS]
    if ax is not None:
        plot_work_precision(found, *keys[0], ax)
        ax.set(xlabel="CPU time of one core (s)", ylabel="relative error (%)")
        legend_above(ax)
        return ax
    columns = min(3, len(keys))
    rows = -(-len(keys) // columns)
    figure, grid = plt.subplots(
        rows, columns, figsize=(3.4 * columns, 0.9 + 2.8 * rows), layout="constrained",
        sharex=True, sharey=True, squeeze=False,
    )  # fmt: skip
    panels = list(grid.flat)
    for number, (of, quantity) in enumerate(keys):
        plot_work_precision(found, of, quantity, panels[number])
        if number + columns >= len(keys):
            panels[number].tick_params(labelbottom=True)
            panels[number].set_xlabel("CPU time of one core (s)")
        if number % columns == 0:
            panels[number].set_ylabel("relative error (%)")
    for panel in panels[len(keys) :]:
        panel.axis("off")
    named = [zip(*each.get_legend_handles_labels(), strict=True) for each in panels]
    legend = {label: handle for pairs in named for handle, label in pairs}
    figure.legend(
        legend.values(), legend.keys(), loc="outside lower center", ncols=4, frameon=False
    )
    figure.suptitle("what accuracy costs", fontsize="medium")
    return panels[0]  # type: ignore[no-any-return]


def plot_work_precision(found: WorkPrecision, of: str, quantity: str, ax: Axes) -> None:
    """The panel of one quantity."""
    import matplotlib.pyplot as plt

    rows = [row for row in found.errors if (row.of, row.quantity) == (of, quantity)]
    colours = plt.get_cmap("viridis")(np.linspace(0.85, 0.1, len(rows)))
    seconds = np.geomspace(*WORK_SECONDS, 121)
    for row, colour in zip(rows, colours, strict=True):
        noise = 100.0 * row.error_of_a_second / np.sqrt(seconds)
        limit = row.step_bias_limit
        floor = 0.0 if limit is None else 100.0 * limit
        if limit is not None and row.bias_is_seen and not found.elastic:
            floor = 100.0 * abs(row.step_bias)
        ax.loglog(
            seconds, np.hypot(noise, floor), color=colour, linewidth=1.6,
            label=f"step {row.step:.3g} s",
        )  # fmt: skip
        if floor > 0.0:
            style = "--" if row.bias_is_seen else ":"
            ax.axhline(floor, color=colour, linestyle=style, linewidth=0.9)
    for model in found.models:
        error, doubt = abs(model.model_error), NOISE * model.model_error_error
        limit = 100.0 * (error if error > doubt else error + doubt)
        if (model.of, model.quantity) == (of, quantity) and limit > ERROR_PERCENT[0]:
            ax.plot(
                max(model.cpu_seconds, WORK_SECONDS[0]), min(limit, ERROR_PERCENT[1]),
                "x" if error > doubt else "v", color=COLOURS.get(model.method, COLOURS["stop"]),
                markersize=7, markeredgewidth=2.0, label=model.method, clip_on=False,
            )  # fmt: skip
    if not found.elastic and all(row.step_bias_limit is None for row in rows):
        ax.text(0.96, 0.93, "bias not known", transform=ax.transAxes, ha="right", va="top")
    ax.set_xlim(*WORK_SECONDS)
    ax.set_ylim(*ERROR_PERCENT)
    ax.minorticks_off()  # those of eight decades on six panels take most of the time of the picture
    add_grid(ax)
    ax.set_title(f"{WORK_TITLES[quantity]}, {of}", fontsize="medium")


def draw_scores(found: Checks, ax: Axes | None = None) -> Axes:
    """Normal quantile plot of the scores of all comparisons: a line of slope 1 if all agree.

    Scores of one simulation are correlated. Against an exact answer there is no bias. The other
    scores measure the part of a difference that the stated biases do not cover. They lie within the
    line where these biases are larger than needed."""
    frame = found.to_frame()
    frame = frame[frame["verdict"].isin([AGREES, DISAGREES]) & frame["score"].notna()]
    exactly = frame["reference"] == "exact"
    ax = axes_or_new(ax)
    reach = 1.1 * max(found.z, float(frame["score"].abs().max()) if len(frame) else 0.0)
    ax.plot([-reach, reach], [-reach, reach], color=COLOURS["stop"], label="normal distribution")
    for side in (-found.z, found.z):
        ax.axhline(side, color=COLOURS["linearise:closure"], linestyle="--")
    ax.text(-reach, found.z, f"  alarm at {found.z:.2f}", va="bottom")
    for chosen, colour, label in (
        (~exactly, COLOURS["linearise:motion"], "others, beyond their stated bias"),
        (exactly, COLOURS["simulate"], "against the exact answer"),
    ):
        scores = np.sort(frame.loc[chosen, "score"].to_numpy())
        expected = ndtri((np.arange(len(scores)) + 0.5) / max(len(scores), 1))
        ax.plot(expected, scores, ".", color=colour, label=f"{len(scores)} {label}")
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-1.6 * reach, 1.2 * reach)  # the legend stands below the lower line
    ax.set_xlabel("score expected of a normal variable")
    ax.set_ylabel("difference / standard error")
    ax.legend(frameon=False, loc="lower right")
    return ax


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
        "scenes, under one alarm rate", overview, ("scene", "methods", "verdict"),
        dict.fromkeys(map(str, overview), ".2f"),
    )  # fmt: skip
    notes = [
        f"alarm: {name}: {row.quantity} of {row.of}: {row.method} {row.value:.6g}, "
        f"{row.reference} {row.reference_value:.6g}, allowed {row.tolerance:.1e}"
        for name, row in verdict.alarms
    ]
    return told_of(verdict, [replace(table, alarms=alarms)], notes, alarm=not verdict.passed)


def problems_told(sentences: Mapping[str, str]) -> Told:
    """A line for each problem: its name, and a sentence that describes it."""
    rows = [*sentences.items()]
    table = Grid(caption="problems", headings=["problem", "what it is"], rows=rows, words=2)
    return Told(sections=[Section(grids=[table])])


def judgement_told(verdict: Judgement) -> Told:
    """Every quantity with its true value, likely causes of disagreements, and the verdict."""
    table = Grid(
        caption="judged against the known answer",
        headings=["quantity", "truth", "found", "off by (%)", "visible (%)", "verdict"],
        rows=[_finding_cells(row) for row in verdict.findings],
        words=("quantity", "verdict"),
        alarms=[k for k, row in enumerate(verdict.findings) if row in verdict.failures],
    )
    notes = [f"left out: {reason}" for reason in verdict.left_out]
    notes += [f"looks like: {hint}" for hint in verdict.hints]
    return told_of(
        verdict,
        [table],
        notes,
        alarm=not verdict.passed,
        statements=[verdict.read_as] if verdict.read_as else [],
    )


def _finding_cells(row: Finding) -> list[str]:
    if row.value is None or row.standard_error is None or row.bias_percent is None:
        return [row.quantity, f"{row.truth:.6g} {row.unit}", "not finite", "", "", row.verdict]
    assert row.bias_error_percent is not None and row.visible_percent is not None
    return [
        row.quantity,
        f"{row.truth:.6g} {row.unit}",
        format_with_error(row.value, row.standard_error),
        format_with_error(row.bias_percent, row.bias_error_percent),
        f"{row.visible_percent:.2g}",
        row.verdict,
    ]


def _judged(judged: Sequence[Comparison]) -> list[Grid]:
    """The comparisons and balances of one method that claims to be right."""
    against = [row.reference for row in judged if row.of != BALANCE]
    title = f"judged: {judged[0].method}"
    title += f" against {against[0]}, and its balances" if against else ", its balances"
    return Grid.by(
        title,
        {
            "quantity": lambda row: (
                f"{row.quantity} balance" if row.of == BALANCE else QUANTITY_NAMES[row.quantity]
            ),
            "reference": lambda row: "" if row.of == BALANCE else f"{row.reference_value:.6g}",
            "value": lambda row: f"{row.value:{'.2e' if row.of == BALANCE else '.6g'}}",
            "difference": lambda row: f"{row.difference:+.1e}",
            "allowed": lambda row: "" if row.tolerance is None else f"{row.tolerance:.1e}",
            "verdict": lambda row: row.verdict,
        },
        [(row,) for row in judged],
        words=("quantity", "verdict"),
        alarms=[k for k, row in enumerate(judged) if row.verdict == DISAGREES],
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
    return Grid.by(
        "natural modes without stops, and the mass that each moves with the base",
        {
            "mode": lambda number, _: number,
            "Hz": lambda _, mode: mode.frequency_hz,
            "zeta": lambda _, mode: (
                NO_VALUE if mode.damping_ratio is None else f"{mode.damping_ratio:.3g}"
            ),
            **{
                f"along {axis} (kg)" if axis else "eff. mass (kg)": lambda _, mode, axis=axis: (
                    f"{mode.effective_mass[axis]:.3g}"
                )
                for axis in modes[0].effective_mass
            },
            "motion": lambda _, mode: mode.motion,
        },
        enumerate(modes, start=1),
        words=0,
    )


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
            f"{LENGTH.text(distance, '.3g')} from its {side} stop"
            for side, distance in (("lower", gap.to_lower), ("upper", gap.to_upper))
            if distance is not None
        ]
        lines.append(f"{name} rests at {LENGTH.text(gap.position, '.3g')}, {' and '.join(left)}")
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
        return format_with_error(100.0 * row.step_bias, 100.0 * row.step_bias_error)
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
        grids=Grid.across("CPU time until both are below (-: bias is not)", "step", cells),
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
    if row.model_error_error == 0.0:
        return f"{100.0 * row.model_error:.3g}{bound}"
    return f"{format_with_error(100.0 * row.model_error, 100.0 * row.model_error_error)}{bound}"


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
    table = Grid.by(
        "laws; rejected below 0.05: the probability of so bad a fit if the law were true",
        {
            "law": lambda name, _: name,
            "numbers": lambda _, fit: ", ".join(
                f"{key} {value_with_error(each)} {fit.units[key]}".rstrip()
                for key, each in fit.numbers.items()
            ),
            "residual": lambda _, fit: fit.residual,
            "AICc": lambda _, fit: fit.criterion,
            "rejected": lambda _, fit: None if fit.rejected is None else f"{fit.rejected:.2g}",
        },
        found.fits.items(),
        words=2,
    )
    of_test = []
    for name, each in found.of_test.items():
        quantity = shown_as(found.test.start[name][1])
        of_test.append(f"{name}: {value_with_error(quantity(each))} {quantity}")
    return told_of(found, table, of_test, statements=[found.line])


def plot_identification(found: Identification, ax: Axes | None = None) -> Axes:
    """What was observed with the laws that fit best, and below it the residuals of the law to take.

    The record of a drop also has its force over the deflection. Given axes get the first panel."""
    import matplotlib.pyplot as plt

    if ax is not None:
        return _draw_laws(found, ax)

    columns = 1 if found.loop is None else 2
    figure, axes = plt.subplots(
        2, columns, figsize=(5.6 * columns, 4.8), layout="constrained", squeeze=False,
    )  # fmt: skip
    _draw_laws(found, axes[0, 0])
    _draw_residuals(found, axes[1, 0])
    if found.loop is not None:
        for each in axes[:, 1]:
            each.remove()
        _draw_loop(found, figure.add_subplot(axes[0, 1].get_gridspec()[:, 1]))
    return axes[0, 0]  # type: ignore[no-any-return]


def _draw_laws(found: Identification, ax: Axes) -> Axes:
    (words_of_place, place), quantity = PLACES[found.test.word], shown_as(found.test.unit)
    table = found.curve.sort_values("place")
    ax.plot(place(table["place"]), quantity(table["observed"]), "o", markersize=3,
            color=COLOURS["exact"], label="measured")  # fmt: skip
    names = sorted(found.fits, key=lambda name: found.fits[name].criterion)[:MOST_LINES]
    if found.chosen not in names:
        names[-1] = found.chosen
    for name, colour, style in zip(names, OWNERS, STYLES, strict=False):
        words = f"{name} (to take)" if name == found.chosen else name
        ax.plot(place(table["place"]), quantity(table[name]), style, color=colour, label=words)
    ax.set_ylabel(quantity.heading(found.test.word))
    ax.set_xlabel(place.heading(words_of_place))
    if found.test.word == "restitution":
        ax.set_xscale("log")
    plain_ticks(ax)
    legend_above(ax, 2)
    add_grid(ax)
    return ax


def _draw_residuals(found: Identification, ax: Axes) -> None:
    words, place = PLACES[found.test.word]
    table = found.curve
    left = shown_as(found.test.unit)(table["observed"] - table[found.chosen])
    ax.plot(place(table["place"]), left, "o", markersize=3, color=COLOURS["simulate"])
    ax.axhline(0.0, color="black", linewidth=0.8)
    ax.set_ylabel("measured - law")
    ax.set_xlabel(place.heading(words))
    if found.test.word == "restitution":
        ax.set_xscale("log")
    plain_ticks(ax)
    add_grid(ax)


def _draw_loop(found: Identification, ax: Axes) -> None:
    loop = found.loop
    assert loop is not None
    ax.plot(LENGTH(loop["deflection"]), FORCE(loop["force"]), "o", markersize=3,
            color=COLOURS["exact"], label="record, integrated")  # fmt: skip
    ax.plot(LENGTH(loop["deflection"]), FORCE(loop["law"]), color=COLOURS["simulate"],
            label="law on that motion")  # fmt: skip
    ax.set_xlabel(f"deflection ({LENGTH})")
    ax.set_ylabel(f"force ({FORCE})")
    ax.legend(fontsize="small")
    add_grid(ax)


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


def plot_history(each: ReplayAt, ax: Axes | None = None) -> Axes:
    """x(t) around the shock between its stops, with the impacts; all coordinates where there are
    several."""
    return _plot_shock(each, axes_or_new(ax, (9.6, 4.2)))


def _plot_shock(each: ReplayAt, ax: Axes, *, whole: bool = False, legend: bool = True) -> Axes:
    """x(t) with stops and impacts: around the shock, that is the fastest impact, or `whole`."""
    kept = each.histories
    assert kept is not None
    first = kept.displacement[_first_moving(each)]
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
        legend_above(ax, 4)
    return ax


def plot_waterfall(each: ReplayAt, ax: Axes | None = None) -> Axes:
    """Short-time spectra of the absolute acceleration of the first coordinate that moves, over the
    whole record, with the impacts as marks above them."""
    from matplotlib.colors import LogNorm

    kept = each.histories
    assert kept is not None
    ax = axes_or_new(ax, (9.6, 4.2))
    owner = _first_moving(each)
    spectra = kept.short_time_spectra(owner)
    unit = shown_as("(rad/s^2)^2/Hz") if owner in ROTATIONS else DENSITY
    density = unit(np.maximum(spectra.density, LEAST_DENSITY))
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


def _first_moving(each: ReplayAt) -> str:
    """The first coordinate that moves; the first one where none does."""
    return min(each.coordinates, key=each.still.__contains__)


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


def draw_replay(found: Replay) -> Axes:
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
        return add_title(above, "replay of the record")
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
    return add_title(axes[0], "replay of the record")
