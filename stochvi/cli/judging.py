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


@main.command()
@click.argument("scene")
@click.option("--rel-error", type=float, default=0.003, show_default=True, help="Of Monte Carlo.")
@options("budget", "seed", "threads", "json", "out", "quiet")
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
    with progress_bar(quiet, "checking") as report:
        verdict = compare(
            loaded, rel_error=rel_error, budget=budget, seed=seed, threads=threads, progress=report
        )
    if not quiet:
        print_check(console_for(json_file), verdict)
    if json_file is not None:
        write_json(verdict.to_dict(), json_file)
    if out is not None:
        write_table(verdict.to_frame(), out / "check.csv")
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
    from stochvi.accuracy import cost as measure
    from stochvi.files import write_json
    from stochvi.scenes import load_scene
    from stochvi.tables import print_cost

    loaded = load_scene(scene)
    with progress_bar(quiet, "cost") as report:
        found = measure(loaded, budget=budget, seed=seed, threads=threads, progress=report)
    if not quiet:
        print_cost(console_for(json_file), found)
    if json_file is not None:
        write_json(found.to_dict(), json_file)
    if out is not None:
        from stochvi.files import write_picture, write_table
        from stochvi.plots import draw_work_precision

        write_table(found.to_frame(), out / "cost.csv")
        write_picture(draw_work_precision(found, loaded.title), out / "cost.png")


@main.command()
@click.argument("scene")
@options("threads", "json", "quiet")
def explain(scene: str, threads: int | None, json_file: str | None, quiet: bool) -> None:
    """What would be simulated, what not, which methods apply, at what price."""
    from stochvi.explanation import explain as tell
    from stochvi.files import write_json
    from stochvi.scenes import load_scene
    from stochvi.tables import print_explanation

    told = tell(load_scene(scene), threads=threads)
    if not quiet:
        print_explanation(console_for(json_file), told)
    if json_file is not None:
        write_json(told.to_dict(), json_file)
