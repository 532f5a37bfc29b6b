"""Command of the replay: a measured record itself between the stops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from stochvi.cli.options import Common, common, lengths
from stochvi.cli.program import main

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@main.command()
@click.argument("scene")
@click.option(
    "--clearances", metavar="LIST",
    help="Clearances: distances of the stops from the static equilibrium, 2mm,3mm (or in m) "
    "[the stops of the scene].",
)  # fmt: skip
@common("seed", "budget", "threads", "json", "out", "force", "quiet")
def replay(options: Common, scene: str, clearances: str | None) -> None:
    """Pass a measured record through the mount and its stops.

    Example: stochvi replay box.toml --clearances 4mm,5mm,6mm --out out
    """
    from stochvi.isolators.record_verdict import record_verdict
    from stochvi.isolators.scene_at_rest import scene_at_rest
    from stochvi.methods.replay import replay as solve
    from stochvi.scenes.scene import load_scene
    from stochvi.views.files import write_table
    from stochvi.views.replay import print_replay

    loaded = load_scene(scene)
    places = None if clearances is None else lengths("--clearances", clearances)
    found = solve(loaded, places, seed=options.seed, threads=options.threads, budget=options.rest)
    record = record_verdict(loaded)

    def picture() -> Axes:
        from stochvi.views.replay import draw_replay

        return draw_replay(found, loaded.title)

    options.show(found, lambda console, answer: print_replay(console, answer, record), "replay")
    if options.out is not None:
        write_table(found.impacts, options.out / "impacts.csv")
        if found.histories is not None:
            write_table(found.histories.to_frame(), options.out / "histories.csv")
    if found.only is None or found.histories is not None:
        options.draw("replay", picture)
    if options.out is not None:
        from stochvi.views.report import write_replay_report

        write_replay_report(
            found,
            loaded,
            scene_at_rest(loaded),
            record,
            options.out,
            options.origin(scene, found.provenance),
        )
