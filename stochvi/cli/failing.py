"""The command that tells how likely a mission is to go wrong."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from stochvi.cli.jobs import _acceleration
from stochvi.cli.methods import _barrier
from stochvi.cli.shared import console_for, main, options, progress_bar

if TYPE_CHECKING:
    from rich.console import Console

    from stochvi.statistics.reliability import Reliability

UNITS = {"impact_speed": "m/s", "peak_acceleration": "m/s^2"}


@main.command()
@click.argument("scene")
@click.option("--mission", type=float, required=True, metavar="SECONDS", help="Its duration.")
@click.option(
    "--barrier", metavar="B|LO,HI",
    help="Without stops: metres from the unloaded spring; leave one empty for none.",
)  # fmt: skip
@click.option("--impact-speed", type=float, metavar="M/S", help="A hit must not be faster.")
@click.option(
    "--peak-acceleration", metavar="A|Ag",
    help="No contact must bring more: m/s^2, or g (80g); stops that give way.",
)  # fmt: skip
@click.option(
    "--start", type=click.Choice(["rest", "stationary"]), default="stationary", show_default=True,
    help="At rest, or in the stationary motion.",
)  # fmt: skip
@click.option(
    "--way", type=click.Choice(["crude", "splitting", "first-crossings"]),
    help="Default: what a pilot finds cheapest.",
)  # fmt: skip
@click.option(
    "--rel-error", type=float, default=0.05, show_default=True, help="Relative standard error."
)
@options("budget", "seed", "threads", "json", "out", "quiet")
def reliability(
    scene: str,
    mission: float,
    barrier: str | None,
    impact_speed: float | None,
    peak_acceleration: str | None,
    start: str,
    way: str | None,
    rel_error: float,
    budget: float,
    seed: int,
    threads: int | None,
    json_file: str | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """P(any hit), P(too hard a hit) and expected hits in a mission, down to 1e-9.

    Example: stochvi reliability box.toml --mission 3600 --impact-speed 0.5 --start rest
    """
    from stochvi.results.errors import NotConverged
    from stochvi.scenes.scene import load_scene
    from stochvi.statistics.reliability import reliability as solve
    from stochvi.views.files import write_json, write_table

    loaded = load_scene(scene)
    asked: dict[str, Any] = {"start": start, "way": way and way.replace("-", " ")}
    reason: NotConverged | None = None
    with progress_bar(quiet, "reliability") as report:
        try:
            found = solve(
                loaded,
                mission=mission,
                barrier=None if barrier is None else _barrier(barrier),
                impact_speed=impact_speed,
                peak_acceleration=_acceleration(peak_acceleration),
                rel_error=rel_error,
                seed=seed,
                threads=threads,
                budget=budget,
                progress=report,
                **asked,
            )
        except NotConverged as error:
            if error.response is None:
                raise
            # what is known is told, and then what is missing
            found, reason = error.response, error
    if not quiet:
        typed = peak_acceleration or ""
        print_reliability(console_for(json_file), found, typed if typed.endswith("g") else None)
    if json_file is not None:
        write_json(found.to_dict(), json_file)
    if out is not None:
        write_table(found.to_frame(), out / "reliability.csv")
    if reason is not None:
        raise reason


NEAR_ONE = 0.999
"""From here on a chance is told by the end of its interval: no digits of it are left to read."""


def _spoken(value: float, error: float, lower: float) -> str:
    """A chance with its error, or what it is more than."""
    from stochvi.results.estimates import format_with_error

    if value < NEAR_ONE:
        return format_with_error(value, error)
    # rounded down: it is to be over what is said
    return f"over {math.floor(1000.0 * lower) / 1000.0:g}"


def print_reliability(console: Console, found: Reliability, typed: str | None = None) -> None:
    """The chances and their intervals, the way to each, the price; `typed` is a limit of the
    acceleration in g."""
    from stochvi.results.estimates import format_with_error
    from stochvi.views.tables import _say, _show, _table

    title = f"in a mission of {found.mission:g} s from {SPOKEN[found.start]}"
    percent = f"{100.0 * found.confidence:g} % interval"
    table = _table(title, ["event", "probability", percent, "rel. bias", "way", "CPU s", "crude"])
    for name, chance in found.chances.items():
        estimate = chance.estimate
        limit = "" if chance.limit is None else f" > {chance.limit:g} {UNITS[name]}"
        if name == "peak_acceleration" and typed:
            limit = f" > {typed.removesuffix('g').strip()} g"
        known = estimate.bias is not None and estimate.value > 0.0
        crude = chance.crude_seconds
        table.add_row(
            f"{name.replace('_', ' ')}{limit}",
            _spoken(estimate.value, estimate.standard_error, chance.lower),
            f"{chance.lower:.3g} to {chance.upper:.3g}",
            f"{(estimate.bias or 0.0) / estimate.value:.1g}" if known else "unknown",
            chance.way,
            f"{chance.seconds:.2g}",
            "" if crude is None else f"{crude:.2g}",
        )
    for name in found.missing:
        if name != "expected_hits":
            table.add_row(name.replace("_", " "), "not found", "", "", "", "", "")
    _show(console, table)
    if "expected_hits" in found.missing:
        console.print("expected hits not found", highlight=False)
    if found.hits is not None and found.hits_interval is not None:
        lower, upper = found.hits_interval
        value = format_with_error(found.hits.value, found.hits.standard_error)
        console.print(f"expected hits {value}, {lower:.4g} to {upper:.4g}", highlight=False)
    for chance in found.chances.values():
        _say(console, f"{chance.event.replace('_', ' ')}: {chance.why}")
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)
    _say(console, f"assumptions: {'; '.join(found.assumptions)}")
    _say(console, f"cost: {found.cost.wall_time:.3g} s; crude: CPU seconds for the same error")


SPOKEN = {"rest": "rest", "stationary": "the stationary motion"}
