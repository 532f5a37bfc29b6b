"""Commands of the methods and of the statistics. Chapters: a scene into a response; spectra,
impacts one by one, damage and reliability of missions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from stochvi.cli.declared import Question, Show, declare
from stochvi.cli.options import (
    BUDGET,
    WITHOUT_BUDGET,
    band,
    tolerances_of,
)
from stochvi.cli.program import executor_at

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.isolators.production_risk import Production
    from stochvi.results.base import Response
    from stochvi.statistics.reliability import Reliability

ANSWERED = "budget, json, out, quiet"
"""Common options of a calculation that samples nothing."""

SAMPLED = "open budget, seed, threads, json, out, quiet"
"""Common options of a simulation that a number of paths may bound."""

MISSION_PARTS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Fractions of a mission at which `first-passage` gives the probability: enough for a curve."""


# ------------------------------------------------------------------------------
# The methods: each turns a scene into a response.
# ------------------------------------------------------------------------------


def response(question: Question, name: str = "", draw: Callable[[], Axes] | None = None) -> Show:
    """What shows a response with its files, and draws a picture of this name if it is whole."""

    def show(found: Response) -> None:
        from stochvi.views.files import to_json, write_text

        question.show(found)
        if (out := question.options.out) is not None:
            write_text(to_json(found.to_dict()) + "\n", out / "response.json")
            _write_map(question, found)
        if draw is not None and question.whole:
            question.options.draw(name, draw)

    return show


def _write_map(question: Question, found: Response) -> None:
    """Write the rms along a bar or beam, or over a plate, as `map.csv` and `map.png`."""
    from stochvi.methods.linearisation.one_form import rms_along
    from stochvi.results.errors import NotApplicable, NotConverged
    from stochvi.views.files import write_table
    from stochvi.views.schematic import draw_map, has_places

    scene, options = question.scene, question.options
    if options.out is None or not has_places(scene):
        return
    try:
        table = rms_along(scene)
    except (NotApplicable, NotConverged):  # not even without stops
        return
    write_table(table, options.out / "map.csv")
    options.draw("map", lambda: draw_map(table, found, scene))


def _density(question: Question, of: Callable[..., Any]) -> Axes:
    """The picture of the density that a method finds for the same scene and options."""
    from stochvi.views.density import draw_density

    scene, rest = question.scene, question.options.rest
    return draw_density(scene, of(scene, **question.asked, budget=rest))


@declare("methods.closed_form:exact", ANSWERED, judged=True)
def exact(question: Question) -> Show:
    """Solve a scene in closed form, where one is known."""
    from stochvi.methods.closed_form import exact_density
    from stochvi.model.coverage import beyond_one_oscillator
    from stochvi.model.model import model_of

    def show(found: Response) -> None:
        model = model_of(question.scene)
        one = not beyond_one_oscillator(model) and not model.tables
        draw = (lambda: _density(question, exact_density)) if one else None
        response(question, "density", draw)(found)

    return show


@declare("methods.fokker_planck:fokker_planck", ANSWERED, judged=True, name="fokker-planck")
def fokker_planck(question: Question) -> Show:
    """Solve the Fokker-Planck equation: one mass, white noise.

    --rtol (float) = 0.01  Relative error of deviations, F1 and F2; 1e-6 takes a second or so.
    --speed-threshold (speed)  Slowest impact that a rate counts, m/s.
    """
    from stochvi.methods.fokker_planck import fokker_planck_density

    return response(question, "density", lambda: _density(question, fokker_planck_density))


@declare("methods.fokker_planck:first_passage", ANSWERED, name="first-passage")
def first_passage(question: Question) -> None:
    """Find P(first impact or passage before t), and its rate.

    --barrier B|LO,HI (barriers)  Barrier, m from the unloaded spring; leave LO or HI empty for
        none. Default: the stops.
    --times LIST (list of s)  Times that are listed, as 10,20 (s) or 1min.
    --mission TIME (time)  Duration, and parts of it, instead of times.
    --start rest|stationary = rest  Start at rest, or in the stationary motion without barriers.
    --rtol (float) = 0.0001  Relative error.
    """
    asked = question.asked
    mission = asked.pop("mission")
    if (asked["times"] is None) == (mission is None):
        raise ValueError("needs exactly one of --times and --mission; give one")
    asked["times"] = asked["times"] or [part * mission for part in MISSION_PARTS]
    asked["lower"], asked["upper"] = asked.pop("barrier") or (None, None)


@declare("methods.linearisation:linearise", ANSWERED, judged=True)
def linearise(question: Question) -> Show:
    """Linearise statistically: approximate, in milliseconds.

    --form closure|motion|force|clumps = closure  Which functions are linearised, and under which
        law.
    --variant consistent|book|box = consistent  Coefficients: consistent with the balances, as
        printed in the book, or for a box.
    """
    return response(question)


@declare("methods.averaging:average", ANSWERED, judged=True)
def average(question: Question) -> Show:
    """Average the energy: approximate, for light damping.

    --variant finite-jumps|continuous|unfolded = finite-jumps  Impacts as jumps of the energy (in
        Python 'finite jumps'), as a loss spread over a cycle, or as a damper.
    """
    from stochvi.methods.averaging import average_density

    question.asked["variant"] = question.asked["variant"].replace("-", " ")
    return response(question, "density", lambda: _density(question, average_density))


@declare(
    "methods.monte_carlo:simulate", "threads, json, out, quiet", progress="simulating", judged=True
)
def simulate(question: Question) -> Show:
    """Simulate by Monte Carlo, with errors and bias.

    --rel-error (float)  Relative standard error to reach [0.01].
    --paths (int)  Number of paths, instead of a relative error.
    --duration (time)  Length of each path after its burn-in, with --paths.
    --speed-threshold (speed)  Slowest impact that a rate counts, m/s.
    --slow-impacts  Refine steps near stops, for rates at R of 0.5 and below.
    {keeping}
    --dask ADDRESS  Simulate on a Dask cluster, as tcp://host:8786.
    --budget TIME (time)  Largest time; the exit code is 1 if the answer is not accurate enough by
        then [{BUDGET:g}; no limit with --paths, --checkpoint and --resume].
    --seed (int)  Seed: the same gives the same digits [0].
    """
    from stochvi.model.coverage import beyond_one_oscillator
    from stochvi.model.model import model_of

    asked, scene = question.asked, question.scene
    if asked["budget"] is None and not any(asked[name] for name in WITHOUT_BUDGET):
        asked["budget"] = BUDGET
    asked["budget"] = question.options.until(asked["budget"]).rest
    executor = executor_at(asked.pop("dask"))
    asked["executor"] = click.get_current_context().with_resource(executor)

    def picture() -> Axes:
        from stochvi.statistics.densities import overview
        from stochvi.views.density import draw_overview

        return draw_overview(overview(scene), scene.title)

    def show(found: Response) -> None:
        model = model_of(scene)
        one = not beyond_one_oscillator(model) and model.omega > 0.0
        response(question, "overview", picture if one else None)(found)

    return show


# ------------------------------------------------------------------------------
# The statistics: spectra, impacts one by one, damage and reliability of missions.
# ------------------------------------------------------------------------------


@declare("statistics.spectra:spectrum", SAMPLED, progress="simulating", judged=True)
def spectrum(question: Question) -> None:
    """Estimate spectra, transmissibility and coherence.

    --rel-error (float)  Relative standard error at a frequency [0.05].
    --paths (int)  Number of paths, instead of a relative error.
    --method welch|multitaper = welch  Overlapping segments, or several tapers over whole paths.
    --highest HZ (float)  Highest frequency [4 times the mode's].
    --segment TIME (time)  Length of a segment [21 / bandwidth].
    {keeping}
    """


@declare("statistics.stability:growth", SAMPLED, progress="simulating")
def growth(question: Question) -> None:
    """Find whether the motion of a modulated structure grows.

    --rel-error (float)  Relative standard error of the exponent [0.02].
    {keeping}
    """


@declare("statistics.impacts:impacts", SAMPLED, progress="simulating", judged=True)
def impacts(question: Question) -> Show:
    """Collect impacts: rates, intervals, speeds, energy.

    --rel-error (float)  Relative standard error of the rate [0.02].
    --paths (int)  Number of paths, instead of a relative error.
    --duration (time)  Length of each path after its burn-in, with --paths.
    --speed-threshold (speed)  Slowest impact that counts, m/s.
    --slow-impacts  Refine steps near stops, for rates at R of 0.5 and below.
    --first-hits  Simulate the rate of first impacts, too.
    --mission TIME (time)  Print the impacts in this time, too.
    {keeping}
    """
    mission = question.asked.pop("mission")
    return lambda found: question.show(found, mission=mission)


@declare(
    "statistics.damage:damage", f"{SAMPLED.replace('open', 'kept')}, verbose", progress="damage",
    judged=True,
    fails=lambda found: found.unseen_in_words if found.unseen else "",
)  # fmt: skip
def damage(question: Question) -> None:
    """Find shock and fatigue spectra of equipment that a scene shakes.

    Example: stochvi damage bumper.toml --mission 1h --equipment 20:2000 --q 10 --exponent 6

    --mission TIME (time)  Duration: 600 (s) or 10h [of a phase its own]; left out where the scene
        has phases.
    --equipment LOW:HIGH[:NUMBER] = 20:2000  Natural frequencies of the equipment, Hz; without a
        number six in each octave.
    --q (float) = 10.0  Q of the equipment.
    --exponent (float) = 6.0  Exponent of its fatigue.
    --at NAME  Coordinate or named point on which it stands; default: the first coordinate.
    --way simulation|clusters|record  Simulate everything, or clusters of impacts alone; by default
        where they are rare. record: follow a measured record itself, with its potholes.
    --levels LIST (list of m/s^2)  Count contacts above these accelerations, m/s^2 or as 10g,20g.
    --rel-error (float) = 0.2  Median relative standard error of the damage.
    --test-duration TIME (time)  Duration of a random test that does the same damage; --out gets its
        profile.csv.
    --breakpoints (int) = 12  Largest number of breakpoints of its profile.
    {keeping}
    """
    from stochvi.scenes.scene import phase_duration

    asked = question.asked
    asked["mission"] = asked["mission"] or phase_duration(question.file)
    asked["levels"] = asked["levels"] or ()
    asked["equipment"] = band("--equipment", asked["equipment"])
    question.judged = asked["way"] != "record"


@declare("statistics.histories:history", "budget, seed, json, out, quiet")
def history(question: Question) -> Show:
    """Record one realisation: motion, forces, impacts.

    Example: stochvi history truck.toml --duration 10s --rate 1000 --out out

    --duration TIME (time, needed)  Length of the path, as 10 (s) or 2min.
    --path (int) = 0  Number of the realisation.
    --rate HZ (float)  Samples per second [one per time step].
    --animate  Also draw history.gif: masses between their stops.
    """
    from stochvi.views.density import draw_history, write_animation
    from stochvi.views.files import write_parquet
    from stochvi.views.schematic import draw_shapes, has_shape

    options, scene, animate = question.options, question.scene, question.asked.pop("animate")
    if animate and options.out is None:
        raise ValueError("--animate writes history.gif into a folder: give --out DIR as well")

    def show(found: Any) -> None:
        question.show(found)
        if options.out is None:
            return
        write_parquet(found.samples, options.out / "history.parquet")
        options.draw("history", lambda: draw_history(found, scene, scene.title))
        if has_shape(found, scene):
            options.draw("shape", lambda: draw_shapes(found, scene, scene.title))
        if animate:
            write_animation(found, scene, options.out / "history.gif", scene.title)

    return show


@declare(
    "statistics.reliability:reliability",
    "kept budget, seed, threads, json, out, force, quiet, verbose",
    progress="reliability", judged=True,
)  # fmt: skip
def reliability(question: Question) -> Show:
    """Find probabilities of impacts in a mission, to 1e-9.

    Example: stochvi reliability box.toml --mission 3600 --impact-speed 0.5 --start rest

    --mission TIME (time)  Duration: 600 (s) or 10h [of a phase its own]; left out where the scene
        has phases.
    --barrier B|LO,HI (barriers)  Without stops: barrier from the unloaded spring, 0.004 (m) or 4mm;
        LO, HI may be empty.
    {limits}
    --at NAME  Coordinate or named point of that acceleration; default: all of them.
    --pair NAME  Count impacts on this pair alone.
    --start rest|stationary = stationary  Start at rest, or in the stationary motion.
    --way crude|splitting|first-crossings  Method; default: the one that a pilot run finds cheapest.
        In Python 'first crossings'.
    --rel-error (float) = 0.05  Relative standard error.
    --tolerances LIST  Distributions between the units of a production, for the mean probability of
        any impact: frequency=normal:3% (std), clearance=uniform:0.1mm.
    {keeping}
    """
    from stochvi.isolators.production_risk import production, unmet
    from stochvi.results.errors import NotApplicable
    from stochvi.scenes.scene import phase_duration
    from stochvi.views.isolator_tables import production_told

    asked, options, scene = question.asked, question.options, question.scene
    asked["mission"] = asked["mission"] or phase_duration(question.file)
    tolerances = asked.pop("tolerances")
    allowed, spreads = tolerances_of(scene, tolerances)
    if tolerances is not None and not spreads:
        raise ValueError(
            "--tolerances must hold a distribution between units, as frequency=normal:3%, got "
            f"{tolerances}; limits are for size"
        )
    alone = asked["barrier"] is not None or asked["start"] == "rest" or bool(scene.phases)
    if alone and tolerances is None:
        spreads = {}  # what the scene states is then at its mean, as the answer says
    if spreads and alone and not scene.phases:
        raise ValueError(
            "--tolerances must be left out with --barrier and --start rest: the mean over units is "
            "found for stops, from a stationary start"
        )
    if spreads and (conditions := unmet(scene)):
        raise NotApplicable("production", conditions)
    deadline = options.until(options.budget)
    asked |= {
        "way": asked["way"] and asked["way"].replace("-", " "),
        "budget": deadline.part(0.5 if spreads else 1.0),
    }

    def units_of(answer: Reliability) -> Production:
        with options.progress("units") as report:
            return production(
                scene, spreads, mission=answer.mission, pair=asked["pair"], tolerances=allowed,
                rel_error=asked["rel_error"], progress=report, seed=options.seed,
                threads=options.threads, budget=deadline.part(1.0),
            )  # fmt: skip

    def show(answer: Reliability) -> None:
        units = [units_of(answer)] if spreads else []
        question.show(
            answer, lambda: beside(*units), more=[production_told(each) for each in units],
            documented={"production": units[0]} if units else {},
        )  # fmt: skip

    def beside(units: Production | None = None) -> dict[str, Any]:
        from stochvi.isolators.screening import scene_at_rest

        if units is not None:
            options.draw("production", units.plot)
        first = scene_at_rest(scene.phases[0].of(scene) if scene.phases else scene)
        record, _ = question.verdict
        return {"scene": scene, "hung": first, "record": record, "production": units}

    return show
