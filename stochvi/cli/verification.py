"""Commands that compare methods, measure the cost of accuracy, and explain a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from stochvi.cli.options import Common, common
from stochvi.cli.program import FAILED, main, stop

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.verification.check import Check

ONE_SCENE = 0.003
"""Default relative error of the Monte Carlo where one scene is checked."""

MANY_SCENES = 0.01
"""Default relative error of the Monte Carlo of each of several scenes that are checked together."""


@main.command()
@click.argument("scenes", metavar="SCENE...", nargs=-1)
@click.option("--zoo", is_flag=True, help="Every scene of the zoo that ships, too.")
@click.option(
    "--rel-error", type=float,
    help=f"Of Monte Carlo; default {ONE_SCENE:g}, of several scenes {MANY_SCENES:g}.",
)  # fmt: skip
@common("budget", "seed", "threads", "json", "out", "quiet")
def check(options: Common, scenes: tuple[str, ...], zoo: bool, rel_error: float | None) -> None:
    """All methods that apply, compared; exit 1 if they disagree.

    Several scenes, or the zoo, are judged under one alarm rate for all their comparisons.
    """
    from stochvi.scenes.scene import load_scene
    from stochvi.verification.check import check as compare
    from stochvi.verification.checks import Checks, check_many
    from stochvi.verification.checks import zoo as shipped
    from stochvi.views.verification_tables import print_check, print_checks

    if not scenes and not zoo:
        raise ValueError("check needs a scene file, several, or --zoo, got none")
    twice = [name for number, name in enumerate(scenes) if name in scenes[:number]]
    if twice:
        raise ValueError(f"check needs each scene once, got {twice[0]} twice; leave one out")
    loaded = {name: load_scene(name) for name in scenes} | (shipped() if zoo else {})
    verdict: Check | Checks
    with options.progress("checking") as report:
        asked = {"progress": report} | options.sampling
        if len(loaded) == 1:
            (only,) = loaded.values()
            error = ONE_SCENE if rel_error is None else rel_error
            verdict = compare(only, rel_error=error, **asked)
        else:
            error = MANY_SCENES if rel_error is None else rel_error
            verdict = check_many(loaded, rel_error=error, **asked)

    def picture() -> Axes:
        from stochvi.views.verification import draw_scores

        assert isinstance(verdict, Checks)
        return draw_scores(verdict)

    if isinstance(verdict, Checks):
        options.show(verdict, print_checks, "check")
        options.draw("scores", picture)
    else:
        options.show(verdict, print_check, "check")
    if not verdict.passed:
        stop(f"check failed: {verdict.summary()}", FAILED)


@main.command()
@click.argument("scene")
@click.option(
    "--budget", type=float, default=20.0, show_default=True, metavar="SECONDS",
    help="Time to spend on measuring.",
)  # fmt: skip
@common("seed", "threads", "json", "out", "quiet")
def cost(options: Common, scene: str, budget: float) -> None:
    """What accuracy costs in time: errors of steps and of models."""
    from stochvi.scenes.scene import load_scene
    from stochvi.verification.cost import cost as measure
    from stochvi.views.verification_tables import print_cost

    loaded = load_scene(scene)
    with options.progress("cost") as report:
        found = measure(
            loaded, budget=budget, seed=options.seed, threads=options.threads, progress=report
        )

    def picture() -> Axes:
        from stochvi.views.verification import draw_work_precision

        return draw_work_precision(found, loaded.title)

    options.show(found, print_cost, "cost")
    options.draw("cost", picture)


@main.command()
@click.argument("scene")
@common("threads", "json", "quiet")
def explain(options: Common, scene: str) -> None:
    """What would be simulated, what not, which methods apply, at what price."""
    from stochvi.scenes.scene import load_scene
    from stochvi.verification.explain import explain as explain_scene
    from stochvi.views.verification_tables import print_explanation

    found = explain_scene(load_scene(scene), threads=options.threads)
    options.show(found, print_explanation)
