"""The command of periodic regimes: what a structure with stops does under a sine."""

from __future__ import annotations

from typing import Any

import click

from stochvi.cli.options import FREQUENCY, Common, common, shown
from stochvi.cli.program import main


@main.command()
@click.argument("scene")
@click.option("--from", "start", type=FREQUENCY, metavar="F", help="Lowest frequency, Hz ...")
@click.option("--to", "end", type=FREQUENCY, metavar="F", help="... and the highest.")
@click.option("--points", type=int, default=400, show_default=True, help="Frequencies in between.")
@click.option(
    "--vary", metavar="KEY=FIRST:LAST:NUMBER",
    help="Instead: values of a key of the scene, as impact_pair.0.clearance=3mm:6mm:100.",
)  # fmt: skip
@click.option(
    "--sweep", type=click.Choice(["up", "down", "both"]),
    help="Simulate a slow sweep from value to value beside the branches.",
)  # fmt: skip
@click.option(
    "--form", type=click.Choice(["exact", "motion", "force"]), default="exact", show_default=True,
    help="Exact, or by harmonic linearisation, with its error.",
)  # fmt: skip
@click.option("--coordinate", metavar="NAME", help="Whose displacement is shown [the first].")
@click.option(
    "--impacts", type=int, default=3, show_default=True,
    help="Largest number of impacts per period of regimes that are looked for.",
)  # fmt: skip
@common("budget", "json", "out", "quiet")
def sine(
    options: Common, scene: str, start: float | None, end: float | None, points: int,
    vary: str | None, sweep: str | None, form: str, coordinate: str | None, impacts: int,
) -> None:  # fmt: skip
    """What a structure between rigid stops does under a sine: all regimes, jumps, stability.

    Regimes that repeat themselves follow exactly, stable or not, over frequency or any key of the
    scene; where a slow sweep jumps is stated. Without --from and --to: at the frequency of the
    scene. Noise of the scene is left out.
    """
    import numpy as np

    from stochvi.methods.periodic import harmonic_response
    from stochvi.scenes.scene import load_scene
    from stochvi.sweeps import values_of
    from stochvi.views.sine import draw_sine, print_sine

    loaded = load_scene(scene)
    asked: dict[str, Any] = {}
    if vary is not None:
        if start is not None or end is not None:
            raise ValueError("--vary takes the place of --from and --to, got both; leave out one")
        asked["vary"] = dict([values_of(vary, loaded.document(as_written=True))])
    elif start is not None or end is not None:
        if start is None or end is None or not start < end:
            raise ValueError(
                f"--from and --to must be two rising frequencies (Hz), got {start} and {end}"
            )
        if points < 2:
            raise ValueError(f"--points must be at least 2, got {points}")
        asked["frequency_hz"] = np.linspace(start, end, points)
    shown(
        lambda: harmonic_response(
            loaded, **asked, form=form, sweep=sweep, coordinate=coordinate, most_impacts=impacts,
            budget=options.budget,
        ),
        lambda found: _show(options, found, print_sine, draw_sine),
    )  # fmt: skip


def _show(options: Common, found: Any, tell: Any, draw: Any) -> None:
    options.show(found, tell, "sine")
    options.draw("sine", lambda: draw(found))
