"""Monte Carlo of a scene: `simulate`, the prediction of its cost, and single recorded paths."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Unpack

import numpy as np

from stochvi.methods.monte_carlo.choose_plan import make_plan, plan_several
from stochvi.methods.monte_carlo.plan import Plan
from stochvi.methods.monte_carlo.prices import seconds_of_first_paths
from stochvi.methods.monte_carlo.quantities import Key
from stochvi.methods.monte_carlo.response_sampler import PathsOf
from stochvi.methods.monte_carlo.simulation import (
    FEWEST_PATHS,
    Simulation,
    relative_standard_errors,
    run_until_accurate,
)
from stochvi.methods.monte_carlo.statistic import Statistic
from stochvi.model.calculations import calculation
from stochvi.model.model import Model, model_of
from stochvi.results.deadline import Deadline, Overdue
from stochvi.results.errors import Interrupted, NotConverged
from stochvi.results.response import Response
from stochvi.results.sizes import MOST_RECORDED, check_size
from stochvi.sampling.blocks import FEWEST_AT_ONCE
from stochvi.sampling.options import SamplingOptions, check_options
from stochvi.sampling.run import Run, sampled
from stochvi.sampling.workers import WorkersLost, pool_of
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd


PILOT_SECONDS, LEAST_PILOT_SECONDS = 1.5, 0.2
"""Seconds that the pilot run of `prospect` takes at most, without compilation, and seconds that it
gets where no time is left."""

LARGEST_PRICE_IN_PILOT = 0.5
"""Share of the seconds of a pilot that its first two paths may take."""

FEWEST_IN_PILOT = 16
"""Fewest paths from which the pilot predicts a price: the price goes as the square of errors, which
16 paths give to 18 %, so that it is good to 40 %."""


@calculation
@sampled
def simulate(
    scene: Scene,
    *,
    speed_threshold: float | None = None,
    slow_impacts: bool = False,
    statistics: Mapping[str, Statistic] | None = None,
    **options: Unpack[SamplingOptions],
) -> Response:
    """Stationary response by Monte Carlo, with standard errors from independent paths.

    White noise is stepped by kick-flow-kick (impacts inside the step, no bias with elastic
    stops); for a tabulated density the response without stops is synthesised and the impacts are
    added. The bias of a finite step is measured by running some of the paths at twice the step,
    with the same noise: |difference| / (2^order - 1). The order is 2, less where slow impacts on
    inelastic stops in white noise are missed: *The bias of a step* in the manual has them. Where it
    is not known the bias is None.

    Parameters
    ----------
    scene
        The scene.
    speed_threshold
        Impacts slower than this (m/s) are left out of the rates, never out of F1 and F2. By
        default 0, or 5 % of the rms velocity where a stop loses energy.
    slow_impacts
        Refine the steps near a stop until impacts at the threshold are resolved, for the rates
        under white noise at restitutions below 0.5. With several coordinates all steps are a
        sixteenth of the usual ones. Ten or more times the cost; without it the
        bias of those rates is unknown (None). F1 and the moments need it only for small errors,
        and get it then by themselves.
    statistics
        Functions of the motion by name, see `Statistic`, of which the answer gives the means over
        time in `statistics`. `rel_error` does not govern them: their errors are stated.
    **options
        `SamplingOptions`: `rel_error` (0.01 if `paths` is not given either) is that of mean
        squares, rate, F1 and F2, and of means relative to the standard deviation; or `paths` of
        `duration` seconds each; `seed`, `threads`, `executor`, `budget`, `progress`,
        `checkpoint`, `resume`.

    Returns
    -------
    Response
        Moments, rates and their errors, SI units.

    Raises
    ------
    NotApplicable
        With every condition that the scene does not meet.
    NotConverged
        Carries the response so far; also if the executor loses its workers.
    CheckpointError
        If `resume` is damaged, or of another scene, seed, version or processor; or `checkpoint`
        cannot be written, or is a file of something else.
    Interrupted
        A KeyboardInterrupt that carries the response so far.

    See Also
    --------
    stochvi.check : Whether all methods agree.
    stochvi.cost : Error against time.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> deviation = simulate(scene, rel_error=0.01).coordinates["x"]["displacement_std"]
    >>> abs(deviation.value - 0.53956) < 4.5 * deviation.standard_error
    True
    """
    check_threshold(speed_threshold)
    run = Run.of(options)
    try:
        plan = make_plan(
            model_of(scene), speed_threshold, run.duration, slow_impacts,
            deadline=run.deadline, statistics=statistics,
        )  # fmt: skip
        run.begin()
        simulation = Simulation(scene, plan, run, compiled(plan), run.seed)
    except KeyboardInterrupt as reason:
        where = "before any path was simulated"
        raise run.deadline.ended_by_exception(reason, where) from None
    try:
        if run.paths is None:
            run_until_accurate(simulation, 0.01 if run.rel_error is None else run.rel_error)
        elif not simulation.add_paths(run.paths):
            raise run.deadline.fell_short(
                f"after {simulation.fine.count} of {run.paths} paths{simulation.cut()}",
                "raise budget",
                _so_far(simulation, "not all paths were simulated"),
            )
    except WorkersLost as error:
        lost = _so_far(simulation, "not all paths were simulated, for want of workers")
        raise NotConverged(f"{error}, after {simulation.fine.count} paths", lost) from error
    except (NotConverged, Interrupted):
        raise
    except KeyboardInterrupt as reason:  # a second Ctrl-C, or one that a program raises
        by_clock = isinstance(reason, Overdue)
        why = "not all" if by_clock else "interrupted before all"
        answer = _so_far(simulation, f"{why} paths were simulated", not by_clock)
        raise run.deadline.ended_by_exception(reason, "on the way", answer) from None
    return simulation.response()


def _so_far(simulation: Simulation, warning: str, interrupted: bool = False) -> Response | None:
    """What the paths say that there are, if they say anything."""
    latest = simulation.run.latest
    if isinstance(latest, PathsOf):
        simulation.sample = latest
    if simulation.fine.count < 2:
        return None
    count = simulation.fine.count
    return simulation.response((f"{warning}: these are the first {count}",), interrupted)


@calculation
def record_path(
    scene: Scene,
    *,
    duration: float,
    seed: int = 0,
    path: int = 0,
    step: float | None = None,
    budget: float | None = None,
) -> pd.DataFrame:
    """One path, sample by sample: time (s), displacement, velocity and impact_speed (SI).

    `impact_speed` is the incident speed of an impact within the step that ends at `time`,
    positive at the upper stop, negative at the lower, 0 for none (several: their sum). The path
    is not stationary at its start: it begins at a guess of the stationary distribution. With
    several coordinates each column names its own, as in "displacement of absorber".

    Parameters
    ----------
    scene
        The scene.
    duration
        Seconds of each path after burn-in.
    seed
        Seed of the random numbers: the same seed gives the same digits.
    path
        Number of the path.
    step
        Time between two samples, s.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    DataFrame
        A row for each combination, or for each sample.

    See Also
    --------
    stochvi.history : Displacement, base, forces and impacts, as a table.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> list(record_path(scene, duration=10.0))
    ['time', 'displacement', 'velocity', 'impact_speed']
    """
    import pandas as pd

    check_options({"duration": duration, "seed": seed})
    if step is not None and not 0.0 < step < math.inf:
        raise ValueError(f"step must be a positive number of seconds, got {step}")
    if not 0 <= path < 2**40:
        raise ValueError(f"path must be in [0, 2^40), got {path}")
    plan = make_plan(model_of(scene), None, duration)
    _check_record(plan, plan.step if step is None else step, 1)
    if step is not None:
        plan = plan.with_step(step)
    columns = plan.record(seed, path)
    samples = len(next(iter(columns.values())))
    return pd.DataFrame({"time": plan.step * np.arange(1, samples + 1), **columns})


def _check_record(plan: Plan, step: float, paths: int) -> None:
    """Raise ValueError where the records of so many paths would not fit into the memory."""
    if paths < 1:
        raise ValueError(f"paths must be at least 1, got {paths}")
    samples = min((plan.burn_in + plan.duration) / step, 2.0 * MOST_RECORDED)
    each = plan.record_size(math.ceil(samples))
    check_size(
        "numbers of all records", paths * each, MOST_RECORDED, "give a shorter duration or fewer "
        "paths, or a larger step"
    )  # fmt: skip


@calculation
def record_paths(
    scene: Scene,
    *,
    duration: float,
    paths: int,
    seed: int = 0,
    first_path: int = 0,
    budget: float | None = None,
) -> tuple[float, list[pd.DataFrame]]:
    """Several paths of a scene of several coordinates at once, as `record_path` gives one.

    Returns the time, s, after which they have settled, and the records, `duration` longer.

    Parameters
    ----------
    scene
        The scene.
    duration
        Seconds of each path after burn-in.
    paths
        Number of paths.
    seed
        Seed of the random numbers: the same seed gives the same digits.
    first_path
        Number of the first path.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    tuple[float, list[pd.DataFrame]]
        Burn-in, s, and a table for each path.

    See Also
    --------
    stochvi.history : One path, as a table.

    Examples
    --------
    >>> import stochvi
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("absorber-in-a-box"))
    >>> burn_in, tables = record_paths(scene, paths=2, duration=1.0)
    >>> [bool(each["time"].iloc[-1] >= burn_in) for each in tables]
    [True, True]
    """
    import pandas as pd

    check_options({"duration": duration, "seed": seed})
    model = model_of(scene)
    settling = plan_several(model, None, duration).burn_in
    plan = plan_several(model, None, settling + duration)
    _check_record(plan, plan.step, paths)
    record = np.zeros((plan.steps, paths, plan.record_width))
    plan.averages(seed, first_path, paths, record)
    time = {"time": plan.step * np.arange(1, plan.steps + 1)}
    return settling, [pd.DataFrame(time | plan.columns(record[:, [path]])) for path in range(paths)]


@dataclass(frozen=True, kw_only=True)
class Prospect:
    """What a simulation would be like: its states and steps, and what they cost here and now.

    `nanoseconds_per_step` is wall time per step of one path, all threads at work; `seconds` maps
    relative errors to predicted wall time, None where no impact was seen to predict by.

    See Also
    --------
    stochvi.methods.monte_carlo.prospect : The calculation.
    """

    method: str
    states: int
    step: float
    burn_in: float
    duration: float
    steps_per_path: int
    nanoseconds_per_step: float
    seconds: dict[float, float | None]
    governed_by: str


@calculation
def prospect(
    scene: Scene, *, threads: int | None = None, seed: int = 0, budget: float | None = None
) -> Prospect:
    """Predict the cost of `simulate` from a pilot run of one block or two.

    Standard errors fall with the square root of the scene time, so seconds(rel_error) =
    seconds(pilot) (pilot error / rel_error)^2, from the quantity that converges last.

    Parameters
    ----------
    scene
        The scene.
    threads
        Number of threads; by default all cores.
    seed
        Seed of the random numbers: the same seed gives the same digits.
    budget
        Seconds that the pilot may take; `PILOT_SECONDS` at most.

    Returns
    -------
    Prospect
        States, steps and predicted times.

    See Also
    --------
    stochvi.simulate : The simulation itself.
    stochvi.cost : Error against time, measured.

    Examples
    --------
    >>> import stochvi
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("oscillator-lossy"))
    >>> expected = prospect(scene, threads=1)
    >>> expected.states
    2
    """
    deadline, model = Deadline.after(budget), model_of(scene)
    plan = make_plan(model)
    compile_time = compiled(plan)
    seconds = max(min(PILOT_SECONDS, deadline.left), LEAST_PILOT_SECONDS)
    price = seconds_of_first_paths(plan, seed, Deadline.after(seconds))
    with pool_of(None, threads) as pool:
        run = Run(pool, Deadline.after(seconds))
        simulation = Simulation(scene, plan, run, compile_time, seed)
        # a pilot of two or three paths would say nothing of errors
        with suppress(NotConverged):
            if price < LARGEST_PRICE_IN_PILOT * seconds:
                simulation.add_paths(max(2 * plan.block, FEWEST_PATHS))
        elapsed = simulation.seconds
    step_seconds = (
        elapsed / simulation.steps
        if simulation.steps
        else price / (FEWEST_AT_ONCE * plan.steps_per_path)
    )
    relative = (
        relative_standard_errors(simulation) if simulation.fine.count >= FEWEST_IN_PILOT else {}
    )
    slowest = max(relative, key=lambda key: relative[key], default=None)
    unseen = any((pair.name, "impact_speed_rate") not in relative for pair in model.pairs)
    if slowest is None:
        governed_by = f"not even {FEWEST_IN_PILOT} paths were simulated in {seconds:.2g} s"
    else:
        governed_by = "no impact was seen" if unseen else _spoken(model, slowest)
    known = slowest is not None and not unseen
    return Prospect(
        method=plan.method,
        states=plan.states,
        step=plan.step,
        burn_in=plan.burn_in,
        duration=plan.duration,
        steps_per_path=plan.steps_per_path,
        nanoseconds_per_step=1e9 * step_seconds,
        seconds={
            target: elapsed * (relative[slowest] / target) ** 2 if known and slowest else None
            for target in (0.01, 0.001)
        },
        governed_by=governed_by,
    )


def _spoken(model: Model, key: Key) -> str:
    """Name of a quantity in words, with its coordinate or pair where the scene has several."""
    owner, name = key
    return name if model.single else f"{name} of {owner}"


def check_threshold(speed_threshold: float | None) -> None:
    """Raise ValueError for a speed threshold that is none."""
    if speed_threshold is not None and not 0.0 <= speed_threshold < math.inf:
        raise ValueError(f"speed_threshold must be at least 0, got {speed_threshold}")


def compile_kernels(scene: Scene) -> None:
    """Compile what a simulation of the scene runs, so that no budget pays for it."""
    compiled(make_plan(model_of(scene)))


def compiled(plan: Plan) -> float:
    """Run the kernels once on very short paths; returns the seconds this took (machine code is
    cached)."""
    start = time.perf_counter()
    plan.shortest().averages(0, 0, 2)
    return time.perf_counter() - start
