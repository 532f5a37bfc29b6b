"""Commands of the users' jobs: isolators and absorbers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from stochvi.cli.shared import (
    FAILED,
    console_for,
    executor_at,
    main,
    notes_of_warnings,
    numbers,
    options,
    progress_bar,
    stop,
)

if TYPE_CHECKING:
    pass


@main.command()
@click.argument("scene")
@options("json", "out", "quiet")
def screen(scene: str, json_file: str | None, out: Path | None, quiet: bool) -> None:
    """Linear screening of an isolator: rms, Miles, 3 sigma, Rice."""
    from stochvi.isolators.screening import screen as solve
    from stochvi.scenes.scene import load_scene
    from stochvi.views.files import write_json, write_table
    from stochvi.views.tables import print_screening

    linear = solve(load_scene(scene))
    if not quiet:
        print_screening(console_for(json_file), linear)
    if json_file is not None:
        write_json({"method": "screen", **linear.to_dict()}, json_file)
    if out is not None:
        write_table(linear.to_frame(), out / "screening.csv")


@main.command()
@click.argument("scene")
@click.option(
    "--gaps", default="1,1.5,2,2.5,3,3.5,4", show_default=True, metavar="LIST",
    help="Clearances per side, in rms displacements without stops.",
)  # fmt: skip
@click.option("--rel-error", type=float, default=0.02, show_default=True, help="Of Monte Carlo.")
@options("budget", "seed", "threads", "out", "quiet")
def clearance(
    scene: str,
    gaps: str,
    rel_error: float,
    budget: float,
    seed: int,
    threads: int | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """Hit rate of an isolator against clearance: Rice, closure, Monte Carlo."""
    from stochvi.isolators.screening import clearance_curve, predicted_curve
    from stochvi.isolators.screening import screen as solve
    from stochvi.scenes.scene import load_scene
    from stochvi.views.files import write_clearance
    from stochvi.views.tables import print_clearance

    multiples = numbers("--gaps", gaps)
    loaded = load_scene(scene)
    sigma = solve(loaded).displacement_std
    with progress_bar(quiet, "clearance") as report:
        curve = clearance_curve(
            loaded, [multiple * sigma for multiple in multiples], rel_error=rel_error,
            budget=budget, seed=seed, threads=threads, progress=report,
        )  # fmt: skip
    if not quiet:
        print_clearance(console_for(None), curve)
    if out is not None:
        write_clearance(curve, predicted_curve(loaded, curve), loaded.title, out)


@main.command()
@click.argument("scene")
@click.option("--probability", type=float, metavar="P", help="Chance of any hit in the mission.")
@click.option("--rate", type=float, metavar="F", help="Or: hits per second on all stops.")
@click.option(
    "--impact-speed", type=float, metavar="V", help="Or: largest impact speed of the mission, m/s."
)
@click.option(
    "--peak-acceleration",
    metavar="A[g]",
    help="Or: largest absolute acceleration of the mission by a hit, m/s^2 or g (80g).",
)
@click.option(
    "--exceedance",
    type=float,
    default=0.01,
    show_default=True,
    metavar="P",
    help="Accepted chance that a speed or acceleration is exceeded.",
)
@click.option(
    "--mission",
    type=float,
    default=3600.0,
    show_default=True,
    metavar="SECONDS",
    help="Time of exposure.",
)
@click.option("--rel-error", type=float, default=0.05, show_default=True, help="Of the risk.")
@click.option("--sensitivity", is_flag=True, help="Also for a changed mount, level and stop law.")
@options("budget", "seed", "threads", "json", "out", "quiet")
def size(
    scene: str,
    probability: float | None,
    rate: float | None,
    impact_speed: float | None,
    peak_acceleration: str | None,
    exceedance: float,
    mission: float,
    rel_error: float,
    sensitivity: bool,
    budget: float,
    seed: int,
    threads: int | None,
    json_file: str | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """The clearance that is really needed, with a stated risk."""
    from stochvi.isolators.sizing.method import size as solve
    from stochvi.scenes.scene import load_scene
    from stochvi.views.files import write_json
    from stochvi.views.tables import print_sizing

    loaded = load_scene(scene)
    with progress_bar(quiet, "sizing") as report:
        found = solve(
            loaded,
            probability=probability,
            rate=rate,
            impact_speed=impact_speed,
            peak_acceleration=_acceleration(peak_acceleration),
            exceedance=exceedance,
            mission=mission,
            rel_error=rel_error,
            seed=seed,
            threads=threads,
            budget=budget,
            progress=report,
        )
    table = None
    if sensitivity:
        from stochvi.isolators.sizing.sensitivity import sensitivity as vary

        table = vary(found, seed=seed, threads=threads)
    if not quiet:
        print_sizing(console_for(json_file), found, table)
    if json_file is not None:
        changes = {} if table is None else {"sensitivity": table.to_dict("records")}
        write_json(found.to_dict() | changes, json_file)
    if out is not None:
        from stochvi.isolators.sizing.review import review
        from stochvi.views.report import write_report

        write_report(review(found, table), out)


def _acceleration(text: str | None) -> float | None:
    """m/s^2 from "150" or "15.3g"."""
    from stochvi.mathematics.units import STANDARD_GRAVITY

    if text is None:
        return None
    number, factor = text.strip(), 1.0
    if number.endswith("g"):
        number, factor = number[:-1], STANDARD_GRAVITY
    try:
        return float(number) * factor
    except ValueError:
        raise ValueError(
            f"--peak-acceleration must be a number of m/s^2 or of g (80g), got {text!r}"
        ) from None


@main.command()
@click.argument("scene")
@click.option(
    "--levels", default="-6,-3,0,3,6", show_default=True, metavar="LIST",
    help="Levels of the excitation, dB about the scene's own.",
)  # fmt: skip
@click.option("--mass-budget", type=float, metavar="KG", help="Instead: design the best box.")
@click.option(
    "--restitutions", default="0.3,0.5,0.7", show_default=True, metavar="LIST",
    help="What a design may choose from.",
)  # fmt: skip
@click.option(
    "--units", default="1", show_default=True, metavar="LIST",
    help="Numbers of equal masses that a design may choose from.",
)  # fmt: skip
@click.option("--rel-error", type=float, default=0.01, show_default=True, help="Of Monte Carlo.")
@options("budget", "seed", "threads", "json", "out", "quiet")
def absorber(
    scene: str,
    levels: str,
    mass_budget: float | None,
    restitutions: str,
    units: str,
    rel_error: float,
    budget: float,
    seed: int,
    threads: int | None,
    json_file: str | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """Does a loose mass in a box help: with, without, over levels; or the best box.

    The scene needs an [absorber] with mass (kg), play (m, total, wall to wall) and law, beside an
    oscillator or isolator of known mass: stochvi new tower.toml --kind absorber writes one. With
    --mass-budget the box of the scene, if there is one, is left out and the best one found.
    """
    from stochvi.absorbers.design import design_absorber
    from stochvi.absorbers.performance import absorber as perform
    from stochvi.scenes.scene import load_scene
    from stochvi.views.absorbers import draw_design, draw_levels, print_absorber, print_design
    from stochvi.views.files import write_json, write_picture, write_table
    from stochvi.views.report.absorber import write_absorber_report

    loaded = load_scene(scene)
    common: dict[str, Any] = {
        "rel_error": rel_error, "seed": seed, "threads": threads, "budget": budget,
    }  # fmt: skip
    with progress_bar(quiet, "absorber") as report:
        if mass_budget is None:
            found: Any = perform(
                loaded, levels_db=numbers("--levels", levels), progress=report, **common
            )
        else:
            found = design_absorber(
                loaded, mass_budget=mass_budget, progress=report,
                restitutions=numbers("--restitutions", restitutions),
                units=[round(n) for n in numbers("--units", units)], **common,
            )  # fmt: skip
    if not quiet:
        (print_absorber if mass_budget is None else print_design)(console_for(json_file), found)
    if json_file is not None:
        write_json(found.to_dict(), json_file)
    if out is not None:
        name, draw = (
            ("absorber", draw_levels) if mass_budget is None else ("absorber-design", draw_design)
        )
        write_table(found.to_frame() if mass_budget is None else found.curve, out / f"{name}.csv")
        write_picture(draw(found), out / f"{name}.png")
        write_absorber_report(found, out)


@main.command()
@click.argument("scene")
@click.option(
    "--speeds", required=True, metavar="LIST",
    help="Jolts: changes of the relative velocity, m/s, with commas.",
)  # fmt: skip
@click.option("--paths", type=int, default=64, show_default=True, help="For each jolt.")
@click.option("--duration", type=float, help="Seconds after a jolt [1000 periods].")
@options("seed", "json", "out", "quiet")
def jolt(
    scene: str,
    speeds: str,
    paths: int,
    duration: float | None,
    seed: int,
    json_file: str | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """Sine on a mount: can a jolt throw it into clatter, how long does it stay."""
    from stochvi.isolators.jolt_response import jolts
    from stochvi.scenes.scene import load_scene
    from stochvi.views.files import write_json, write_table
    from stochvi.views.tables import print_frame

    found = jolts(
        load_scene(scene), numbers("--speeds", speeds), paths=paths, duration=duration, seed=seed
    )
    if not quiet:
        console = console_for(json_file)
        console.print(found.summary(), style="bold", highlight=False)
        columns = {
            "jolt": "jolt (m/s)",
            "captured_low": "95 % from",
            "captured_high": "to",
            "on_both_stops": "on both stops",
            "left_later": "left later",
        }
        title = f"shares of {found.paths} paths, watched for {found.duration:.3g} s"
        print_frame(console, found.to_frame().rename(columns=columns), title)
    if json_file is not None:
        write_json(found.to_dict(), json_file)
    if out is not None:
        write_table(found.to_frame(), out / "jolts.csv")


@main.command()
@click.argument("scene")
@click.option(
    "--vary", required=True, multiple=True, metavar="KEY=FIRST:LAST:NUMBER",
    help="As impact_pair.0.law.coefficient=0.3:1:8; also ...:log, or KEY=VALUE,VALUE. Several: "
    "all combinations.",
)  # fmt: skip
@click.option(
    "--method", default="simulate", show_default=True,
    type=click.Choice(["simulate", "exact", "closure", "fokker-planck", "average"]),
    help="What answers for each scene.",
)  # fmt: skip
@click.option("--rel-error", type=float, help="Of simulations [0.01].")
@click.option("--paths", type=int, help="Instead: this many paths ...")
@click.option("--duration", type=float, help="... of this many seconds each, after burn-in.")
@click.option(
    "--random-numbers", type=click.Choice(["common", "independent"]), default="common",
    show_default=True, help="The same in each row, so that differences are the scenes', or not.",
)  # fmt: skip
@click.option("--dask", metavar="ADDRESS", help="Simulate on a Dask cluster.")
@click.option("--budget", type=float, metavar="SECONDS", help="Of a row [60; none with --paths].")
@click.option("--seed", type=int, default=0, help="Same seed, same digits.")
@options("threads", "out", "quiet")
def sweep(
    scene: str,
    vary: tuple[str, ...],
    method: str,
    rel_error: float | None,
    paths: int | None,
    duration: float | None,
    random_numbers: str,
    dask: str | None,
    budget: float | None,
    seed: int,
    threads: int | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """A scene over ranges of its keys: a table, a picture per quantity.

    Rows are kept in --out as they come; the same command goes on where it was stopped. Beside
    sweep.csv it writes sweep.parquet where pyarrow is installed (pip install pyarrow).
    """
    from stochvi.scenes.scene import load_scene
    from stochvi.sweeps import once, values_of
    from stochvi.sweeps import sweep as solve
    from stochvi.views.sweep import terminal_table, write_sweep
    from stochvi.views.tables import LAST_DIGITS, print_frame

    ranges = dict(once([values_of(text) for text in vary]))
    asked: dict[str, Any] = {
        "rel_error": rel_error, "paths": paths, "duration": duration, "threads": threads,
        "budget": budget,
    }  # fmt: skip
    asked = {name: value for name, value in asked.items() if value is not None}
    loaded = load_scene(scene)
    if method != "simulate" and (useless := sorted(set(asked) | ({"dask"} if dask else set()))):
        raise ValueError(f"--{useless[0].replace('_', '-')} is for --method simulate alone")
    if paths is not None:
        asked.setdefault("budget", None)
    try:
        with (
            executor_at(dask) as executor,
            notes_of_warnings(),
            progress_bar(quiet, "sweep") as report,
        ):
            table = solve(
                loaded, ranges, method=method, out=out, common=random_numbers == "common",
                seed=seed, executor=executor, progress=report, **asked,
            )  # fmt: skip
    except KeyboardInterrupt:
        kept = f"rows are kept in {out}: the same command goes on" if out else "nothing was kept"
        stop(f"interrupted by Ctrl-C; {kept}", FAILED)
    if not quiet:
        print_frame(console_for(None), terminal_table(table, list(ranges)), method)
        if method == "simulate":
            console_for(None).print(LAST_DIGITS, style="dim", highlight=False)
    if out is not None:
        write_sweep(table, list(ranges), out, loaded.title)
    if (noted := table[table["note"] != ""]).shape[0]:
        stop(f"{len(noted)} of {len(table)} rows fell short: {noted['note'].iloc[0]}", FAILED)
