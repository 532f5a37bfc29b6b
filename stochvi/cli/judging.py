"""Commands that compare methods and tell what they cost."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from stochvi.cli.shared import (
    FAILED,
    console_for,
    main,
    options,
    progress_bar,
    stop,
)

if TYPE_CHECKING:
    pass


ONE_SCENE, MANY_SCENES = 0.003, 0.01
"""Default relative error of Monte Carlo for one scene and for each of many."""


@main.command()
@click.argument("scenes", metavar="SCENE...", nargs=-1)
@click.option("--zoo", is_flag=True, help="Every scene of the zoo that ships, too.")
@click.option(
    "--rel-error", type=float,
    help=f"Of Monte Carlo; default {ONE_SCENE:g}, of several scenes {MANY_SCENES:g}.",
)  # fmt: skip
@options("budget", "seed", "threads", "json", "out", "quiet")
def check(
    scenes: tuple[str, ...],
    zoo: bool,
    rel_error: float | None,
    budget: float,
    seed: int,
    threads: int | None,
    json_file: str | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """All methods that apply, compared; exit 1 if they disagree.

    Several scenes, or the zoo, are judged under one alarm rate for all their comparisons.
    """
    from stochvi.scenes.scene import load_scene
    from stochvi.verification.check import Check
    from stochvi.verification.check import check as compare
    from stochvi.verification.checks import Checks, check_many
    from stochvi.verification.checks import zoo as shipped
    from stochvi.views.files import write_json, write_picture, write_table
    from stochvi.views.tables import print_check, print_checks
    from stochvi.views.verification import draw_scores

    if not scenes and not zoo:
        raise ValueError("check needs a scene file, several, or --zoo, got none")
    twice = [name for number, name in enumerate(scenes) if name in scenes[:number]]
    if twice:
        raise ValueError(f"check needs each scene once, got {twice[0]} twice; leave one out")
    loaded = {name: load_scene(name) for name in scenes} | (shipped() if zoo else {})
    verdict: Check | Checks
    with progress_bar(quiet, "checking") as report:
        if len(loaded) == 1:
            (scene,) = loaded.values()
            verdict = compare(
                scene,
                rel_error=ONE_SCENE if rel_error is None else rel_error,
                budget=budget,
                seed=seed,
                threads=threads,
                progress=report,
            )
        else:
            verdict = check_many(
                loaded,
                rel_error=MANY_SCENES if rel_error is None else rel_error,
                budget=budget,
                seed=seed,
                threads=threads,
                progress=report,
            )
    if not quiet:
        show = print_check if isinstance(verdict, Check) else print_checks
        show(console_for(json_file), verdict)  # type: ignore[arg-type]
    if json_file is not None:
        write_json(verdict.to_dict(), json_file)
    if out is not None:
        write_table(verdict.to_frame(), out / "check.csv")
        if isinstance(verdict, Checks):
            write_picture(draw_scores(verdict), out / "scores.png")
    if not verdict.passed:
        stop(f"check failed: {verdict.summary()}", FAILED)


@main.command()
@click.argument("scene")
@click.option(
    "--budget", type=float, default=20.0, show_default=True, metavar="SECONDS",
    help="Time to spend on measuring.",
)  # fmt: skip
@options("seed", "threads", "json", "out", "quiet")
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
    from stochvi.scenes.scene import load_scene
    from stochvi.verification.cost import cost as measure
    from stochvi.views.files import write_json
    from stochvi.views.tables import print_cost

    loaded = load_scene(scene)
    with progress_bar(quiet, "cost") as report:
        found = measure(loaded, budget=budget, seed=seed, threads=threads, progress=report)
    if not quiet:
        print_cost(console_for(json_file), found)
    if json_file is not None:
        write_json(found.to_dict(), json_file)
    if out is not None:
        from stochvi.views.files import write_picture, write_table
        from stochvi.views.verification import draw_work_precision

        write_table(found.to_frame(), out / "cost.csv")
        write_picture(draw_work_precision(found, loaded.title), out / "cost.png")


@main.command()
@click.argument("scene")
@options("threads", "json", "quiet")
def explain(scene: str, threads: int | None, json_file: str | None, quiet: bool) -> None:
    """What would be simulated, what not, which methods apply, at what price."""
    from stochvi.scenes.scene import load_scene
    from stochvi.verification.explain import explain as tell
    from stochvi.views.files import write_json
    from stochvi.views.tables import print_explanation

    told = tell(load_scene(scene), threads=threads)
    if not quiet:
        print_explanation(console_for(json_file), told)
    if json_file is not None:
        write_json(told.to_dict(), json_file)
