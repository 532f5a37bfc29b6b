"""Commands of the methods: a scene in, a response out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from stochvi.cli.shared import (
    BUDGET,
    FAILED,
    console_for,
    executor_at,
    finish,
    main,
    numbers,
    options,
    progress_bar,
    stop,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from stochvi.methods.fokker_planck import FirstPassage
    from stochvi.statistics.impacts import ImpactStatistics
    from stochvi.statistics.spectra import ResponseSpectrum

MISSION_PARTS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Of a mission, for which its first passage is told: the table and the picture of a curve."""


@main.command()
@click.argument("scene")
@options("json", "out", "quiet")
def exact(scene: str, json_file: str | None, out: Path | None, quiet: bool) -> None:
    """Closed form, where there is one: white noise, elastic stops."""
    from stochvi.methods.closed_form import exact as solve
    from stochvi.scenes.scene import load_scene

    loaded = load_scene(scene)
    finish(solve(loaded), json_file, out, quiet)
    if out is not None and not loaded.beyond_one_oscillator() and not loaded.system().tables:
        from stochvi.methods.closed_form import exact_density
        from stochvi.views.density import draw_density
        from stochvi.views.files import write_picture

        write_picture(draw_density(loaded, exact_density(loaded)), out / "density.png")


@main.command("fokker-planck")
@click.argument("scene")
@click.option(
    "--rtol", type=float, default=0.01, show_default=True,
    help="Relative error of deviations, F1 and F2; 1e-6 takes a second or so.",
)  # fmt: skip
@click.option("--speed-threshold", type=float, help="Slowest impact that a rate counts, m/s.")
@options("json", "out", "quiet")
def fokker_planck(
    scene: str,
    rtol: float,
    speed_threshold: float | None,
    json_file: str | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """Fokker-Planck equation: one oscillator, white noise, stops of any law."""
    from stochvi.methods.fokker_planck import fokker_planck as solve
    from stochvi.results.errors import NotConverged
    from stochvi.scenes.scene import load_scene

    loaded = load_scene(scene)
    try:
        response = solve(loaded, rtol=rtol, speed_threshold=speed_threshold)
    except NotConverged as reason:
        if reason.response is not None:
            finish(reason.response, json_file, out, quiet)
        raise
    finish(response, json_file, out, quiet)
    if out is not None:
        from stochvi.methods.fokker_planck import fokker_planck_density
        from stochvi.views.density import draw_density
        from stochvi.views.files import write_picture

        found = fokker_planck_density(loaded, rtol=rtol, speed_threshold=speed_threshold)
        write_picture(draw_density(loaded, found), out / "density.png")


@main.command("first-passage")
@click.argument("scene")
@click.option(
    "--barrier", metavar="B|LO,HI",
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
@options("json", "out", "quiet")
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
    from stochvi.methods.fokker_planck import first_passage as solve
    from stochvi.results.errors import NotConverged
    from stochvi.scenes.scene import load_scene

    if (times is None) == (mission is None):
        raise ValueError("give --times or --mission, one of them")
    if mission is None:
        moments = numbers("--times", times or "")
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


def _barrier(text: str | None) -> tuple[float | None, float | None]:
    """Lower and upper barrier from "3", the same on both sides, or from "LO,HI"."""
    if text is None:
        return None, None
    words = [word.strip() for word in text.split(",")]
    if len(words) == 1 and words[0]:
        (either,) = numbers("--barrier", words[0])
        if not either > 0.0:
            raise ValueError(f"--barrier must be positive, or LO,HI, got {text!r}")
        return -either, either
    if len(words) != 2 or not any(words):
        raise ValueError(f"--barrier must be B, or LO,HI with at least one of them, got {text!r}")
    lower, upper = (numbers("--barrier", word)[0] if word else None for word in words)
    return lower, upper


def _finish_passage(
    found: FirstPassage, title: str, json_file: str | None, out: Path | None, quiet: bool
) -> None:
    from stochvi.views.files import write_json, write_picture, write_table
    from stochvi.views.tables import print_first_passage

    if not quiet:
        print_first_passage(console_for(json_file), found)
    if json_file is not None:
        write_json(found.to_dict(), json_file)
    if out is not None:
        from stochvi.views.first_passage import plot_first_passage

        write_table(found.to_frame(), out / "first_passage.csv")
        ax = plot_first_passage(found)
        ax.set_title(title)
        write_picture(ax, out / "first_passage.png")


@main.command()
@click.argument("scene")
@click.option(
    "--form", type=click.Choice(["closure", "motion", "force", "clumps"]), default="closure",
    show_default=True, help="What is linearised, and with which law.",
)  # fmt: skip
@click.option(
    "--variant", type=click.Choice(["consistent", "book", "box"]), default="consistent",
    show_default=True, help="Coefficients that obey the balances, as printed, or of a box.",
)  # fmt: skip
@options("json", "out", "quiet")
def linearise(
    scene: str, form: str, variant: str, json_file: str | None, out: Path | None, quiet: bool
) -> None:
    """Statistical linearisation: milliseconds, approximate."""
    from stochvi.methods.linearisation import linearise as solve
    from stochvi.scenes.scene import load_scene

    finish(solve(load_scene(scene), form=form, variant=variant), json_file, out, quiet)


@main.command()
@click.argument("scene")
@click.option(
    "--variant", type=click.Choice(["finite-jumps", "continuous", "unfolded"]),
    default="finite-jumps", show_default=True,
    help="Impacts as jumps of the energy, spread over a cycle, or as a damper.",
)  # fmt: skip
@options("json", "out", "quiet")
def average(scene: str, variant: str, json_file: str | None, out: Path | None, quiet: bool) -> None:
    """Averaging of the energy: milliseconds, approximate, for light damping."""
    from stochvi.methods.averaging import average as solve
    from stochvi.scenes.scene import load_scene

    finish(solve(load_scene(scene), variant=variant.replace("-", " ")), json_file, out, quiet)


def _assumed(console: Console, assumptions: Sequence[str]) -> None:
    """As `print_response` says it."""
    console.print(f"assumptions: {'; '.join(assumptions)}", style="dim", highlight=False)


@main.command()
@click.argument("scene")
@click.option("--rel-error", type=float, help="At a frequency [0.05].")
@click.option("--paths", type=int, help="Instead: this many paths.")
@click.option(
    "--method", type=click.Choice(["welch", "multitaper"]), default="welch", show_default=True,
    help="Overlapping segments, or several tapers over whole paths.",
)  # fmt: skip
@click.option("--highest", type=float, metavar="HZ", help="Highest frequency [4 times the mode's].")
@click.option("--segment", type=float, metavar="SECONDS", help="Length [21 / bandwidth].")
@options("open budget", "seed", "threads", "json", "out", "quiet")
def spectrum(
    scene: str,
    rel_error: float | None,
    paths: int | None,
    method: str,
    highest: float | None,
    segment: float | None,
    budget: float | None,
    seed: int,
    threads: int | None,
    json_file: str | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """Spectra of the response, transmissibility, coherence, with bands."""
    from stochvi.results.errors import NotConverged
    from stochvi.scenes.scene import load_scene
    from stochvi.statistics.spectra import spectrum as solve

    loaded = load_scene(scene)
    if budget is None and paths is None:
        budget = BUDGET
    try:
        with progress_bar(quiet, "simulating") as report:
            found = solve(
                loaded, rel_error=rel_error, paths=paths,
                method="welch" if method == "welch" else "multitaper", highest=highest,
                segment=segment, budget=budget, seed=seed, threads=threads, progress=report,
            )  # fmt: skip
    except NotConverged as reason:
        _finish_spectrum(reason.response, loaded.title, json_file, out, quiet)
        raise
    _finish_spectrum(found, loaded.title, json_file, out, quiet)


def _finish_spectrum(
    found: ResponseSpectrum, title: str, json_file: str | None, out: Path | None, quiet: bool
) -> None:
    from stochvi.views.files import write_json, write_picture, write_table
    from stochvi.views.tables import print_frame

    if not quiet:
        console = console_for(json_file)
        print_frame(console, found.peaks(), "at the peak of each spectrum, one-sided per hertz")
        for name, meaning in found.meanings.items():
            console.print(f"{name}: {meaning}", style="dim", highlight=False)
        console.print(found.summary(), highlight=False)
        _assumed(console, found.assumptions)
        for warning in found.warnings:
            console.print(f"note: {warning}", style="yellow", highlight=False)
    if json_file is not None:
        write_json(found.to_dict(), json_file)
    if out is not None:
        from stochvi.views.spectra import draw_spectrum

        write_table(found.to_frame(), out / "spectrum.csv")
        write_picture(draw_spectrum(found, title), out / "spectrum.png")


@main.command()
@click.argument("scene")
@click.option("--rel-error", type=float, help="Of the rate [0.02].")
@click.option("--paths", type=int, help="Instead: this many paths ...")
@click.option("--duration", type=float, help="... of this many seconds each, after burn-in.")
@click.option("--speed-threshold", type=float, help="Slowest impact that counts, m/s.")
@click.option("--slow-impacts", is_flag=True, help="Resolve impacts down to the threshold.")
@click.option("--first-hits", is_flag=True, help="Simulate the rate of first hits, too.")
@options("open budget", "seed", "threads", "json", "out", "quiet")
def impacts(
    scene: str,
    rel_error: float | None,
    paths: int | None,
    duration: float | None,
    speed_threshold: float | None,
    slow_impacts: bool,
    first_hits: bool,
    budget: float | None,
    seed: int,
    threads: int | None,
    json_file: str | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """Impacts one by one: rates, intervals, speeds, energy, clusters."""
    from stochvi.results.errors import NotConverged
    from stochvi.scenes.scene import load_scene
    from stochvi.statistics.impacts import impacts as solve

    loaded = load_scene(scene)
    if budget is None and paths is None:
        budget = BUDGET
    try:
        with progress_bar(quiet, "simulating") as report:
            found = solve(
                loaded, rel_error=rel_error, paths=paths, duration=duration,
                speed_threshold=speed_threshold, slow_impacts=slow_impacts, first_hits=first_hits,
                budget=budget, seed=seed, threads=threads, progress=report,
            )  # fmt: skip
    except NotConverged as reason:
        _finish_impacts(reason.response, loaded.title, json_file, out, quiet)
        raise
    _finish_impacts(found, loaded.title, json_file, out, quiet)


def _finish_impacts(
    found: ImpactStatistics, title: str, json_file: str | None, out: Path | None, quiet: bool
) -> None:
    from stochvi.views.files import write_json, write_picture, write_table
    from stochvi.views.tables import print_frame

    if not quiet:
        console = console_for(json_file)
        print_frame(console, found.to_table(), "impacts, with 95 % intervals of the rates")
        console.print(found.summary(), highlight=False)
        _assumed(console, found.assumptions)
        for warning in found.warnings:
            console.print(f"note: {warning}", style="yellow", highlight=False)
    if json_file is not None:
        write_json(found.to_dict(), json_file)
    if out is not None:
        write_table(found.to_frame(), out / "impacts.csv")
        write_table(found.histograms(), out / "histograms.csv")
        from stochvi.views.impacts import draw_impacts

        if any(pair.speeds is not None for pair in found.pairs.values()):
            write_picture(draw_impacts(found, title), out / "impacts.png")


@main.command()
@click.argument("scene")
@click.option("--rel-error", type=float, help="Relative standard error to reach [0.01].")
@click.option("--paths", type=int, help="Instead: this many paths ...")
@click.option("--duration", type=float, help="... of this many seconds each, after burn-in.")
@click.option("--speed-threshold", type=float, help="Slowest impact that a rate counts, m/s.")
@click.option("--slow-impacts", is_flag=True, help="Refine steps near stops, for rates at R < 0.5.")
@click.option(
    "--checkpoint",
    metavar="FILE",
    help="Keep what was simulated here; a checkpoint there is replaced, a long one kept as "
    "FILE.earlier.",
)
@click.option(
    "--checkpoint-interval", type=float, default=1.0, show_default=True, metavar="SECONDS",
    help="At most this is lost in a crash, and one task.",
)  # fmt: skip
@click.option(
    "--resume", metavar="FILE",
    help="Go on from a checkpoint, with its paths, duration and seed, and on keeping it.",
)  # fmt: skip
@click.option("--dask", metavar="ADDRESS", help="Simulate on a Dask cluster, as tcp://host:8786.")
@click.option(
    "--budget", type=float, metavar="SECONDS",
    help=f"Give up (exit 1) after this [{BUDGET:g}; none with --paths, --checkpoint, --resume].",
)  # fmt: skip
@click.option("--seed", type=int, help="Same seed, same digits [0].")
@options("threads", "json", "out", "quiet")
def simulate(
    scene: str,
    rel_error: float | None,
    paths: int | None,
    duration: float | None,
    speed_threshold: float | None,
    slow_impacts: bool,
    checkpoint: str | None,
    checkpoint_interval: float,
    resume: str | None,
    dask: str | None,
    budget: float | None,
    seed: int | None,
    threads: int | None,
    json_file: str | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """Monte Carlo, with standard errors and the bias of the step."""
    from stochvi.methods.monte_carlo import simulate as solve
    from stochvi.results.errors import NotConverged
    from stochvi.scenes.scene import load_scene

    loaded = load_scene(scene)
    if budget is None and not (paths or checkpoint or resume):
        budget = BUDGET
    try:
        with executor_at(dask) as executor, progress_bar(quiet, "simulating") as report:
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
                executor=executor,
                progress=report,
                checkpoint=checkpoint,
                checkpoint_interval=checkpoint_interval,
                resume=resume,
            )
    except (NotConverged, KeyboardInterrupt) as reason:
        so_far = getattr(reason, "response", None)  # Ctrl-C may come before there is a run
        if so_far is not None:
            finish(so_far, json_file, out, quiet)
        kept = checkpoint or resume
        there = kept is not None and Path(kept).is_file()
        said = str(reason) or "interrupted by Ctrl-C"
        stop(said + (f"; go on with --resume {kept}" if there else ""), FAILED)
    finish(response, json_file, out, quiet)
    if out is not None and not loaded.beyond_one_oscillator() and loaded.system().omega > 0.0:
        from stochvi.statistics.overview import overview
        from stochvi.views.files import write_picture
        from stochvi.views.overview import draw_overview

        write_picture(draw_overview(overview(loaded), loaded.title), out / "overview.png")
