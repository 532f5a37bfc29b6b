"""Tables on a terminal: numbers and names are never cut short."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from stochvi.isolators.sizing.answer import HITS_PER_FIRST_HIT, spoken_mission, spoken_percent
from stochvi.results.estimates import Estimate, format_with_error
from stochvi.results.response import QUANTITY_UNITS, Response
from stochvi.verification.check import (
    APPROXIMATE,
    BALANCE,
    DISAGREES,
    ROUNDING,
    Check,
    Comparison,
)
from stochvi.verification.checks import BALANCES_ONLY
from stochvi.verification.cost import TARGETS, ModelError, StepError, WorkPrecision, spoken_time
from stochvi.views.words import places_of_stops

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators.screening import Screening
    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.methods.fokker_planck import FirstPassage
    from stochvi.verification.checks import Checks
    from stochvi.verification.explain import Explanation

QUANTITY_NAMES = {
    "displacement_mean": "mean displacement",
    "displacement_std": "rms displacement",
    "displacement_mean_square": "mean square displ.",
    "velocity_std": "rms velocity",
    "velocity_mean_square": "mean square velocity",
    "acceleration_std": "rms abs. acceleration",
    "upcrossing_rate": "up-crossings of mean",
    "collision_rate": "hits, all stops",
    "collision_rate_lower": "hits, lower stop",
    "collision_rate_upper": "hits, upper stop",
    "impact_speed_mean": "mean impact speed",
    "impact_speed_rate": "F1, sum of w per s",
    "impact_speed_square_rate": "F2, sum of w^2 per s",
    "peak_force": "peak force",
    "contact_probability": "share of time in contact",
    "contact_force_lower": "mean force, lower stop",
    "contact_force_upper": "mean force, upper stop",
    "relative_displacement_mean": "mean relative displ.",
    "relative_displacement_std": "rms relative displ.",
    "relative_velocity_std": "rms relative velocity",
}
"""Short names for people; w is the speed of an impact, rms is about the mean."""

NOISE = 4.0
"""Standard errors below which a number may be nothing but noise."""

ROUGH = 1e-3
"""Relative bias from which on four digits are enough."""

NEGLIGIBLE = 1e-12
"""Means below this share of the standard deviation are rounding, and shown as 0."""


def print_response(console: Console, response: Response) -> None:
    """Every quantity with its errors, then what was simulated, assumed and warned of."""
    table = _table(response.method, ["of", "quantity", "value", "unit", "rel. error", "rel. bias"])
    deviation = _deviation(response)
    for (owner, name), estimate in response.estimates().items():
        table.add_row(
            owner,
            QUANTITY_NAMES[name],
            _value(estimate, deviation if name == "displacement_mean" else 0.0),
            QUANTITY_UNITS[name],
            _relative(estimate.standard_error, estimate),
            "unknown" if estimate.bias is None else _relative_bias(estimate),
        )
    _show(console, table)
    for reason in _without_bound(response):
        _say(console, f"{NO_BOUND}{reason}")
    balances = [
        f"{name} {format_with_error(residual.value, residual.standard_error)}"
        if residual.standard_error
        else f"{name} {residual.value:.0e}"
        for name, residual in response.identities.items()
    ]
    if balances:
        _say(console, f"balances, relative to their largest term: {', '.join(balances)}")
    _say(console, f"simulated effects: {'; '.join(response.effects)}")
    _say(console, f"assumptions: {'; '.join(response.assumptions)}")
    cost = response.cost
    price = f"cost: {cost.wall_time:.3g} s"
    if cost.steps:
        price += (
            f" on {cost.threads} threads (compilation {cost.compile_time:.2g} s apart), "
            f"{cost.steps:.3g} steps, {cost.impacts:.3g} impacts, {cost.paths} paths"
        )
    if cost.tenfold_wall_time is not None:
        price += f"; a tenth of the errors: about {cost.tenfold_wall_time:.2g} s"
    _say(console, price)
    for warning in response.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


NO_BOUND = "no error bound: "
"""In what an approximation says of itself, before the reason."""


def _without_bound(response: Response) -> list[str]:
    """Why the error of a number that nothing was sampled for is unknown."""
    told = [
        each.how
        for each in response.estimates().values()
        if each.bias is None and each.standard_error == 0.0
    ]
    reasons = [
        how.partition(NO_BOUND)[2] or f"none is known of what {how.partition(';')[0]} gives here"
        for how in told
    ]
    return list(dict.fromkeys(reasons))


def print_first_passage(console: Console, found: FirstPassage) -> None:
    """P(first passage before t) at each time, then its mean time and rates."""
    table = _table("P(first passage before t)", ["t (s)", "probability", "rel. bias"])
    for moment, estimate in zip(found.times, found.probability, strict=True):
        table.add_row(f"{moment:g}", _value(estimate), _relative_bias(estimate))
    _show(console, table)
    ends = [f"{x:g} m" for x in (found.lower, found.upper) if x is not None]
    _say(console, f"barriers at {' and '.join(ends)}; start: {found.start}")
    rates = [
        f"mean time to the first passage {_value(found.mean_time)} s",
        f"rate in the end {_value(found.decay_rate)} 1/s",
    ]
    if found.rice_rate is not None:
        rates.append(f"Rice {found.rice_rate.value:.4g} 1/s")
    console.print("; ".join(rates), highlight=False)
    _say(console, f"simulated effects: {'; '.join(found.effects)}")
    _say(console, f"assumptions: {'; '.join(found.assumptions)}")
    _say(console, f"cost: {found.cost.wall_time:.3g} s")


def print_check(console: Console, verdict: Check) -> None:
    """What was judged, what linearisation gets wrong, and the verdict in a sentence."""
    judged = [row for row in verdict.comparisons if row.verdict != APPROXIMATE]
    for method in dict.fromkeys(row.method for row in judged):
        _print_judged(console, [row for row in judged if row.method == method])
    _print_approximations(console, verdict)
    for reason in verdict.left_out:
        _say(console, f"left out: {reason}")
    for response in verdict.responses[:1]:
        for warning in response.warnings:
            console.print(f"note: {warning}", style="yellow", highlight=False)
    console.print(verdict.summary(), style="green" if verdict.passed else "bold red")


def print_checks(console: Console, verdict: Checks) -> None:
    """A line for each scene, every alarm, and the verdict in a sentence."""
    overview = verdict.overview()
    headings = [str(name) for name in overview.columns]
    table = _table("scenes, under one alarm rate", headings, ["scene", "methods", "verdict"])
    for line in overview.itertuples(index=False):
        cells = [_cell(cell, ".2f" if isinstance(cell, float) else "") for cell in line]
        cells = ["" if cell == "nan" else cell for cell in cells]
        table.add_row(*cells, style="" if cells[-1] in ("passed", BALANCES_ONLY) else "bold red")
    _show(console, table)
    for name, row in verdict.alarms:
        _say(
            console,
            f"alarm: {name}: {row.quantity} of {row.of}: {row.method} {row.value:.6g}, "
            f"{row.reference} {row.reference_value:.6g}, allowed {row.tolerance:.1e}",
        )
    console.print(verdict.summary(), style="green" if verdict.passed else "bold red")


def _print_judged(console: Console, judged: Sequence[Comparison]) -> None:
    """The comparisons and balances of one method that claims to be right."""
    against = [row.reference for row in judged if row.of != BALANCE]
    title = f"judged: {judged[0].method}"
    title += f" against {against[0]}, and its balances" if against else ", its balances"
    headings = ["quantity", "reference", "value", "difference", "allowed", "verdict"]
    table = _table(title, headings)
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
    _show(console, table)


def _print_approximations(console: Console, verdict: Check) -> None:
    """Relative errors of the approximate methods against the reference, not judged."""
    shown = [row for row in verdict.comparisons if row.verdict == APPROXIMATE]
    if not shown:
        return
    methods = list(dict.fromkeys(row.method for row in shown))
    title = f"error of linearisation against {shown[0].reference} (%), not judged"
    headings = ["quantity", *(method.removeprefix("linearise:") for method in methods)]
    table = _table(title, headings)
    for quantity in dict.fromkeys(row.quantity for row in shown):
        if quantity == "displacement_mean":
            continue
        errors = {row.method: row.relative for row in shown if row.quantity == quantity}
        cells = [f"{100.0 * errors[m]:+.2f}" if m in errors else "" for m in methods]
        table.add_row(QUANTITY_NAMES[quantity], *cells)
    _show(console, table)


def print_frame(
    console: Console, frame: pd.DataFrame, title: str, formats: Mapping[str, str] | None = None
) -> None:
    """A table of numbers, one format per column (default: 4 significant digits)."""
    numeric = {str(name): frame[name].dtype.kind in "fiu" for name in frame.columns}
    table = _table(title, list(numeric), [name for name in numeric if not numeric[name]])
    for _, row in frame.iterrows():
        cells = (_cell(row[name], (formats or {}).get(name, ".4g")) for name in numeric)
        table.add_row(*cells)
    _show(console, table)


def print_explanation(console: Console, told: Explanation) -> None:
    """What would be simulated, by what, at which price."""
    console.print("simulated:     " + "; ".join(told.effects), highlight=False)
    console.print("not simulated: " + ("; ".join(told.absent) or "-"), highlight=False)
    for method, verdict in told.methods.items():
        console.print(f"{method}: {verdict}", highlight=False)
    plan = told.simulation
    if plan is not None:
        console.print(
            f"{plan.method}: {plan.states} states, step {plan.step:.3g} s, "
            f"{plan.steps_per_path} steps a path "
            f"({plan.burn_in:.3g} s of burn-in, {plan.duration:.3g} s counted), "
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
    _say(console, f"assumptions: {'; '.join(told.assumptions)}")
    for note in told.notes:
        console.print(f"note: {note}", style="yellow", highlight=False)


def print_screening(console: Console, linear: Screening) -> None:
    """The linear screening of an isolator, with its notes."""
    print_frame(console, linear.to_frame(), "linear screening, stops left out")
    for note in linear.notes:
        console.print(f"note: {note}", style="yellow", highlight=False)


CLEARANCE_COLUMNS = {
    "clearance_in_sigma": "gap/sigma",
    "gap": "gap (mm)",
    "rice": "Rice (1/s)",
    "closure": "closure",
    "simulated": "Monte Carlo",
    "interval": "95 % interval",
    "impact_speed_mean": "speed (m/s)",
}


def print_clearance(console: Console, curve: pd.DataFrame) -> None:
    """Hit rate against clearance, as `clearance_curve` returns it."""
    limits = zip(curve["simulated_low"], curve["simulated_high"], strict=True)
    shown = curve.assign(
        gap=1e3 * curve["clearance"], interval=[f"{a:.3g} to {b:.3g}" for a, b in limits]
    )
    print_frame(
        console,
        shown[list(CLEARANCE_COLUMNS)].rename(columns=CLEARANCE_COLUMNS),
        "hits per second on both stops, and mean impact speed",
        {"gap/sigma": ".2f"},
    )


def print_sizing(console: Console, sizing: Sizing, sensitivity: pd.DataFrame | None = None) -> None:
    """The clearance and what three sigma buys, first; then what both rest on."""
    console.print(sizing.verdict(), style="bold", highlight=False)
    _say(console, places_of_stops(sizing))
    three, mission = sizing.three_sigma, spoken_mission(sizing.mission)
    table = _table(
        f"at 3 sigma = {1e3 * three.clearance:.4g} mm, in {mission}", ["quantity", "value"]
    )
    table.add_row("chance of any hit", spoken_percent(three.probability.value))
    table.add_row("hits by Rice", f"{three.rice_hits:.4g}")
    table.add_row("first hits (bursts)", _value(three.first_hits))
    if three.hits is not None:
        table.add_row("hits, simulated", _value(three.hits))
    if three.impact_speed_mean is not None:
        table.add_row("mean impact speed (m/s)", _value(three.impact_speed_mean))
    _show(console, table)
    limits = zip(sizing.required["clearance_low"], sizing.required["clearance_high"], strict=True)
    print_frame(
        console,
        sizing.required.assign(
            probability=[spoken_percent(chance) for chance in sizing.required["probability"]],
            clearance=1e3 * sizing.required["clearance"],
            interval=[f"{1e3 * low:.4g} to {1e3 * high:.4g}" for low, high in limits],
        )[list(REQUIRED_COLUMNS)].rename(columns=REQUIRED_COLUMNS),
        f"chance of any hit in {mission}",
    )
    _print_hits(console, sizing)
    if sensitivity is not None:
        print_frame(
            console,
            sensitivity.assign(
                clearance=1e3 * sensitivity["clearance"],
                clearance_change=[f"{100.0 * c:+.1f} %" for c in sensitivity["clearance_change"]],
                probability=[spoken_percent(chance) for chance in sensitivity["probability"]],
            )[list(CHANGE_COLUMNS)].rename(columns=CHANGE_COLUMNS),
            "for the same target, and at the old clearance",
        )
    _say(console, f"method: {sizing.method}")
    _say(console, f"cost: {sizing.cost.wall_time:.3g} s on {sizing.cost.threads} threads")
    for warning in sizing.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def _print_hits(console: Console, sizing: Sizing) -> None:
    """At 3 sigma and at the answer; what was tried on the way there answers nothing."""
    if len(sizing.simulated):
        places = [sizing.three_sigma.clearance, sizing.clearance.value]
        table = sizing.simulated[sizing.simulated["clearance"].isin(places)]
        print_frame(
            console,
            table.assign(clearance=1e3 * table["clearance"])[list(HIT_COLUMNS)].rename(
                columns=HIT_COLUMNS
            ),
            "hits on all stops, with the stop law",
        )
        _say(console, HITS_PER_FIRST_HIT)
    _say(console, LAST_DIGITS)


LAST_DIGITS = "in brackets: the standard error of the last digits, 607(20) is 607 +- 20"
"""How `Estimate` is written, in words."""

REQUIRED_COLUMNS = {
    "probability": "chance",
    "clearance": "clearance (mm)",
    "interval": "95 % interval",
    "clearance_in_sigma": "in sigma",
}

CHANGE_COLUMNS = {
    "change": "change",
    "clearance": "clearance (mm)",
    "clearance_change": "by",
    "probability": "chance of any hit",
}

HIT_COLUMNS = {
    "clearance": "clearance (mm)",
    "clearance_in_sigma": "in sigma",
    "hit_rate": "hits (1/s)",
    "hits_per_first_hit": "hits per first hit",
    "impact_speed_mean": "mean speed (m/s)",
    "by": "by",
}


def print_cost(console: Console, found: WorkPrecision) -> None:
    """Bias and statistical error at each step, the prices that follow, and errors of models."""
    steps = [f"{step:.3g} s" for step in found.steps]
    bias = _table("bias of the step (%)", ["quantity", *steps])
    noise = _table("standard error of one CPU second (%)", ["quantity", *steps])
    for key in dict.fromkeys((row.of, row.quantity) for row in found.errors):
        rows = [row for row in found.errors if (row.of, row.quantity) == key]
        bias.add_row(_whose(found, *key), *(_step_bias(found, row) for row in rows))
        noise.add_row(
            _whose(found, *key), *(f"{100.0 * row.error_of_a_second:.2g}" for row in rows)
        )
    console.print(bias)
    console.print(noise)
    _print_prices(console, found)
    _print_models(console, found)
    against = f"biases are measured against: {found.reference}"
    if found.elastic:
        against += "; with elastic stops there is none at any step, in theory"
    _say(console, against)
    _say(
        console,
        f"{found.method}, {found.cost.paths} paths at every step, {found.cost.wall_time:.3g} s on "
        f"{found.cost.threads} threads; errors of a mean are relative to the rms displacement",
    )
    for reason in found.left_out:
        console.print(f"note: {reason}", style="yellow", highlight=False)
    console.print(found.summary(), style="green" if not found.left_out else "yellow")


def _whose(found: WorkPrecision, owner: str, quantity: str) -> str:
    """A quantity in words; of whom, where the scene has several coordinates or pairs."""
    hits = [row.of for row in found.errors if row.quantity == "impact_speed_rate"]
    moments = [row.of for row in found.errors if row.quantity == "velocity_mean_square"]
    alone = len(set(hits)) < 2 and len(set(moments)) < 2
    return QUANTITY_NAMES[quantity] if alone else f"{owner}: {QUANTITY_NAMES[quantity]}"


def _step_bias(found: WorkPrecision, row: StepError) -> str:
    """In per cent with its standard error; an upper limit where it may be nothing but noise."""
    if row.step_bias_limit is None:
        return "unknown"
    if row.bias_is_seen:
        return format_with_error(100.0 * row.step_bias, 100.0 * row.step_bias_error)
    if row.step_bias_error == 0.0:
        return "reference"
    return f"< {100.0 * (row.largest_bias if found.elastic else row.step_bias_limit):.2g}"


def _print_prices(console: Console, found: WorkPrecision) -> None:
    """CPU seconds to bring statistical error and bias below each target, by step."""
    targets = [f"{100.0 * target:g} %" for target in TARGETS]
    groups = [("", False), ("hits ", True)]
    groups = [group for group in groups if found.of_step(found.steps[0], rates=group[1])]
    headings = [name + target for name, _ in groups for target in targets]
    table = _table("CPU time until both are below (-: bias is not)", ["step", *headings])
    for step in found.steps:
        cells = []
        for _, rates in groups:
            for target in TARGETS:
                prices = [row.seconds(target) for row in found.of_step(step, rates=rates)]
                known = [price for price in prices if price is not None]
                complete = bool(known) and len(known) == len(prices)
                cells.append(spoken_time(max(known)) if complete else "-")
        table.add_row(f"{step:.3g} s{' *' if step == found.default_step else ''}", *cells)
    _show(console, table)
    usual = "* the step that simulate takes"
    _say(console, usual if found.elastic else f"{usual}, and twice it: half as much time on top")


def _print_models(console: Console, found: WorkPrecision) -> None:
    """Errors that no time makes smaller."""
    if not found.models:
        return
    methods = list(dict.fromkeys(row.method for row in found.models))
    bounded = [row.method for row in found.models if row.stated_bias]
    short = {"fokker-planck": "Fokker-P."}
    names = [short.get(method, method.removeprefix("linearise:")) for method in methods]
    title = "error of the model (%), free and to stay"
    title += "; bound: stated by Fokker-Planck" if bounded else ""
    table = _table(title, ["quantity", *names, *(["bound"] if bounded else [])])
    for key in dict.fromkeys((row.of, row.quantity) for row in found.models):
        errors = {row.method: row for row in found.models if (row.of, row.quantity) == key}
        cells = [_model_error(errors[m]) if m in errors else "" for m in methods]
        for method in bounded[:1]:
            bound = errors[method].stated_bias if method in errors else None
            cells.append("" if bound is None else f"{100.0 * bound:.2g}")
        table.add_row(_whose(found, *key), *cells)
    _show(console, table)


def _model_error(row: ModelError) -> str:
    if abs(row.model_error) < ROUNDING:
        return "0"
    if row.model_error_error == 0.0:
        return f"{100.0 * row.model_error:.3g}"
    return format_with_error(100.0 * row.model_error, 100.0 * row.model_error_error)


METHOD_COLUMNS = {
    "displacement_std": "rms x",
    "velocity_std": "rms v",
    "collision_rate": "hits",
    "impact_speed_rate": "F1",
    "impact_speed_square_rate": "F2",
}


def methods_table(responses: Sequence[Response]) -> pd.DataFrame:
    """One row per method, one column per quantity of `METHOD_COLUMNS`, values with errors."""
    import pandas as pd

    rows = []
    for response in responses:
        found = {name: estimate for (_, name), estimate in response.estimates().items()}
        row = {"method": response.method.removeprefix("linearise:")}
        for name, heading in METHOD_COLUMNS.items():
            row[heading] = _value(found[name]) if name in found else ""
        rows.append(row)
    return pd.DataFrame(rows)


WIDEST = 10_000
"""Columns that any table fits into."""

WORDS = ("of", "quantity", "unit", "verdict", "methods", "by", "change")


def _table(title: str, headings: Sequence[str], words: Sequence[str] = WORDS) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    for heading in headings:
        justify = "left" if heading in words else "right"
        table.add_column(heading, justify=justify, no_wrap=True, overflow="fold")  # type: ignore[arg-type]
    return table


def _show(console: Console, table: Table) -> None:
    """Print a table as wide as it is: a terminal may wrap its lines, nothing is cut short."""
    needed = Measurement.get(console, console.options.update(width=WIDEST), table).maximum
    width = console.width
    console.width = max(needed, width)
    try:
        console.print(table)
    finally:
        console.width = width


def _say(console: Console, line: str) -> None:
    console.print(line, style="dim", highlight=False)


def _deviation(response: Response) -> float:
    """The smallest of a coordinate, that means are measured by."""
    found = [
        estimate.value
        for (_, name), estimate in response.estimates().items()
        if name == "displacement_std"
    ]
    return min(found, default=0.0)


def _value(estimate: Estimate, scale: float = 0.0) -> str:
    if estimate.upper_95 is not None:
        return f"0 (< {estimate.upper_95:.2g})"
    if abs(estimate.value) < NEGLIGIBLE * scale:
        return "0"
    if estimate.standard_error == 0.0:
        # an approximation has no use for many digits
        rough = estimate.bias is None or estimate.bias > ROUGH * abs(estimate.value)
        return f"{estimate.value:.4g}" if rough else f"{estimate.value:.7g}"
    return format_with_error(estimate.value, estimate.standard_error)


def _relative(error: float, estimate: Estimate) -> str:
    if estimate.upper_95 is not None or (error == 0.0 and estimate.bias is None):
        return "-"
    if error == 0.0:
        return "0"
    ratio = error / abs(estimate.value) if estimate.value else float("inf")
    return f"{ratio:.1e}" if ratio < 1.0 else "-"


def _relative_bias(estimate: Estimate) -> str:
    """Not of what is itself no more than its error, as is a mean that vanishes."""
    if 0.0 < abs(estimate.value) < NOISE * estimate.standard_error:
        return "-"
    return _relative(estimate.bias or 0.0, estimate)


def _cell(value: object, form: str) -> str:
    return value if isinstance(value, str) else format(value, form)
