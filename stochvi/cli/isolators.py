"""Commands of isolators between stops. Chapters: `size` by a map, by damage and by phases; the law
of a stop from a test; screening, clearance, sizing, perturbations; replay; absorbers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from stochvi.cli.declared import Question, Show, command, declare
from stochvi.cli.options import (
    BUDGET,
    Common,
    Varied,
    band,
    tolerances_of,
)
from stochvi.statistics.hardness import HARDNESS

if TYPE_CHECKING:
    from stochvi.isolators import Sizing
    from stochvi.mathematics.numerics import Vector
    from stochvi.methods.replay import Replay
    from stochvi.results.base import DataFrame
    from stochvi.scenes.scene import Scene


# ------------------------------------------------------------------------------
# `size --map`, `size --damage-ratio`, and `size` of a scene with phases.
# ------------------------------------------------------------------------------


AXES = ("clearance", "stiffness")
"""Axes of the map."""

FAINT = 1e-3
"""Share of the stiffness of the stops below which no stiffness of a map is meant."""

POINTS = 20
"""Number of values of an axis where only its ends are given."""

OTHER = ("wanted", "pad_force", "rattle_space", "damage_ratio", "equipment", "q", "exponent")
"""Options of `size` that are for a map, or for damage."""

TARGETS = ("probability", "rate", *HARDNESS)
NEVER_WITH = ("at", "pair", "common", "sensitivity", "tolerances")
"""Targets of `size`, and its options that do not go with a map, damage or phases."""


def other_sizing(question: Question, other: dict[str, Any]) -> Show | None:
    """What shows a map, a sizing by damage or one of phases, if one of them is asked for; it is
    then what the question asks. `other` are the options `OTHER`."""
    given, scene = question.asked, question.scene
    limits = {name: other[name] for name in ("pad_force", "rattle_space")}
    if other["wanted"] is not None and other["damage_ratio"] is not None:
        raise ValueError("--map must stand without --damage-ratio, got both")
    if other["wanted"] is not None:
        _refuse("--map", given, (*NEVER_WITH, *(set(TARGETS) - {"peak_acceleration"})))
        limits["peak_acceleration"] = given["peak_acceleration"]
        kept = {name: most for name, most in limits.items() if most is not None}
        asked = _left(given) | {"limits": kept, **_ranges(scene, other["wanted"])}
        question.asks("isolators.bumpers:bumper_map", "map", asked)
        question.judged = True
        return question.show
    if any(limit is not None for limit in limits.values()):
        raise ValueError("--pad-force and --rattle-space must stand with --map, got no --map")
    if other["damage_ratio"] is not None:
        never = [name for name in NEVER_WITH if name != "at"]
        _refuse("--damage-ratio", given, (*never, *TARGETS))
        asked = {name: each for name, each in _left(given).items() if name != "exceedance"}
        asked |= {} if given["at"] is None else {"at": given["at"]}
        asked |= {"ratio": other["damage_ratio"], "q": other["q"], "exponent": other["exponent"]}
        asked["equipment"] = band("--equipment", other["equipment"])
        question.asks("isolators.sizing.size:size_by_damage", "damage", asked)
        return question.show
    from stochvi.isolators.sizing.size import is_one_phase

    if scene.phases or is_one_phase(scene):
        alone = "noise that is not Gaussian, shocks, or a spring or damper that is a function,"
        what = "a scene with phases" if scene.phases else alone
        part = (
            "size one phase, as FILE.toml#PHASE"
            if scene.phases
            else "leave it out, and sweep a key of the scene with --method size instead"
        )
        taken = ("common", "tolerances")
        _refuse(what, given, tuple(name for name in NEVER_WITH if name not in taken), part)
        asked = {name: each for name, each in given.items() if name not in NEVER_WITH}
        allowed, spreads = tolerances_of(scene, given["tolerances"])
        asked |= {"common": given["common"] or [], "tolerances": allowed, "spreads": spreads}
        question.asks(question.of, "phases", asked)
        return question.show
    return None


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
    if high < FAINT * own:  # factors of a law that has a stiffness
        raise ValueError(
            f"--map stiffness is in N/m where stops are linear springs, here of {own:g} N/m, got "
            f"{low:g} to {high:g}; write {low * own:g}:{high * own:g} for factors of it"
        )
    return {"stiffness_factors": np.geomspace(low, high, number) / own}


# ------------------------------------------------------------------------------
# The command that finds the law of a stop from a test of it.
# ------------------------------------------------------------------------------


@command("json, out, quiet", reads="file")
def identify(
    options: Common, file: str, kind: Any, at_speed: float | None, column: str | None, **asked: Any
) -> None:
    """Find the law of a stop from a test of it.

    Example: stochvi identify drop.csv --test drop --mass 2.3 --height 100mm --out out

    --test speeds|times|force|drop as kind (needed)  What FILE holds: speeds of approach and
        rebound; times of successive impacts; force over deflection (with times in front where it is
        fast); the acceleration of one drop.
    --mass KG (float)  Mass that meets the stop; for a drop.
    --unit LIST  Units of the columns, as mm,N, if FILE states none.
    --height LENGTH (length)  Height of the drop, 0.1 (m) or 100mm.
    --timing-error TIME (time) := 0.0  Standard deviation of a time of an impact, 1ms; a third of
        the interval of a video.
    --pendulum  Gravity does not press the mass onto the stop.
    --fs HZ (float)  Sampling rate of a record without times.
    --column NAME  Column of a record with several, name or number.
    --at-speed M/S (speed)  Speed whose restitution the line for a scene file states [mean of the
        test].
    """
    from stochvi.identification import identify as solve
    from stochvi.identification import read_test

    number = int(column) if column is not None and column.isdigit() else column
    test = read_test(Path(file), kind, column=number, **asked)
    options.show(solve(test, at_speed=at_speed))


# ------------------------------------------------------------------------------
# The command that finds the shocks in a record.
# ------------------------------------------------------------------------------


@command("json, out, quiet, verbose", reads="file")
def shocks(
    options: Common, file: str, scene: Path | None, column: str | None, **asked: Any
) -> None:
    """Find the shocks in a record, cut them out, and count them.

    Example: stochvi shocks drive.csv --natural-frequency 12Hz --scene box.toml --out out

    --natural-frequency F (frequency)  That of the mount: shocks count as it feels them [any].
    --scene FILE (path)  With --out: scene whose structure and stops that of both takes.
    --false-alarms N (float) = 0.05  Mean number of false shocks, at most, in such a record.
    --unit UNIT  Unit of the values, g, m/s2 or N, if FILE states none.
    --fs HZ (float)  Sampling rate of a record without times.
    --column NAME  Column of a record with several, name or number.
    --gaps refuse|split = refuse  What to do where samples are missing.
    """
    from stochvi.identification.shocks import shocks as solve
    from stochvi.scenes.text_tables import read_text
    from stochvi.views.files import write_text
    from stochvi.views.pages import Told

    if scene is not None and options.out is None:
        raise ValueError("--scene needs --out, the folder that gets the scene of both")
    text = "" if scene is None else read_text(scene)
    number = int(column) if column is not None and column.isdigit() else column
    found = solve(Path(file), column=number, **asked)
    options.show(found)
    if found.shocks:
        after = "with --out out: the quiet record, the shocks, and a scene of both"
        if options.out is not None:
            write_text(found.scene_text(text), options.out / "with-shocks.toml")
            after = f"stochvi size {options.out}/with-shocks.toml --probability 1% --mission 8h"
        options.say(Told(statements=[f"Next, {after}"]))


# ------------------------------------------------------------------------------
# Commands of isolators between stops: screening, clearance, sizing, perturbations.
# ------------------------------------------------------------------------------


@declare("isolators.screening:screen", "budget, json, out, quiet, verbose")
def screen(question: Question) -> None:
    """Find the motion without stops: rms, 3 sigma, Rice."""


def _too_rare(curve: DataFrame) -> str:
    """Why a curve of impact rates is not as accurate as asked for; empty where it is."""
    from stochvi.isolators.screening import unseen_notes

    unseen = len(unseen_notes(curve))
    return f"upper limits alone are known of {unseen} of the simulated rates" if unseen else ""


@declare(
    "isolators.screening:clearance_curve",
    "kept budget, seed, threads, json, out, quiet, verbose", progress="clearance",
    fails=_too_rare,
)  # fmt: skip
def clearance(question: Question) -> Show:
    """Find impact rates against clearance.

    --gaps LIST (multiples) = 1,1.5,2,2.5,3,3.5,4  Clearances per side, in rms displacements without
        stops, or with units: 1mm,2mm.
    --rel-error (float) = 0.02  Relative standard error of each simulated rate.
    {keeping}
    """
    import numpy as np

    from stochvi.isolators.screening import clearance_notes, predicted_curve, unseen_notes
    from stochvi.isolators.screening import screen as solve
    from stochvi.model.coverage import unshaken
    from stochvi.results.base import plain
    from stochvi.results.errors import NotApplicable
    from stochvi.views.files import write_table
    from stochvi.views.isolator_tables import curve_told

    scene, options = question.scene, question.options
    if not scene.impact_pairs:
        why = "the scene needs an impact_pair, for its law; screen and size need none"
        raise NotApplicable("clearance", why)
    linear = solve(scene)
    stds = {name: gap.displacement_std for name, gap in linear.impact_pairs.items()}
    if still := unshaken(stds):
        raise NotApplicable("clearance", still)
    gaps = question.asked.pop("gaps")
    places = np.transpose([gaps(std) for std in stds.values()]).reshape(-1, len(stds))
    question.asked["clearances"] = places

    def show(curve: DataFrame) -> None:
        notes = [*clearance_notes(linear, places), *unseen_notes(curve)]
        document = {
            "method": "clearance",
            "displacement_std": stds if len(stds) > 1 else next(iter(stds.values())),
            "curve": plain(curve),
            "notes": notes,
            "record": None,
        }
        options.tell(document, lambda: [curve_told(curve, notes)], linear.record)
        if options.out is not None:
            from stochvi.views.sizing import draw_clearance

            predicted = predicted_curve(scene, curve)
            write_table(curve, options.out / "clearance.csv")
            options.draw("clearance", lambda: draw_clearance(curve, predicted, scene.title))

    return show


@declare(
    "isolators.sizing.size:size", "kept budget, seed, threads, json, out, force, quiet, verbose",
    progress="sizing",
)  # fmt: skip
def size(question: Question) -> Show:
    """Find the clearance that keeps a stated risk.

    Give one target: --probability, --rate, or a limit of the hardest impact.

    --probability P (probability)  Target: probability of any impact in the mission, 0.01 or 1%.
    --rate F (rate)  Target: rate of impacts on all stops, 2 (1/s) or 0.1/h.
    {limits}
    --exceedance P (probability) = 0.01  Accepted probability that a limit is exceeded.
    --mission TIME (time)  Time of exposure: 3600 (s), 30min, 10h [1h, of a phase its duration; left
        out where the scene has phases].
    --at NAME  Coordinate or named point of that acceleration; default: all of them.
    --pair NAME  Pair that is sized where there are several; the others stay as they are.
    --common LIST (names)  Pairs that are made with one clearance in common: corner1,corner2.
    --rel-error (float)  Relative standard error of the risk [0.05], of a map or of the damage
        [0.1].
    --map clearance,stiffness as wanted  Instead: peak acceleration, force, travel and energy over
        both, or over clearance=2mm:9mm:20,stiffness=1e4:1e6:20; --peak-acceleration is then a limit
        of it.
    --pad-force F (force)  With --map: largest force on a stop, N.
    --rattle-space D (length)  With --map: limit of the travel from the static equilibrium, m or
        8mm.
    --damage-ratio R (float)  Instead: damage of equipment with stops over that without, at most R
        at all frequencies.
    --equipment LOW:HIGH[:NUMBER] = 20:2000  With --damage-ratio: natural frequencies of the
        equipment, Hz; without a number six in each octave.
    --q (float) = 10.0  with --damage-ratio: Q of the equipment.
    --exponent (float) = 6.0  With --damage-ratio: exponent of its fatigue.
    --sensitivity  Repeat the sizing for a changed mount, level and law of the stops.
    --tolerances LIST  Tolerances within which the clearance keeps its target: usual (frequency=10%,
        damping=30%, level=3dB, stiffness=20%), or some, as frequency=5%,level=1dB; a rigid body
        also takes centre=5mm. Or distributions between units, as frequency=normal:3% (std),
        clearance=uniform:0.1mm [those that the scene states, as structure.frequency_tolerance].
    {keeping}
    """
    from stochvi.isolators.sizing.sensitivity import sensitivity as vary
    from stochvi.results.deadline import partial_result
    from stochvi.scenes.scene import phase_duration

    asked, options, scene = question.asked, question.options, question.scene
    asked["mission"] = asked["mission"] or phase_duration(question.file)
    if asked["rel_error"] is None:
        del asked["rel_error"]
    if shows := other_sizing(question, {name: asked.pop(name) for name in OTHER}):
        return shows
    # wrong tolerances are refused before the work
    allowed, spreads = tolerances_of(scene, asked["tolerances"])
    deadline = options.until(options.budget, REPORT_SECONDS)
    sensitivity, common = asked.pop("sensitivity"), asked["common"] or []
    # changed cases and the report take the time that the sizing leaves
    share = FIRST if sensitivity else BEFORE_REPORT if options.out is not None else 1.0
    asked |= {"tolerances": allowed, "spreads": spreads, "common": common}
    asked["budget"] = deadline.part(share)

    def changed(answer: Sizing) -> DataFrame:
        with options.progress("sensitivity") as report:
            return partial_result(
                vary, answer, seed=options.seed, threads=options.threads,
                budget=deadline.part(1.0 if options.out is None else FIRST), progress=report,
            )  # fmt: skip

    def show(answer: Sizing) -> None:
        fell_short, table = [*answer.fell_short], None
        if sensitivity:
            table = changed(answer)
            fell_short.extend(
                f"--sensitivity, {change}: {note}"
                for change, note in zip(table["change"], table["note"], strict=True)
                if note
            )
        if fell_short:
            more = f" (and {len(fell_short) - 1} more)" if len(fell_short) > 1 else ""
            question.unmet.append(f"not as accurate as asked for: {fell_short[0]}{more}")
        question.show(
            answer, lambda: reviewed(answer, table), sensitivity=table,
            documented={} if table is None else {"sensitivity": table},
        )  # fmt: skip

    def reviewed(answer: Sizing, table: DataFrame | None) -> dict[str, Any]:
        from stochvi.isolators.sizing.review import ReviewSettings, review

        if answer.several:
            return {"sensitivity": table}
        settings = ReviewSettings(budget=deadline.rest or BUDGET)
        own = review(answer, table, settings, threads=options.threads)
        return {"sensitivity": table, "review": own}

    return show


REPORT_SECONDS = 3.0
"""Time that the tables, the first picture and the calculations of a report take, s (measured on a
busy machine)."""

FIRST, BEFORE_REPORT = 0.5, 0.7
"""Shares of the budget for the sizing itself if --sensitivity or only a report follows."""


@declare(
    "isolators.jolt_response:perturbations", "seed, budget, json, out, quiet",
    progress="perturbations",
)  # fmt: skip
def perturbations(question: Question) -> None:
    """Find whether a perturbation leads to clatter under a sine.

    --speeds LIST (list of m/s, needed)  Sudden changes of the relative velocity, as 0.1,0.2 (m/s)
        or 10mm/s.
    --paths (int) = 64  Number of paths for each perturbation.
    --duration (time)  Time for which paths are watched after it [1000 periods].
    """


# ------------------------------------------------------------------------------
# Command of the replay: a measured record itself between the stops.
# ------------------------------------------------------------------------------


@declare("methods.replay:replay", "seed, budget, threads, json, out, force, quiet, verbose")
def replay(question: Question) -> Show:
    """Pass a measured record through the mount and its stops.

    Example: stochvi replay box.toml --clearances 4mm,5mm,6mm --out out

    --clearances LIST (lengths)  Clearances: distances of the stops from the static equilibrium,
        2mm,3mm (or in m) [the stops of the scene].
    """

    def show(found: Replay) -> None:
        from stochvi.isolators.record_verdict import record_verdict
        from stochvi.isolators.screening import scene_at_rest

        scene, record = question.scene, record_verdict(question.scene)
        beside = {"scene": scene, "record": record}
        question.show(found, lambda: beside | {"hung": scene_at_rest(scene)}, record=record)

    return show


# ------------------------------------------------------------------------------
# The command of impact absorbers: effect of a loose mass in a box, or the best box.
# ------------------------------------------------------------------------------


@declare(
    "absorbers.performance:absorber", "budget, seed, threads, json, out, force, quiet",
    progress="absorber",
)  # fmt: skip
def absorber(question: Question) -> None:
    """Judge an impact absorber, or find the best one.

    The scene needs an [absorber] with mass (kg), play (m, total, stop to stop) and law, and an
    oscillator or isolator of known mass: stochvi new tower.toml --kind absorber writes one.
    With --mass-budget the box of the scene, if there is one, is left out, and the best one is
    found. With --sine the amplitude with the absorber is shown over frequency, or over play and
    mass at the frequency of the scene.

    --levels LIST (list of dB) = -6,-3,0,3,6  Levels of the excitation, dB relative to that of the
        scene.
    --mass-budget KG (float)  Mass for which the best box is designed, instead of judging that of
        the scene.
    --restitutions LIST (list) = 0.3,0.5,0.7  Restitutions of the stops that a design may choose
        from.
    --masses LIST (list) = 1  Numbers of equal masses that a design may choose from.
    --sine  Find the exact regimes under the sine of the scene instead.
    --from F as start (frequency)  With --sine: lowest frequency, Hz.
    --to F as end (frequency)  With --sine: highest frequency, Hz.
    --points (int) = 200  Number of frequencies, both ends included.
    --vary KEY=FIRST:LAST:NUMBER  With --sine: values of a key to tune, as absorber.play=1mm:9mm:50
        [play or gap, and mass].
    --rel-error (float) = 0.01  Relative standard error of mean squares and rates.
    """
    asked, scene = question.asked, question.scene
    varied, mass = Varied.of(asked), asked["mass_budget"]
    if asked["sine"] and mass is not None:
        raise ValueError("--sine and --mass-budget exclude each other, got both; leave out one")
    if varied.given and not asked["sine"]:
        raise ValueError(
            "--from, --to and --vary need --sine, got none; add --sine, or leave them out"
        )
    kept = {"rel_error": asked["rel_error"]}
    if asked["sine"]:
        over = {"frequency_hz": varied.frequencies(), "tune": varied.values(scene)}
        question.asks("absorbers:absorber_sine", "", over)
        question.shares = "budget"
    elif mass is None:
        question.asks(question.of, "absorber", kept | {"levels_db": asked["levels"]})
    else:
        kept |= {"mass_budget": mass, "restitutions": asked["restitutions"]}
        kept |= {"units": [round(number) for number in asked["masses"]]}
        question.asks("absorbers.design:design_absorber", "absorber", kept)
