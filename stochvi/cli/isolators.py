"""Commands of isolators between stops: screening, clearance, sizing, jolts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import click

from stochvi.cli.options import (
    BUDGET,
    CHANCE,
    RATE,
    SPEED,
    TIME,
    Common,
    Quantity,
    acceleration,
    common,
    equipped,
    fail_unless_gaussian,
    keeping,
    lengths,
    numbers,
    shown,
)
from stochvi.cli.program import FAILED, main, stop
from stochvi.cli.tolerances import tolerances_of

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators import Jolts, Sizing
    from stochvi.isolators.record_verdict import RecordVerdict


@main.command()
@click.argument("scene")
@common("budget", "json", "out", "quiet")
def screen(options: Common, scene: str) -> None:
    """Find the motion without stops: rms, 3 sigma, Rice."""
    from stochvi.isolators.screening import screen as solve
    from stochvi.scenes.scene import load_scene
    from stochvi.views.isolator_tables import print_screening

    found = solve(load_scene(scene), budget=options.rest)
    document = {"method": "screen", **found.to_dict()}
    options.show(found, print_screening, "screening", document)
    if found.impact_pairs:
        options.draw("screening", found.plot)
    fail_unless_gaussian(found.record)


@main.command()
@click.argument("scene")
@click.option(
    "--gaps", default="1,1.5,2,2.5,3,3.5,4", show_default=True, metavar="LIST",
    help="Clearances per side, in rms displacements without stops, or with units: 1mm,2mm.",
)  # fmt: skip
@click.option(
    "--rel-error", type=float, default=0.02, show_default=True,
    help="Relative standard error of each simulated rate.",
)  # fmt: skip
@keeping
@common("kept budget", "seed", "threads", "json", "out", "quiet")
def clearance(options: Common, scene: str, gaps: str, **asked: Any) -> None:
    """Find impact rates against clearance."""
    import numpy as np

    from stochvi.isolators.clearance import (
        clearance_curve,
        clearance_notes,
        predicted_curve,
        unseen_notes,
    )
    from stochvi.isolators.screening import screen as solve
    from stochvi.results.base import plain
    from stochvi.results.errors import NotApplicable
    from stochvi.scenes.scene import load_scene
    from stochvi.views.files import write_clearance
    from stochvi.views.isolator_tables import print_clearance, print_record

    loaded = load_scene(scene)
    if not loaded.impact_pairs:
        why = "the scene needs an impact_pair, for its law; screen and size need none"
        raise NotApplicable("clearance", [why])
    linear = solve(loaded)
    record = linear.record
    stds = {name: gap.displacement_std for name, gap in linear.impact_pairs.items()}
    if still := [name for name, std in stds.items() if not std > 0.0]:
        raise NotApplicable(
            "clearance",
            [f"excitation must move the gap of {', '.join(still)}; leave out what stays still"],
        )
    places = np.transpose([lengths("--gaps", gaps, plain=std) for std in stds.values()])
    places = places.reshape(-1, len(stds))
    unseen: list[str] = []
    if not options.quiet:
        print_record(options.console, record)

    def simulated() -> pd.DataFrame:
        with options.progress("clearance") as report:
            return clearance_curve(loaded, places, progress=report, **options.sampling, **asked)

    def show(curve: pd.DataFrame) -> None:
        unseen.extend(unseen_notes(curve))
        notes = [*clearance_notes(linear, places), *unseen]
        document = {
            "method": "clearance",
            "displacement_std": stds if len(stds) > 1 else next(iter(stds.values())),
            "curve": plain(curve),
            "notes": notes,
            "record": plain(record),
        }
        options.show(
            curve, lambda console, each: print_clearance(console, each, notes), None, document
        )
        if options.out is not None:
            write_clearance(curve, predicted_curve(loaded, curve), loaded.title, options.out)

    shown(simulated, show, asked)
    fail_unless_gaussian(record)
    if unseen:
        stop(f"upper limits alone are known of {len(unseen)} of the simulated rates", FAILED)


@main.command()
@click.argument("scene")
@click.option(
    "--probability",
    type=CHANCE,
    metavar="P",
    help="Target: probability of any impact in the mission, 0.01 or 1%.",
)
@click.option(
    "--rate", type=RATE, metavar="F", help="Target: rate of impacts on all stops, 2 (1/s) or 0.1/h."
)
@click.option(
    "--impact-speed",
    type=SPEED,
    metavar="V",
    help="Target: largest impact speed of the mission, m/s.",
)
@click.option(
    "--peak-acceleration",
    metavar="A[g]",
    help="Target: largest absolute acceleration during an impact in the mission, m/s^2 or g (80g).",
)
@click.option(
    "--exceedance",
    type=CHANCE,
    default=0.01,
    show_default=True,
    metavar="P",
    help="Accepted probability that a speed or acceleration is exceeded.",
)
@click.option(
    "--mission",
    type=TIME,
    metavar="TIME",
    help="Time of exposure: 3600 (s), 30min, 10h [1h, of a phase its duration; left out where the "
    "scene has phases].",
)
@click.option(
    "--at", metavar="NAME",
    help="Coordinate or named point of that acceleration; default: all of them.",
)  # fmt: skip
@click.option(
    "--pair",
    metavar="NAME",
    help="Pair that is sized where there are several; the others stay as they are.",
)
@click.option(
    "--common", metavar="LIST",
    help="Pairs that are made with one clearance in common: corner1,corner2.",
)  # fmt: skip
@click.option(
    "--rel-error", type=float,
    help="Relative standard error of the risk [0.05], of a map or of the damage [0.1].",
)  # fmt: skip
@click.option(
    "--map", "wanted", metavar="clearance,stiffness",
    help="Instead: peak acceleration, force, travel and energy over both, or over "
    "clearance=2mm:9mm:20,stiffness=1e4:1e6:20; --peak-acceleration is then a limit of it.",
)  # fmt: skip
@click.option(
    "--pad-force", type=Quantity("force"), metavar="F",
    help="With --map: largest force on a stop, N.",
)  # fmt: skip
@click.option(
    "--rattle-space", type=Quantity("length"), metavar="D",
    help="With --map: limit of the travel from the static equilibrium, m or 8mm.",
)  # fmt: skip
@click.option(
    "--damage-ratio", type=float, metavar="R",
    help="Instead: damage of equipment with stops over that without, at most R at all frequencies.",
)  # fmt: skip
@equipped("with --damage-ratio: ")
@click.option(
    "--sensitivity",
    is_flag=True,
    help="Repeat the sizing for a changed mount, level and law of the stops.",
)
@click.option(
    "--tolerances", metavar="LIST",
    help="Tolerances within which the clearance keeps its target: usual (frequency=10%, "
    "damping=30%, level=3dB, stiffness=20%), or some, as frequency=5%,level=1dB; a rigid body "
    "also takes centre=5mm. Or distributions between units, as frequency=normal:3% (std), "
    "clearance=uniform:0.1mm [those that the scene states, as structure.frequency_tolerance].",
)  # fmt: skip
@keeping
@common("kept budget", "seed", "threads", "json", "out", "force", "quiet")
def size(
    options: Common, scene: str, peak_acceleration: str | None, sensitivity: bool,
    tolerances: str | None, common: str | None, **asked: Any,
) -> None:  # fmt: skip
    """Find the clearance that keeps a stated risk."""
    from stochvi.cli.other_sizings import OTHER, names_in, other_sizing
    from stochvi.isolators.sizing.method import size as solve
    from stochvi.isolators.sizing.sensitivity import sensitivity as vary
    from stochvi.results.base import plain
    from stochvi.results.deadline import partial_result
    from stochvi.scenes.scene import load_scene, phase_duration
    from stochvi.views.isolator_tables import print_sizing

    loaded = load_scene(scene)
    asked["mission"] = asked["mission"] or phase_duration(scene)
    other = {name: asked.pop(name) for name in OTHER}
    asked = {name: each for name, each in asked.items() if name != "rel_error" or each is not None}
    alone = {"peak_acceleration": acceleration(peak_acceleration), "sensitivity": sensitivity,
             "tolerances": tolerances, "common": common}  # fmt: skip
    if other_sizing(options, scene, loaded, asked | alone, other):
        return
    # wrong tolerances are refused before the work
    allowed, spreads = tolerances_of(loaded, tolerances)
    deadline = options.until(options.budget, REPORT_SECONDS)
    fell_short: list[str] = []
    judged: list[RecordVerdict | None] = []

    def found() -> Sizing:
        # changed cases and the report take the time that the sizing leaves
        share = FIRST if sensitivity else BEFORE_REPORT if options.out is not None else 1.0
        sampling = options.sampling | {"budget": deadline.part(share)}
        with options.progress("sizing") as report:
            answer = solve(
                loaded, peak_acceleration=acceleration(peak_acceleration), tolerances=allowed,
                spreads=spreads, common=names_in(common),
                progress=report, **sampling, **asked,
            )  # fmt: skip
        return cast("Sizing", answer)  # phases were shown before

    def show(answer: Sizing) -> None:
        fell_short.extend(answer.fell_short)
        document, table = answer.to_dict(), None
        if sensitivity:
            with options.progress("sensitivity") as report:
                table = partial_result(
                    vary, answer, seed=options.seed, threads=options.threads,
                    budget=deadline.part(1.0 if options.out is None else FIRST), progress=report,
                )  # fmt: skip
            document |= {"sensitivity": plain(table)}
            fell_short.extend(
                f"--sensitivity, {change}: {note}"
                for change, note in zip(table["change"], table["note"], strict=True)
                if note
            )
        options.show(
            answer, lambda console, each: print_sizing(console, each, table), None, document
        )
        judged.append(answer.record)
        if options.out is None:
            return
        if answer.production is not None:
            options.draw("production", answer.production.plot)
        from stochvi.isolators.sizing.review import ReviewSettings, review
        from stochvi.views.report import write_report

        reviewed = None
        if not answer.several:
            settings = ReviewSettings(budget=deadline.rest or BUDGET)
            reviewed = review(answer, table, settings, threads=options.threads)
        origin = options.origin(scene, answer.provenance)
        write_report(answer, options.out, origin, review=reviewed, sensitivity=table)

    shown(found, show, asked)
    for record in judged:
        fail_unless_gaussian(record)
    if fell_short:
        more = f" (and {len(fell_short) - 1} more)" if len(fell_short) > 1 else ""
        stop(f"not as accurate as asked for: {fell_short[0]}{more}", FAILED)


REPORT_SECONDS = 3.0
"""Time that the tables, the first picture and the calculations of a report take, s (measured on a
busy machine)."""

FIRST, BEFORE_REPORT = 0.5, 0.7
"""Shares of the budget for the sizing itself if --sensitivity or only a report follows."""


@main.command()
@click.argument("scene")
@click.option(
    "--speeds", required=True, metavar="LIST",
    help="Changes of the relative velocity by the jolts, as 0.1,0.2 (m/s) or 10mm/s.",
)  # fmt: skip
@click.option(
    "--paths", type=int, default=64, show_default=True, help="Number of paths for each jolt."
)
@click.option(
    "--duration", type=TIME, help="Time for which paths are watched after a jolt [1000 periods]."
)
@common("seed", "budget", "json", "out", "quiet")
def jolt(options: Common, scene: str, speeds: str, **asked: Any) -> None:
    """Find whether a jolt leads to clatter under a sine."""
    from stochvi.isolators.jolt_response import jolts
    from stochvi.scenes.scene import load_scene
    from stochvi.views.isolator_tables import print_jolts

    loaded, wanted = load_scene(scene), numbers("--speeds", speeds, "m/s")

    def solve() -> Jolts:
        with options.progress("jolt") as report:
            return jolts(
                loaded, wanted, seed=options.seed, budget=options.rest, progress=report, **asked
            )

    shown(solve, lambda found: options.show(found, print_jolts, "jolts"))
