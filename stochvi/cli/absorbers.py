"""The command of impact absorbers: effect of a loose mass in a box, or the best box."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from stochvi.cli.options import Common, Varied, common, numbers, shown, varied
from stochvi.cli.program import main

if TYPE_CHECKING:
    from stochvi.absorbers import AbsorberReport, AbsorberSine, Design


@main.command()
@click.argument("scene")
@click.option(
    "--levels", default="-6,-3,0,3,6", show_default=True, metavar="LIST",
    help="Levels of the excitation, dB relative to that of the scene.",
)  # fmt: skip
@click.option(
    "--mass-budget",
    type=float,
    metavar="KG",
    help="Mass for which the best box is designed, instead of judging that of the scene.",
)
@click.option(
    "--restitutions", default="0.3,0.5,0.7", show_default=True, metavar="LIST",
    help="Restitutions of the stops that a design may choose from.",
)  # fmt: skip
@click.option(
    "--masses", default="1", show_default=True, metavar="LIST",
    help="Numbers of equal masses that a design may choose from.",
)  # fmt: skip
@click.option(
    "--sine", is_flag=True, help="Find the exact regimes under the sine of the scene instead."
)
@varied(
    200,
    "values of a key to tune, as absorber.play=1mm:9mm:50 [play or gap, and mass].",
    "With --sine: ",
)
@click.option(
    "--rel-error", type=float, default=0.01, show_default=True,
    help="Relative standard error of mean squares and rates.",
)  # fmt: skip
@common("budget", "seed", "threads", "json", "out", "force", "quiet")
def absorber(
    options: Common, scene: str, *, levels: str, mass_budget: float | None, restitutions: str,
    masses: str, sine: bool, varied: Varied, rel_error: float,
) -> None:  # fmt: skip
    """Judge an impact absorber, or find the best one.

    The scene needs an [absorber] with mass (kg), play (m, total, stop to stop) and law, and an
    oscillator or isolator of known mass: stochvi new tower.toml --kind absorber writes one. With
    --mass-budget the box of the scene, if there is one, is left out, and the best one is found.
    With --sine the amplitude with the absorber is shown over frequency, or over play and mass at
    the frequency of the scene.
    """
    from stochvi.absorbers import absorber_sine
    from stochvi.absorbers.design import design_absorber
    from stochvi.absorbers.performance import absorber as perform
    from stochvi.scenes.scene import load_scene

    loaded = load_scene(scene)
    asked = {"rel_error": rel_error} | options.sampling

    def performance() -> AbsorberReport:
        with options.progress("absorber") as report:
            return perform(
                loaded, levels_db=numbers("--levels", levels, "dB"), progress=report, **asked
            )

    def design() -> Design:
        assert mass_budget is not None
        with options.progress("absorber") as report:
            return design_absorber(
                loaded, mass_budget=mass_budget, progress=report,
                restitutions=numbers("--restitutions", restitutions),
                units=[round(n) for n in numbers("--masses", masses)], **asked,
            )  # fmt: skip

    if sine:
        if mass_budget is not None:
            raise ValueError("--sine and --mass-budget exclude each other, got both; leave out one")
        shown(
            lambda: absorber_sine(
                loaded, varied.frequencies(), tune=varied.values(loaded), budget=options.rest
            ),
            lambda found: _show_sine(options, scene, found),
        )
    elif varied.given:
        raise ValueError(
            "--from, --to and --vary need --sine, got none; add --sine, or leave them out"
        )
    elif mass_budget is None:
        shown(performance, lambda found: _show_performance(options, scene, found))
    else:
        shown(design, lambda found: _show_design(options, scene, found))


def _show_performance(options: Common, scene: str, found: AbsorberReport) -> None:
    from stochvi.views.absorbers import draw_levels, draw_plays, print_absorber
    from stochvi.views.report.absorber import write_absorber_report

    options.show(found, print_absorber, "absorber")
    options.draw("absorber", lambda: draw_levels(found))
    if found.play_curve:
        options.draw("absorber-play", lambda: draw_plays(found))
    if options.out is not None:
        write_absorber_report(found, options.out, options.origin(scene, found.provenance))


def _show_sine(options: Common, scene: str, found: AbsorberSine) -> None:
    from stochvi.views.absorber_sine import draw_absorber_sine, print_absorber_sine
    from stochvi.views.report.absorber import write_absorber_report

    options.show(found, print_absorber_sine, "absorber-sine")
    options.draw("absorber-sine", lambda: draw_absorber_sine(found))
    if options.out is not None:
        write_absorber_report(found, options.out, options.origin(scene, found.provenance))


def _show_design(options: Common, scene: str, found: Design) -> None:
    from stochvi.views.absorbers import draw_design, print_design
    from stochvi.views.files import write_table
    from stochvi.views.report.absorber import write_absorber_report

    options.show(found, print_design)
    options.draw("absorber-design", lambda: draw_design(found))
    if options.out is not None:
        write_table(found.curve, options.out / "absorber-design.csv")
        write_absorber_report(found, options.out, options.origin(scene, found.provenance))
