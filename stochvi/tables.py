"""Tables on a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from stochvi.crosscheck import APPROXIMATE, DISAGREES, Check
from stochvi.estimates import QUANTITY_UNITS, Estimate, Response, format_with_error

if TYPE_CHECKING:
    import pandas as pd

QUANTITY_NAMES = {
    "displacement_mean": "mean displacement",
    "displacement_std": "rms displacement about the mean",
    "displacement_mean_square": "mean square displacement",
    "velocity_std": "rms velocity",
    "velocity_mean_square": "mean square velocity",
    "acceleration_std": "rms absolute acceleration",
    "upcrossing_rate": "up-crossings of the mean",
    "collision_rate": "collision rate, all stops",
    "collision_rate_lower": "collision rate, lower stop",
    "collision_rate_upper": "collision rate, upper stop",
    "impact_speed_mean": "mean impact speed",
    "impact_speed_rate": "F1: impact speed per second",
    "impact_speed_square_rate": "F2: impact speed squared per second",
    "peak_force": "peak force",
}


def print_response(console: Console, response: Response) -> None:
    """Every quantity with its errors, then what was simulated, assumed and warned of."""
    table = Table(title=f"{response.method}", title_justify="left", title_style="bold")
    for heading, justify in (("of", "left"), ("quantity", "left")):
        table.add_column(heading, justify=justify)  # type: ignore[arg-type]
    for heading in ("value", "unit", "rel. error", "rel. bias"):
        table.add_column(heading, justify="left" if heading == "unit" else "right")
    for (owner, name), estimate in response.estimates().items():
        table.add_row(
            owner,
            QUANTITY_NAMES[name],
            _value(estimate),
            QUANTITY_UNITS[name],
            _relative(estimate.standard_error, estimate.value),
            "unknown" if estimate.bias is None else _relative(estimate.bias, estimate.value),
        )
    console.print(table)
    for name, residual in response.identities.items():
        console.print(
            f"{name} balance: off by {format_with_error(residual.value, residual.standard_error)} "
            "of its largest term",
            style="dim",
        )
    for title, lines in (("effects", response.effects), ("assumptions", response.assumptions)):
        console.print(f"{title}: {'; '.join(lines)}", style="dim", highlight=False)
    cost = response.cost
    price = f"cost: {cost.wall_time:.3g} s"
    if cost.steps:
        price += (
            f" on {cost.threads} threads (compilation {cost.compile_time:.2g} s apart), "
            f"{cost.steps:.3g} steps, {cost.impacts:.3g} impacts, {cost.paths} paths"
        )
    console.print(price, style="dim", highlight=False)
    for warning in response.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def print_check(console: Console, verdict: Check) -> None:
    """The comparisons of a check, and its verdict in a sentence."""
    table = Table(title="check", title_justify="left", title_style="bold")
    for heading in ("quantity", "methods"):
        table.add_column(heading)
    for heading in ("reference", "value", "difference", "tolerance"):
        table.add_column(heading, justify="right")
    table.add_column("verdict")
    for row in verdict.comparisons:
        style = {DISAGREES: "bold red", APPROXIMATE: "dim"}.get(row.verdict, "")
        balance = row.of == "balance"
        table.add_row(
            f"{row.quantity} balance" if balance else QUANTITY_NAMES[row.quantity],
            row.method if balance else f"{row.method} - {row.reference}",
            f"{row.reference_value:.6g}",
            f"{row.value:.6g}",
            f"{row.difference:+.2e}" + ("" if balance else f" ({100.0 * row.relative:+.2f} %)"),
            "" if row.tolerance is None else f"{row.tolerance:.2e}",
            row.verdict,
            style=style,
        )
    console.print(table)
    for reason in verdict.left_out:
        console.print(f"left out: {reason}", style="dim", highlight=False)
    if verdict.passed:
        judged = sum(row.verdict != APPROXIMATE for row in verdict.comparisons)
        console.print(
            f"{judged} comparisons agree within {verdict.z:.2f} standard errors and stated bias",
            style="green", highlight=False,
        )  # fmt: skip
    else:
        wrong = sum(row.verdict == DISAGREES for row in verdict.comparisons)
        console.print(f"{wrong} comparisons DISAGREE", style="bold red", highlight=False)


def print_frame(
    console: Console, frame: pd.DataFrame, title: str, formats: Mapping[str, str]
) -> None:
    """A table of numbers, one format per column (default: 4 significant digits)."""
    table = Table(title=title, title_justify="left", title_style="bold")
    for column in frame.columns:
        numeric = frame[column].dtype.kind in "fiu"
        table.add_column(str(column), justify="right" if numeric else "left")
    for _, row in frame.iterrows():
        table.add_row(*(_cell(row[name], formats.get(str(name), ".4g")) for name in frame.columns))
    console.print(table)


def methods_table(responses: Sequence[Response], quantities: Sequence[str]) -> pd.DataFrame:
    """One row per method, one column per quantity, values with their errors."""
    import pandas as pd

    rows = []
    for response in responses:
        found = {name: estimate for (_, name), estimate in response.estimates().items()}
        rows.append(
            {"method": response.method}
            | {name: _value(found[name]) if name in found else "" for name in quantities}
        )
    return pd.DataFrame(rows)


def _value(estimate: Estimate) -> str:
    if estimate.upper_95 is not None:
        return f"0 (< {estimate.upper_95:.2g})"
    if estimate.standard_error == 0.0:
        return f"{estimate.value:.7g}"
    return format_with_error(estimate.value, estimate.standard_error)


def _relative(error: float, value: float) -> str:
    if error == 0.0:
        return "0"
    ratio = error / abs(value) if value else float("inf")
    return f"{ratio:.1e}" if ratio < 1.0 else "-"


def _cell(value: object, form: str) -> str:
    return value if isinstance(value, str) else format(value, form)
