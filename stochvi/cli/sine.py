"""Commands of motions under a sine: regimes, basins, bifurcations, and life times in noise."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from stochvi.cli.options import Common, Varied, common, keeping, shown, varied
from stochvi.cli.program import main

if TYPE_CHECKING:
    from stochvi.methods.periodic import Basins
    from stochvi.statistics import LifeTimes


@main.command()
@click.argument("scene")
@varied(400, "values of a key of the scene, as impact_pair.0.clearance=3mm:6mm:100.")
@click.option(
    "--sweep", type=click.Choice(["up", "down", "both"]),
    help="Also simulate a slow sweep from value to value.",
)  # fmt: skip
@click.option(
    "--form", type=click.Choice(["exact", "motion", "force"]), default="exact", show_default=True,
    help="Exact regimes, or harmonic linearisation of motion or force, with its error.",
)  # fmt: skip
@click.option(
    "--coordinate", metavar="NAME",
    help="Coordinate or point whose displacement is shown [the first].",
)  # fmt: skip
@click.option(
    "--impacts", type=int, default=3, show_default=True,
    help="Largest number of impacts per period of regimes that are looked for.",
)  # fmt: skip
@common("budget", "json", "out", "quiet")
def sine(
    options: Common, scene: str, varied: Varied, sweep: str | None, form: str,
    coordinate: str | None, impacts: int,
) -> None:  # fmt: skip
    """Find all periodic motions under a sine, and jumps.

    Periodic regimes, stable or not, are calculated exactly over frequency or any key of the scene,
    with the values at which a slow sweep jumps. Without --from and --to they are calculated at the
    frequency of the scene. Noise of the scene is left out.
    """
    from stochvi.methods.periodic import harmonic_response
    from stochvi.scenes.scene import load_scene
    from stochvi.views.sine import draw_sine, print_sine

    loaded = load_scene(scene)
    asked = varied.asked(loaded)
    shown(
        lambda: harmonic_response(
            loaded, **asked, form=form, sweep=sweep, coordinate=coordinate, most_impacts=impacts,
            budget=options.rest,
        ),
        lambda found: _show(options, found, print_sine, draw_sine, "sine"),
    )  # fmt: skip


@main.command()
@click.argument("scene")
@click.option(
    "--start", "sides", multiple=True, metavar="NAME=FIRST:LAST:NUMBER",
    help="Starts along one axis of the map, as displacement.x=-1mm:1mm:300; give it for both axes.",
)  # fmt: skip
@click.option(
    "--phase", type=float, default=0.0, show_default=True,
    help="Phase of the force at the start, degrees.",
)  # fmt: skip
@click.option(
    "--periods",
    type=int,
    default=300,
    show_default=True,
    help="Periods for which each start is followed.",
)
@keeping
@common("threads", "kept budget", "json", "out", "quiet")
def basins(
    options: Common, scene: str, sides: tuple[str, ...], phase: float, periods: int, **kept: Any
) -> None:
    """Find which motion each start ends in, under a sine.

    The starts lie in a plane of two displacements or velocities, all others being 0. Each start is
    followed to the regime in which it ends, and the plane is coloured by regime. Noise of the scene
    is left out.
    """
    from stochvi.methods.periodic import basins as map_of
    from stochvi.scenes.scene import load_scene
    from stochvi.views.basins import plot_basins, print_basins

    loaded = load_scene(scene)
    plane = dict(_numbers_of(side) for side in sides) or None

    def solve() -> Basins:
        with options.progress("basins") as report:
            return map_of(
                loaded, plane, phase_deg=phase, periods=periods, threads=options.threads,
                budget=options.rest, progress=report, **kept,
            )  # fmt: skip

    shown(solve, lambda found: _show(options, found, print_basins, plot_basins, "basins"), kept)


@main.command()
@click.argument("scene")
@varied(400, "values of a key of the scene, as excitation.0.amplitude=1:3:400.")
@click.option(
    "--sweep", type=click.Choice(["up", "down", "both"]), default="both", show_default=True,
    help="Direction of the sweep; each motion starts from that at the value before.",
)  # fmt: skip
@click.option(
    "--settling", type=int, default=300, show_default=True,
    help="Periods that pass at each value before its motion is watched.",
)  # fmt: skip
@click.option(
    "--watched",
    type=int,
    default=128,
    show_default=True,
    help="Periods for which the motion is watched.",
)
@click.option(
    "--start", "starts", multiple=True, metavar="NAME=VALUE",
    help="State before the first value, as velocity.x=0.2 [at rest].",
)  # fmt: skip
@common("budget", "json", "out", "quiet")
def bifurcation(
    options: Common, scene: str, varied: Varied, sweep: str, settling: int, watched: int,
    starts: tuple[str, ...],
) -> None:  # fmt: skip
    """Sweep a key slowly: period doublings and chaos.

    They are simulated from impact to impact, with the Lyapunov exponent at each value. Noise of the
    scene is left out.
    """
    from stochvi.methods.periodic import bifurcation as diagram_of
    from stochvi.scenes.scene import load_scene
    from stochvi.views.basins import draw_bifurcation, print_bifurcation

    loaded = load_scene(scene)
    asked = varied.asked(loaded)
    if not asked:
        raise ValueError("--from and --to, or --vary, must say what is varied, got neither")
    begun = {name: values[0] for name, values in map(_numbers_of, starts)}
    shown(
        lambda: diagram_of(
            loaded, **asked, sweep=sweep, settling=settling, watched=watched, start=begun,
            budget=options.rest,
        ),
        lambda found: _show(options, found, print_bifurcation, draw_bifurcation, "bifurcation"),
    )  # fmt: skip


@main.command()
@click.argument("scene")
@click.option(
    "--regime", "regimes", multiple=True, metavar="NAME",
    help='Regime whose life time is wanted, as "no impacts" [all].',
)  # fmt: skip
@click.option(
    "--rel-error",
    type=float,
    default=0.1,
    show_default=True,
    help="Relative standard error of the mean life times.",
)
@keeping
@common("seed", "threads", "kept budget", "json", "out", "quiet")
def lifetimes(
    options: Common, scene: str, regimes: tuple[str, ...], rel_error: float, **kept: Any
) -> None:
    """Find how long each motion lasts in noise.

    Paths start in each of the regimes that coexist without noise. They are simulated with the noise
    of the scene until enough of them have left."""
    from stochvi.scenes.scene import load_scene
    from stochvi.statistics.lifetimes import lifetimes as times_of
    from stochvi.views.basins import plot_lifetimes, print_lifetimes

    loaded = load_scene(scene)

    def solve() -> LifeTimes:
        with options.progress("lifetimes") as report:
            return times_of(
                loaded, regimes or None, rel_error=rel_error, progress=report,
                **options.sampling, **kept,
            )  # fmt: skip

    shown(
        solve,
        lambda found: _show(options, found, print_lifetimes, plot_lifetimes, "lifetimes"),
        kept,
    )


def _show(options: Common, found: Any, tell: Any, draw: Any, name: str) -> None:
    options.show(found, tell, name)
    options.draw(name, lambda: draw(found))


def _numbers_of(text: str) -> tuple[str, list[float]]:
    """Name and values of a displacement (m) or velocity (m/s), from "NAME=FIRST:LAST:NUMBER" or
    "NAME=VALUE,VALUE"."""
    from stochvi.mathematics.units import measured_in
    from stochvi.results.sizes import spaced

    name, _, listed = text.partition("=")
    unit = "m/s" if name.startswith("velocity") else "m"
    try:
        if ":" not in listed:
            return name, [measured_in(word, unit) for word in listed.split(",")]
        first, last, number = listed.split(":")
        ends, count = [measured_in(first, unit), measured_in(last, unit)], int(number)
        if count < 1:
            raise ValueError
    except ValueError:
        raise ValueError(
            f"--start must be NAME=FIRST:LAST:NUMBER or NAME=VALUE, such as displacement.x=-1mm:"
            f"1mm:300 or velocity.x=0.2, got {text!r}"
        ) from None
    return name, spaced(f"--start {name}", ends[0], ends[1], count)
