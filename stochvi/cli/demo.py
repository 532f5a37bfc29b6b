"""The command `demo`: a textbook oscillator and a real isolator, by all methods."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from stochvi.cli.options import Common, common
from stochvi.cli.output import console_for, progress_bar
from stochvi.cli.program import FAILED, main, stop

if TYPE_CHECKING:
    from rich.console import Console

    from stochvi.results.progress import Progress
    from stochvi.scenes.scene import Scene
    from stochvi.verification.check import Check

TEXTBOOK = {"oscillator-elastic": "R = 1", "oscillator-lossy": "R = 0.8"}
"""Shipped scenes of the textbook case, with the restitution that distinguishes them."""

CLEARANCES_IN_SIGMA = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
"""Clearances of the isolator in the table, in rms displacements without stops."""


@main.command()
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("out"), show_default=True,
    metavar="DIR", help="Where tables and pictures go.",
)  # fmt: skip
@common("seed", "threads", "quiet")
def demo(options: Common, out: Path) -> None:
    """Run a textbook case and a truck isolator."""
    from stochvi.cli.writable_targets import check_folder_target

    check_folder_target(out)
    console = console_for(None)
    console.quiet = options.quiet
    with progress_bar(options.quiet, "demo", console) as report:
        agreed = run_demo(options, out, console, report)
    console.print(f"\ntables and pictures are in {out}/", highlight=False)
    if not agreed:
        stop("the methods disagree, see above", FAILED)


def run_demo(options: Common, out: Path, console: Console, report: Progress) -> bool:
    """Run the demo, print its tables, write them with pictures to `out`; True if all agree."""
    from stochvi.scenes.datasets import shipped_scene
    from stochvi.scenes.scene import load_scene
    from stochvi.verification.check import check
    from stochvi.views.files import folder_in

    agreed = True
    for number, (name, label) in enumerate(TEXTBOOK.items()):
        report(0.15 * number, f"oscillator between stops, {label}")
        scene = load_scene(shipped_scene(name))
        verdict = check(scene, rel_error=0.002, seed=options.seed, threads=options.threads)
        agreed &= verdict.passed
        _show_textbook(scene, verdict, label, folder_in(out, name), console)
    report(0.3, "isolator: linear screening")
    isolator = load_scene(shipped_scene("isolator-truck"))
    _show_isolator(isolator, folder_in(out, "isolator-truck"), options, console, report)
    report(1.0, "done")
    return agreed


def _show_textbook(scene: Scene, verdict: Check, label: str, out: Path, console: Console) -> None:
    import pandas as pd

    from stochvi.methods.linearisation import linearise
    from stochvi.statistics.overview import overview
    from stochvi.views.files import try_picture, write_table
    from stochvi.views.overview import draw_overview
    from stochvi.views.tables import methods_table, print_frame
    from stochvi.views.verification_tables import print_check

    console.print(f"\nOscillator between stops at 1 sigma, {label}", style="bold", highlight=False)
    forms = [linearise(scene, form=form, variant="book") for form in ("motion", "force")]
    table = methods_table([*verdict.responses, *forms])
    print_frame(console, table, "by all methods, SI units; standard errors in brackets")
    console.print(
        "closure, motion, force: statistical linearisation, approximate; book: as printed there",
        style="dim",
        highlight=False,
    )
    if not verdict.passed:
        print_check(console, verdict)
    console.print(verdict.summary(), highlight=False)
    write_table(verdict.to_frame(), out / "check.csv")
    write_table(
        pd.concat([response.to_frame() for response in [*verdict.responses, *forms]]),
        out / "methods.csv",
    )
    try_picture(
        lambda: draw_overview(overview(scene), f"{scene.title}, {label}"), out / "overview.png"
    )


def _show_isolator(
    scene: Scene, out: Path, options: Common, console: Console, report: Progress
) -> None:
    from stochvi.isolators.clearance import clearance_curve, predicted_curve
    from stochvi.isolators.screening import screen
    from stochvi.statistics.overview import overview
    from stochvi.views.files import try_picture, write_clearance, write_table
    from stochvi.views.isolator_tables import print_clearance, print_screening
    from stochvi.views.overview import draw_overview

    console.print(f"\n{scene.title}", style="bold", highlight=False)
    linear = screen(scene)
    print_screening(console, linear)
    write_table(linear.to_frame(), out / "screening.csv")
    curve = clearance_curve(
        scene,
        [multiple * linear.displacement_std for multiple in CLEARANCES_IN_SIGMA],
        seed=options.seed,
        threads=options.threads,
        progress=lambda done, text: report(0.35 + 0.55 * done, f"impact rate: {text}"),
    )
    print_clearance(console, curve)
    report(0.92, "pictures")
    write_clearance(curve, predicted_curve(scene, curve), scene.title, out)
    try_picture(lambda: draw_overview(overview(scene), scene.title), out / "overview.png")
