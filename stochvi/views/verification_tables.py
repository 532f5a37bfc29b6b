"""Verdicts, costs and explanations on a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from stochvi.mathematics.shown_units import LENGTH, MILLIRADIANS
from stochvi.results.estimates import format_with_error
from stochvi.results.quantity_units import ROTATIONS
from stochvi.verification.check import (
    APPROXIMATE,
    BALANCE,
    DETERMINISTIC_ERROR,
    DISAGREES,
    OTHER_THRESHOLD,
    STOPPED_EARLY,
    Check,
    Comparison,
)
from stochvi.verification.check_of_many import BALANCES_ONLY
from stochvi.verification.cost import TARGETS, ModelError, StepError, WorkPrecision, spoken_time
from stochvi.views.tables import (
    NO_VALUE,
    QUANTITY_NAMES,
    effects_in_words,
    formatted_cell,
    new_table,
    print_line,
    print_table,
)

if TYPE_CHECKING:
    from rich.console import Console

    from stochvi.verification.check_of_many import Checks
    from stochvi.verification.explain import Explanation
    from stochvi.verification.testing.judging import Finding, Judgement


NOT_JUDGED = (APPROXIMATE, OTHER_THRESHOLD)
"""Verdicts on approximations."""


def print_check(console: Console, verdict: Check) -> None:
    """Print what was judged, the errors of linearisation, and the verdict in a sentence."""
    judged = [row for row in verdict.comparisons if row.verdict not in NOT_JUDGED]
    for method in dict.fromkeys(row.method for row in judged):
        _print_judged(console, [row for row in judged if row.method == method])
    _print_approximations(console, verdict)
    for reason in verdict.left_out:
        if not reason.startswith(STOPPED_EARLY):
            print_line(console, f"left out: {reason}")
        elif reason != verdict.summary():  # which is printed below
            print_line(console, reason)
    for response in verdict.responses[:1]:
        for warning in response.warnings:
            console.print(f"note: {warning}", style="yellow", highlight=False)
    console.print(verdict.summary(), style="green" if verdict.passed else "bold red")


def print_checks(console: Console, verdict: Checks) -> None:
    """Print a line for each scene, every alarm, and the verdict in a sentence."""
    overview = verdict.overview()
    headings = [str(name) for name in overview.columns]
    table = new_table("scenes, under one alarm rate", headings, ["scene", "methods", "verdict"])
    for line in overview.itertuples(index=False):
        cells = [formatted_cell(cell, ".2f" if isinstance(cell, float) else "") for cell in line]
        cells = ["" if cell == "nan" else cell for cell in cells]
        table.add_row(*cells, style="" if cells[-1] in ("passed", BALANCES_ONLY) else "bold red")
    print_table(console, table)
    for name, row in verdict.alarms:
        print_line(
            console,
            f"alarm: {name}: {row.quantity} of {row.of}: {row.method} {row.value:.6g}, "
            f"{row.reference} {row.reference_value:.6g}, allowed {row.tolerance:.1e}",
        )
    console.print(verdict.summary(), style="green" if verdict.passed else "bold red")


def print_problems(console: Console, sentences: Mapping[str, str]) -> None:
    """Print a line for each problem: its name, and a sentence that describes it."""
    width = max(map(len, sentences))
    for name, sentence in sentences.items():
        console.print(f"{name:{width}}  {sentence}", markup=False, highlight=False, soft_wrap=True)


def print_judgement(console: Console, verdict: Judgement) -> None:
    """Print every quantity with its true value, likely causes of disagreements, and the verdict."""
    if verdict.read_as:
        print_line(console, verdict.read_as)
    headings = ["quantity", "truth", "found", "off by (%)", "visible (%)", "verdict"]
    table = new_table("judged against the known answer", headings, ["quantity", "verdict"])
    for row in verdict.findings:
        style = "bold red" if row in verdict.failures else ""
        table.add_row(*_finding_cells(row), style=style)
    print_table(console, table)
    for reason in verdict.left_out:
        print_line(console, f"left out: {reason}")
    for hint in verdict.hints:
        print_line(console, f"looks like: {hint}")
    console.print(
        verdict.summary(), style="green" if verdict.passed else "bold red", highlight=False
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


def _print_judged(console: Console, judged: Sequence[Comparison]) -> None:
    """The comparisons and balances of one method that claims to be right."""
    against = [row.reference for row in judged if row.of != BALANCE]
    title = f"judged: {judged[0].method}"
    title += f" against {against[0]}, and its balances" if against else ", its balances"
    headings = ["quantity", "reference", "value", "difference", "allowed", "verdict"]
    table = new_table(title, headings)
    for row in judged:
        name = f"{row.quantity} balance" if row.of == BALANCE else QUANTITY_NAMES[row.quantity]
        reference = "" if row.of == BALANCE else f"{row.reference_value:.6g}"
        table.add_row(
            name,
            reference,
            f"{row.value:.2e}" if row.of == BALANCE else f"{row.value:.6g}",
            f"{row.difference:+.1e}",
            "" if row.tolerance is None else f"{row.tolerance:.1e}",
            row.verdict,
            style="bold red" if row.verdict == DISAGREES else "",
        )
    print_table(console, table)


def _print_approximations(console: Console, verdict: Check) -> None:
    """Relative errors of the approximate methods against the reference, not judged."""
    shown = [row for row in verdict.comparisons if row.verdict in NOT_JUDGED]
    if not shown:
        return
    methods = list(dict.fromkeys(row.method for row in shown))
    title = f"errors of approximations against {shown[0].reference} (%), not judged"
    headings = ["quantity", *(method.removeprefix("linearise:") for method in methods)]
    table = new_table(title, headings)
    for quantity in dict.fromkeys(row.quantity for row in shown):
        if quantity == "displacement_mean":
            continue
        rows = {row.method: row for row in shown if row.quantity == quantity}
        cells = [_error_in_words(rows[method]) if method in rows else "" for method in methods]
        table.add_row(QUANTITY_NAMES[quantity], *cells)
    print_table(console, table)


def _error_in_words(row: Comparison) -> str:
    """The relative error in per cent; "never seen" where the reference value is 0, and no number
    where the two count impacts above different speeds."""
    if row.verdict == OTHER_THRESHOLD:
        return "other threshold"
    if row.reference_value == 0.0 != row.value:
        return "never seen"
    return f"{100.0 * row.relative:+.2f}"


def print_explanation(console: Console, explanation: Explanation) -> None:
    """Print which effects would be simulated, by which method, and the expected cost."""
    words = ("simulated:", "not simulated:")
    if not explanation.simulated:
        words = ("in the scene:", "not in the scene:")
    width = max(map(len, words)) + 1
    for word, effects in zip(words, (explanation.effects, explanation.absent), strict=True):
        console.print(f"{word:{width}}{effects_in_words(effects) or '-'}", highlight=False)
    _print_modes(console, explanation)
    for method, verdict in explanation.methods.items():
        console.print(f"{method}: {verdict}", highlight=False)
    plan = explanation.simulation
    if plan is not None:
        console.print(
            f"{plan.method}: {plan.states} states, step {plan.step:.3g} s, {plan.steps_per_path} "
            f"steps a path ({plan.burn_in:.3g} s of burn-in, {plan.duration:.3g} s counted), "
            f"{plan.nanoseconds_per_step:.2g} ns a step here",
            highlight=False,
        )
        for target, seconds in plan.seconds.items():
            cost = "unknown"
            if seconds is not None:
                cost = f"about {seconds:.1g} s" if seconds < 10.0 else f"about {seconds:.0f} s"
            console.print(
                f"relative error {target:g}: {cost} ({plan.governed_by})", highlight=False
            )
    for assumption in explanation.assumptions:
        print_line(console, f"assumed: {assumption}")
    for note in explanation.notes:
        console.print(f"note: {note}", style="yellow", highlight=False)


def print_phases(console: Console, phases: Mapping[str, Explanation]) -> None:
    """Print the explanation of each phase of a mission."""
    for name, each in phases.items():
        console.print(f"phase {name}", style="bold", highlight=False)
        print_explanation(console, each)
    print_line(console, "all phases together: size, reliability and damage")


def _print_modes(console: Console, explanation: Explanation) -> None:
    """Print the modes of a structure of several coordinates, and where it rests under loads."""
    if len(explanation.modes) > 1:
        axes = list(explanation.modes[0].effective_mass)
        titles = [f"along {axis} (kg)" if axis else "eff. mass (kg)" for axis in axes]
        table = new_table(
            "natural modes without stops, and the mass that each moves with the base",
            ["mode", "Hz", "zeta", *titles, "motion"],
        )
        for number, mode in enumerate(explanation.modes, start=1):
            zeta = "-" if mode.damping_ratio is None else f"{mode.damping_ratio:.3g}"
            moved = [f"{mode.effective_mass[axis]:.3g}" for axis in axes]
            table.add_row(str(number), f"{mode.frequency_hz:.4g}", zeta, *moved, mode.motion)
        print_table(console, table)
    if explanation.rest:
        listed = ", ".join(
            f"{name} {(MILLIRADIANS if name in ROTATIONS else LENGTH).text(value, '.3g')}"
            for name, value in explanation.rest.items()
        )
        print_line(console, f"at rest under constant loads: {listed}")
    for name, gap in explanation.rest_of_gaps.items():
        left = [
            f"{LENGTH.text(distance, '.3g')} from its {side} stop"
            for side, distance in (("lower", gap.to_lower), ("upper", gap.to_upper))
            if distance is not None
        ]
        print_line(
            console, f"{name} rests at {LENGTH.text(gap.position, '.3g')}, {' and '.join(left)}"
        )


def print_cost(console: Console, found: WorkPrecision) -> None:
    """Print bias and statistical error at each step, the CPU times that follow, and errors of
    models."""
    steps = [f"{step:.3g} s" for step in found.steps]
    bias = new_table("bias of the step (%)", ["quantity", *steps])
    noise = new_table("standard error of one CPU second (%)", ["quantity", *steps])
    for key in dict.fromkeys((row.of, row.quantity) for row in found.errors):
        rows = [row for row in found.errors if (row.of, row.quantity) == key]
        bias.add_row(_whose(found, *key), *(_step_bias(found, row) for row in rows))
        noise.add_row(
            _whose(found, *key), *(f"{100.0 * row.error_of_a_second:.2g}" for row in rows)
        )
    print_table(console, bias)
    print_table(console, noise)
    _print_prices(console, found)
    _print_models(console, found)
    against = f"biases are measured against: {found.reference}"
    if found.reference == "fokker-planck":
        against += " (itself against the simulation)"
    if found.elastic:
        against += "; with elastic stops there is none at any step, in theory"
    print_line(console, against)
    print_line(
        console,
        f"{found.method}, {found.cost.paths} paths at every step, {found.cost.wall_time:.3g} s on "
        f"{found.cost.threads} threads; errors of a mean are relative to the standard "
        "deviation of the displacement",
    )
    if not found.elastic:
        print_line(
            console,
            "these are true errors; the interval that simulate states is wider, as it holds what "
            "simulate knows of its own bias",
        )
    for reason in found.left_out:
        console.print(f"note: {reason}", style="yellow", highlight=False)
    console.print(found.summary(), style="green" if not found.left_out else "yellow")


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


def _print_prices(console: Console, found: WorkPrecision) -> None:
    """Print the CPU seconds that bring statistical error and bias below each target, by step."""
    targets = [f"{100.0 * target:g} %" for target in TARGETS]
    groups = [("", False), ("impacts ", True)]
    groups = [group for group in groups if found.of_step(found.steps[0], rates=group[1])]
    headings = [name + target for name, _ in groups for target in targets]
    table = new_table("CPU time until both are below (-: bias is not)", ["step", *headings])
    for step in found.steps:
        cells = []
        for _, rates in groups:
            for target in TARGETS:
                prices = [row.seconds(target) for row in found.of_step(step, rates=rates)]
                known = [price for price in prices if price is not None]
                complete = bool(known) and len(known) == len(prices)
                cells.append(spoken_time(max(known)) if complete else "-")
        table.add_row(f"{step:.3g} s{' *' if step == found.default_step else ''}", *cells)
    print_table(console, table)
    usual = "* the step that simulate takes"
    print_line(
        console, usual if found.elastic else f"{usual}, and twice it: half as much time on top"
    )


def _print_models(console: Console, found: WorkPrecision) -> None:
    """Print the errors of models, which more time does not make smaller."""
    if not found.models:
        return
    methods = list(dict.fromkeys(row.method for row in found.models))
    short = {"fokker-planck": "Fokker-P.", "average:finite jumps": "average"}
    names = [short.get(method, method.removeprefix("linearise:")) for method in methods]
    title = "error of methods without random numbers (%) [bound that the method states]"
    table = new_table(title, ["quantity", *names])
    for key in dict.fromkeys((row.of, row.quantity) for row in found.models):
        errors = {row.method: row for row in found.models if (row.of, row.quantity) == key}
        cells = [_model_error(errors[m]) if m in errors else NO_VALUE for m in methods]
        table.add_row(_whose(found, *key), *cells)
    print_table(console, table)
    print_line(console, f"{NO_VALUE}: not known, or of impacts above another speed than simulated")


def _model_error(row: ModelError) -> str:
    bound = f" [{100.0 * row.stated_bias:.2g}]" if row.stated_bias else ""
    if abs(row.model_error) < DETERMINISTIC_ERROR:
        return f"0{bound}"
    if row.model_error_error == 0.0:
        return f"{100.0 * row.model_error:.3g}{bound}"
    return f"{format_with_error(100.0 * row.model_error, 100.0 * row.model_error_error)}{bound}"
