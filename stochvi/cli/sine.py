"""Commands of motions under a sine, and of sweeps. Chapters: regimes, basins, bifurcations and life
times; a scene over ranges of its keys."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import Any

from stochvi.cli.declared import Question, command, declare
from stochvi.cli.options import (
    Common,
    Varied,
    fail_unless_gaussian,
    judged_phase,
)
from stochvi.cli.program import FAILED, executor_at, stop
from stochvi.notices import InputWarning
from stochvi.statistics.hardness import HARDNESS


@declare("methods.periodic:harmonic_response", "budget, json, out, quiet")
def sine(question: Question) -> None:
    """Find all periodic motions under a sine, and jumps.

    Periodic regimes, stable or not, are calculated exactly over frequency or any key of the scene,
    with the values at which a slow sweep jumps. Without --from and --to they are calculated at the
    frequency of the scene. Noise of the scene is left out.

    See also: sine basins, sine bifurcation, sine lifetimes, sine perturbations.

    {range}
    --vary KEY=FIRST:LAST:NUMBER  Instead of frequencies: values of a key of the scene, as
        impact_pair.0.clearance=3mm:6mm:100.
    --sweep up|down|both  Also simulate a slow sweep from value to value.
    --form exact|motion|force = exact  Exact regimes, or harmonic linearisation of motion or force,
        with its error.
    --coordinate NAME  Coordinate or point whose displacement is shown [the first].
    --impacts as most_impacts (int) = 3  Largest number of impacts per period of regimes that are
        looked for.
    """
    question.asked |= Varied.of(question.asked).asked(question.scene)


@declare("methods.periodic:basins", "threads, kept budget, json, out, quiet", progress="basins")
def basins(question: Question) -> None:
    """Find which motion each start ends in, under a sine.

    The starts lie in a plane of two displacements or velocities, all others being 0. Each start is
    followed to the regime in which it ends, and the plane is coloured by regime. Noise of the scene
    is left out.

    --start NAME=FIRST:LAST:NUMBER as plane (many)  Starts along one axis of the map, as
        displacement.x=-1mm:1mm:300; give it for both axes.
    --phase as phase_deg (float) = 0.0  Phase of the force at the start, degrees.
    --periods (int) = 300  Periods for which each start is followed.
    {keeping}
    """
    question.asked["plane"] = dict(map(_numbers_of, question.asked["plane"])) or None


@declare("methods.periodic:bifurcation", "budget, json, out, quiet")
def bifurcation(question: Question) -> None:
    """Sweep a key slowly: period doublings and chaos.

    They are simulated from impact to impact, with the Lyapunov exponent at each value. Noise of the
    scene is left out.

    {range}
    --vary KEY=FIRST:LAST:NUMBER  Instead of frequencies: values of a key of the scene, as
        excitation.0.amplitude=1:3:400.
    --sweep up|down|both = both  Direction of the sweep; each motion starts from that at the value
        before.
    --settling (int) = 300  Periods that pass at each value before its motion is watched.
    --watched (int) = 128  Periods for which the motion is watched.
    --start NAME=VALUE as starts (many)  State before the first value, as velocity.x=0.2 [at rest].
    """
    asked = question.asked
    starts = asked.pop("starts")
    over = Varied.of(asked).asked(question.scene)
    if not over:
        raise ValueError("--from and --to, or --vary, must say what is varied, got neither")
    begun = {name: values[0] for name, values in map(_numbers_of, starts)}
    question.asked |= {**over, "start": begun}


@declare(
    "statistics.lifetimes:lifetimes", "seed, threads, kept budget, json, out, quiet",
    progress="lifetimes",
)  # fmt: skip
def lifetimes(question: Question) -> None:
    """Find how long each motion lasts in noise.

    Paths start in each of the regimes that coexist without noise. They are simulated with the noise
    of the scene until enough of them have left.

    --regime NAME as regimes (many)  Regime whose life time is wanted, as "no impacts" [all].
    --rel-error (float) = 0.1  Relative standard error of the mean life times.
    {keeping}
    """
    question.asked["regimes"] = question.asked["regimes"] or None


def _numbers_of(text: str) -> tuple[str, list[float]]:
    """Name and values of a displacement (m) or velocity (m/s), from "NAME=FIRST:LAST:NUMBER" or
    "NAME=VALUE,VALUE"."""
    from stochvi.mathematics.units import measured_in
    from stochvi.results.errors import spaced

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


# ------------------------------------------------------------------------------
# The command that answers for a scene over ranges of its keys.
# ------------------------------------------------------------------------------


SIZE, RISK = {"rate", "probability", "exceedance"}, {"mission", *HARDNESS}

OPTIONS = {
    "simulate": {"rel_error", "paths", "duration", "dask", "budget"},
    "size": SIZE | RISK | {"rel_error", "dask", "budget"},
    "reliability": RISK | {"rel_error", "dask", "budget"},
}
"""Options of the methods; the others have none. All take the common ones: --threads changes nothing
where nothing is sampled."""


def _check_options(method: str, given: Mapping[str, Any], phases: bool) -> None:
    """ValueError if an option is for another method, or one that a method needs is missing; a scene
    with phases has its own duration."""
    for name in sorted(given.keys() - OPTIONS.get(method, set())):
        methods = [each for each, known in OPTIONS.items() if name in known]
        alone = " alone" if len(methods) == 1 else ""
        option = f"--{name.replace('_', '-')}"
        raise ValueError(f"{option} is for --method {' or '.join(methods)}{alone}")
    if method == "reliability" and "mission" not in given and not phases:
        raise ValueError("--method reliability needs --mission, as 3600 (s) or 10h")
    targets = ("probability", "rate", *HARDNESS)
    limits = given.keys() & {*targets}
    if method == "size" and len(limits) != 1:
        *first, last = (f"--{name.replace('_', '-')}" for name in targets)
        raise ValueError(
            f"--method size needs exactly one of {', '.join(first)} and {last}, got "
            f"{', '.join(sorted(limits)) or 'none'}"
        )


@command("seed, threads, out, quiet")
def sweep(
    options: Common, scene: str, vary: tuple[str, ...], method: str, random_numbers: str,
    dask: str | None, **asked: Any,
) -> None:  # fmt: skip
    """Answer a scene over ranges of its keys.

    Each finished row is kept in --out, and the same command continues a sweep that was stopped.
    Besides sweep.csv it writes sweep.parquet if pyarrow is installed (pip install pyarrow).

    --vary KEY=FIRST:LAST:NUMBER (needed, many)  For example impact_pair.0.law.coefficient=0.3:1:8;
        also ...:log, or KEY=VALUE,VALUE. A value may have a unit:
        impact_pair.0.clearance=3mm:6mm:4. Several --vary: all combinations.
    --method simulate|exact|closure|fokker-planck|average|size|reliability|replay = simulate  Method
        that is applied to each scene.
    --probability P (probability)  size: probability of any impact, 0.01 or 1%.
    --rate F (rate)  size: impacts on all stops, 2 (1/s), 0.1/h.
    {limits}
    --exceedance P (probability)  size: probability of exceeding the limit [0.01].
    --mission TIME (time)  size [1h], reliability: 3600 (s), 10h.
    --rel-error (float)  Relative standard error: of means [0.01], of the risk [0.05].
    --paths (int)  Number of paths, instead of a relative error.
    --duration (time)  Length of each path after its burn-in, with --paths.
    --random-numbers common|independent = common  The same in each row, so that rows differ by their
        scenes only, or other ones.
    --dask ADDRESS  Simulate on a Dask cluster.
    --budget TIME (time)  Time for each row: N rows take up to N times this [60; none with --paths].
    """
    from stochvi.methods.replay.recorded_motion import doubts_of
    from stochvi.scenes.scene import load_scene
    from stochvi.sweeps import once, values_of
    from stochvi.sweeps import sweep as solve
    from stochvi.views.datasets import sweep_told, unseen, write_sweep, write_sweep_table
    from stochvi.views.isolator_tables import record_told

    given = {"dask": dask} | asked
    given = {name: value for name, value in given.items() if value is not None}
    loaded = load_scene(scene)
    document = loaded.document(as_written=True)
    ranges = dict(once([values_of(text, document) for text in vary]))
    _check_options(method, given, bool(loaded.phases))
    given.pop("dask", None)
    if "budget" in given:
        rows = math.prod(len(values) for values in ranges.values())
        given["budget"] = (options.until(rows * given["budget"]).rest or 0.0) / rows
    elif "paths" in given:
        given["budget"] = None
    try:
        with (
            executor_at(dask) as executor,
            options.progress("sweep") as report,
        ):
            table = solve(
                loaded, ranges, method=method, out=options.out, executor=executor, progress=report,
                common=random_numbers == "common", seed=options.seed, threads=options.threads,
                **given,
            )  # fmt: skip
    except KeyboardInterrupt as reason:
        so_far = getattr(reason, "partial", None)
        if options.out is not None and so_far is not None and len(so_far):
            write_sweep_table(so_far, list(ranges), options.out)
        kept = (
            f"rows are kept in {options.out}: the same command goes on"
            if options.out
            else "nothing was kept"
        )
        stop(f"interrupted by Ctrl-C; {kept}", FAILED)
    # of the scene as it stands; a row may change what its record moves
    record, judged_in = (None, "") if method == "replay" else judged_phase(loaded)
    options.say(record_told(record, judged_in), sweep_told(table, list(ranges), method))
    for doubt in doubts_of(loaded) if method == "replay" else ():
        warnings.warn(doubt, InputWarning, stacklevel=2)
    if options.out is not None:
        write_sweep(table, list(ranges), options.out, loaded.title)
    fail_unless_gaussian(record)
    if (noted := table[table["note"] != ""]).shape[0]:
        few = int((unseen(table) & (table["note"] == "")).sum())
        more = f" (in {few} more nothing was seen, and only a limit is given)" if few else ""
        stop(f"{len(noted)} of {len(table)} rows fell short{more}: {noted['note'].iloc[0]}", FAILED)
