"""Commands of isolators between stops. Chapters: `size` by a map, by damage and by phases; the law
of a stop from a test; screening, clearance, sizing and jolts; replay of a record; impact absorbers.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
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
    Varied,
    acceleration,
    band,
    common,
    equipped,
    fail_unless_gaussian,
    judged_record,
    keeping,
    lengths,
    numbers,
    shown,
    tolerances_of,
    varied,
)
from stochvi.cli.program import FAILED, main, stop

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from stochvi.absorbers import AbsorberReport, AbsorberSine, Design
    from stochvi.isolators import Jolts, Sizing
    from stochvi.isolators.record_verdict import RecordVerdict
    from stochvi.mathematics.numerics import Vector
    from stochvi.scenes.scene import Scene


# ------------------------------------------------------------------------------
# `size --map`, `size --damage-ratio`, and `size` of a scene with phases.
# ------------------------------------------------------------------------------


AXES = ("clearance", "stiffness")
"""Axes of the map."""

POINTS = 20
"""Number of values of an axis where only its ends are given."""

OTHER = ("wanted", "pad_force", "rattle_space", "damage_ratio", "equipment", "q", "exponent")
"""Options of `size` that are for a map, or for damage."""

TARGETS = ("probability", "rate", "impact_speed", "peak_acceleration")
NEVER_WITH = ("at", "pair", "common", "sensitivity", "tolerances")
"""Targets of `size`, and its options that do not go with a map, damage or phases."""


def other_sizing(
    options: Common, scene: str, loaded: Scene, given: dict[str, Any], other: dict[str, Any]
) -> bool:
    """Show a map, a sizing by damage or one of phases, if one of them is asked for.

    `scene` is the file of the scene, `given` are the arguments of `size`, and `other` those of
    `OTHER`.
    """
    limits = {name: other[name] for name in ("pad_force", "rattle_space")}
    if other["wanted"] is not None and other["damage_ratio"] is not None:
        raise ValueError("--map must stand without --damage-ratio, got both")
    if other["wanted"] is not None:
        _refuse("--map", given, (*NEVER_WITH, *(set(TARGETS) - {"peak_acceleration"})))
        limits["peak_acceleration"] = given["peak_acceleration"]
        _show_map(options, loaded, other["wanted"], limits, _left(given))
        return True
    if any(limit is not None for limit in limits.values()):
        raise ValueError("--pad-force and --rattle-space must stand with --map, got no --map")
    if other["damage_ratio"] is not None:
        never = [name for name in NEVER_WITH if name != "at"]
        _refuse("--damage-ratio", given, (*never, *TARGETS))
        left = {name: each for name, each in _left(given).items() if name != "exceedance"}
        left |= {} if given["at"] is None else {"at": given["at"]}
        _show_damage(options, scene, loaded, other, left)
        return True
    from stochvi.isolators.sizing.size import is_not_gaussian

    if loaded.phases or is_not_gaussian(loaded):
        alone = "noise that is not Gaussian, or shocks,"
        what = "a scene with phases" if loaded.phases else alone
        part = "size one phase, as FILE.toml#PHASE" if loaded.phases else "leave it out"
        _refuse(what, given, tuple(name for name in NEVER_WITH if name != "common"), part)
        _show_phases(options, scene, loaded, given)
        return True
    return False


def names_in(text: str | None) -> list[str]:
    """Names that are separated by commas; none without a text."""
    return [] if text is None else [name.strip() for name in text.split(",")]


def _refuse(
    what: str, given: dict[str, Any], names: tuple[str, ...], instead: str = "leave it out"
) -> None:
    unused = [name for name in names if given[name] not in (None, False)]
    if unused:
        named = ", ".join(f"--{name.replace('_', '-')}" for name in sorted(unused))
        raise ValueError(f"{what} must stand without {named}; {instead}")


def _left(given: dict[str, Any]) -> dict[str, Any]:
    """Arguments that go on to a calculation: those with a value, without targets."""
    unused = (*TARGETS, *NEVER_WITH)
    return {name: each for name, each in given.items() if name not in unused and each is not None}


def _show(
    options: Common, title: str, solve: Callable[..., Any], given: dict[str, Any],
    tell: Callable[..., None], draw: Callable[[Any], Any], report_of: str | None = None,
    record: RecordVerdict | None = None,
) -> None:  # fmt: skip
    """Find an answer and show it; its files have the name `title`. A clearance also gets a report,
    that of the scene file `report_of`; the `record` of an answer that does not judge it itself
    stands before it."""
    judged: list[RecordVerdict | None] = []

    def found() -> Any:
        with options.progress(title) as report:
            return solve(progress=report, **options.sampling, **given)

    def show(answer: Any) -> None:
        judged.append(getattr(answer, "record", None))
        options.show(answer, tell, title, record=record)
        options.draw(title, lambda: draw(answer))
        if options.out is not None and report_of is not None:
            from stochvi.views.report import write_clearance_report

            origin = options.origin(report_of, answer.provenance)
            write_clearance_report(answer, options.out, origin)

    shown(found, show, given)
    for record in judged:
        fail_unless_gaussian(record)


def _show_map(
    options: Common, loaded: Scene, wanted: str, limits: dict[str, float | None],
    given: dict[str, Any],
) -> None:  # fmt: skip
    from stochvi.isolators.bumpers import bumper_map
    from stochvi.views.statistics import draw_bumper_map, print_bumper_map

    kept = {name: most for name, most in limits.items() if most is not None}
    solve = partial(bumper_map, loaded, limits=kept, **_ranges(loaded, wanted))  # type: ignore[arg-type]
    _show(
        options, "map", solve, given, print_bumper_map,
        lambda answer: draw_bumper_map(answer, loaded.title), record=judged_record(loaded),
    )  # fmt: skip


def _show_damage(
    options: Common, scene: str, loaded: Scene, other: dict[str, Any], given: dict[str, Any]
) -> None:
    from stochvi.isolators.sizing.size import size_by_damage
    from stochvi.views.isolator_tables import plot_damage_sizing, print_damage_sizing

    solve = partial(
        size_by_damage, loaded, ratio=other["damage_ratio"], q=other["q"],
        exponent=other["exponent"], equipment=band("--equipment", other["equipment"]),
    )  # fmt: skip
    _show(options, "damage", solve, given, print_damage_sizing, plot_damage_sizing, scene)


def _show_phases(options: Common, scene: str, loaded: Scene, given: dict[str, Any]) -> None:
    from stochvi.isolators.sizing.size import size
    from stochvi.views.isolator_tables import plot_mission_sizing, print_mission_sizing

    common = names_in(given["common"])
    given = {name: each for name, each in given.items() if name not in NEVER_WITH}
    _show(
        options, "phases", partial(size, loaded, common=common), given, print_mission_sizing,
        plot_mission_sizing, scene,
    )  # fmt: skip


def _ranges(scene: Scene, text: str) -> dict[str, Vector]:
    """The axes of "clearance,stiffness", each with the ends that it may have, as
    "clearance=2mm:9mm,stiffness=1e4:1e6:30"."""
    found: dict[str, Vector] = {}
    words = [word.strip().partition("=") for word in text.split(",")]
    if sorted(name.strip() for name, _, _ in words) != sorted(AXES):
        raise ValueError(
            f"--map must be clearance,stiffness, each with or without FIRST:LAST:NUMBER, as "
            f"clearance=2mm:9mm:20,stiffness=1e4:1e6, got {text!r}"
        )
    for name, equals, span in words:
        if not equals:
            continue
        low, high, number = _span(name.strip(), span)
        found |= _axis(scene, name.strip(), low, high, number)
    return found


def _span(name: str, text: str) -> tuple[float, float, int]:
    from stochvi.mathematics.units import measured
    from stochvi.results.errors import MOST_SPACED, check_size

    words = text.split(":")
    try:
        low, high = (
            measured(word, "length") if name == "clearance" else float(word) for word in words[:2]
        )
        number = int(words[2]) if len(words) == 3 else POINTS
        if len(words) not in (2, 3) or number < 2 or not 0.0 < low < high:
            raise ValueError
    except ValueError:
        raise ValueError(
            f"--map {name} must be FIRST:LAST or FIRST:LAST:NUMBER, rising, got {text!r}"
        ) from None
    check_size(f"--map {name}", number, MOST_SPACED, "ask for fewer")
    return low, high, number


def _axis(scene: Scene, name: str, low: float, high: float, number: int) -> dict[str, Vector]:
    """The values of one axis; stiffnesses are in N/m where the stops are linear springs, else
    factors of the law."""
    import numpy as np

    from stochvi.isolators.bumpers import stiffness_of

    if name == "clearance":
        return {"clearances": np.linspace(low, high, number)}
    own = stiffness_of(scene) or 1.0
    return {"stiffness_factors": np.geomspace(low, high, number) / own}


# ------------------------------------------------------------------------------
# The command that finds the law of a stop from a test of it.
# ------------------------------------------------------------------------------


@main.command()
@click.argument("file")
@click.option(
    "--test", "kind", required=True, type=click.Choice(["speeds", "times", "force", "drop"]),
    help="What FILE holds: speeds of approach and rebound; times of successive impacts; force over "
    "deflection (with times in front where it is fast); the acceleration of one drop.",
)  # fmt: skip
@click.option("--mass", type=float, metavar="KG", help="Mass that meets the stop; for a drop.")
@click.option("--unit", metavar="LIST", help="Units of the columns, as mm,N, if FILE states none.")
@click.option(
    "--height", type=Quantity("length"), metavar="LENGTH",
    help="Height of the drop, 0.1 (m) or 100mm.",
)  # fmt: skip
@click.option(
    "--timing-error",
    type=TIME,
    default=0.0,
    metavar="TIME",
    help="Standard deviation of a time of an impact, 1ms; a third of the interval of a video.",
)
@click.option("--pendulum", is_flag=True, help="Gravity does not press the mass onto the stop.")
@click.option("--fs", type=float, metavar="HZ", help="Sampling rate of a record without times.")
@click.option("--column", metavar="NAME", help="Column of a record with several, name or number.")
@click.option(
    "--at-speed", type=SPEED, metavar="M/S",
    help="Speed whose restitution the line for a scene file states [mean of the test].",
)  # fmt: skip
@common("json", "out", "quiet")
def identify(
    options: Common, file: str, kind: Any, at_speed: float | None, column: str | None, **asked: Any
) -> None:
    """Find the law of a stop from a test of it.

    Example: stochvi identify drop.csv --test drop --mass 2.3 --height 100mm --out out
    """
    from stochvi.identification import identify as solve
    from stochvi.identification import read_test
    from stochvi.views.files import write_table
    from stochvi.views.verification import plot_identification, print_identification

    number = int(column) if column is not None and column.isdigit() else column
    test = read_test(Path(file), kind, column=number, **asked)
    found = solve(test, at_speed=at_speed)
    options.show(found, print_identification, "identify")
    if options.out is not None:
        write_table(found.curve, options.out / "curve.csv")
    options.draw("identify", lambda: plot_identification(found))


# ------------------------------------------------------------------------------
# Commands of isolators between stops: screening, clearance, sizing, jolts.
# ------------------------------------------------------------------------------


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

    from stochvi.isolators.screening import (
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
    from stochvi.isolators.sizing.sensitivity import sensitivity as vary
    from stochvi.isolators.sizing.size import size as solve
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


# ------------------------------------------------------------------------------
# Command of the replay: a measured record itself between the stops.
# ------------------------------------------------------------------------------


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
    from stochvi.isolators.screening import scene_at_rest
    from stochvi.methods.replay import replay as solve
    from stochvi.scenes.scene import load_scene
    from stochvi.views.files import write_table
    from stochvi.views.verification import print_replay

    loaded = load_scene(scene)
    places = None if clearances is None else lengths("--clearances", clearances)
    found = solve(loaded, places, seed=options.seed, threads=options.threads, budget=options.rest)
    record = record_verdict(loaded)

    def picture() -> Axes:
        from stochvi.views.verification import draw_replay

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


# ------------------------------------------------------------------------------
# The command of impact absorbers: effect of a loose mass in a box, or the best box.
# ------------------------------------------------------------------------------


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
    from stochvi.views.absorbers import draw_absorber_sine, print_absorber_sine
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
