"""The command that answers for a scene over ranges of its keys."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import click

from stochvi.cli.options import (
    CHANCE,
    RATE,
    SPEED,
    TIME,
    Common,
    acceleration,
    common,
    fail_unless_gaussian,
    judged_phase,
)
from stochvi.cli.output import executor_at
from stochvi.cli.program import FAILED, main, stop

SIZE, RISK = {"rate", "probability", "exceedance"}, {"mission", "impact_speed", "peak_acceleration"}

OPTIONS = {
    "simulate": {"rel_error", "paths", "duration", "dask", "budget"},
    "size": SIZE | RISK | {"rel_error", "dask", "budget"},
    "reliability": RISK | {"rel_error", "dask", "budget"},
}
"""Options of the methods; the others have none. All take the common ones: --threads changes nothing
where nothing is sampled."""


def _check_options(method: str, given: Mapping[str, Any], phases: bool) -> None:
    """ValueError if an option is for another method, or one that a method needs is missing; a scene
    with phases has its own duration."""
    for name in sorted(given.keys() - OPTIONS.get(method, set())):
        methods = [each for each, known in OPTIONS.items() if name in known]
        alone = " alone" if len(methods) == 1 else ""
        option = f"--{name.replace('_', '-')}"
        raise ValueError(f"{option} is for --method {' or '.join(methods)}{alone}")
    if method == "reliability" and "mission" not in given and not phases:
        raise ValueError("--method reliability needs --mission, as 3600 (s) or 10h")
    limits = given.keys() & {"probability", "rate", "impact_speed", "peak_acceleration"}
    if method == "size" and len(limits) != 1:
        raise ValueError(
            "--method size needs exactly one of --probability, --rate, --impact-speed and "
            f"--peak-acceleration, got {', '.join(sorted(limits)) or 'none'}"
        )


@main.command()
@click.argument("scene")
@click.option(
    "--vary", required=True, multiple=True, metavar="KEY=FIRST:LAST:NUMBER",
    help="For example impact_pair.0.law.coefficient=0.3:1:8; also ...:log, or KEY=VALUE,VALUE. A "
    "value may have a unit: impact_pair.0.clearance=3mm:6mm:4. Several --vary: all combinations.",
)  # fmt: skip
@click.option(
    "--method", default="simulate", show_default=True,
    type=click.Choice([
        "simulate", "exact", "closure", "fokker-planck", "average", "size", "reliability", "replay"
    ]),
    help="Method that is applied to each scene.",
)  # fmt: skip
@click.option(
    "--probability", type=CHANCE, metavar="P", help="size: probability of any impact, 0.01 or 1%."
)
@click.option("--rate", type=RATE, metavar="F", help="size: impacts on all stops, 2 (1/s), 0.1/h.")
@click.option("--impact-speed", type=SPEED, metavar="V", help="size, reliability: limit, m/s.")
@click.option(
    "--peak-acceleration", metavar="A[g]", help="size, reliability: limit, m/s^2 or g (40g)."
)
@click.option(
    "--exceedance",
    type=CHANCE,
    metavar="P",
    help="size: probability of exceeding the limit [0.01].",
)
@click.option("--mission", type=TIME, metavar="TIME", help="size [1h], reliability: 3600 (s), 10h.")
@click.option(
    "--rel-error", type=float, help="Relative standard error: of means [0.01], of the risk [0.05]."
)
@click.option("--paths", type=int, help="Number of paths, instead of a relative error.")
@click.option("--duration", type=TIME, help="Length of each path after its burn-in, with --paths.")
@click.option(
    "--random-numbers", type=click.Choice(["common", "independent"]), default="common",
    show_default=True,
    help="The same in each row, so that rows differ by their scenes only, or other ones.",
)  # fmt: skip
@click.option("--dask", metavar="ADDRESS", help="Simulate on a Dask cluster.")
@click.option(
    "--budget", type=TIME, metavar="TIME",
    help="Time for each row: N rows take up to N times this [60; none with --paths].",
)  # fmt: skip
@common("seed", "threads", "out", "quiet")
def sweep(
    options: Common, scene: str, vary: tuple[str, ...], method: str, random_numbers: str,
    dask: str | None, **asked: Any,
) -> None:  # fmt: skip
    """Answer a scene over ranges of its keys.

    Each finished row is kept in --out, and the same command continues a sweep that was stopped.
    Besides sweep.csv it writes sweep.parquet if pyarrow is installed (pip install pyarrow).
    """
    from stochvi.scenes.scene import load_scene
    from stochvi.sweeps import once, values_of
    from stochvi.sweeps import sweep as solve
    from stochvi.views.isolator_tables import print_record
    from stochvi.views.sweep import terminal_table, unseen, write_sweep, write_sweep_table
    from stochvi.views.tables import LAST_DIGITS, NEVER_SEEN, print_frame

    given = {"dask": dask} | asked
    given = {name: value for name, value in given.items() if value is not None}
    loaded = load_scene(scene)
    document = loaded.document(as_written=True)
    ranges = dict(once([values_of(text, document) for text in vary]))
    _check_options(method, given, bool(loaded.phases))
    given.pop("dask", None)
    if "peak_acceleration" in given:
        given["peak_acceleration"] = acceleration(given["peak_acceleration"])
    if "budget" in given:
        rows = math.prod(len(values) for values in ranges.values())
        given["budget"] = (options.until(rows * given["budget"]).rest or 0.0) / rows
    elif "paths" in given:
        given["budget"] = None
    try:
        with (
            executor_at(dask) as executor,
            options.progress("sweep") as report,
        ):
            table = solve(
                loaded, ranges, method=method, out=options.out, executor=executor, progress=report,
                common=random_numbers == "common", seed=options.seed, threads=options.threads,
                **given,
            )  # fmt: skip
    except KeyboardInterrupt as reason:
        so_far = getattr(reason, "partial", None)
        if options.out is not None and so_far is not None and len(so_far):
            write_sweep_table(so_far, list(ranges), options.out)
        kept = (
            f"rows are kept in {options.out}: the same command goes on"
            if options.out
            else "nothing was kept"
        )
        stop(f"interrupted by Ctrl-C; {kept}", FAILED)
    # of the scene as it stands; a row may change what its record moves
    record, judged_in = (None, "") if method == "replay" else judged_phase(loaded)
    if not options.quiet:
        print_record(options.console, record, judged_in)
        print_frame(options.console, terminal_table(table, list(ranges)), method)
        if method == "simulate":
            options.console.print(LAST_DIGITS, style="dim", highlight=False)
        if unseen(table).any():
            options.console.print(NEVER_SEEN, style="dim", highlight=False)
    if options.out is not None:
        write_sweep(table, list(ranges), options.out, loaded.title)
    fail_unless_gaussian(record)
    if (noted := table[table["note"] != ""]).shape[0]:
        few = int((unseen(table) & (table["note"] == "")).sum())
        more = f" (in {few} more nothing was seen, and only a limit is given)" if few else ""
        stop(f"{len(noted)} of {len(table)} rows fell short{more}: {noted['note'].iloc[0]}", FAILED)
