"""Commands of the methods: each turns a scene into a response."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from stochvi.cli.options import (
    BUDGET,
    SPEED,
    TIME,
    Common,
    barriers,
    common,
    how_to_go_on,
    judged_record,
    keeping,
    numbers,
    shown,
)
from stochvi.cli.program import FAILED, executor_at, main, stop

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.methods.fokker_planck import FirstPassage
    from stochvi.results.base import Response
    from stochvi.scenes.scene import Scene

MISSION_PARTS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Fractions of a mission at which `first-passage` gives the probability: enough for a curve."""


def show_response(options: Common, found: Response, scene: Scene) -> None:
    """Print a response, write the files that the options ask for, and judge a record."""
    from stochvi.views.files import to_json, write_text
    from stochvi.views.tables import print_response

    record = judged_record(scene)
    options.show(found, print_response, "response", record=record)
    if options.out is not None:
        write_text(to_json(found.to_dict()) + "\n", options.out / "response.json")
        write_map(options, found, scene)


def write_map(options: Common, found: Response, scene: Scene) -> None:
    """Write the rms along a bar or beam, or over a plate, as `map.csv` and `map.png`."""
    from stochvi.methods.linearisation.one_form import rms_along
    from stochvi.results.errors import NotApplicable, NotConverged
    from stochvi.views.files import write_table
    from stochvi.views.schematic import draw_map, has_places

    if options.out is None or not has_places(scene):
        return
    try:
        table = rms_along(scene)
    except (NotApplicable, NotConverged):  # not even without stops
        return
    write_table(table, options.out / "map.csv")
    options.draw("map", lambda: draw_map(table, found, scene))


@main.command()
@click.argument("scene")
@common("budget", "json", "out", "quiet")
def exact(options: Common, scene: str) -> None:
    """Solve a scene in closed form, where one is known."""
    from stochvi.methods.closed_form import exact as solve
    from stochvi.methods.closed_form import exact_density
    from stochvi.model.coverage import beyond_one_oscillator
    from stochvi.model.model import model_of
    from stochvi.scenes.scene import load_scene

    def density() -> Axes:
        from stochvi.views.density import draw_density

        return draw_density(loaded, exact_density(loaded, budget=options.rest))

    loaded = load_scene(scene)
    show_response(options, solve(loaded, budget=options.rest), loaded)
    model = model_of(loaded)
    if not beyond_one_oscillator(model) and not model.tables:
        options.draw("density", density)


@main.command("fokker-planck")
@click.argument("scene")
@click.option(
    "--rtol", type=float, default=0.01, show_default=True,
    help="Relative error of deviations, F1 and F2; 1e-6 takes a second or so.",
)  # fmt: skip
@click.option("--speed-threshold", type=SPEED, help="Slowest impact that a rate counts, m/s.")
@common("budget", "json", "out", "quiet")
def fokker_planck(options: Common, scene: str, **asked: Any) -> None:
    """Solve the Fokker-Planck equation: one mass, white noise."""
    from stochvi.methods.fokker_planck import fokker_planck as solve
    from stochvi.methods.fokker_planck import fokker_planck_density
    from stochvi.scenes.scene import load_scene

    def density() -> Axes:
        from stochvi.views.density import draw_density

        return draw_density(loaded, fokker_planck_density(loaded, **asked, budget=options.rest))

    loaded = load_scene(scene)
    shown(
        lambda: solve(loaded, **asked, budget=options.rest),
        lambda found: show_response(options, found, loaded),
    )
    options.draw("density", density)


@main.command("first-passage")
@click.argument("scene")
@click.option(
    "--barrier", metavar="B|LO,HI",
    help="Barrier, m from the unloaded spring; leave LO or HI empty for none. Default: the stops.",
)  # fmt: skip
@click.option("--times", metavar="LIST", help="Times that are listed, as 10,20 (s) or 1min.")
@click.option(
    "--mission", type=TIME, metavar="TIME", help="Duration, and parts of it, instead of times."
)
@click.option(
    "--start", type=click.Choice(["rest", "stationary"]), default="rest", show_default=True,
    help="Start at rest, or in the stationary motion without barriers.",
)  # fmt: skip
@click.option("--rtol", type=float, default=1e-4, show_default=True, help="Relative error.")
@common("budget", "json", "out", "quiet")
def first_passage(
    options: Common, scene: str, barrier: str | None, times: str | None, mission: float | None,
    **asked: Any,
) -> None:  # fmt: skip
    """Find P(first impact or passage before t), and its rate."""
    from stochvi.methods.fokker_planck import first_passage as solve
    from stochvi.scenes.scene import load_scene
    from stochvi.views.tables import print_first_passage

    if (times is None) == (mission is None):
        raise ValueError("needs exactly one of --times and --mission; give one")
    if mission is None:
        moments = numbers("--times", times or "", "s")
    else:
        moments = [part * mission for part in MISSION_PARTS]
    lower, upper = barriers(barrier)
    loaded = load_scene(scene)

    def show(found: FirstPassage) -> None:
        def picture() -> Axes:
            from stochvi.views.density import plot_first_passage

            ax = plot_first_passage(found)
            ax.set_title(loaded.title)
            return ax

        options.show(found, print_first_passage, "first_passage")
        options.draw("first_passage", picture)

    shown(lambda: solve(loaded, lower, upper, times=moments, **asked, budget=options.rest), show)


@main.command()
@click.argument("scene")
@click.option(
    "--form", type=click.Choice(["closure", "motion", "force", "clumps"]), default="closure",
    show_default=True, help="Which functions are linearised, and under which law.",
)  # fmt: skip
@click.option(
    "--variant", type=click.Choice(["consistent", "book", "box"]), default="consistent",
    show_default=True,
    help="Coefficients: consistent with the balances, as printed in the book, or for a box.",
)  # fmt: skip
@common("budget", "json", "out", "quiet")
def linearise(options: Common, scene: str, **asked: Any) -> None:
    """Linearise statistically: approximate, in milliseconds."""
    from stochvi.methods.linearisation import linearise as solve
    from stochvi.scenes.scene import load_scene

    loaded = load_scene(scene)
    show_response(options, solve(loaded, **asked, budget=options.rest), loaded)


@main.command()
@click.argument("scene")
@click.option(
    "--variant", type=click.Choice(["finite-jumps", "continuous", "unfolded"]),
    default="finite-jumps", show_default=True,
    help="Impacts as jumps of the energy (in Python 'finite jumps'), as a loss spread over a "
    "cycle, or as a damper.",
)  # fmt: skip
@common("budget", "json", "out", "quiet")
def average(options: Common, scene: str, variant: str) -> None:
    """Average the energy: approximate, for light damping."""
    from stochvi.methods.averaging import average as solve
    from stochvi.methods.averaging import average_density
    from stochvi.scenes.scene import load_scene

    def density() -> Axes:
        from stochvi.views.density import draw_density

        return draw_density(loaded, average_density(loaded, variant=variant, budget=options.rest))

    variant = variant.replace("-", " ")
    loaded = load_scene(scene)
    show_response(options, solve(loaded, variant=variant, budget=options.rest), loaded)
    options.draw("density", density)


@main.command()
@click.argument("scene")
@click.option("--rel-error", type=float, help="Relative standard error to reach [0.01].")
@click.option("--paths", type=int, help="Number of paths, instead of a relative error.")
@click.option("--duration", type=TIME, help="Length of each path after its burn-in, with --paths.")
@click.option("--speed-threshold", type=SPEED, help="Slowest impact that a rate counts, m/s.")
@click.option(
    "--slow-impacts", is_flag=True, help="Refine steps near stops, for rates at R of 0.5 and below."
)
@keeping
@click.option("--dask", metavar="ADDRESS", help="Simulate on a Dask cluster, as tcp://host:8786.")
@click.option(
    "--budget", type=TIME, metavar="TIME",
    help="Largest time; the exit code is 1 if the answer is not accurate enough by then "
    f"[{BUDGET:g}; no limit with --paths, --checkpoint and --resume].",
)  # fmt: skip
@click.option("--seed", type=int, help="Seed: the same gives the same digits [0].")
@common("threads", "json", "out", "quiet")
def simulate(
    options: Common, scene: str, dask: str | None, budget: float | None, checkpoint: str | None,
    resume: str | None, **asked: Any,
) -> None:  # fmt: skip
    """Simulate by Monte Carlo, with errors and bias."""
    from stochvi.methods.monte_carlo import simulate as solve
    from stochvi.model.coverage import beyond_one_oscillator
    from stochvi.model.model import model_of
    from stochvi.results.errors import NotConverged
    from stochvi.scenes.scene import load_scene

    loaded = load_scene(scene)
    if budget is None and not (asked["paths"] or checkpoint or resume):
        budget = BUDGET
    try:
        with executor_at(dask) as executor, options.progress("simulating") as report:
            response = solve(
                loaded, budget=options.until(budget).rest, threads=options.threads,
                executor=executor, progress=report, checkpoint=checkpoint, resume=resume, **asked,
            )  # fmt: skip
    except (NotConverged, KeyboardInterrupt) as reason:
        so_far = getattr(reason, "partial", None)  # Ctrl-C may come before there is a run
        if so_far is not None:
            show_response(options, so_far, loaded)
        remedy = how_to_go_on({"checkpoint": checkpoint, "resume": resume})
        stop((str(reason) or "interrupted by Ctrl-C") + remedy, FAILED)

    def picture() -> Axes:
        from stochvi.statistics.densities import overview
        from stochvi.views.density import draw_overview

        return draw_overview(overview(loaded), loaded.title)

    show_response(options, response, loaded)
    model = model_of(loaded)
    if not beyond_one_oscillator(model) and model.omega > 0.0:
        options.draw("overview", picture)
