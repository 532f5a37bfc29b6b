"""Commands of motions under a sine, and of sweeps. Chapters: regimes, basins, bifurcations and life
times; a scene over ranges of its keys."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from stochvi.cli.options import (
    CHANCE,
    RATE,
    SPEED,
    TIME,
    Common,
    Varied,
    acceleration,
    common,
    fail_unless_gaussian,
    judged_phase,
    keeping,
    shown,
    varied,
)
from stochvi.cli.program import FAILED, executor_at, main, stop

if TYPE_CHECKING:
    from stochvi.methods.periodic import Basins
    from stochvi.statistics import LifeTimes


@main.command()
@click.argument("scene")
@varied(400, "values of a key of the scene, as impact_pair.0.clearance=3mm:6mm:100.")
@click.option(
    "--sweep", type=click.Choice(["up", "down", "both"]),
    help="Also simulate a slow sweep from value to value.",
)  # fmt: skip
@click.option(
    "--form", type=click.Choice(["exact", "motion", "force"]), default="exact", show_default=True,
    help="Exact regimes, or harmonic linearisation of motion or force, with its error.",
)  # fmt: skip
@click.option(
    "--coordinate", metavar="NAME",
    help="Coordinate or point whose displacement is shown [the first].",
)  # fmt: skip
@click.option(
    "--impacts", type=int, default=3, show_default=True,
    help="Largest number of impacts per period of regimes that are looked for.",
)  # fmt: skip
@common("budget", "json", "out", "quiet")
def sine(
    options: Common, scene: str, varied: Varied, sweep: str | None, form: str,
    coordinate: str | None, impacts: int,
) -> None:  # fmt: skip
    """Find all periodic motions under a sine, and jumps.

    Periodic regimes, stable or not, are calculated exactly over frequency or any key of the scene,
    with the values at which a slow sweep jumps. Without --from and --to they are calculated at the
    frequency of the scene. Noise of the scene is left out.
    """
    from stochvi.methods.periodic import harmonic_response
    from stochvi.scenes.scene import load_scene
    from stochvi.views.sine import draw_sine, print_sine

    loaded = load_scene(scene)
    asked = varied.asked(loaded)
    shown(
        lambda: harmonic_response(
            loaded, **asked, form=form, sweep=sweep, coordinate=coordinate, most_impacts=impacts,
            budget=options.rest,
        ),
        lambda found: _show(options, found, print_sine, draw_sine, "sine"),
    )  # fmt: skip


@main.command()
@click.argument("scene")
@click.option(
    "--start", "sides", multiple=True, metavar="NAME=FIRST:LAST:NUMBER",
    help="Starts along one axis of the map, as displacement.x=-1mm:1mm:300; give it for both axes.",
)  # fmt: skip
@click.option(
    "--phase", type=float, default=0.0, show_default=True,
    help="Phase of the force at the start, degrees.",
)  # fmt: skip
@click.option(
    "--periods",
    type=int,
    default=300,
    show_default=True,
    help="Periods for which each start is followed.",
)
@keeping
@common("threads", "kept budget", "json", "out", "quiet")
def basins(
    options: Common, scene: str, sides: tuple[str, ...], phase: float, periods: int, **kept: Any
) -> None:
    """Find which motion each start ends in, under a sine.

    The starts lie in a plane of two displacements or velocities, all others being 0. Each start is
    followed to the regime in which it ends, and the plane is coloured by regime. Noise of the scene
    is left out.
    """
    from stochvi.methods.periodic import basins as map_of
    from stochvi.scenes.scene import load_scene
    from stochvi.views.sine import plot_basins, print_basins

    loaded = load_scene(scene)
    plane = dict(_numbers_of(side) for side in sides) or None

    def solve() -> Basins:
        with options.progress("basins") as report:
            return map_of(
                loaded, plane, phase_deg=phase, periods=periods, threads=options.threads,
                budget=options.rest, progress=report, **kept,
            )  # fmt: skip

    shown(solve, lambda found: _show(options, found, print_basins, plot_basins, "basins"), kept)


@main.command()
@click.argument("scene")
@varied(400, "values of a key of the scene, as excitation.0.amplitude=1:3:400.")
@click.option(
    "--sweep", type=click.Choice(["up", "down", "both"]), default="both", show_default=True,
    help="Direction of the sweep; each motion starts from that at the value before.",
)  # fmt: skip
@click.option(
    "--settling", type=int, default=300, show_default=True,
    help="Periods that pass at each value before its motion is watched.",
)  # fmt: skip
@click.option(
    "--watched",
    type=int,
    default=128,
    show_default=True,
    help="Periods for which the motion is watched.",
)
@click.option(
    "--start", "starts", multiple=True, metavar="NAME=VALUE",
    help="State before the first value, as velocity.x=0.2 [at rest].",
)  # fmt: skip
@common("budget", "json", "out", "quiet")
def bifurcation(
    options: Common, scene: str, varied: Varied, sweep: str, settling: int, watched: int,
    starts: tuple[str, ...],
) -> None:  # fmt: skip
    """Sweep a key slowly: period doublings and chaos.

    They are simulated from impact to impact, with the Lyapunov exponent at each value. Noise of the
    scene is left out.
    """
    from stochvi.methods.periodic import bifurcation as diagram_of
    from stochvi.scenes.scene import load_scene
    from stochvi.views.sine import draw_bifurcation, print_bifurcation

    loaded = load_scene(scene)
    asked = varied.asked(loaded)
    if not asked:
        raise ValueError("--from and --to, or --vary, must say what is varied, got neither")
    begun = {name: values[0] for name, values in map(_numbers_of, starts)}
    shown(
        lambda: diagram_of(
            loaded, **asked, sweep=sweep, settling=settling, watched=watched, start=begun,
            budget=options.rest,
        ),
        lambda found: _show(options, found, print_bifurcation, draw_bifurcation, "bifurcation"),
    )  # fmt: skip


@main.command()
@click.argument("scene")
@click.option(
    "--regime", "regimes", multiple=True, metavar="NAME",
    help='Regime whose life time is wanted, as "no impacts" [all].',
)  # fmt: skip
@click.option(
    "--rel-error",
    type=float,
    default=0.1,
    show_default=True,
    help="Relative standard error of the mean life times.",
)
@keeping
@common("seed", "threads", "kept budget", "json", "out", "quiet")
def lifetimes(
    options: Common, scene: str, regimes: tuple[str, ...], rel_error: float, **kept: Any
) -> None:
    """Find how long each motion lasts in noise.

    Paths start in each of the regimes that coexist without noise. They are simulated with the noise
    of the scene until enough of them have left."""
    from stochvi.scenes.scene import load_scene
    from stochvi.statistics.lifetimes import lifetimes as times_of
    from stochvi.views.sine import plot_lifetimes, print_lifetimes

    loaded = load_scene(scene)

    def solve() -> LifeTimes:
        with options.progress("lifetimes") as report:
            return times_of(
                loaded, regimes or None, rel_error=rel_error, progress=report,
                **options.sampling, **kept,
            )  # fmt: skip

    shown(
        solve,
        lambda found: _show(options, found, print_lifetimes, plot_lifetimes, "lifetimes"),
        kept,
    )


def _show(options: Common, found: Any, tell: Any, draw: Any, name: str) -> None:
    options.show(found, tell, name)
    options.draw(name, lambda: draw(found))


def _numbers_of(text: str) -> tuple[str, list[float]]:
    """Name and values of a displacement (m) or velocity (m/s), from "NAME=FIRST:LAST:NUMBER" or
    "NAME=VALUE,VALUE"."""
    from stochvi.mathematics.units import measured_in
    from stochvi.results.errors import spaced

    name, _, listed = text.partition("=")
    unit = "m/s" if name.startswith("velocity") else "m"
    try:
        if ":" not in listed:
            return name, [measured_in(word, unit) for word in listed.split(",")]
        first, last, number = listed.split(":")
        ends, count = [measured_in(first, unit), measured_in(last, unit)], int(number)
        if count < 1:
            raise ValueError
    except ValueError:
        raise ValueError(
            f"--start must be NAME=FIRST:LAST:NUMBER or NAME=VALUE, such as displacement.x=-1mm:"
            f"1mm:300 or velocity.x=0.2, got {text!r}"
        ) from None
    return name, spaced(f"--start {name}", ends[0], ends[1], count)


# ------------------------------------------------------------------------------
# The command that answers for a scene over ranges of its keys.
# ------------------------------------------------------------------------------


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
    from stochvi.views.datasets import terminal_table, unseen, write_sweep, write_sweep_table
    from stochvi.views.isolator_tables import print_record
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
