"""The command line. Nothing heavy is imported before a command needs it."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

if TYPE_CHECKING:
    from rich.console import Console

    from stochvi.estimates import Response
    from stochvi.galerkin import FirstPassage

FAILED, BAD_INPUT = 1, 2
MISSION_PARTS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Of a mission, for which its first passage is told: the table and the picture of a curve."""

PLAIN_WIDTH = 100
"""Columns of a table that is not written to a terminal, unless COLUMNS says otherwise."""

TEMPLATE = """\
title = "isolated box on a truck"

[structure]
kind = "isolator"            # "oscillator": on a fixed base, "isolator": on a moving one
frequency_hz = 12.0          # with exactly one of zeta and Q
zeta = 0.1
# mass = 2.5                 # kg; needed if a force acts on the mass
# or: mass (kg), damping (N s/m) and stiffness (N/m)
# several masses: kind = "matrices", coordinates = ["box", "absorber"], mass = [[..], [..]],
# damping = .., stiffness = ..; then say on = or between = in every entry below, on = "base" for
# an acceleration of the base

[[impact_pair]]              # leave the section out for no stops
lower = -0.004               # m from the position of the unloaded spring; leave out for none
upper = 0.004
law = { kind = "restitution", coefficient = 0.5 }    # lower_law / upper_law where they differ
# stops that give way, under white noise (N/m): { kind = "elastic", stiffness = 1e5 },
# { kind = "viscoelastic", stiffness = 1e5, damping_ratio = 0.2 }, { kind = "hertz",
# coefficient = 1e6 }, { kind = "table", deflection = [..], force = [..] } (m, N)
# on = "absorber", or between = ["absorber", "box"] (first minus second)

[[excitation]]
kind = "psd"                 # or "white", "filtered", "sine", "constant"; several add up
profile = "mil-std-810h-truck-vertical-5hz"          # see: stochvi profiles
level_db = 0.0
# or: file = "my.csv" (two columns), or frequency_hz = [..] and density = [..], with a unit:
# unit = "g2/Hz"             # "g2/Hz", "(m/s2)2/Hz" or "N2/Hz"; one-sided per hertz
# white: intensity = S0 (two-sided, SI), or density = .. with unit = ..
# filtered: the same, of the white noise before it passes a resonance of frequency_hz and zeta
# (which raises a density to its 1 / (4 zeta^2)-fold at the peak)
# sine: amplitude (N, or m/s^2 of the base) and frequency_hz
# constant: force (N) or acceleration (m/s^2, of the base; 9.80665 presses towards -x like gravity)
"""


class _Commands(click.Group):
    """Turns every expected error into one sentence on stderr and its exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def invoke(self, ctx: click.Context) -> Any:
        from stochvi.errors import NotConverged, StochviError

        try:
            return super().invoke(ctx)
        except NotConverged as error:
            _stop(str(error), FAILED)
        except (StochviError, ValueError, ArithmeticError) as error:
            _stop(str(error), BAD_INPUT)
        except OSError as error:
            _stop(f"{error.filename or ''} {(error.strerror or str(error)).lower()}", BAD_INPUT)


def _stop(message: str, code: int) -> NoReturn:
    for line in message.splitlines():
        click.echo(f"stochvi: {line.strip()}", err=True)
    sys.exit(code)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="stochvi")
def main() -> None:
    """Stochastic vibration of systems that hit their stops.

    A scene file says what moves, where it hits and what shakes it; each command answers one
    question about it. Start with: stochvi new scene.toml, then stochvi check scene.toml.
    """


def _options(*names: str) -> Callable[[Any], Any]:
    """The options that several commands share."""
    known = {
        "json": click.option(
            "--json", "json_file", metavar="FILE|-", help="Write the answer as JSON (- : stdout)."
        ),
        "out": click.option(
            "--out", type=click.Path(path_type=Path), metavar="DIR",
            help="Write tables and pictures here.",
        ),
        "seed": click.option("--seed", type=int, default=0, help="Same seed, same digits."),
        "threads": click.option("--threads", type=int, help="Default: all cores."),
        "budget": click.option(
            "--budget", type=float, default=60.0, show_default=True, metavar="SECONDS",
            help="Give up (exit 1) if the accuracy takes longer.",
        ),
        "quiet": click.option("--quiet", is_flag=True, help="No tables, no progress."),
    }  # fmt: skip

    def decorate(command: Any) -> Any:
        for name in reversed(names):
            command = known[name](command)
        return command

    return decorate


@main.command()
@click.argument("scene")
@_options("json", "out", "quiet")
def exact(scene: str, json_file: str | None, out: Path | None, quiet: bool) -> None:
    """Closed form, where there is one: white noise, elastic stops."""
    from stochvi.closed_form import exact as solve
    from stochvi.scenes import load_scene

    _finish(solve(load_scene(scene)), json_file, out, quiet)


@main.command("fokker-planck")
@click.argument("scene")
@click.option(
    "--rtol", type=float, default=0.01, show_default=True,
    help="Relative error of deviations, F1 and F2; 1e-6 takes a second or so.",
)  # fmt: skip
@click.option("--speed-threshold", type=float, help="Slowest impact that a rate counts, m/s.")
@_options("json", "out", "quiet")
def fokker_planck(
    scene: str,
    rtol: float,
    speed_threshold: float | None,
    json_file: str | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """Fokker-Planck equation: one oscillator, white noise, stops of any law."""
    from stochvi.errors import NotConverged
    from stochvi.galerkin import fokker_planck as solve
    from stochvi.scenes import load_scene

    try:
        response = solve(load_scene(scene), rtol=rtol, speed_threshold=speed_threshold)
    except NotConverged as reason:
        if reason.response is not None:
            _finish(reason.response, json_file, out, quiet)
        raise
    _finish(response, json_file, out, quiet)


@main.command("first-passage")
@click.argument("scene")
@click.option(
    "--barrier", metavar="LO,HI",
    help="Metres from the unloaded spring; leave one empty for none. Default: the stops.",
)  # fmt: skip
@click.option("--times", metavar="LIST", help="Seconds, with commas ...")
@click.option(
    "--mission", type=float, metavar="SECONDS", help="... or a duration, and parts of it."
)
@click.option(
    "--start", type=click.Choice(["rest", "stationary"]), default="rest", show_default=True,
    help="At rest, or in the stationary law without barriers.",
)  # fmt: skip
@click.option("--rtol", type=float, default=1e-4, show_default=True, help="Relative error.")
@_options("json", "out", "quiet")
def first_passage(
    scene: str,
    barrier: str | None,
    times: str | None,
    mission: float | None,
    start: str,
    rtol: float,
    json_file: str | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """P(first impact, or first passage of a barrier, before t): white noise."""
    from stochvi.errors import NotConverged
    from stochvi.galerkin import first_passage as solve
    from stochvi.scenes import load_scene

    if (times is None) == (mission is None):
        raise ValueError("give --times or --mission, one of them")
    if mission is None:
        moments = _numbers("--times", times or "")
    else:
        moments = [part * mission for part in MISSION_PARTS]
    lower, upper = _barrier(barrier)
    loaded = load_scene(scene)
    try:
        found = solve(
            loaded, lower, upper,
            times=moments, start="rest" if start == "rest" else "stationary", rtol=rtol,
        )  # fmt: skip
    except NotConverged as reason:
        _finish_passage(reason.response, loaded.title, json_file, out, quiet)
        raise
    _finish_passage(found, loaded.title, json_file, out, quiet)


def _numbers(option: str, text: str) -> list[float]:
    """A list of numbers with commas between them."""
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise ValueError(f"{option} must be numbers with commas, got {text!r}") from None


def _barrier(text: str | None) -> tuple[float | None, float | None]:
    if text is None:
        return None, None
    words = [word.strip() for word in text.split(",")]
    if len(words) != 2 or not any(words):
        raise ValueError(f"--barrier must be LO,HI with at least one of them, got {text!r}")
    lower, upper = (_numbers("--barrier", word)[0] if word else None for word in words)
    return lower, upper


def _finish_passage(
    found: FirstPassage, title: str, json_file: str | None, out: Path | None, quiet: bool
) -> None:
    from stochvi.files import write_json, write_picture, write_table
    from stochvi.tables import print_first_passage

    if not quiet:
        print_first_passage(_console(json_file), found)
    if json_file is not None:
        write_json(found.to_dict(), json_file)
    if out is not None:
        from stochvi.plots import plot_first_passage

        write_table(found.to_frame(), out / "first_passage.csv")
        ax = plot_first_passage(found)
        ax.set_title(title)
        write_picture(ax, out / "first_passage.png")


@main.command()
@click.argument("scene")
@click.option(
    "--form", type=click.Choice(["closure", "motion", "force"]), default="closure",
    show_default=True, help="What is linearised, and with which law.",
)  # fmt: skip
@click.option(
    "--variant", type=click.Choice(["consistent", "book"]), default="consistent",
    show_default=True, help="Coefficients that obey the balances, or as printed in the book.",
)  # fmt: skip
@_options("json", "out", "quiet")
def linearise(
    scene: str, form: str, variant: str, json_file: str | None, out: Path | None, quiet: bool
) -> None:
    """Statistical linearisation: milliseconds, approximate."""
    from stochvi.linearisation import linearise as solve
    from stochvi.scenes import load_scene

    _finish(solve(load_scene(scene), form=form, variant=variant), json_file, out, quiet)


@main.command()
@click.argument("scene")
@click.option(
    "--variant", type=click.Choice(["finite-jumps", "continuous", "unfolded"]),
    default="finite-jumps", show_default=True,
    help="Impacts as jumps of the energy, spread over a cycle, or as a damper.",
)  # fmt: skip
@_options("json", "out", "quiet")
def average(scene: str, variant: str, json_file: str | None, out: Path | None, quiet: bool) -> None:
    """Averaging of the energy: milliseconds, approximate, for light damping."""
    from stochvi.averaging import average as solve
    from stochvi.scenes import load_scene

    _finish(solve(load_scene(scene), variant=variant.replace("-", " ")), json_file, out, quiet)


@main.command()
@click.argument("scene")
@click.option("--rel-error", type=float, help="Relative standard error to reach [0.01].")
@click.option("--paths", type=int, help="Instead: this many paths ...")
@click.option("--duration", type=float, help="... of this many seconds each, after burn-in.")
@click.option("--speed-threshold", type=float, help="Slowest impact that a rate counts, m/s.")
@click.option("--slow-impacts", is_flag=True, help="Refine steps near stops, for rates at R < 0.5.")
@_options("budget", "seed", "threads", "json", "out", "quiet")
def simulate(
    scene: str,
    rel_error: float | None,
    paths: int | None,
    duration: float | None,
    speed_threshold: float | None,
    slow_impacts: bool,
    budget: float,
    seed: int,
    threads: int | None,
    json_file: str | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """Monte Carlo, with standard errors and the bias of the step."""
    from stochvi.errors import NotConverged
    from stochvi.monte_carlo import simulate as solve
    from stochvi.scenes import load_scene

    loaded = load_scene(scene)
    try:
        with _progress(quiet, "simulating") as report:
            response = solve(
                loaded,
                rel_error=rel_error,
                paths=paths,
                duration=duration,
                speed_threshold=speed_threshold,
                slow_impacts=slow_impacts,
                budget=budget,
                seed=seed,
                threads=threads,
                progress=report,
            )
    except NotConverged as reason:
        if reason.response is not None:
            _finish(reason.response, json_file, out, quiet)
        raise
    _finish(response, json_file, out, quiet)
    if out is not None and not loaded.beyond_one_oscillator() and loaded.system().omega > 0.0:
        from stochvi.files import write_picture
        from stochvi.plots import draw_overview

        write_picture(draw_overview(loaded, loaded.title), out / "overview.png")


@main.command()
@click.argument("scene")
@click.option("--rel-error", type=float, default=0.003, show_default=True, help="Of Monte Carlo.")
@_options("budget", "seed", "threads", "json", "out", "quiet")
def check(
    scene: str,
    rel_error: float,
    budget: float,
    seed: int,
    threads: int | None,
    json_file: str | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """All methods that apply, compared; exit 1 if they disagree."""
    from stochvi.crosscheck import check as compare
    from stochvi.files import write_json, write_table
    from stochvi.scenes import load_scene
    from stochvi.tables import print_check

    loaded = load_scene(scene)
    with _progress(quiet, "checking") as report:
        verdict = compare(
            loaded, rel_error=rel_error, budget=budget, seed=seed, threads=threads, progress=report
        )
    if not quiet:
        print_check(_console(json_file), verdict)
    if json_file is not None:
        write_json(verdict.to_dict(), json_file)
    if out is not None:
        write_table(verdict.to_frame(), out / "check.csv")
    if not verdict.passed:
        _stop(f"check failed: {verdict.summary()}", FAILED)


@main.command()
@click.argument("scene")
@click.option(
    "--budget", type=float, default=20.0, show_default=True, metavar="SECONDS",
    help="Time to spend on measuring.",
)  # fmt: skip
@_options("seed", "threads", "json", "out", "quiet")
def cost(
    scene: str,
    budget: float,
    seed: int,
    threads: int | None,
    json_file: str | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """What accuracy costs in time: errors of steps and of models."""
    from stochvi.accuracy import cost as measure
    from stochvi.files import write_json
    from stochvi.scenes import load_scene
    from stochvi.tables import print_cost

    loaded = load_scene(scene)
    with _progress(quiet, "cost") as report:
        found = measure(loaded, budget=budget, seed=seed, threads=threads, progress=report)
    if not quiet:
        print_cost(_console(json_file), found)
    if json_file is not None:
        write_json(found.to_dict(), json_file)
    if out is not None:
        from stochvi.files import write_picture, write_table
        from stochvi.plots import draw_work_precision

        write_table(found.to_frame(), out / "cost.csv")
        write_picture(draw_work_precision(found, loaded.title), out / "cost.png")


@main.command()
@click.argument("scene")
@_options("threads", "json", "quiet")
def explain(scene: str, threads: int | None, json_file: str | None, quiet: bool) -> None:
    """What would be simulated, what not, which methods apply, at what price."""
    from stochvi.explanation import explain as tell
    from stochvi.files import write_json
    from stochvi.scenes import load_scene
    from stochvi.tables import print_explanation

    told = tell(load_scene(scene), threads=threads)
    if not quiet:
        print_explanation(_console(json_file), told)
    if json_file is not None:
        write_json(told.to_dict(), json_file)


@main.command()
@click.argument("scene")
@_options("json", "out", "quiet")
def screen(scene: str, json_file: str | None, out: Path | None, quiet: bool) -> None:
    """Linear screening of an isolator: rms, Miles, 3 sigma, Rice."""
    from stochvi.files import write_json, write_table
    from stochvi.isolators import screen as solve
    from stochvi.scenes import load_scene
    from stochvi.tables import print_screening

    linear = solve(load_scene(scene))
    if not quiet:
        print_screening(_console(json_file), linear)
    if json_file is not None:
        write_json({"method": "screen", **vars(linear)}, json_file)
    if out is not None:
        write_table(linear.to_frame(), out / "screening.csv")


@main.command()
@click.argument("scene")
@click.option(
    "--gaps", default="1,1.5,2,2.5,3,3.5,4", show_default=True, metavar="LIST",
    help="Clearances per side, in rms displacements without stops.",
)  # fmt: skip
@click.option("--rel-error", type=float, default=0.02, show_default=True, help="Of Monte Carlo.")
@_options("budget", "seed", "threads", "out", "quiet")
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
    from stochvi.files import write_clearance
    from stochvi.isolators import clearance_curve
    from stochvi.isolators import screen as solve
    from stochvi.scenes import load_scene
    from stochvi.tables import print_clearance

    multiples = _numbers("--gaps", gaps)
    loaded = load_scene(scene)
    sigma = solve(loaded).displacement_std
    with _progress(quiet, "clearance") as report:
        curve = clearance_curve(
            loaded, [multiple * sigma for multiple in multiples], rel_error=rel_error,
            budget=budget, seed=seed, threads=threads, progress=report,
        )  # fmt: skip
    if not quiet:
        print_clearance(_console(None), curve)
    if out is not None:
        write_clearance(loaded, curve, out)


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
@_options("budget", "seed", "threads", "json", "out", "quiet")
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
    from stochvi.files import write_json
    from stochvi.scenes import load_scene
    from stochvi.sizing import size as solve
    from stochvi.tables import print_sizing

    loaded = load_scene(scene)
    with _progress(quiet, "sizing") as report:
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
        from stochvi.sensitivity import sensitivity as vary

        table = vary(found, seed=seed, threads=threads)
    if not quiet:
        print_sizing(_console(json_file), found, table)
    if json_file is not None:
        changes = {} if table is None else {"sensitivity": table.to_dict("records")}
        write_json(found.to_dict() | changes, json_file)
    if out is not None:
        from stochvi.report import write_report

        write_report(found, out, table)


def _acceleration(text: str | None) -> float | None:
    """m/s^2 from "150" or "15.3g"."""
    from stochvi.conventions import STANDARD_GRAVITY

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
@_options("budget", "seed", "threads", "json", "out", "quiet")
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
    """Does a loose mass in a box help: with, without, over levels; or the best box."""
    from stochvi.absorber_design import design_absorber
    from stochvi.absorber_views import draw_design, draw_levels, print_absorber, print_design
    from stochvi.absorbers import absorber as perform
    from stochvi.files import write_json, write_picture, write_table
    from stochvi.scenes import load_scene

    loaded = load_scene(scene)
    common: dict[str, Any] = {
        "rel_error": rel_error, "seed": seed, "threads": threads, "budget": budget,
    }  # fmt: skip
    with _progress(quiet, "absorber") as report:
        if mass_budget is None:
            found: Any = perform(
                loaded, levels_db=_numbers("--levels", levels), progress=report, **common
            )
        else:
            found = design_absorber(
                loaded, mass_budget=mass_budget, progress=report,
                restitutions=_numbers("--restitutions", restitutions),
                units=[round(n) for n in _numbers("--units", units)], **common,
            )  # fmt: skip
    if not quiet:
        (print_absorber if mass_budget is None else print_design)(_console(json_file), found)
    if json_file is not None:
        write_json(found.to_dict(), json_file)
    if out is not None:
        name, draw = (
            ("absorber", draw_levels) if mass_budget is None else ("absorber-design", draw_design)
        )
        write_table(found.to_frame() if mass_budget is None else found.curve, out / f"{name}.csv")
        write_picture(draw(found), out / f"{name}.png")


@main.command()
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("out"), show_default=True,
    metavar="DIR", help="Where tables and pictures go.",
)  # fmt: skip
@_options("seed", "threads", "quiet")
def demo(out: Path, seed: int, threads: int | None, quiet: bool) -> None:
    """A textbook oscillator and a truck isolator, by every method, with pictures."""
    from stochvi.demo import run_demo

    console = _console(None)
    console.quiet = quiet
    with _progress(quiet, "demo", console) as report:
        agreed = run_demo(out, console, report, seed=seed, threads=threads)
    console.print(f"\ntables and pictures are in {out}/", highlight=False)
    if not agreed:
        _stop("the methods disagree, see above", FAILED)


@main.command()
def profiles() -> None:
    """The tabulated environments that ship."""
    import pandas as pd

    from stochvi.conventions import STANDARD_GRAVITY
    from stochvi.datasets import profiles as shipped
    from stochvi.excitations import TabulatedNoise
    from stochvi.tables import print_frame

    rows = [
        {
            "profile": profile.name,
            "from Hz": profile.frequency_hz[0],
            "to Hz": profile.frequency_hz[-1],
            "stated g": profile.stated_g_rms,
            "g rms": TabulatedNoise(profile=profile.name).table.mean_square() ** 0.5
            / STANDARD_GRAVITY,
        }
        for profile in shipped().values()
    ]
    print_frame(_console(None), pd.DataFrame(rows), "profiles, g rms as stated and recomputed")


@main.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--kind", type=click.Choice(["any", "bumper", "road", "record"]), default="any",
    show_default=True, help="A scene with every key, or an isolator of this kind with its tables.",
)  # fmt: skip
def new(file: Path, kind: str) -> None:
    """Write a commented scene file to start from."""
    import shutil

    from stochvi.datasets import scene_files

    shipped = [] if kind == "any" else scene_files(f"isolator-{kind}")
    tables = shipped[1:]
    for target in (file, *(file.parent / table.name for table in tables)):
        if target.exists():
            _stop(f"{target} exists already; choose another name", BAD_INPUT)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(shipped[0].read_text("utf-8") if shipped else TEMPLATE, encoding="utf-8")
    for table in tables:
        shutil.copy(table, file.parent)
    written = ", ".join(str(path) for path in (file, *(file.parent / t.name for t in tables)))
    try_it = f"check {file}" if kind == "any" else f"size {file} --probability 0.01 --out out"
    click.echo(f"wrote {written}; try: stochvi {try_it}", err=True)


def _finish(response: Response, json_file: str | None, out: Path | None, quiet: bool) -> None:
    """Print, and write what was asked for."""
    from stochvi.files import to_json, write_json, write_table, write_text
    from stochvi.tables import print_response

    if not quiet:
        print_response(_console(json_file), response)
    if json_file is not None:
        write_json(response.to_dict(), json_file)
    if out is not None:
        write_table(response.to_frame(), out / "response.csv")
        write_text(to_json(response.to_dict()) + "\n", out / "response.json")


def _console(json_file: str | None) -> Console:
    """Standard output, or standard error where the JSON document has the output to itself."""
    from rich.console import Console

    stream = sys.stderr if json_file == "-" else sys.stdout
    plain = int(os.environ.get("COLUMNS") or PLAIN_WIDTH)
    return Console(file=stream, width=None if stream.isatty() else max(plain, 80))


@contextlib.contextmanager
def _progress(
    quiet: bool, title: str, console: Console | None = None
) -> Iterator[Callable[[float, str], None]]:
    """A bar on a terminal, nothing elsewhere."""
    from rich.console import Console
    from rich.progress import Progress

    if quiet or not sys.stderr.isatty():
        yield lambda done, text: None
        return
    terminal = console if console and console.is_terminal else Console(stderr=True)
    with Progress(console=terminal, transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda done, text: bar.update(task, completed=done, description=f"{title}: {text}")
