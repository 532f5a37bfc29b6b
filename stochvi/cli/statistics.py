"""Commands of the statistics: spectra, impacts one by one, damage and reliability of missions."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import click

from stochvi.cli.options import (
    SPEED,
    TIME,
    Common,
    acceleration,
    band,
    barriers,
    common,
    equipped,
    judged_phase,
    judged_record,
    keeping,
    numbers,
    shown,
    tolerances_of,
)
from stochvi.cli.program import FAILED, main, stop

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.console import Console

    from stochvi.isolators.production_risk import Production
    from stochvi.statistics.damage import Damage
    from stochvi.statistics.impacts import ImpactStatistics
    from stochvi.statistics.spectra import ResponseSpectrum
    from stochvi.statistics.stability import Stability


@main.command()
@click.argument("scene")
@click.option("--rel-error", type=float, help="Relative standard error at a frequency [0.05].")
@click.option("--paths", type=int, help="Number of paths, instead of a relative error.")
@click.option(
    "--method", type=click.Choice(["welch", "multitaper"]), default="welch", show_default=True,
    help="Overlapping segments, or several tapers over whole paths.",
)  # fmt: skip
@click.option("--highest", type=float, metavar="HZ", help="Highest frequency [4 times the mode's].")
@click.option("--segment", type=TIME, metavar="TIME", help="Length of a segment [21 / bandwidth].")
@keeping
@common("open budget", "seed", "threads", "json", "out", "quiet")
def spectrum(options: Common, scene: str, **asked: Any) -> None:
    """Estimate spectra, transmissibility and coherence."""
    from stochvi.scenes.scene import load_scene
    from stochvi.statistics.spectra import spectrum as solve
    from stochvi.views.statistics import print_spectrum

    loaded = load_scene(scene)

    def found() -> ResponseSpectrum:
        with options.progress("simulating") as report:
            return solve(
                loaded, budget=options.rest, seed=options.seed,
                threads=options.threads, progress=report, **asked,
            )  # fmt: skip

    def show(answer: ResponseSpectrum) -> None:
        def picture() -> Axes:
            from stochvi.views.statistics import draw_spectrum

            return draw_spectrum(answer, loaded.title)

        options.show(answer, print_spectrum, "spectrum", record=judged_record(loaded))
        options.draw("spectrum", picture)

    shown(found, show, asked)


@main.command()
@click.argument("scene")
@click.option("--rel-error", type=float, help="Relative standard error of the exponent [0.02].")
@keeping
@common("open budget", "seed", "threads", "json", "out", "quiet")
def stability(options: Common, scene: str, **asked: Any) -> None:
    """Find whether the motion of a modulated structure grows."""
    from stochvi.scenes.scene import load_scene
    from stochvi.statistics.stability import stability as solve
    from stochvi.views.sine import plot_stability, print_stability

    loaded = load_scene(scene)

    def found() -> Stability:
        with options.progress("simulating") as report:
            return solve(
                loaded, budget=options.rest, seed=options.seed,
                threads=options.threads, progress=report, **asked,
            )  # fmt: skip

    def show(answer: Stability) -> None:
        options.show(answer, print_stability, "stability")
        options.draw("stability", lambda: plot_stability(answer))

    shown(found, show, asked)


@main.command()
@click.argument("scene")
@click.option("--rel-error", type=float, help="Relative standard error of the rate [0.02].")
@click.option("--paths", type=int, help="Number of paths, instead of a relative error.")
@click.option("--duration", type=TIME, help="Length of each path after its burn-in, with --paths.")
@click.option("--speed-threshold", type=SPEED, help="Slowest impact that counts, m/s.")
@click.option(
    "--slow-impacts",
    is_flag=True,
    help="Refine steps near stops, for rates at R of 0.5 and below.",
)
@click.option("--first-hits", is_flag=True, help="Simulate the rate of first impacts, too.")
@click.option("--mission", type=TIME, metavar="TIME", help="Print the impacts in this time, too.")
@keeping
@common("open budget", "seed", "threads", "json", "out", "quiet")
def impacts(options: Common, scene: str, mission: float | None, **asked: Any) -> None:
    """Collect impacts: rates, intervals, speeds, energy."""
    from stochvi.scenes.scene import load_scene
    from stochvi.statistics.impacts import impacts as solve
    from stochvi.views.files import write_table
    from stochvi.views.statistics import print_impacts

    loaded = load_scene(scene)

    def found() -> ImpactStatistics:
        with options.progress("simulating") as report:
            return solve(
                loaded, budget=options.rest, seed=options.seed,
                threads=options.threads, progress=report, **asked,
            )  # fmt: skip

    def show(answer: ImpactStatistics) -> None:
        def picture() -> Axes:
            from stochvi.views.statistics import draw_impacts

            return draw_impacts(answer, loaded.title)

        told = partial(print_impacts, mission=mission)
        options.show(answer, told, "impacts", record=judged_record(loaded))
        if options.out is not None:
            write_table(answer.histograms(), options.out / "histograms.csv")
        if any(pair.speeds is not None for pair in answer.pairs.values()):
            options.draw("impacts", picture)

    shown(found, show, asked)


@main.command()
@click.argument("scene")
@click.option(
    "--mission", type=TIME, metavar="TIME",
    help="Duration: 600 (s) or 10h [of a phase its own]; left out where the scene has phases.",
)  # fmt: skip
@equipped()
@click.option(
    "--at", metavar="NAME",
    help="Coordinate or named point on which it stands; default: the first coordinate.",
)  # fmt: skip
@click.option(
    "--way", type=click.Choice(["simulation", "clusters", "record"]),
    help="Simulate everything, or clusters of impacts alone; by default where they are rare. "
    "record: follow a measured record itself, with its potholes.",
)  # fmt: skip
@click.option(
    "--levels", metavar="A,A,...",
    help="Count contacts above these accelerations, m/s^2 or as 10g,20g.",
)  # fmt: skip
@click.option(
    "--rel-error", type=float, default=0.2, show_default=True,
    help="Median relative standard error of the damage.",
)  # fmt: skip
@click.option(
    "--test-duration", type=TIME, metavar="TIME",
    help="Duration of a random test that does the same damage; --out gets its profile.csv.",
)  # fmt: skip
@click.option(
    "--breakpoints", type=int, default=12, show_default=True,
    help="Largest number of breakpoints of its profile.",
)  # fmt: skip
@keeping
@common("kept budget", "seed", "threads", "json", "out", "quiet")
def damage(
    options: Common, scene: str, equipment: str, levels: str | None, **asked: Any
) -> None:  # fmt: skip
    """Find shock and fatigue spectra of equipment that a scene shakes.

    Example: stochvi damage bumper.toml --mission 1h --equipment 20:2000 --q 10 --exponent 6
    """
    from stochvi.scenes.scene import load_scene, phase_duration
    from stochvi.statistics.damage import damage as solve
    from stochvi.views.files import write_table
    from stochvi.views.statistics import draw_damage, print_damage

    loaded = load_scene(scene)
    asked["mission"] = asked["mission"] or phase_duration(scene)
    counted = () if levels is None else numbers("--levels", levels, "m/s^2")

    def found() -> Damage:
        with options.progress("damage") as report:
            return solve(
                loaded, equipment=band("--equipment", equipment), levels=counted,
                progress=report, **options.sampling, **asked,
            )  # fmt: skip

    unseen: list[str] = []

    def show(answer: Damage) -> None:
        if answer.unseen:
            unseen.append(answer.unseen_in_words)
        judged = (None, "") if asked["way"] == "record" else judged_phase(loaded)
        options.show(answer, print_damage, "damage", None, *judged)
        if options.out is not None and answer.test is not None:
            write_table(answer.test.to_frame(), options.out / "profile.csv")
        options.draw("damage", lambda: draw_damage(answer, loaded.title))

    shown(found, show, asked)
    if unseen:
        stop(unseen[0], FAILED)


@main.command()
@click.argument("scene")
@click.option(
    "--duration",
    type=TIME,
    required=True,
    metavar="TIME",
    help="Length of the path, as 10 (s) or 2min.",
)
@click.option("--path", type=int, default=0, show_default=True, help="Number of the realisation.")
@click.option("--rate", type=float, metavar="HZ", help="Samples per second [one per time step].")
@click.option("--animate", is_flag=True, help="Also draw history.gif: masses between their stops.")
@common("budget", "seed", "json", "out", "quiet")
def history(
    options: Common, scene: str, duration: float, animate: bool, path: int, rate: float | None
) -> None:
    """Record one realisation: motion, forces, impacts.

    Example: stochvi history truck.toml --duration 10s --rate 1000 --out out
    """
    from stochvi.scenes.scene import load_scene
    from stochvi.statistics.histories import history as solve
    from stochvi.views.density import draw_history, print_history, write_animation
    from stochvi.views.files import write_parquet, write_table
    from stochvi.views.schematic import draw_shapes, has_shape

    if animate and options.out is None:
        raise ValueError("--animate writes history.gif into a folder: give --out DIR as well")
    loaded = load_scene(scene)
    found = solve(
        loaded, duration=duration, seed=options.seed, path=path, rate=rate, budget=options.rest
    )
    options.show(found, print_history, "history")
    if options.out is not None:
        write_table(found.impacts, options.out / "impacts.csv")
        write_parquet(found.samples, options.out / "history.parquet")
    options.draw("history", lambda: draw_history(found, loaded, loaded.title))
    if has_shape(found, loaded):
        options.draw("shape", lambda: draw_shapes(found, loaded, loaded.title))
    if animate and options.out is not None:
        write_animation(found, loaded, options.out / "history.gif", loaded.title)


@main.command()
@click.argument("scene")
@click.option(
    "--mission",
    type=TIME,
    metavar="TIME",
    help="Duration: 600 (s) or 10h [of a phase its own]; left out where the scene has phases.",
)
@click.option(
    "--barrier", metavar="B|LO,HI",
    help="Without stops: barrier from the unloaded spring, 0.004 (m) or 4mm; LO, HI may be empty.",
)  # fmt: skip
@click.option("--impact-speed", type=SPEED, metavar="M/S", help="Largest allowed impact speed.")
@click.option(
    "--peak-acceleration", metavar="A|Ag",
    help="Largest allowed acceleration in a contact with compliant stops, m/s^2 or g (80g).",
)  # fmt: skip
@click.option(
    "--at", metavar="NAME",
    help="Coordinate or named point of that acceleration; default: all of them.",
)  # fmt: skip
@click.option("--pair", metavar="NAME", help="Count impacts on this pair alone.")
@click.option(
    "--start", type=click.Choice(["rest", "stationary"]), default="stationary", show_default=True,
    help="Start at rest, or in the stationary motion.",
)  # fmt: skip
@click.option(
    "--way", type=click.Choice(["crude", "splitting", "first-crossings"]),
    help="Method; default: the one that a pilot run finds cheapest. In Python 'first crossings'.",
)  # fmt: skip
@click.option(
    "--rel-error", type=float, default=0.05, show_default=True, help="Relative standard error."
)
@click.option(
    "--tolerances", metavar="LIST",
    help="Distributions between the units of a production, for the mean probability of any impact: "
    "frequency=normal:3% (std), clearance=uniform:0.1mm.",
)  # fmt: skip
@keeping
@common("kept budget", "seed", "threads", "json", "out", "force", "quiet")
def reliability(
    options: Common, scene: str, barrier: str | None, peak_acceleration: str | None,
    way: str | None, tolerances: str | None, **asked: Any,
) -> None:  # fmt: skip
    """Find probabilities of impacts in a mission, to 1e-9.

    Example: stochvi reliability box.toml --mission 3600 --impact-speed 0.5 --start rest
    """
    from stochvi.isolators.production_risk import production, unmet
    from stochvi.results.errors import NotApplicable
    from stochvi.scenes.scene import load_scene, phase_duration
    from stochvi.statistics.reliability import Reliability
    from stochvi.statistics.reliability import reliability as solve
    from stochvi.views.isolator_tables import print_production
    from stochvi.views.statistics import print_reliability
    from stochvi.views.tables import print_line

    loaded = load_scene(scene)
    asked["mission"] = asked["mission"] or phase_duration(scene)
    allowed, spreads = tolerances_of(loaded, tolerances)
    if tolerances is not None and not spreads:
        raise ValueError(
            "--tolerances must hold a distribution between units, as frequency=normal:3%, got "
            f"{tolerances}; limits are for size"
        )
    alone = barrier is not None or asked["start"] == "rest" or bool(loaded.phases)
    if alone and tolerances is None:
        spreads = {}  # what the scene states is then at its mean, as the answer says
    if spreads and alone and not loaded.phases:
        raise ValueError(
            "--tolerances must be left out with --barrier and --start rest: the mean over units is "
            "found for stops, from a stationary start"
        )
    if spreads and (conditions := unmet(loaded)):
        raise NotApplicable("production", conditions)
    deadline = options.until(options.budget)
    units: list[Production] = []
    limit_in_g = peak_acceleration if (peak_acceleration or "").endswith("g") else None

    def found() -> Reliability:
        with options.progress("reliability") as report:
            return solve(
                loaded,
                barrier=None if barrier is None else barriers(barrier),
                peak_acceleration=acceleration(peak_acceleration),
                way=way and way.replace("-", " "),  # type: ignore[arg-type]
                progress=report,
                **options.sampling | {"budget": deadline.part(0.5 if spreads else 1.0)},
                **asked,
            )

    record, judged_in = judged_phase(loaded)

    def tell(console: Console, answer: Reliability) -> None:
        print_reliability(console, answer, limit_in_g)
        for each in units:
            print_line(console, each.summary())
            print_production(console, each)

    def show(answer: Reliability) -> None:
        found_of_units = {}
        if spreads:
            with options.progress("units") as report:
                units.append(
                    production(
                        loaded, spreads, mission=answer.mission, pair=asked["pair"],
                        tolerances=allowed, rel_error=asked["rel_error"], progress=report,
                        seed=options.seed, threads=options.threads, budget=deadline.part(1.0),
                    )
                )  # fmt: skip
            found_of_units["production"] = units[0].to_dict()
        document = answer.to_dict() | found_of_units
        options.show(answer, tell, "reliability", document, record, judged_in)
        for each in units:
            options.draw("production", each.plot)
        if options.out is not None:
            from stochvi.isolators.screening import scene_at_rest
            from stochvi.views.report import write_reliability_report

            origin = options.origin(scene, answer.provenance)
            first = loaded.phases[0].of(loaded) if loaded.phases else loaded
            write_reliability_report(
                answer, loaded, scene_at_rest(first), record, options.out, origin, *units,
            )  # fmt: skip

    shown(found, show, asked)
