"""Commands that compare methods, measure the cost of accuracy, and explain a scene."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import click

from stochvi.cli.options import BUDGET, TIME, Common, common, shown
from stochvi.cli.program import FAILED, main, stop

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from matplotlib.axes import Axes

    from stochvi.verification.check import Check, Explanation

ONE_SCENE = 0.003
"""Default relative error of the Monte Carlo where one scene is checked."""

MANY_SCENES = 0.01
"""Default relative error of the Monte Carlo of each of several scenes that are checked together."""


@main.command()
@click.argument("scenes", metavar="SCENE...", nargs=-1)
@click.option("--zoo", is_flag=True, help="Also check every scene of the zoo that ships.")
@click.option(
    "--rel-error", type=float,
    help=f"Relative standard error of each simulation [{ONE_SCENE:g}; with several scenes "
    f"{MANY_SCENES:g}].",
)  # fmt: skip
@click.option(
    "--budget", type=TIME, metavar="TIME",
    help=f"Time for the simulations of all scenes together [{BUDGET:g} for each].",
)  # fmt: skip
@common("seed", "threads", "json", "out", "quiet")
def check(
    options: Common, scenes: tuple[str, ...], zoo: bool, rel_error: float | None,
    budget: float | None,
) -> None:  # fmt: skip
    """Compare all methods that apply; exit 1 if they disagree.

    Several scenes, or the zoo, are judged under one alarm rate for all their comparisons.
    """
    from stochvi.scenes.scene import load_scene
    from stochvi.verification.check import Checks, check_many
    from stochvi.verification.check import check as compare
    from stochvi.verification.check import zoo as shipped
    from stochvi.views.verification import print_check, print_checks

    if not scenes and not zoo:
        raise ValueError("check needs a scene file, several, or --zoo, got none")
    twice = [name for number, name in enumerate(scenes) if name in scenes[:number]]
    if twice:
        raise ValueError(f"check needs each scene once, got {twice[0]} twice; leave one out")
    loaded = {name: load_scene(name) for name in scenes} | (shipped() if zoo else {})
    seconds = BUDGET * len(loaded) if budget is None else budget
    asked = options.sampling | {"budget": options.until(seconds).rest}
    failed: list[str] = []

    def judged() -> Check | Checks:
        with options.progress("checking") as report:
            if len(loaded) == 1:
                (only,) = loaded.values()
                error = ONE_SCENE if rel_error is None else rel_error
                return compare(only, rel_error=error, progress=report, **asked)
            error = MANY_SCENES if rel_error is None else rel_error
            return check_many(loaded, rel_error=error, progress=report, **asked)

    def picture(verdict: Checks) -> Axes:
        from stochvi.views.verification import draw_scores

        return draw_scores(verdict)

    def show(verdict: Check | Checks) -> None:
        if isinstance(verdict, Checks):
            options.show(verdict, print_checks, "check")
            options.draw("scores", lambda: picture(verdict))
        else:
            options.show(verdict, print_check, "check")
        failed.extend([] if verdict.passed else [verdict.summary()])

    with options.within(seconds):
        shown(judged, show)
    if failed:
        stop(f"check failed: {failed[0]}", FAILED)


PANELS_SECONDS = 3.5
"""Time that the errors of `cost` and the many panels of its picture take, s (measured on a busy
machine)."""


@main.command()
@click.argument("scene")
@click.option(
    "--budget", type=TIME, default=20.0, show_default=True, metavar="TIME",
    help="Time to spend on measuring.",
)  # fmt: skip
@common("seed", "threads", "json", "out", "quiet")
def cost(options: Common, scene: str, budget: float) -> None:
    """Measure what accuracy costs in time."""
    from stochvi.scenes.scene import load_scene
    from stochvi.verification.cost import cost as measure
    from stochvi.views.verification import print_cost

    loaded = load_scene(scene)
    with options.progress("cost") as report:
        found = measure(
            loaded, budget=options.until(budget, PANELS_SECONDS).rest or budget, seed=options.seed,
            threads=options.threads, progress=report,
        )  # fmt: skip

    def picture() -> Axes:
        from stochvi.views.verification import draw_work_precision

        return draw_work_precision(found, loaded.title)

    options.show(found, print_cost, "cost")
    options.draw("cost", picture)


EXPLAIN_BUDGET = 10.0
"""Time of an explanation, s, unless --budget is given."""


@main.command()
@click.argument("scene")
@click.option(
    "--budget", type=TIME, default=EXPLAIN_BUDGET, show_default=True, metavar="TIME",
    help="Largest time, without compiling; the trial simulation gets what is left of it.",
)  # fmt: skip
@common("threads", "json", "out", "quiet")
def explain(options: Common, scene: str, budget: float) -> None:
    """Say what is simulated, by which methods, at what price.

    With --out it draws the scene with its lengths as scene.svg.
    """
    from stochvi.scenes.scene import load_scene
    from stochvi.verification.check import explain as explain_scene
    from stochvi.verification.check import explain_phases
    from stochvi.views.verification import print_explanation, print_phases

    loaded = load_scene(scene)
    before = time.process_time()  # a command that starts does nothing else
    left = options.until(budget).rest or budget
    if loaded.phases:
        phases = {
            name: each.with_start(before)
            for name, each in explain_phases(loaded, threads=options.threads, budget=left).items()
        }
        each = {name: answer.to_dict() for name, answer in phases.items()}
        document = {"method": "explain", "phases": each}
        options.show(phases, print_phases, None, document)
        if options.out is not None:
            _write_phases(phases, options.out)
        found, loaded = next(iter(phases.values())), loaded.in_phase(loaded.phases[0].name)
    else:
        found = explain_scene(loaded, threads=options.threads, budget=left).with_start(before)
        options.show(found, print_explanation, "methods")
    if options.out is not None:
        from stochvi.views.schematic import write_problem

        rests = {name: gap.position for name, gap in found.rest_of_gaps.items()}
        write_problem(loaded, rests, options.out)


def _write_phases(phases: Mapping[str, Explanation], folder: Path) -> None:
    """Write the methods that apply in each phase of a mission as one table."""
    import pandas as pd

    from stochvi.views.files import write_table

    tables = [each.to_frame().assign(phase=name) for name, each in phases.items()]
    write_table(pd.concat(tables), folder / "methods.csv")


FILE_PATHS = 4096
"""Default number of paths of a problem for other programs: enough to show the bias of an integrator
that includes the transient from the start in its averages."""


@main.command()
@click.option(
    "--paths", type=int, default=FILE_PATHS, show_default=True, help="Paths of each problem."
)
@click.option(
    "--relaxations", type=float, default=20.0, show_default=True,
    help="Length of a path, in relaxation times.",
)  # fmt: skip
@common("out", "quiet")
def problems(options: Common, paths: int, relaxations: float) -> None:
    """List known-answer problems for other integrators.

    They are listed; with --out each is written as plain numbers in JSON, with its answer, an index
    and a README.
    """
    from stochvi.verification.testing.documents import (
        in_a_sentence,
        index_row,
        problem_document,
        readme,
    )
    from stochvi.verification.testing.problems import shipped_problems
    from stochvi.views.files import write_json, write_table, write_text
    from stochvi.views.verification import print_problems

    found = shipped_problems(paths=paths, relaxations=relaxations)
    if not options.quiet:
        sentences = {each[0].name: in_a_sentence(*each) for each in found}
        print_problems(options.console, sentences)
    if options.out is None:
        return
    import pandas as pd

    for problem, answer in found:
        write_json(problem_document(problem, answer), str(options.out / f"{problem.name}.json"))
    write_table(pd.DataFrame([index_row(*each) for each in found]), options.out / "index.csv")
    write_text(readme(), options.out / "README.txt")


@main.command()
@click.argument("file")
@click.option(
    "--problem", required=True, metavar="NAME|FILE.json",
    help="A problem that `problems` lists, or a file that it wrote.",
)  # fmt: skip
@click.option(
    "--format", "form", type=click.Choice(["statistics", "averages", "records"]),
    help="Format of FILE; default: recognised by its header.",
)  # fmt: skip
@click.option(
    "--allowed", type=float, default=0.0, show_default=True, metavar="PERCENT",
    help="Largest bias that is accepted, per cent.",
)  # fmt: skip
@common("json", "out", "quiet")
def judge(options: Common, file: str, problem: str, form: str | None, allowed: float) -> None:
    """Judge what another program wrote; exit 1 if it is wrong.

    FILE is CSV: statistics (quantity,value,standard_error), averages of each path, or records
    (path,time,x,v).
    """
    from stochvi.verification.testing.documents import judge_file
    from stochvi.views.verification import print_judgement

    if not 0.0 <= allowed < 100.0:
        raise ValueError(f"--allowed must be at least 0 and below 100 per cent, got {allowed:g}")
    verdict = judge_file(file, problem, format=form, paths=FILE_PATHS, allowed_percent=allowed)
    options.show(verdict, print_judgement, "judge")
    if not verdict.passed:
        stop(f"judge failed: {verdict.summary()}", FAILED)
