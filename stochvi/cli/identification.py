"""The command that finds the law of a stop from a test of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from stochvi.cli.options import SPEED, TIME, Common, Quantity, common
from stochvi.cli.program import main


@main.command()
@click.argument("file")
@click.option(
    "--test", "kind", required=True, type=click.Choice(["speeds", "times", "force", "drop"]),
    help="What FILE holds: speeds of approach and rebound; times of successive impacts; force over "
    "deflection (with times in front where it is fast); the acceleration of one drop.",
)  # fmt: skip
@click.option("--mass", type=float, metavar="KG", help="Mass that meets the stop; for a drop.")
@click.option("--unit", metavar="LIST", help="Units of the columns, as mm,N, if FILE states none.")
@click.option(
    "--height", type=Quantity("length"), metavar="LENGTH",
    help="Height of the drop, 0.1 (m) or 100mm.",
)  # fmt: skip
@click.option(
    "--timing-error",
    type=TIME,
    default=0.0,
    metavar="TIME",
    help="Standard deviation of a time of an impact, 1ms; a third of the interval of a video.",
)
@click.option("--pendulum", is_flag=True, help="Gravity does not press the mass onto the stop.")
@click.option("--fs", type=float, metavar="HZ", help="Sampling rate of a record without times.")
@click.option("--column", metavar="NAME", help="Column of a record with several, name or number.")
@click.option(
    "--at-speed", type=SPEED, metavar="M/S",
    help="Speed whose restitution the line for a scene file states [mean of the test].",
)  # fmt: skip
@common("json", "out", "quiet")
def identify(
    options: Common, file: str, kind: Any, at_speed: float | None, column: str | None, **asked: Any
) -> None:
    """Find the law of a stop from a test of it.

    Example: stochvi identify drop.csv --test drop --mass 2.3 --height 100mm --out out
    """
    from stochvi.identification import identify as solve
    from stochvi.identification import read_test
    from stochvi.views.files import write_table
    from stochvi.views.identification import plot_identification, print_identification

    number = int(column) if column is not None and column.isdigit() else column
    test = read_test(Path(file), kind, column=number, **asked)
    found = solve(test, at_speed=at_speed)
    options.show(found, print_identification, "identify")
    if options.out is not None:
        write_table(found.curve, options.out / "curve.csv")
    options.draw("identify", lambda: plot_identification(found))
